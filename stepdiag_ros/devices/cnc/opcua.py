"""Controllers and PLCs with an OPC UA server, by a mapping of nodes.

A move is an order with an identity: target, feed and axes are written first, and the identity,
which starts it, only when they have arrived; or a method is called with all of them. The PLC says
which identity it has taken, and which it has carried out. An identity is used once, also after a
lost connection, so no order is carried out twice. The PLC brakes when the driver stops counting
its watchdog: the count goes on only as long as ``poll`` is called.

Positions come by subscription, each with the time of its sampling. A server reports only changes,
so everything is read ten times a second besides: that shows that what has not changed stands still,
and that the server is alive.

Source: OPC UA (IEC 62541) Part 4; what the nodes must do is our own agreement with the PLC
(``docs/controllers.md``).
"""

import time
from collections.abc import Callable, Mapping
from enum import Enum
from importlib.util import find_spec
from math import isfinite
from typing import Any

from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.cnc import (
    UNKNOWN_POINT,
    CncEvent,
    CncState,
    MoveRefused,
    Point,
    PositionSample,
    StateChange,
    Traits,
    not_ready,
    still_moves,
)
from stepdiag_ros.devices.cnc.move_check import check_target, far_axes
from stepdiag_ros.devices.cnc.opcua_session import Finished, OpcUaSession, Value
from stepdiag_ros.devices.cnc.opcua_settings import MOTORS, POSITIONS, TARGETS, OpcUaSettings
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.refusal import Lost, Refusal, Silent
from stepdiag_ros.metrology.units import NANOSECONDS

TAKING = 2 * NANOSECONDS
"""ns in which the PLC takes an order."""
ENDING = NANOSECONDS
"""ns in which the axes are at the target when the PLC has carried out an order."""
CLOCK_MEMORY = 60 * NANOSECONDS
"""ns for which a small delay of the transport is remembered."""
LAST_IDENTITY = 2**31 - 1
FAULTY = "the PLC has a fault"


class _Doing(Enum):
    """What the driver is about, in words."""

    CONNECTING = "is being connected"
    NOTHING = "does nothing"
    MOVING = "moves"
    STOPPING = "brakes"
    RESETTING = "is being reset"


class OpcUaCnc:
    """A PLC with an OPC UA server (protocol: ``CncDevice``).

    It is FAULT, and refuses moves, until it is connected and has reported the positions of the
    axes.

    Args:
        machine: travel, feed limit, window and hold time.
        settings: of the driver.
        start: now, ns.
    """

    def __init__(self, machine: Machine, settings: OpcUaSettings, start: int) -> None:
        self._machine, self._settings = machine, settings
        self._now = self._told = start
        self._session = OpcUaSession(settings)
        self._values: dict[str, Any] = {}
        self._sources: dict[str, int | None] = {}
        self._clock = SourceClock()
        self._state, self._reason = CncState.FAULT, ""
        self._doing, self._since = _Doing.CONNECTING, start
        self._events: list[CncEvent] = []
        self._position: Point = UNKNOWN_POINT
        self._asked = start
        self._read_due = self._count_due = start
        self._reading = self._counting = False
        # Not the number at which the last session left off: the PLC sees changes.
        self._count = start // 1_000_000 % 30_000
        self._identity = 0
        self._target: Point = UNKNOWN_POINT
        self._sent = False
        self._within: int | None = None
        self._rest: tuple[int, Point] = (start, UNKNOWN_POINT)
        self._why = ""
        self._change(start, CncState.FAULT, f"the controller {_Doing.CONNECTING.value}")

    @property
    def state(self) -> CncState:
        """State at the last time passed to the device."""
        return self._state

    @property
    def soft_limits(self) -> tuple[Point, Point]:
        """Limits of the machine file, m; the PLC has its own besides."""
        return self._machine.travel_low_m, self._machine.travel_high_m

    @property
    def traits(self) -> Traits:
        """What the device file says of the controller."""
        settings = self._settings
        step = settings.resolution
        return Traits(
            resolution=(step, step, step),
            dead_man=settings.watchdog_limit,
            measured=settings.measured,
        )

    def start_move(self, time_ns: int, target: Point, feed: float, axes: str) -> None:
        """Begin a straight move of the named axes (see ``CncDevice.start_move``)."""
        now = self._tick(time_ns)
        if self._doing is _Doing.CONNECTING:
            raise MoveRefused(f"the controller {self._doing.value}")
        if self._state is not CncState.READY or self._doing is not _Doing.NOTHING:
            raise not_ready(self._state)
        check_target(
            self._position,
            target,
            feed,
            axes,
            limits=self.soft_limits,
            feed_limit=self._machine.feed_limit_m_per_s,
            near=self._near,
        )
        self._target, self._within = target, None
        # A move of no length is not an order: nothing could be carried out.
        self._sent = bool(axes)
        if axes:
            self._order(target, feed, axes)
        self._begin(_Doing.MOVING)
        self._change(now, CncState.MOVING, "")

    def stop(self, time_ns: int, reason: str) -> None:
        """Brake to rest at once; STOPPED, with the reason, is reported when the axes stand."""
        now = self._tick(time_ns)
        if self._doing is _Doing.CONNECTING or self._state is CncState.STOPPED:
            return
        self._session.halt()
        if self._state is CncState.READY:
            self._change(now, CncState.STOPPED, reason)
        elif self._doing is _Doing.MOVING:
            self._why = reason
            self._rest = (now, UNKNOWN_POINT)
            self._begin(_Doing.STOPPING)

    def reset(self, time_ns: int) -> None:
        """Become READY again after a stop or a fault whose cause is gone.

        The PLC is asked to clear its stop and its fault, which is refused for the moment: it is to
        be asked for again.

        Raises:
            MoveRefused: the axes still move, or the PLC is not ready; the text says why.
        """
        now = self._tick(time_ns)
        if self._state is CncState.READY:
            return
        if self._doing is _Doing.CONNECTING:
            raise MoveRefused(f"the controller {self._doing.value}: reset again in a moment")
        if self._state is CncState.MOVING or self._values["busy"]:
            raise still_moves()
        if self._doing is not _Doing.RESETTING:
            self._session.resume()
            self._begin(_Doing.RESETTING)
            raise MoveRefused("the controller is being reset: reset again in a moment")
        if now - self._since < 0.2 * NANOSECONDS or self._reset_pending:
            raise MoveRefused("the controller is being reset: reset again in a moment")
        self._session.write("reset end", [("reset", False)])
        self._begin(_Doing.NOTHING)
        if trouble := self._trouble():
            raise MoveRefused(trouble)
        self._change(now, CncState.READY, "")

    def poll(self, time_ns: int) -> list[CncEvent]:
        """Return what has happened since the last poll, in order of time."""
        now = self._tick(time_ns)
        self._take(self._session.news(), now, time.monotonic_ns())
        if self._session.open:
            self._ask(now)
        self._judge(now)
        events, self._events = self._events, []
        return events

    def close(self) -> None:
        """Let the controller go; its watchdog brakes what still moves."""
        self._session.close()

    # What it says ---------------------------------------------------------------------------------

    def _take(self, news: list[Value | Finished], now: int, moment: int) -> None:
        """Take values in the order of their times, and what has become of requests."""
        timed = []
        for one in news:
            if isinstance(one, Finished):
                self._on_finished(one)
            else:
                heard = now - (moment - one.heard)
                if one.asked is None:
                    timed.append((self._clock.local(one.source, heard), one))
                else:
                    timed.append((heard - (one.heard - one.asked) // 2, one))
        timed.sort(key=lambda entry: entry[0])
        for number, (instant, one) in enumerate(timed):
            known = self._sources.get(one.name)
            # A reading overtakes the publication of an older change.
            if known is None or one.source is None or one.source >= known:
                self._values[one.name] = one.value
                self._sources[one.name] = one.source
            last = number + 1 == len(timed) or timed[number + 1][0] != instant
            # Axes that were sampled together are one position.
            if last:
                self._locate(min(instant, now))

    def _on_finished(self, done: Finished) -> None:
        if done.request == "read":
            self._reading = False
        elif done.request == "count":
            self._counting = False
        if not done.failure:
            if done.request == "order" and self._settings.arguments and done.result:
                self._fault(f"the PLC refused the order: {self._fault_words(done.result)}")
            return
        if done.request == "order":
            raise TimeoutError(
                f"a command could not be sent: {done.failure}; whether the PLC executes it is"
                " unknown"
            )
        raise Lost(f"the PLC cannot be used ({done.request}): {done.failure}", fault="failed")

    def _locate(self, instant: int) -> None:
        """Take the position out of the values."""
        if not all(name in self._values for name in self._settings.watched):
            return
        self._position = self._point(POSITIONS)
        if not all(map(isfinite, self._position)):
            raise ValueError(f"the PLC reports the position {self._position}, which is not valid")
        motors = self._point(MOTORS) if self._settings.has_motors else None
        self._told = max(self._told, instant)
        self._events.append(PositionSample(self._told, self._position, motors))
        if self._doing is _Doing.CONNECTING:
            self._on_first()
        elif self._doing is _Doing.MOVING:
            self._watch_move(self._told)
        elif self._doing is _Doing.STOPPING:
            self._watch_stop(self._told)
        elif self._state is CncState.READY:
            self._watch_rest()
        elif self._reason.startswith(FAULTY) and self._trouble().startswith(FAULTY):
            # The words of a fault may come after its number.
            self._fault(self._trouble())

    def _point(self, names: tuple[str, ...]) -> Point:
        try:
            x, y, z = (float(self._values[name]) * self._settings.unit for name in names)
        except (TypeError, ValueError):
            shown = ", ".join(f"{name} {self._values[name]!r}" for name in names)
            raise ValueError(f"the PLC reports values that are not numbers: {shown}") from None
        return x, y, z

    def _on_first(self) -> None:
        self._begin(_Doing.NOTHING)
        # An identity that the PLC knows already would not be carried out.
        used = ("acknowledged", "done", "identity")
        self._identity = max(int(self._values.get(name, 0)) for name in used)
        if self._values["busy"]:
            self._fault("the machine is moved by the command of somebody else")
        elif trouble := self._trouble():
            self._fault(trouble)
        else:
            self._change(self._told, CncState.READY, "")

    def _trouble(self) -> str:
        """Say why no order would be carried out; empty if it would."""
        fault = self._values.get("fault", 0)
        if fault:
            return f"{FAULTY}: {self._fault_words(fault)}"
        if not self._values.get("ready", True):
            return "the PLC is not ready: is it in automatic mode, with drives on?"
        if self._values.get("stopped", False):
            return "the PLC is stopped"
        return ""

    def _fault_words(self, fault: Any) -> str:
        text = str(self._values.get("fault_text", "")).strip()
        known = "" if isinstance(fault, bool) else self._settings.fault_words.get(int(fault), "")
        number = "" if isinstance(fault, bool) else f"number {int(fault)}"
        return ": ".join(filter(None, (number, known, text))) or "it does not say which"

    # Watching -------------------------------------------------------------------------------------

    def _watch_rest(self) -> None:
        if self._values["busy"]:
            self._fault("the machine is moved by the command of somebody else")
        elif trouble := self._trouble():
            if self._values.get("stopped", False) and not self._values.get("fault", 0):
                self._change(self._told, CncState.STOPPED, trouble)
            else:
                self._fault(trouble)

    def _watch_move(self, instant: int) -> None:
        trouble = self._trouble()
        if self._values.get("stopped", False) and not self._values.get("fault", 0):
            self._why = "the PLC has stopped the machine"
            self._rest = (instant, UNKNOWN_POINT)
            self._begin(_Doing.STOPPING)
        elif trouble:
            self._fault(trouble)
        elif self._sent and (int(self._values["done"]) != self._identity or self._values["busy"]):
            self._within = None
        elif far_axes(self._position, self._target, self._near):
            self._within = None
            if self._sent and self._now - self._since > TAKING + ENDING and self._standing(instant):
                where = ", ".join(f"{value * 1e3:.4f}" for value in self._position)
                self._fault(f"the PLC has ended the move at {where} mm, away from the target")
        elif self._within is None:
            self._within = instant
        elif instant - self._within >= self._machine.position_hold_s * NANOSECONDS:
            self._begin(_Doing.NOTHING)
            self._change(instant, CncState.READY, "")

    def _standing(self, instant: int) -> bool:
        """Say whether the axes have stood for the hold time, and as long as ten readings."""
        since, place = self._rest
        if far_axes(place, self._position, self._near):
            self._rest = (instant, self._position)
            return False
        hold = max(self._machine.position_hold_s, 2.0 * self._settings.confirm)
        return instant - since >= hold * NANOSECONDS

    def _watch_stop(self, instant: int) -> None:
        standing = self._standing(instant)
        if standing and not self._values["busy"]:
            self._begin(_Doing.NOTHING)
            self._change(instant, CncState.STOPPED, self._why)

    def _judge(self, now: int) -> None:
        """Notice what does not happen in time."""
        if self._doing is _Doing.CONNECTING:
            return
        # Counted from the question, so that a pause of whoever polls is not a silence of the PLC.
        if self._reading and now - self._asked > self._settings.silence * NANOSECONDS:
            raise Silent(
                f"the PLC has not answered for {self._settings.silence:g} s", fault="silent"
            )
        waited = now - self._since
        if self._doing is _Doing.MOVING and self._sent and waited > TAKING:
            if int(self._values["acknowledged"]) != self._identity:
                raise Silent(
                    f"the PLC has not taken order {self._identity}: whether the PLC executes it"
                    " is unknown",
                    fault="undetermined",
                )
        elif self._doing is _Doing.STOPPING and waited > self._settings.stop_limit * NANOSECONDS:
            raise TimeoutError(
                f"the axes do not stand {self._settings.stop_limit:g} s after the stop: use the"
                " emergency stop"
            )

    # Doing ----------------------------------------------------------------------------------------

    @property
    def _near(self) -> tuple[float, float, float]:
        near = self._machine.position_window_m + self._settings.resolution
        return near, near, near

    @property
    def _reset_pending(self) -> bool:
        return bool(self._values.get("stopped", False) or self._values.get("fault", 0)) and (
            self._now - self._since < NANOSECONDS
        )

    def _order(self, target: Point, feed: float, axes: str) -> None:
        settings = self._settings
        self._identity = self._identity % LAST_IDENTITY + 1
        places = [value / settings.unit for value in target]
        mask = sum(1 << number for number, axis in enumerate(AXES) if axis in axes)
        if settings.arguments:
            given = dict(zip(AXES, places, strict=True)) | {
                "identity": self._identity,
                "feed": feed / settings.feed_unit,
                "axes": mask,
            }
            self._session.call([given[name] for name in settings.arguments])
            return
        data: list[tuple[str, Any]] = list(zip(TARGETS, places, strict=True))
        data.append(("feed", feed / settings.feed_unit))
        if "axes" in settings.nodes:
            data.append(("axes", mask))
        self._session.order(data, [("identity", self._identity)])

    def _ask(self, now: int) -> None:
        """Read everything, and count the watchdog, when it is time to."""
        settings = self._settings
        if not self._reading and now >= self._read_due:
            self._session.read("read", settings.watched)
            self._reading, self._asked = True, now
            self._read_due = now + round(settings.confirm * NANOSECONDS)
        if "watchdog" in settings.nodes and not self._counting and now >= self._count_due:
            self._count = self._count % 30_000 + 1
            self._session.count(self._count)
            self._counting = True
            self._count_due = now + round(settings.watchdog_period * NANOSECONDS)

    def _fault(self, reason: str) -> None:
        """Be faulty; what moves is braked."""
        if self._state is CncState.MOVING:
            self._session.halt()
        self._begin(_Doing.NOTHING)
        if self._state is not CncState.FAULT or reason != self._reason:
            self._change(self._now, CncState.FAULT, reason)

    def _begin(self, doing: _Doing) -> None:
        self._doing, self._since = doing, self._now

    def _tick(self, time_ns: int) -> int:
        self._now = max(time_ns, self._now)
        return self._now

    def _change(self, instant: int, state: CncState, reason: str) -> None:
        self._told = max(instant, self._told)
        self._state, self._reason = state, reason
        self._events.append(StateChange(self._told, state, self._position, reason))


class SourceClock:
    """Turns times of the server's clock into ours.

    The two clocks need not agree. What differs least between them and the arrival, within the last
    minute, is the difference of the clocks and the shortest transport.
    """

    def __init__(self) -> None:
        self._least: list[tuple[int, int]] = []

    def local(self, source: int | None, heard: int) -> int:
        """Return the time of a sample by our clock, ns.

        Args:
            source: by the clock of the server; None if it does not say.
            heard: time of arrival, by our clock.
        """
        if source is None:
            return heard
        delay = heard - source
        # Kept in order of arrival and of delay: the first is the least of the last minute.
        while self._least and self._least[-1][1] >= delay:
            self._least.pop()
        self._least.append((heard, delay))
        while self._least[0][0] < heard - CLOCK_MEMORY:
            self._least.pop(0)
        return source + self._least[0][1]


def from_settings(
    settings: Mapping[str, Any], surroundings: Surroundings
) -> Callable[[int], OpcUaCnc]:
    """Return what opens a PLC with an OPC UA server at a time, ns.

    Settings: those of ``OpcUaSettings.from_mapping``, explained in config/devices/opcua.yaml.

    Raises:
        ValueError: a setting is wrong, or there is no machine; asyncua is not installed.
    """
    machine = surroundings.machine_for("opcua controller")
    prepared = OpcUaSettings.from_mapping(settings)
    if find_spec("asyncua") is None:
        raise Refusal(
            "the driver 'opcua' needs asyncua, which is not installed:"
            " pip install 'stepdiag_ros[opcua]'",
            fault="not_installed",
        )
    return lambda start: OpcUaCnc(machine, prepared, start)
