"""How instruments and machine are, judged from what they send."""

from collections.abc import Iterable
from math import inf, isnan, nan

from stepdiag_ros.devices.cnc import CncState, Point
from stepdiag_ros.devices.interferometer import (
    STATUS_BEAM_LOST,
    STATUS_COUNT_ERROR,
    STATUS_FAULT,
    STATUS_LOW_SIGNAL,
    STATUS_OK,
    STATUS_OVERSPEED,
)
from stepdiag_ros.metrology.air.known_air import PLAUSIBLE, KnownAir
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.measurement import Reading
from stepdiag_ros.run.entitlement import Silence
from stepdiag_ros.run.health import HOLD, WINDOW, Age, HealthFinding, Level, figure

HAS_BEAM = (STATUS_OK, STATUS_LOW_SIGNAL)
NOW_LOST = {
    STATUS_BEAM_LOST: "the beam is lost",
    STATUS_OVERSPEED: "the mirror moved too fast for the counter: the zero is lost",
    STATUS_FAULT: "the interferometer reports a fault of its own",
    STATUS_COUNT_ERROR: "the count does not fit the way of the axes: the zero is lost",
}
NO_BEAM_YET = "there is no beam"
"""In a run, before its first setup: somebody is about to align it."""
NO_BEAM_NEEDED = "there is no beam, and no run that needs one"
DIM = "the beam is dim"
WAS_LOST = "the beam was lost for a moment: the zero of this setup is gone until the next"
GOOD = "the beam is there"
NO_READING_YET = "no reading has come yet"


class Beam:
    """Judges the beam of an interferometer by its readings.

    Args:
        stale_after: s without a reading after which the instrument counts as silent.
        dim_below: signal, as a part of the full one, below which the beam is dim, whatever the
            instrument itself says.
    """

    def __init__(self, stale_after: float, dim_below: float) -> None:
        self.stale_after = stale_after
        self.dim_below = dim_below
        self._age = Age()
        self._good = Age()
        self._status = STATUS_OK
        self._losses = 0
        self._dimmed = -inf
        # Since when beam and mirror stand for the present setup, ns; was it lost after that?
        self._set_up = 0
        self._zero_lost = False
        # Signal of the window that is being filled, and of the last whole one.
        self._since = nan
        self._lowest, self._sum, self._count = inf, 0.0, 0
        self._shown = (nan, nan)

    def begin(self, real: float) -> None:
        """Wait for readings from now on (s): the instrument has just begun to stream."""
        self._age.begin(real)
        self._good.begin(real)

    def expect_setup(self) -> None:
        """Take note that beam and mirror are still to be set up, for a run that begins."""
        self._set_up = 0

    def set_up(self, time: int) -> None:
        """Take note that beam and mirror stand for another setup, and its zero is set, at a time.

        Args:
            time: ROS time, ns; what was lost before no longer matters.
        """
        self._set_up, self._zero_lost = time, False

    def take(self, readings: Iterable[Reading], real: float) -> bool:
        """Take readings, in order, that have come at a time (s) of a clock that never steps.

        Returns:
            whether the beam is lost since, or back.
        """
        before = self._status
        for reading in readings:
            status, signal = reading.status, reading.signal_strength
            if status == STATUS_OK:
                self._good.take(reading.time, real)
            elif status == STATUS_LOW_SIGNAL:
                self._dimmed = real
            else:
                self._losses += self._status in HAS_BEAM
                self._zero_lost |= reading.time > self._set_up
            self._status = status
            self._age.take(reading.time, real)
            if not isnan(signal):
                self._lowest = min(self._lowest, signal)
                self._sum += signal
                self._count += 1
                if signal < self.dim_below and status == STATUS_OK:
                    self._dimmed = real
        return (before in HAS_BEAM) != (self._status in HAS_BEAM)

    def judge(self, now: int, real: float, in_run: bool) -> HealthFinding:
        """Return how the beam is.

        Args:
            now: ROS time, ns.
            real: s of a clock that never steps.
            in_run: a run goes on, which needs the beam.
        """
        self._turn_window(real)
        age = self._age.at(now, real)
        lowest, mean = self._shown
        values = {
            "age of the last reading (s)": figure(age),
            "age of the last good reading (s)": figure(self._good.at(now, real)),
            "lowest signal of the last second (0..1)": figure(lowest),
            "mean signal of the last second (0..1)": figure(mean),
            "dim below a signal of (0..1)": figure(self.dim_below),
            "times lost since the start": str(self._losses),
        }
        if isnan(age):
            late = self._age.waited(real) > self.stale_after
            return HealthFinding(Level.STALE, NO_READING_YET, values, forbids=late)
        if age > self.stale_after:
            silent = f"no reading has come for more than {self.stale_after:g} s"
            return HealthFinding(Level.STALE, silent, values, forbids=True)
        needed = in_run and 0 < self._set_up < (self._age.time or 0)
        if self._status == STATUS_BEAM_LOST and not needed:
            if not in_run:
                return HealthFinding(Level.OK, NO_BEAM_NEEDED, values)
            return HealthFinding(Level.WARN, NO_BEAM_YET, values)
        if self._status not in HAS_BEAM:
            unknown = f"the interferometer gives the unknown status {self._status}"
            return HealthFinding(Level.ERROR, NOW_LOST.get(self._status, unknown), values)
        if needed and self._zero_lost:
            return HealthFinding(Level.WARN, WAS_LOST, values)
        if real - self._dimmed <= HOLD:
            return HealthFinding(Level.WARN, DIM, values)
        return HealthFinding(Level.OK, GOOD, values)

    def _turn_window(self, real: float) -> None:
        if isnan(self._since):
            self._since = real
        elif real - self._since >= WINDOW:
            known = self._count > 0
            self._shown = (self._lowest, self._sum / self._count) if known else (nan, nan)
            self._since, self._lowest, self._sum, self._count = real, inf, 0.0, 0


FOR_THE_RECORD = "material_temperature"
"""Field that no reading is compensated for."""


class Air:
    """Judges what is known of air and material.

    Args:
        stale_after: s after which a value counts as unknown; NaN if values do not age.

    Attributes:
        known: what of it may be used.
    """

    def __init__(self, stale_after: float) -> None:
        self.stale_after = stale_after
        self.known = KnownAir(stale_after)
        self._values: dict[str, float] = {}
        self._first_heard = nan
        self._ages = {name: Age() for name in PLAUSIBLE}
        self._gaps = 0
        self._missing = False

    def take(self, name: str, value: float, time: int, real: float) -> None:
        """Take one value.

        Args:
            name: field of ``Environment``.
            value: in the unit of that field.
            time: of measurement, ns.
            real: when it came, s of a clock that never steps.
        """
        if not self._values:
            self._first_heard = real
        self._values[name] = value
        self._ages[name].take(time, real)
        self.known.take(name, value, time)

    def judge(self, now: int, real: float) -> HealthFinding:
        """Return what is known (``now``: ROS time, ns; ``real``: s, never steps)."""
        values: dict[str, str] = {}
        unknown: list[str] = []
        strange: list[str] = []
        for name, expected in PLAUSIBLE.items():
            value, age = self._values.get(name, nan), self._ages[name].at(now, real)
            values[f"{expected.words} ({expected.unit})"] = figure(value, 6)
            values[f"age of the {expected.words} (s)"] = figure(age)
            if isnan(value) or isnan(age) or age > self.stale_after:
                unknown.append(name)
            elif objection := self.known.objection(name):
                strange.append(f"the {expected.words} is {objection}")
        needed = [name for name in unknown if name != FOR_THE_RECORD]
        missing = bool(self._values) and bool(needed or strange)
        self._gaps += missing and not self._missing
        self._missing = missing
        values["times not known since the start"] = str(self._gaps)
        if not self._values:
            return HealthFinding(Level.STALE, "no weather sensor has sent a value yet", values)
        if len(self._values) < len(PLAUSIBLE) and real - self._first_heard < HOLD:
            return HealthFinding(Level.STALE, "some weather sensors have sent no value yet", values)
        if strange:
            return HealthFinding(Level.ERROR, f"{'; '.join(strange)}; it is not used", values)
        if needed:
            consequence = "readings are not compensated"
            return HealthFinding(Level.ERROR, f"{_named(needed)} not known: {consequence}", values)
        if unknown:
            return HealthFinding(Level.WARN, f"{_named(unknown)} not known", values)
        return HealthFinding(Level.OK, "air and material are known", values)


def _named(names: list[str]) -> str:
    words = [PLAUSIBLE[name].words for name in names]
    return f"{' and '.join(words)} {'is' if len(words) == 1 else 'are'}"


NOT_ASKED_FOR = "readings are not compensated for the air, as it was asked for"
NO_COMPENSATED = (
    "the instrument does not compensate for the air: set the parameter compensation to own"
)
AIR_UNKNOWN = (
    "readings are not compensated, because the air is not known: start the node weather, check its"
    " sensors, or set the parameter compensation to off"
)
NO_RAW = "the instrument reports no count: set the parameter compensation to instrument"


class Compensation:
    """Judges whether readings are compensated for the air in the way that was asked for.

    Args:
        kind: one of ``compensator.COMPENSATIONS``.
    """

    LOOKS = 12
    """Looks in a row, some 3 s, for which an instrument must fail its part before this is reported.

    An instrument with sensors of its own receives air data no sooner than this node does."""

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self._last: Reading | None = None
        self._ever = False
        self._doubts = 0

    def take(self, readings: Iterable[Reading]) -> None:
        """Take readings, in order."""
        for reading in readings:
            if reading.status in HAS_BEAM:
                self._last = reading
                self._ever |= not isnan(reading.compensated_displacement)

    def judge(self, air: HealthFinding) -> HealthFinding:
        """Return how readings are compensated, where the sensors are found to be so (``air``)."""
        values = {"compensated by": self._kind}
        if self._last is None:
            return HealthFinding(Level.OK, NO_READING_YET, values)
        if self._kind == "off":
            return HealthFinding(Level.WARN, NOT_ASKED_FOR, values)
        known = not isnan(self._last.compensated_displacement)
        # Nobody can compensate for air that is not known.
        excused = self._kind == "instrument" and air.level is not Level.OK
        self._doubts = 0 if known or self._ever or excused else self._doubts + 1
        if known:
            return HealthFinding(Level.OK, "readings are compensated for the air", values)
        # The first readings may come before the weather; and what could be done before, will be.
        if self._doubts >= self.LOOKS:
            if self._kind == "own" and isnan(self._last.raw_displacement):
                return HealthFinding(Level.ERROR, NO_RAW, values, forbids=True)
            if self._kind == "instrument":
                return HealthFinding(Level.ERROR, NO_COMPENSATED, values, forbids=True)
        return HealthFinding(Level.ERROR, AIR_UNKNOWN, values)


TROUBLE = {
    CncState.STOPPED: "the machine was stopped",
    CncState.FAULT: "the controller is faulty",
}
SOME_POSITIONS = 3.0
"""So many positions must fail to come before axes that move count as silent."""
LIMIT_ALLOWANCE = 1e-6
"""m beyond a soft limit that are still the servo's business."""


class Axes:
    """Judges the axes by the actual positions and the state that their controller reports.

    Args:
        stale_after: s after which a position is stale.
    """

    def __init__(self, stale_after: float) -> None:
        self.stale_after = stale_after
        self._age = Age()
        self._silence = Silence()
        self._position: Point = (nan, nan, nan)
        self._low: Point = (nan, nan, nan)
        self._high: Point = (nan, nan, nan)

    def begin(self, real: float) -> None:
        """Wait for positions from now on (s): the controller has just begun to report them."""
        self._age.begin(real)

    def limit(self, low: Point, high: Point) -> None:
        """Take the soft limits, m."""
        self._low, self._high = low, high

    def take(self, position: Point, time: int, real: float) -> None:
        """Take actual positions (m) of a time (ns), come at a time (s) that never steps."""
        self._position = position
        self._age.take(time, real)
        self._silence.heard(real)

    def moves(self, real: float) -> None:
        """Expect positions often from now on (s): a move begins."""
        self._silence.heard(real)

    def silent(self, limit: float, rate: float, now: int, real: float) -> str:
        """Report that positions of moving axes are missing; empty if enough arrive.

        Args:
            limit: s; that of some positions, if they come so rarely.
            rate: of the positions, Hz.
            now: ROS time, ns.
            real: s of a clock that never steps; looked at many times a second.
        """
        limit = max(limit, SOME_POSITIONS / rate)
        if self._silence.look(real) <= limit or self._age.at(now, real) <= limit:
            return ""
        return f"the axes move, but no actual position has come for {limit:g} s"

    def judge(self, state: CncState, reason: str, now: int, real: float) -> HealthFinding:
        """Return how the axes are.

        Args:
            state: of the controller.
            reason: why it stopped or is faulty.
            now: ROS time, ns.
            real: s of a clock that never steps.
        """
        age = self._age.at(now, real)
        values = {"state": state.name.lower(), "age of the last position (s)": figure(age)}
        beyond = []
        for axis, place, low, high in zip(AXES, self._position, self._low, self._high, strict=True):
            values[f"position of {axis} (m)"] = figure(place, 9)
            values[f"soft limits of {axis} (m)"] = f"{figure(low, 9)} to {figure(high, 9)}"
            if place < low - LIMIT_ALLOWANCE or place > high + LIMIT_ALLOWANCE:
                beyond.append(axis)
        because = f": {reason}" if reason else ""
        if isnan(age):
            late = self._age.waited(real) > self.stale_after
            nothing = f"no actual position has come yet{because}"
            return HealthFinding(Level.STALE, nothing, values, forbids=late)
        if age > self.stale_after:
            silent = f"no actual position has come for more than {self.stale_after:g} s"
            return HealthFinding(Level.STALE, silent, values, forbids=True)
        if state is CncState.FAULT:
            return HealthFinding(Level.ERROR, f"{TROUBLE[state]}{because}", values)
        if state is CncState.STOPPED:
            return HealthFinding(Level.WARN, f"{TROUBLE[state]}{because}", values)
        if beyond:
            where = " and ".join(beyond)
            return HealthFinding(
                Level.WARN, f"the machine stands beyond its soft limits in {where}", values
            )
        return HealthFinding(Level.OK, "the machine is ready and reports its position", values)
