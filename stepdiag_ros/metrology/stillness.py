"""Where the mirror stood still, found in the stream of readings alone.

An instrument that is not connected to the control does not know when the machine is in position.
What it sees is that the readings stay where they are for about the time of a dwell, and then go on
by about a step. Both scales come from the plan (``Criteria.of_plan``): what stays within a small
part of the smallest step for half a stop is a rest. Where exactly a rest begins and ends, and with
it what part of the approach, the settling and the departure belongs to it, is decided by the noise
of its own readings: a reading belongs to it if it is within five standard deviations of its level.

No setting is to be tuned: noise, quantisation, sampling rate and drift are whatever they are.
"""

from collections import deque
from dataclasses import dataclass
from itertools import islice
from math import isfinite

import numpy as np

from stepdiag_ros.metrology.assembly import FIRST_STATUS_THAT_LOSES_ZERO
from stepdiag_ros.metrology.geometry import Vector, beam_direction
from stepdiag_ros.metrology.measurement import Reading
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.window import FEWEST_READINGS

PART_OF_STEP = 0.1
"""Part of the smallest step along a beam within which the readings of a rest stay."""
PART_OF_STOP = 0.5
"""Part of a stop's settle and window times that a rest lasts at least."""
SLOWEST = 0.5
"""Part of the plan's feed with which the machine moves at least (an override of the operator)."""
DEVIATIONS = 5.0
"""Standard deviations of a rest's readings within which a reading belongs to it."""
FASTER_THAN_ANY_MOVE = 3.0
"""Multiple of the plan's feed at which a reading changes only if the count of fringes is lost."""
_KEPT_STOPS = 4.0
_NOISES = 51
_NEGLIGIBLE = 1e-9
"""m: what still settles by less is settled, whatever the noise."""
_SPIKE = 2
_FEW = 8.0
"""Readings below which their own standard deviation is little known; wider limits then."""
_NORMAL = 1.4826
"""Standard deviation of a normal distribution, in median absolute deviations."""


@dataclass(frozen=True)
class Criteria:
    """What counts as standing still.

    Attributes:
        band: the readings of a rest stay within this, m.
        shortest: a rest lasts at least this, s.
        kept: readings at the beginning and at the end of a rest that decide about these, s.
        fastest: speed of the mirror along a beam, m/s; NaN if not known.
    """

    band: float
    shortest: float
    kept: float
    fastest: float

    @classmethod
    def of_plan(cls, plan: Plan) -> "Criteria":
        """Return the criteria for a plan's steps, feed and times of sampling."""
        sampling = plan.sampling
        stop = sampling.settle + sampling.window
        shortest = PART_OF_STOP * stop
        step, slowest = smallest_step(plan), _slowest(plan)
        band = PART_OF_STEP * step
        if isfinite(slowest):
            # Passing through the band takes at most half as long as a rest.
            band = min(band, 0.5 * SLOWEST * slowest * shortest)
        return cls(band, shortest, _KEPT_STOPS * stop, plan.feed)


@dataclass(frozen=True)
class Rest:
    """A time during which the mirror stood still.

    Attributes:
        start: of its first reading, ns; the approach and its settling are before.
        end: of its last reading, ns.
        arrived: level at the beginning, m (median).
        left: level at the end, m; in a long rest drift or the operator may have changed it.
        noise: standard deviation of one reading, m (from the median absolute deviation).
        readings: how many.
        zero: how often the zero was lost before; levels of rests with different numbers cannot be
            compared.
    """

    start: int
    end: int
    arrived: float
    left: float
    noise: float
    readings: int
    zero: int

    @property
    def duration(self) -> float:
        """Return how long it lasts, s."""
        return (self.end - self.start) * 1e-9


def smallest_step(plan: Plan) -> float:
    """Return the smallest displacement along the beam between two stops of a line, m."""
    return min(step for step, _ in _steps(plan))


def _slowest(plan: Plan) -> float:
    """Return the smallest speed along the beam of a move between two stops, m/s."""
    return min(plan.feed * step / way for step, way in _steps(plan))


def _steps(plan: Plan) -> list[tuple[float, float]]:
    """Return displacement along the beam and way of every kind of move between stops, m."""
    found: set[tuple[float, float]] = set()
    for line in {(one.name, one.order): one for one in plan.lines}.values():
        beam = beam_direction(line.name, np.asarray(plan.volume.step))
        moves = np.diff(line.stops(plan.volume)[: max(len(line.order), 1) + 1], axis=0)
        along, ways = np.abs(moves @ beam), np.linalg.norm(moves, axis=1)
        found.update(zip(along.tolist(), ways.tolist(), strict=True))
    return sorted(found)


class StillnessDetector:
    """Finds rests in readings as they come.

    Args:
        criteria: what counts as standing still.
    """

    def __init__(self, criteria: Criteria) -> None:
        self._criteria = criteria
        self._shortest = round(criteria.shortest * 1e9)
        self._kept = round(criteria.kept * 1e9)
        self._zero = 0
        self._quantum = 0.0
        self._noises: deque[float] = deque(maxlen=_NOISES)
        self._latest: Reading | None = None
        self._losing = False
        self._last_rest: Rest | None = None
        # The newest readings that stay within the band, with the indices of extremes to come.
        self._window: deque[tuple[int, float]] = deque()
        self._highest: deque[tuple[int, float]] = deque()
        self._lowest: deque[tuple[int, float]] = deque()
        self._open: _OpenRest | None = None
        self._strays: list[tuple[int, float]] = []

    @property
    def since(self) -> int | None:
        """Return when the rest that goes on began at the earliest, ns; None if nothing rests."""
        return None if self._open is None else self._open.head[0][0]

    @property
    def present(self) -> Rest | None:
        """Return the rest that goes on, as far as it is known; None if nothing rests."""
        return None if self._open is None else self._made(self._open)

    def add(self, reading: Reading) -> list[Rest]:
        """Take the next reading; return the rests that have ended.

        A reading that is not later than the one before is left out. Readings that lose the zero, or
        are not numbers, end a rest.
        """
        before = self._latest
        if before is not None and reading.time <= before.time:
            return []
        restarted = before is not None and reading.sequence <= before.sequence
        self._latest = reading
        value = reading.compensated_displacement
        lost = reading.status >= FIRST_STATUS_THAT_LOSES_ZERO
        if lost or restarted or not isfinite(value):
            ended = self.finish()
            if (lost or restarted) and not self._losing:
                self._zero += 1
            self._losing = lost
            return ended
        self._losing = False
        sample = (reading.time, value)
        if self._open is None:
            self._slide(sample)
            return []
        return self._continue(self._open, sample)

    def finish(self) -> list[Rest]:
        """Return the rest that went on, for there are no readings after it."""
        ended = self._close()
        self._strays = []
        self._clear()
        return ended

    def _clear(self) -> None:
        self._window.clear()
        self._highest.clear()
        self._lowest.clear()

    def _slide(self, sample: tuple[int, float]) -> None:
        """Move the window on; open a rest when it has become long enough."""
        time, value = sample
        self._window.append(sample)
        while self._highest and self._highest[-1][1] <= value:
            self._highest.pop()
        self._highest.append(sample)
        while self._lowest and self._lowest[-1][1] >= value:
            self._lowest.pop()
        self._lowest.append(sample)
        while self._highest[0][1] - self._lowest[0][1] > self._criteria.band:
            gone = self._window.popleft()
            for extremes in (self._highest, self._lowest):
                if extremes[0][0] == gone[0]:
                    extremes.popleft()
        if time - self._window[0][0] >= self._shortest and len(self._window) >= FEWEST_READINGS:
            self._open = _OpenRest(
                self._window[0][0] + self._kept, self._lowest[0][1], self._highest[0][1]
            )
            for kept in self._window:
                self._open.take(kept, self._kept)
            self._clear()

    def _continue(self, rest: "_OpenRest", sample: tuple[int, float]) -> list[Rest]:
        """Add a reading to the rest that goes on, or end it."""
        if rest.spread_with(sample[1]) <= self._criteria.band:
            # One or two readings beside the others are spikes of the instrument, not a move.
            self._strays = []
            rest.take(sample, self._kept)
            return []
        self._strays.append(sample)
        lasting = sample[0] - self._strays[0][0] > self._shortest // 2
        apart = sample[0] - rest.tail[-1][0] > self._shortest
        if len(self._strays) <= _SPIKE and not lasting and not apart:
            return []
        strays, self._strays = self._strays, []
        if self._still_coming(rest, strays):
            return []
        ended = self._close()
        for stray in strays:
            self._slide(stray)
        return ended

    def _still_coming(self, rest: "_OpenRest", strays: list[tuple[int, float]]) -> bool:
        """Begin a young rest later if only its beginning, still settling, is outside the band."""
        if rest.count > len(rest.head):
            return False
        samples = [*rest.head, *strays]
        low = high = samples[-1][1]
        first = len(samples) - 1
        for index in range(len(samples) - 1, -1, -1):
            value = samples[index][1]
            if max(high, value) - min(low, value) > self._criteria.band:
                break
            low, high, first = min(low, value), max(high, value), index
        if rest.tail[-1][0] - samples[first][0] < self._shortest // 2:
            return False
        self._open = _OpenRest(samples[first][0] + self._kept, low, high)
        for sample in samples[first:]:
            self._open.take(sample, self._kept)
        return True

    def _close(self) -> list[Rest]:
        if self._open is None:
            return []
        rest, self._open = self._made(self._open, ended=True), None
        self._last_rest = rest
        return [rest]

    def _made(self, found: "_OpenRest", ended: bool = False) -> Rest:
        head, tail = found.head, list(found.tail)
        usual = float(np.median(self._noises)) if self._noises else 0.0
        first, arrived, noise, quantum = _beginning(head, self._quantum, usual)
        last, left, noise_of_end, quantum_of_end = _beginning(tail[::-1], self._quantum, usual)
        smallest = [value for value in (self._quantum, quantum, quantum_of_end) if value > 0.0]
        if ended:
            self._noises.append(max(noise, noise_of_end))
            self._quantum = min(smallest, default=0.0)
        if not found.placed:
            found.placed = True
            self._note_jump(first, arrived)
        return Rest(
            start=first,
            end=max(last, first),
            arrived=arrived,
            left=left,
            noise=max(noise, noise_of_end),
            readings=found.count,
            zero=self._zero,
        )

    def _note_jump(self, start: int, level: float) -> None:
        """Count a zero as lost if the reading came here faster than any move could bring it."""
        before, fastest = self._last_rest, self._criteria.fastest
        if before is None or before.zero != self._zero or not isfinite(fastest):
            return
        way, took = abs(level - before.left), (start - before.end) * 1e-9
        if way > self._criteria.band and took < way / (FASTER_THAN_ANY_MOVE * fastest):
            self._zero += 1


class _OpenRest:
    """A rest that goes on: its first and its last readings.

    Args:
        head_until: ns; readings up to then belong to its beginning.
        low: smallest reading so far, m.
        high: largest, m.
    """

    def __init__(self, head_until: int, low: float, high: float) -> None:
        self._head_until = head_until
        self._low, self._high = low, high
        self.head: list[tuple[int, float]] = []
        self.tail: deque[tuple[int, float]] = deque()
        self.count = 0
        self.placed = False

    def spread_with(self, value: float) -> float:
        """Return the spread of all readings and one more, m."""
        return max(self._high, value) - min(self._low, value)

    def take(self, sample: tuple[int, float], kept: int) -> None:
        """Add a reading; ``kept``: ns of the last readings that are kept."""
        time, value = sample
        self._low, self._high = min(self._low, value), max(self._high, value)
        self.count += 1
        if time <= self._head_until:
            self.head.append(sample)
        self.tail.append(sample)
        while time - self.tail[0][0] > kept:
            self.tail.popleft()


def _beginning(
    samples: list[tuple[int, float]], quantum: float, usual: float
) -> tuple[int, float, float, float]:
    """Find where a rest begins; given backwards in time, where it ends.

    Args:
        samples: time (ns) and value (m) of its readings.
        quantum: smallest difference between readings that was seen so far, m; 0 if none was.
        usual: standard deviation of a reading in the rests before, m; counts where there are too
            few readings to determine it.

    Returns:
        time of the first reading at rest, ns; level, m; standard deviation of a reading, m;
        smallest difference between readings, m.
    """
    values = np.array([value for _, value in samples])
    # What comes first may still be settling, what comes last may be leaving already.
    begin = len(values) // 3
    core = values[begin : max(len(values) - begin, begin + FEWEST_READINGS)]
    level = float(np.median(core))
    noise = _noise(core)
    differences = np.abs(np.diff(core))
    differences = differences[differences > 0.0]
    smallest = float(np.min(differences)) if differences.size else 0.0
    own = max(noise, usual) if len(core) < _FEW else noise
    allowed = DEVIATIONS * own * (1.0 + _FEW / len(core))
    beside = np.abs(values - level) > max(allowed, 1.5 * (smallest or quantum), _NEGLIGIBLE)
    first = 0
    for index in range(begin - 1, 0, -1):
        if beside[index] and beside[index - 1]:
            first = index + 1
            break
    while first < len(values) - 1 and beside[first]:
        first += 1
    time = next(islice(samples, first, None))[0]
    return time, level, noise, smallest


def _noise(values: Vector) -> float:
    """Return the standard deviation of readings about their straight line, m, robustly."""
    count = len(values)
    if count < FEWEST_READINGS:
        return 0.0
    places = np.arange(count) - 0.5 * (count - 1)
    slope = float(places @ (values - values[0])) / float(places @ places)
    rest = values - values[0] - slope * places
    if count < _FEW:
        return float(np.std(rest, ddof=2))
    return _NORMAL * float(np.median(np.abs(rest - np.median(rest))))
