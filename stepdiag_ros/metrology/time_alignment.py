"""By how much the time stamps of readings are late against those of positions, from the moves.

While an axis moves, the reading follows its position: with p(t) the position along the beam, and
readings stamped late by τ,

    s(t) = c + k · p(t - τ).

τ is looked for in two steps: first where one c and one k for the whole line leave the least (which
also shows how large it may be), then for each move by least squares, with a c and a k of its own
and a bend q · (p - p₁)(p₂ - p) between its ends, so that misalignment, slope and curvature of the
machine's errors, and drift of the air do not act on τ. Without the bend, the curvature that the
moves of one axis have in common would shift them all alike. The moves do not know of each other, so
their scatter is the uncertainty of their mean (GUM type A). Positions are taken as linear between
two samples: over a move from rest to rest what that adds while the axis gains speed is mostly taken
back while it loses it. By how much the result differs with a cubic between them (Hermite's, slopes
from both neighbours) is the half-width of a rectangular distribution, which is added (type B): it
counts where positions are slow and the moves in step with them.

What cannot be separated: the clocks' offset, the time on the way (where a side stamps what comes
in), filters on either side, and the lag of the position behind the machine. All of it together is
what matters to a stop. A line without moves, or a stream that pauses, has no result.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan, sqrt

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.geometry import Vector

SEARCH_LIMIT = 1.0
"""s: offsets up to this, either way, are found."""
FEWEST_MOVES = 3
_MOST_READINGS = 200_000
"""Of a line, that are looked at: at 1 kHz all of three minutes, and of ten those of a corner of 30
ms."""
_MOST_IN_SEARCH = 4000
"""Of these, that are enough for a rough offset."""
_FEWEST_IN_MOVE = 8
"""Readings on the way, and as many at rest, without which a move does not count."""
_MOVING = 0.02
"""Part of the highest speed above which the axis moves."""
_REST = 0.5
"""s of rest, at most, that are looked at before and behind a move."""
_AMBIGUOUS = 4.0
"""Times the least sum of squares below which another offset fits as well."""
_STEPS = 4

Instants = NDArray[np.int64]


@dataclass(frozen=True)
class TimeOffset:
    """How late the readings of one line, or of a run, are stamped.

    Attributes:
        time: at which it is meant, ns; the middle of the moves.
        offset: s; positive: readings are stamped later than positions of the same instant.
        standard_uncertainty: s; NaN where it is not known.
        degrees_of_freedom: of the uncertainty.
        moves: that it was found from.
        others: s, offsets that fit about as well; empty if there are none.
        reason: why there is no result; empty if there is one.
    """

    time: int = 0
    offset: float = nan
    standard_uncertainty: float = nan
    degrees_of_freedom: int = 0
    moves: int = 0
    others: tuple[float, ...] = ()
    reason: str = ""

    @property
    def expanded_uncertainty(self) -> float:
        """Return the half-width of the 95 % interval, s; NaN where it is not known."""
        if self.degrees_of_freedom < 1:
            return nan
        from scipy.special import stdtrit

        return float(stdtrit(self.degrees_of_freedom, 0.975)) * self.standard_uncertainty


@dataclass(frozen=True)
class RunTiming:
    """How late the readings of a run are stamped, and how that changes.

    Attributes:
        offset: at the middle of the run.
        drift: s/s, by which the offset grows; NaN with fewer than three lines.
        drift_uncertainty: standard uncertainty, s/s; NaN where it is not known.
        lines: of each line that has a result.
    """

    offset: TimeOffset
    drift: float
    drift_uncertainty: float
    lines: tuple[TimeOffset, ...]


@dataclass(frozen=True)
class LineRecord:
    """What was recorded of one line.

    Positions should reach ``SEARCH_LIMIT`` beyond the readings at either end. Where they do not,
    the machine is taken to stand as at the last of them; if it moves there, the outer readings are
    left out.

    Attributes:
        position_times: ns, rising, shape (n,).
        positions: along the beam, m, shape (n,).
        reading_times: ns, rising, shape (m,); good readings of one zero alone.
        displacements: m, shape (m,).
    """

    position_times: Instants
    positions: Vector
    reading_times: Instants
    displacements: Vector


def line_offset(record: LineRecord) -> TimeOffset:
    """Return how late the readings of one line are stamped, up to ``SEARCH_LIMIT`` either way."""
    if len(record.position_times) < _FEWEST_IN_MOVE:
        return TimeOffset(reason="too few positions were recorded")
    origin = int(record.position_times[0])
    at: Vector = np.asarray((record.position_times - origin) * 1e-9, dtype=np.float64)
    place = record.positions
    speeds = np.abs(np.diff(place) / np.diff(at))
    stands = speeds[[0, -1]] <= _MOVING * np.max(speeds)
    beyond = np.where(stands, -SEARCH_LIMIT, SEARCH_LIMIT) * 1e9
    inside = np.searchsorted(
        record.reading_times, [origin + beyond[0], record.position_times[-1] - beyond[1]]
    )
    part = slice(int(inside[0]), int(inside[1]))
    times: Vector = np.asarray((record.reading_times[part] - origin) * 1e-9, dtype=np.float64)
    values = record.displacements[part]
    if len(times) < 2 * _FEWEST_IN_MOVE:
        return TimeOffset(reason="too few good readings were recorded")
    thin = -(-len(times) // _MOST_READINGS)
    times, values = times[::thin], values[::thin]
    line = _Line(at, place, times, values - values[0])
    moves = line.moves()
    if len(moves) < FEWEST_MOVES:
        return TimeOffset(
            moves=len(moves), reason=f"the line has {len(moves)} moves; {FEWEST_MOVES} are needed"
        )
    begin, others = line.search(SEARCH_LIMIT)
    if not abs(begin) < SEARCH_LIMIT:
        return TimeOffset(reason=f"readings and positions do not fit within {SEARCH_LIMIT:g} s")
    offset, found, weights = line.refine(begin, moves)
    if len(found) < FEWEST_MOVES:
        return TimeOffset(moves=len(found), reason="too few readings were taken on the way")
    spread = float(weights @ (found - offset) ** 2) / (len(found) - 1)
    otherwise, _, _ = line.refine(offset, moves, cubic=True)
    return TimeOffset(
        time=origin + round(float(np.mean([0.5 * (a + b) for a, b in moves])) * 1e9),
        offset=offset,
        standard_uncertainty=sqrt(
            spread / float(np.sum(weights)) + (otherwise - offset) ** 2 / 3.0
        ),
        degrees_of_freedom=len(found) - 1,
        moves=len(found),
        others=others,
    )


def run_timing(lines: Sequence[TimeOffset]) -> RunTiming:
    """Return how late the readings of a run are stamped, from its lines.

    The mean of the lines, and with three or more of them a straight line through them, weighted by
    their uncertainties. Where they scatter more than these allow, the uncertainty is as much
    larger.
    """
    good = tuple(line for line in lines if not line.reason)
    if not good:
        reasons = sorted({line.reason for line in lines})
        reason = "; ".join(reasons) or "no line was measured"
        return RunTiming(TimeOffset(reason=reason), nan, nan, ())
    origin = good[0].time
    times = np.array([(line.time - origin) * 1e-9 for line in good])
    values = np.array([line.offset for line in good])
    # Two lines of which one has scattered little by chance: no line counts as better than the best
    # half of them.
    uncertainties = np.array([line.standard_uncertainty for line in good])
    weights = 1.0 / np.maximum(uncertainties, max(float(np.median(uncertainties)), 1e-12)) ** 2
    middle = float(weights @ times / np.sum(weights))
    columns = [np.ones(len(good))]
    if len(good) > 2 and np.ptp(times) > 0.0:
        columns.append(times - middle)
    design = np.column_stack(columns)
    covariance = np.linalg.inv(design.T @ (weights[:, None] * design))
    estimate = covariance @ (design.T @ (weights * values))
    freedom = len(good) - len(estimate)
    left = float(weights @ (values - design @ estimate) ** 2)
    covariance *= max(1.0, left / freedom) if freedom else 1.0
    drifts = len(estimate) > 1
    offset = TimeOffset(
        time=origin + round(middle * 1e9),
        offset=float(estimate[0]),
        standard_uncertainty=sqrt(float(covariance[0, 0])),
        degrees_of_freedom=sum(line.degrees_of_freedom for line in good),
        moves=sum(line.moves for line in good),
        others=tuple(sorted({other for line in good for other in line.others})),
    )
    return RunTiming(
        offset,
        float(estimate[1]) if drifts else nan,
        sqrt(float(covariance[1, 1])) if drifts else nan,
        good,
    )


class _Line:
    """One line in seconds since its first position."""

    def __init__(self, at: Vector, place: Vector, times: Vector, values: Vector) -> None:
        self._at, self._place = at, place
        self._times, self._values = times, values
        thin = -(-len(times) // _MOST_IN_SEARCH)
        self._coarse_times, self._coarse_values = times[::thin], values[::thin]
        steps = np.diff(at)
        self._speeds = np.diff(place) / steps
        self._period = float(np.median(steps))

    def moves(self) -> list[tuple[float, float]]:
        """Return begin and end (s) of every move that begins and ends at rest."""
        speeds = np.abs(self._speeds)
        moving = np.concatenate(([False], speeds > _MOVING * float(np.max(speeds)), [False]))
        edges = np.flatnonzero(moving[1:] != moving[:-1])
        pairs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
        last = len(self._at) - 1
        return [
            (float(self._at[begin]), float(self._at[end]))
            for begin, end in pairs
            if begin > 0 and end < last
        ]

    def search(self, limit: float) -> tuple[float, tuple[float, ...]]:
        """Return the offset (s) that fits best, and others that fit about as well."""
        step = max(0.5 * self._period, limit / 200.0)
        count = int(limit / step)
        offsets: Vector = np.asarray(step * np.arange(-count, count + 1), dtype=np.float64)
        left = np.array([self._left(float(offset)) for offset in offsets])
        inner = np.arange(1, len(left) - 1)
        lowest = inner[(left[inner] <= left[inner - 1]) & (left[inner] <= left[inner + 1])]
        best = int(np.argmin(left))
        if best not in lowest:
            return inf, ()
        # On a coarse grid the least is between two offsets: what is there decides.
        floor = min(float(left[best]), self._left(_vertex(offsets, left, best)))
        others = [
            float(offsets[other])
            for other in lowest.tolist()
            if other != best and left[other] <= _AMBIGUOUS * max(floor, 1e-18 * len(self._times))
        ]
        return _vertex(offsets, left, best), tuple(others)

    def refine(
        self, begin: float, moves: list[tuple[float, float]], cubic: bool = False
    ) -> tuple[float, Vector, Vector]:
        """Return the mean offset (s), that of each move, and their weights.

        Args:
            begin: an offset that is near, s.
            moves: begin and end of each, s.
            cubic: take positions as cubic between two samples, not as linear.
        """
        between = self._cubic if cubic else self._linear
        offset, found, weights = begin, np.empty(0), np.empty(0)
        for _ in range(_STEPS):
            told = [
                one for move in self._spans(moves) if (one := self._of_move(move, offset, between))
            ]
            if not told:
                break
            found = offset + np.array([change for change, _ in told])
            weights = np.array([weight for _, weight in told])
            offset = float(weights @ found / np.sum(weights))
        return offset, found, weights

    def _spans(self, moves: list[tuple[float, float]]) -> list[tuple[float, float, float, float]]:
        """Return each move with the rest on both sides that belongs to it, s."""
        ends = [float(self._at[0]), *(end for _, end in moves)]
        begins = [*(begin for begin, _ in moves), float(self._at[-1])]
        spans = []
        for number, (begin, end) in enumerate(moves):
            rest_before = min(_REST, 0.5 * (begin - ends[number]))
            rest_behind = min(_REST, 0.5 * (begins[number + 1] - end))
            spans.append((begin - rest_before, begin, end, end + rest_behind))
        return spans

    def _of_move(
        self,
        span: tuple[float, float, float, float],
        offset: float,
        between: Callable[[Vector], Vector],
    ) -> tuple[float, float] | None:
        """Return by how much (s) the offset of one move differs, and its weight."""
        first, begin, end, last = span
        edges = np.searchsorted(self._times, [t + offset for t in (first, begin, end, last)])
        on_way, at_rest = edges[2] - edges[1], edges[3] - edges[0] - (edges[2] - edges[1])
        if min(on_way, at_rest) < _FEWEST_IN_MOVE:
            return None
        part = slice(int(edges[0]), int(edges[3]))
        times, values = self._times[part] - offset, self._values[part]
        places = between(times)
        way = places - places[0]
        if not abs(way[-1]) > 0.0:
            return None
        bend = way * (1.0 - way / way[-1])
        design = np.column_stack((np.ones(len(times)), way, -self._speed(times), bend))
        estimate, _, rank, _ = np.linalg.lstsq(design, values, rcond=None)
        if rank < 4 or not abs(estimate[1]) > 0.5:
            # It moves across the beam, or what was read is not this move.
            return None
        inverse = np.linalg.inv(design.T @ design)
        weight = float(estimate[1] ** 2 / inverse[2, 2])
        change = float(estimate[2] / estimate[1])
        return (change, weight) if isfinite(change) and isfinite(weight) else None

    def _linear(self, times: Vector) -> Vector:
        places: Vector = np.interp(times, self._at, self._place)
        return places

    def _cubic(self, times: Vector) -> Vector:
        """Return the positions at some times by Hermite's cubic; the first and last stay beyond."""
        at, place = self._at, self._place
        inside = np.clip(times, at[0], at[-1])
        before = np.clip(np.searchsorted(at, inside, side="right") - 1, 0, len(at) - 2)
        length = at[before + 1] - at[before]
        part = (inside - at[before]) / length
        slope = np.gradient(place, at)
        rest = 1.0 - part
        places: Vector = (
            (1.0 + 2.0 * part) * rest**2 * place[before]
            + part**2 * (3.0 - 2.0 * part) * place[before + 1]
            + part * rest * length * (rest * slope[before] - part * slope[before + 1])
        )
        return places

    def _speed(self, times: Vector) -> Vector:
        """Return the speed at some times, m/s, over one period of the positions."""
        half = 0.5 * self._period
        ahead = np.interp(times + half, self._at, self._place)
        behind = np.interp(times - half, self._at, self._place)
        speed: Vector = (ahead - behind) / self._period
        return speed

    def _left(self, offset: float) -> float:
        """Return the sum of squares that one straight line through the whole line leaves, m²."""
        places = np.interp(self._coarse_times - offset, self._at, self._place)
        places = places - float(np.mean(places))
        values = self._coarse_values - float(np.mean(self._coarse_values))
        power = float(places @ places)
        slope = float(places @ values) / power if power > 0.0 else 0.0
        return float(np.sum((values - slope * places) ** 2))


def _vertex(offsets: Vector, left: Vector, best: int) -> float:
    """Return where the parabola through the least of some values and its neighbours is least."""
    before, least, behind = (float(left[best + shift]) for shift in (-1, 0, 1))
    bend = before - 2.0 * least + behind
    shift = 0.5 * (before - behind) / bend if bend > 0.0 else 0.0
    return float(offsets[best] + shift * (offsets[1] - offsets[0]))
