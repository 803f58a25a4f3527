"""How the machine moved in a pass, from its positions alone: moves, corners, feed."""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import Vector, inner
from stepdiag_ros.metrology.on_the_fly.record import Finding, Flags, PassFault, PassRecord
from stepdiag_ros.metrology.plan import moved_axes

FEWEST_POSITIONS = 8
"""In a move, without which it is not evaluated."""
LONGEST_PERIOD = 0.011
"""s from one position to the next; with more, the way between two is not known well enough."""
GAP = 2.5
"""Periods of the positions without one that are a gap."""
FEED_TOLERANCE = 0.05
"""Part of the feed by which it may vary within a move, and from move to move."""
_MOST_HIDDEN = 0.2
"""Part of a move that a gap may hide."""
_FEWEST_IN_CORNER = 2
"""Positions beside a gap at a corner."""
_MOVED = 1e-7
"""m: an axis that has gone farther has begun its move; its own delay counts from there."""
_FEED_SPAN = 0.02
_SPEED_SPAN = 0.005
"""s, either way, over which a speed is taken, to judge the feed and to fit the delay."""


@dataclass(frozen=True)
class Motion:
    """The way of a pass, along its moves.

    Attributes:
        origin: time of the first position, ns.
        at: times of the positions, s since then, shape (n,).
        period: of the positions, s.
        way: of the machine along its path, m, shape (n,).
        speed: along the path, m/s, shape (n,).
        acceleration: along the path, m/s², shape (n,).
        smooth_speed: the same as ``speed``, over a longer time, m/s, shape (n,).
        lengths: of the moves, m, shape (moves,).
        units: directions of the moves, shape (moves, 3).
        axes: that each move moves.
        onsets: when each move leaves its first node, s, shape (moves,).
        ends: when each move reaches its last node, s, shape (moves,).
        feeds: highest steady speed of each move, m/s, shape (moves,).
    """

    origin: int
    at: Vector
    period: float
    way: Vector
    speed: Vector
    acceleration: Vector
    smooth_speed: Vector
    lengths: Vector
    units: Vector
    axes: tuple[str, ...]
    onsets: Vector
    ends: Vector
    feeds: Vector

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Return begin and end of each gap in the positions, s."""
        wide = np.flatnonzero(np.diff(self.at) > GAP * self.period)
        return [(float(self.at[index]), float(self.at[index + 1])) for index in wide.tolist()]

    def known(self, times: Vector) -> Flags:
        """Say at which times (s) the position is known, because no gap is there."""
        known: Flags = np.ones(len(times), dtype=np.bool_)
        for begin, end in self.gaps:
            known &= (times < begin) | (times > end)
        return known

    def steady(self, move: int, speed: Vector) -> Flags:
        """Say at which speeds within a move (from 0) its feed is constant."""
        feed = self.feeds[move]
        constant: Flags = np.abs(speed - feed) <= FEED_TOLERANCE * feed
        return constant


def motion_of(record: PassRecord) -> Motion | Finding:
    """Return the motion of a pass, or the reason for not having it."""
    moves = record.moves
    at: Vector = (record.position_times - record.position_times[:1]) * np.float64(1e-9)
    if len(at) < FEWEST_POSITIONS * moves:
        return _seldom(f"{len(at)} in {moves} moves")
    if np.any(np.diff(at) <= 0.0):
        return Finding(
            PassFault.CLOCK_STEP,
            "the clock of the controller stepped back: the time stamps of the positions do not"
            " rise; measure the line again",
        )
    period = float(np.median(np.diff(at)))
    if period > LONGEST_PERIOD:
        return _seldom(f"every {period * 1e3:.3g} ms")
    steps = np.diff(record.targets, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    units = steps / lengths[:, np.newaxis]
    begins = inner(units, record.targets[:-1])
    corners = np.concatenate(([0.0], np.cumsum(lengths)))
    way = np.zeros(len(at))
    for unit, begin, length in zip(units, begins.tolist(), lengths.tolist(), strict=True):
        way += np.clip(inner(record.positions, unit) - begin, 0.0, length)
    near = min(record.corner, 0.1 * float(np.min(lengths)))
    onsets = np.array([_last(way <= corner + _MOVED, at) for corner in corners[:-1]])
    ends = np.array([_first(way >= corner - near, at) for corner in corners[1:]])
    reach = max(1, round(_SPEED_SPAN / period))
    speed = _slope(at, way, reach)
    # Where time stamps scatter, a speed is known over a longer time only.
    smooth = _slope(at, way, max(1, round(_FEED_SPAN / period)))
    feeds = np.zeros(moves)
    for move in range(moves):
        inside = (at > onsets[move]) & (at < ends[move])
        if np.count_nonzero(inside) < FEWEST_POSITIONS:
            return _seldom(f"{np.count_nonzero(inside)} in move {move + 1}")
        feeds[move] = np.percentile(smooth[inside], 80.0)
    return Motion(
        origin=int(record.position_times[0]),
        at=at,
        period=period,
        way=way,
        speed=speed,
        acceleration=_slope(at, speed, reach),
        lengths=lengths,
        units=units,
        axes=tuple(
            moved_axes(a, b) for a, b in zip(record.targets[:-1], record.targets[1:], strict=True)
        ),
        onsets=onsets,
        ends=ends,
        smooth_speed=smooth,
        feeds=feeds,
    )


def faults_of_motion(record: PassRecord, motion: Motion) -> list[Finding]:
    """Return what is wrong with the motion: gaps in its record, corners, feed."""
    return [
        *_gaps(motion),
        *_blended(record, motion),
        *_feed_changes(motion),
    ]


def _gaps(motion: Motion) -> list[Finding]:
    """Find the gaps that hide a corner, or much of a move; in others only the readings are left."""
    found = []
    for begin, end in motion.gaps:
        moves = set()
        for move, (onset, reached) in enumerate(zip(motion.onsets, motion.ends, strict=True)):
            left = _end_of_interval(motion, move)
            hidden = min(end, reached) - max(begin, onset)
            seen = np.count_nonzero((motion.at >= reached) & (motion.at <= left))
            corner = begin < left and end > reached and seen < _FEWEST_IN_CORNER
            if hidden > _MOST_HIDDEN * (reached - onset) or corner:
                moves.add(move + 1)
        text = (
            f"the positions pause for {(end - begin) * 1e3:.3g} ms (their period is"
            f" {motion.period * 1e3:.3g} ms), or their clock stepped"
        )
        if moves:
            found.append(Finding(PassFault.POSITION_GAP, text, frozenset(moves)))
    return found


def _end_of_interval(motion: Motion, move: int) -> float:
    later = move + 1 < len(motion.onsets)
    return float(motion.onsets[move + 1] if later else motion.at[-1])


def _blended(record: PassRecord, motion: Motion) -> list[Finding]:
    """Find the corners through which the path did not pass, or without a stay."""
    missed: dict[int, float] = {}
    for move in range(record.moves - 1):
        if any(
            begin < motion.onsets[move + 1] + motion.period and end > motion.ends[move] - 1e-9
            for begin, end in motion.gaps
        ):
            continue
        stay = slice(
            *np.searchsorted(motion.at, (motion.ends[move], motion.onsets[move + 1])).tolist()
        )
        around = slice(max(0, stay.start - 2), max(stay.stop, stay.start) + 2)
        off = np.max(np.abs(record.positions[around] - record.targets[move + 1]), axis=1)
        if motion.ends[move] > motion.onsets[move + 1] or np.min(off) > record.corner:
            missed[move + 1] = float(np.min(off))
    if not missed:
        return []
    text = (
        f"the controller blended {len(missed)} of {record.moves - 1} corners although exact stop"
        f" was asked: the path missed them by up to {max(missed.values()) * 1e6:.3g} µm; set exact"
        " stop (G61, G9) at the controller"
    )
    if len(missed) == record.moves - 1:
        return [Finding(PassFault.BLENDED_CORNER, text)]
    return [
        Finding(PassFault.BLENDED_CORNER, text, frozenset(m for c in missed for m in (c, c + 1)))
    ]


def _feed_changes(motion: Motion) -> list[Finding]:
    """Find the moves whose feed is not steady, or that took another time than those like them."""
    found: dict[int, float] = {}
    times = motion.ends - motion.onsets
    for move, (axes, length) in enumerate(zip(motion.axes, motion.lengths, strict=True)):
        alike = [
            other == axes and abs(way - length) < 1e-6
            for other, way in zip(motion.axes, motion.lengths, strict=True)
        ]
        usual = float(np.median(times[alike]))
        # What a gap hides may be missing, or be too much.
        unsure = 2.0 * motion.period + sum(
            end - begin
            for begin, end in motion.gaps
            if begin <= motion.ends[move] and end >= motion.onsets[move]
        )
        longer = max(0.0, abs(float(times[move]) - usual) - unsure) / usual
        inside = (motion.at > motion.onsets[move]) & (motion.at < motion.ends[move])
        speed = motion.smooth_speed[inside]
        fast = np.flatnonzero(speed >= (1.0 - FEED_TOLERANCE) * motion.feeds[move])
        dip = 1.0 - float(np.min(speed[fast[0] : fast[-1] + 1])) / float(motion.feeds[move])
        if longer > FEED_TOLERANCE or dip > 2.0 * FEED_TOLERANCE:
            found[move + 1] = max(longer, dip)
    if not found:
        return []
    listed = ", ".join(map(str, found))
    text = (
        f"the feed changed by {100.0 * max(found.values()):.0f} % in move {listed}: was the"
        " override turned?"
    )
    return [Finding(PassFault.FEED_CHANGED, text, frozenset(found))]


def _seldom(found: str) -> Finding:
    return Finding(
        PassFault.NO_POSITIONS,
        f"{PassFault.NO_POSITIONS.value}: {found}; {FEWEST_POSITIONS} are needed in a move, at"
        f" least every {LONGEST_PERIOD * 1e3:g} ms. Without them delay, vibration and the errors"
        " between the nodes stay unknown; the line is measured with stops at its corners instead."
        " Raise 'position_rate' of the bridge",
    )


def _slope(at: Vector, values: Vector, reach: int) -> Vector:
    """Return the slope over some samples either way, shape (n,)."""
    behind = np.maximum(np.arange(len(at)) - reach, 0)
    ahead = np.minimum(np.arange(len(at)) + reach, len(at) - 1)
    slope: Vector = (values[ahead] - values[behind]) / (at[ahead] - at[behind])
    return slope


def _first(holds: Flags, at: Vector) -> float:
    return float(at[int(np.argmax(holds))]) if holds.any() else float(at[-1])


def _last(holds: Flags, at: Vector) -> float:
    return float(at[len(at) - 1 - int(np.argmax(holds[::-1]))]) if holds.any() else float(at[0])
