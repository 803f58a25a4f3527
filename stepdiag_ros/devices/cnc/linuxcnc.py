"""LinuxCNC, through the agent that runs in it (``linuxcnc_agent``): moves, states, positions.

The agent does itself whatever must not depend on this process: it checks each move, follows it to
its end by actual positions, and brakes when this process falls silent. The protocol is described in
``linuxcnc_agent/stepdiag_agent.py``. Positions are machine coordinates (G53), the time stamps those
of the agent, on the same computer.
"""

from __future__ import annotations

import errno
import json
import select
import socket
import time
from collections.abc import Callable, Mapping
from math import isfinite, nan
from typing import Any

from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.cnc import (
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
from stepdiag_ros.devices.cnc.move_check import check_target
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.refusal import Refusal

PROTOCOL = 1
SILENCE_LIMIT = 1.0
"""Real seconds without a word from the agent, after which it counts as dead, unless set."""
ALIVE_PERIOD = 0.05
"""Real seconds between two signs of life, if the watchdog does not need them more often."""
_LONGEST_LINE = 65536
_STATES = {
    "ready": CncState.READY,
    "moving": CncState.MOVING,
    "stopped": CncState.STOPPED,
    "fault": CncState.FAULT,
}


class LinuxCnc:
    """A machine tool controlled by LinuxCNC (protocol: ``CncDevice``).

    Args:
        path: of the agent's Unix socket.
        machine: travel, feed limit and in-position window.
        sample_rate: of the position samples, Hz.
        dead_man: s; the agent brakes when it receives nothing from here for so long.
        silence: s without a word from the agent, after which it counts as dead. A quarter of it is
            the limit for the answer to a move, for which the bridge waits; 5 ms is usual.

    Raises:
        OSError: the agent does not answer.
        ValueError: what it answers makes no sense, or it refuses this client.
    """

    def __init__(
        self,
        path: str,
        machine: Machine,
        sample_rate: float,
        dead_man: float,
        silence: float = SILENCE_LIMIT,
    ) -> None:
        self._path = path
        self._machine = machine
        self._dead_man, self._silence = dead_man, silence
        self._in, self._out = b"", b""
        self._state, self._reason = CncState.FAULT, ""
        self._position: Point = (nan, nan, nan)
        self._events: list[CncEvent] = []
        self._asked = 0
        self._answers: dict[int, dict[str, Any]] = {}
        self._heard = self._spoken = time.monotonic()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._connect()
            facts = self._ask(
                "hello",
                protocol=PROTOCOL,
                window=machine.position_window_m,
                hold=machine.position_hold_s,
                dead_man=dead_man,
                rate=sample_rate,
            )
            self._last_move = int(facts["last_move"])
            self._limits = self._common_travel(_point(facts["low"]), _point(facts["high"]))
            self._traits = Traits(
                acceleration=_known(facts["acceleration"]),
                feed_limit=_known(facts["velocity"]),
                dead_man=dead_man,
            )
        except (KeyError, TypeError) as error:
            self.close()
            raise Refusal(
                f"{self._whom}: cannot read its hello ({error!r})", fault="malformed"
            ) from None
        except BaseException:
            self.close()
            raise

    @property
    def state(self) -> CncState:
        """State at the last time passed to the device."""
        return self._state

    @property
    def soft_limits(self) -> tuple[Point, Point]:
        """Lower and upper limits of X, Y, Z, m: the tighter of the machine file and LinuxCNC."""
        return self._limits

    @property
    def traits(self) -> Traits:
        """What LinuxCNC says of the machine in its INI file."""
        return self._traits

    def start_move(self, time_ns: int, target: Point, feed: float, axes: str) -> None:  # noqa: ARG002
        """Begin a straight move (see ``CncDevice.start_move``); it is never sent twice."""
        if self._state is not CncState.READY:
            raise not_ready(self._state)
        # The agent compares with what is commanded; the actual position differs by up to a window.
        near = [2.0 * self._machine.position_window_m] * 3
        limit = self._machine.feed_limit_m_per_s
        check_target(
            self._position, target, feed, axes, limits=self._limits, feed_limit=limit, near=near
        )
        number = self._last_move + 1
        # Counted whatever becomes of it: a move that may have begun is not sent once more.
        self._last_move = number
        answer = self._ask("move", move=number, target=list(target), feed=feed, axes=axes)
        if not answer["ok"]:
            self._last_move = number - 1
            raise MoveRefused(str(answer["reason"]), fault="rejected")

    def stop(self, time_ns: int, reason: str) -> None:  # noqa: ARG002
        """Brake to rest at once; STOPPED, with the reason, is reported when the axes stand."""
        if self._state not in (CncState.STOPPED, CncState.FAULT):
            self._send("stop", reason=reason)

    def reset(self, time_ns: int) -> None:  # noqa: ARG002
        """Inform the agent that an operator lets the machine move (see ``CncDevice.reset``)."""
        if self._state is CncState.MOVING:
            raise still_moves()
        answer = self._ask("start")
        if not answer["ok"]:
            raise MoveRefused(str(answer["reason"]), fault="rejected")

    def poll(self, time_ns: int) -> list[CncEvent]:  # noqa: ARG002
        """Return what has happened since the last poll, in order of time."""
        now = time.monotonic()
        if now - self._spoken > min(ALIVE_PERIOD, self._dead_man / 4.0):
            self._send("alive")
        self._take()
        if now - self._heard > self._silence:
            raise OSError(errno.ETIMEDOUT, f"{self._whom} has sent nothing for {self._silence:g} s")
        events, self._events = self._events, []
        return events

    def close(self) -> None:
        """Let LinuxCNC go; a move that is left behind is braked by the agent."""
        self._socket.close()

    @property
    def _whom(self) -> str:
        return f"the agent in LinuxCNC ({self._path})"

    def _connect(self) -> None:
        self._socket.setblocking(False)
        try:
            self._socket.connect(self._path)
        except OSError as error:
            raise OSError(
                error.errno,
                f"{self._whom} cannot be reached ({error.strerror}): check that LinuxCNC runs",
            ) from None

    def _common_travel(self, low: Point, high: Point) -> tuple[Point, Point]:
        machine = self._machine
        lows = tuple(max(pair) for pair in zip(low, machine.travel_low_m, strict=True))
        highs = tuple(min(pair) for pair in zip(high, machine.travel_high_m, strict=True))
        for axis, least, most in zip(AXES, lows, highs, strict=True):
            if not least < most:
                raise Refusal(
                    f"the travel of {axis} in the machine file does not overlap with the soft"
                    " limits of LinuxCNC",
                    fault="mismatch",
                )
        return _point(lows), _point(highs)

    def _ask(self, op: str, **content: Any) -> dict[str, Any]:
        """Return the answer of the agent to a request."""
        number = self._send(op, **content)
        # Nothing moves while the agent greets or lets the machine move again.
        limit = 0.25 * self._silence if op == "move" else self._silence
        deadline = time.monotonic() + limit
        while number not in self._answers:
            left = deadline - time.monotonic()
            if left <= 0.0:
                raise OSError(errno.ETIMEDOUT, f"{self._whom} has not answered within {limit:g} s")
            select.select([self._socket], [], [], left)
            self._take()
        answer = self._answers.pop(number)
        if not isinstance(answer.get("ok"), bool):
            raise Refusal(f"{self._whom}: its answer lacks 'ok'", fault="malformed")
        return answer

    def _send(self, op: str, **content: Any) -> int:
        self._asked += 1
        self._out += json.dumps({"ask": self._asked, "op": op, **content}).encode() + b"\n"
        self._spoken = time.monotonic()
        try:
            sent = self._socket.send(self._out)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            # It may have said why.
            self._take()
            raise OSError(error.errno, f"{self._whom} has gone") from None
        self._out = self._out[sent:]
        if len(self._out) > _LONGEST_LINE:
            raise OSError(errno.ENOBUFS, f"{self._whom} does not accept the commands sent to it")
        return self._asked

    def _take(self) -> None:
        """Take what the agent has said."""
        while True:
            try:
                data = self._socket.recv(_LONGEST_LINE)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                raise OSError(errno.ECONNRESET, f"{self._whom} has gone")
            self._heard = time.monotonic()
            *lines, self._in = (self._in + data).split(b"\n")
            if len(self._in) > _LONGEST_LINE:
                raise Refusal(f"{self._whom}: its line has no end", fault="too_many")
            for line in lines:
                self._understand(line)

    def _understand(self, line: bytes) -> None:
        try:
            message = json.loads(line)
            if "answer" in message:
                # Nobody waits for that of a stop.
                self._answers = {int(message["answer"]): message}
            elif message["event"] == "sample":
                motors = message["motors"]
                self._position = _point(message["position"])
                self._events.append(
                    PositionSample(
                        int(message["time"]),
                        self._position,
                        None if motors is None else _point(motors),
                    )
                )
            elif message["event"] == "state":
                self._position = _point(message["position"])
                self._state, self._reason = _STATES[message["state"]], str(message["reason"])
                self._events.append(
                    StateChange(int(message["time"]), self._state, self._position, self._reason)
                )
            else:
                raise OSError(errno.EBUSY, f"{self._whom} refuses: {message['reason']}")
        except (KeyError, TypeError, ValueError):
            raise Refusal(
                f"{self._whom}: '{line[:80]!r}' cannot be read", fault="malformed"
            ) from None


def _point(values: Any) -> Point:
    x, y, z = (float(value) for value in values)
    if not (isfinite(x) and isfinite(y) and isfinite(z)):
        raise Refusal("a coordinate of a position is not a number", fault="malformed")
    return x, y, z


def _known(values: Any) -> Point:
    x, y, z = (nan if value is None else float(value) for value in values)
    return x, y, z


def from_settings(
    settings: Mapping[str, Any], surroundings: Surroundings
) -> Callable[[int], LinuxCnc]:
    """Return what connects to the agent in LinuxCNC.

    Settings: ``socket``, the path of the agent's Unix socket ([STEPDIAG] SOCKET in the INI file);
    ``dead_man_s`` (default 0.5, 0.1 to 2): the agent brakes when it receives nothing for so long;
    ``position_rate_hz`` (default 200); ``silence_s`` (default 1, 0.5 to 30): without a word from
    the agent for so long, it counts as dead.

    Raises:
        ValueError: a setting is wrong, or there is no machine.
    """
    machine = surroundings.machine_for("LinuxCNC driver")
    section = Section(settings, "settings of the LinuxCNC driver")
    path = section.text("socket")
    dead_man = section.number("dead_man_s", low=0.1, high=2.0, default=0.5)
    rate = section.number("position_rate_hz", low=1.0, high=500.0, default=200.0)
    silence = section.number("silence_s", low=0.5, high=30.0, default=SILENCE_LIMIT)
    section.finish()
    return lambda _: LinuxCnc(path, machine, rate, dead_man, silence)
