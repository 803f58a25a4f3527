"""What a gap looks like before it has a name: which moves of which lines, and what it goes with.

Each pattern is a place in the run (the moves of an axis, the stops right after them, whole passes,
the middle of a line, all that follows a certain stop) times something that it goes with (nothing,
direction, time, temperature, repeat), on some or all lines. The pattern that takes most of the gap
for the fewest lines is reported, then what is left is searched again. No physics of any effect is
in
here: patterns say where to look, also where no effect of the catalogue fits.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import Whitened
from stepdiag_ros.metrology.discrepancy.chance import tail
from stepdiag_ros.metrology.discrepancy.findings import Pattern, pattern_words
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.plan import BACKWARD

_LEVEL = 0.001
"""Chance, times the number of columns tried, below which a pattern is reported."""
_MOST = 3
"""Patterns that are reported of one gap."""
_LEAST_SHARE = 0.1
"""A further pattern is reported only if it takes this much of what the first took."""
_LEAST_OF_LINE = 0.05
"""A line is named with others only if it takes this much of what they took."""
_UNDECIDED = 10.0
"""Difference of scores below which the data do not distinguish one pattern from another (odds
1:150).
"""
_ABSORBED = 1e-4
"""Share of a column's squares that the free values must leave for it to be a pattern."""
_FINE = 1e-9
_MOST_JUMPS = 2000
"""Stops at which a jump is looked for; of more, only every second, third, … of each pass."""
JUMP = "shifted by one jump"
SWING = "swinging"
ALONG = "the moves"
TURNED = "opposite forward and backward"
_FEWEST_HALF_WAVES, _MOST_HALF_WAVES = 3, 40
"""Of a swing in the time of the run; slower ones are not distinguished from growing."""
_EVERYWHERE = "all lines"


@dataclass(frozen=True)
class _Trial:
    """Columns of one place and one thing that it goes with, one a line, or one for all lines."""

    place: str
    with_what: str
    lines: tuple[str, ...]
    columns: Vector
    """Shape (stops, lines)."""


@dataclass(frozen=True)
class _Found:
    """A trial and the lines that it was found on."""

    trial: _Trial
    lines: tuple[str, ...]


def patterns(
    problem: Whitened, gap: Vector, span: Vector, stops: Stops, noise_freedom: float
) -> tuple[Pattern, ...]:
    """Return what a gap looks like, clearest pattern first; none if it looks like noise.

    Args:
        problem: whitened.
        gap: whitened, baseline and findings projected out, shape (rows,).
        span: orthonormal columns of the findings, shape (rows, k).
        stops: of the run.
        noise_freedom: degrees of freedom of the noise.
    """
    good = problem.baseline.good
    trials = [*_trials(stops), *_jumps(stops)]
    raw = problem.of(np.column_stack([one.columns for one in trials])[good])
    length = np.sum(raw**2, axis=0)
    left = problem.projected(raw)
    left -= span @ (span.T @ left)
    ends = np.cumsum([one.columns.shape[1] for one in trials])
    blocks = [slice(end - one.columns.shape[1], end) for one, end in zip(trials, ends, strict=True)]
    excess = float(gap @ gap) - (problem.freedom - span.shape[1])
    found: list[Pattern] = []
    gains: list[float] = []
    for _ in range(_MOST):
        first, least = _gains(left, gap, length)[0], _least(gap)
        # Of most blocks no column is worth it.
        scored = [
            _fit(left[:, block], gap, length[block])
            if np.max(first[block], initial=0.0) >= least
            else (0.0, [], np.zeros((len(gap), 0)))
            for block in blocks
        ]
        scores = [_score(gain, basis.shape[1], len(gap)) for gain, _, basis in scored]
        alike = _alike(trials, scores, [len(one[1]) for one in scored])
        best = alike[0]
        gain, chosen, basis = scored[best]
        if not chosen:
            break
        chance = len(length) * float(tail(np.array(gain), float(len(chosen)), noise_freedom))
        if chance > _LEVEL or (gains and gain < _LEAST_SHARE * gains[0]):
            break
        trial = trials[best]
        part = basis @ (basis.T @ gap)
        there = np.any(trial.columns[good][:, chosen] != 0.0, axis=1)
        values = problem.readings(part)[there]
        found.append(
            Pattern(
                place=trial.place,
                lines=_lines(trial, chosen, stops),
                with_what=trial.with_what,
                rms=float(np.sqrt(np.mean(values**2))),
                share=_share(gain, excess, problem.freedom),
                gain=gain,
                p_value=min(chance, 1.0),
                columns=len(chosen),
            )
        )
        others = [_Found(trials[one], _lines(trials[one], scored[one][1], stops)) for one in alike]
        found[-1] = replace(found[-1], or_else=_other_words(others))
        gains.append(gain)
        gap = gap - part
        left = left - basis @ (basis.T @ left)
    return tuple(found)


def _score(gain: float, count: int, readings: int) -> float:
    """Return what a pattern is worth: its gain less what as many columns gain by chance."""
    return gain - count * float(np.log(readings)) if count else -np.inf


def _alike(trials: list[_Trial], scores: list[float], counts: list[int]) -> list[int]:
    """Return the patterns that the data do not distinguish from the best: simplest first.

    Of jumps the clearest comes first, since none is plainer than another.
    """
    least = max(scores) - _UNDECIDED
    near = [one for one, score in enumerate(scores) if score >= least]

    def plainness(one: int) -> tuple[int, int, float]:
        jump = trials[one].with_what == JUMP
        return counts[one], len(trials) if jump else one, -scores[one]

    return sorted(near, key=plainness)


def _other_words(found: list[_Found]) -> tuple[str, ...]:
    """Return what else the first of these could go with, or where else it could be."""
    first = found[0]
    words: dict[str, None] = {}
    for other in found[1:]:
        if other.lines == first.lines and other.trial.place == first.trial.place:
            if SWING not in other.trial.with_what:
                words[other.trial.with_what] = None
        elif (
            first.trial.place != ALONG
            and first.trial.with_what != JUMP
            and other.trial.with_what == first.trial.with_what
        ):
            words[pattern_words(other.trial.place, other.lines)] = None
    return tuple(words)[:_MOST]


def _share(gain: float, excess: float, freedom: int) -> float:
    """Return the share of what exceeds noise; NaN where that is itself within its scatter."""
    if excess < 3.0 * np.sqrt(2.0 * freedom):
        return float("nan")
    return min(gain / excess, 1.0)


def _fit(columns: Vector, gap: Vector, length: Vector) -> tuple[float, list[int], Vector]:
    """Take columns of a block one after another while each is worth it.

    Returns:
        the gain of χ², which columns, and an orthonormal basis of them.
    """
    left = columns.copy()
    basis: list[Vector] = []
    chosen: list[int] = []
    total = 0.0
    while len(chosen) < left.shape[1]:
        gains, squares = _gains(left, gap, length)
        gains[chosen] = 0.0
        best = int(np.argmax(gains))
        if gains[best] < max(_least(gap), _LEAST_OF_LINE * total):
            break
        unit = left[:, best] / np.sqrt(squares[best])
        basis.append(unit)
        chosen.append(best)
        total += float(gains[best])
        left -= np.outer(unit, unit @ left)
    matrix = np.column_stack(basis) if basis else np.zeros((len(gap), 0))
    return total, chosen, matrix


def _gains(left: Vector, gap: Vector, length: Vector) -> tuple[Vector, Vector]:
    """Return what χ² loses by each column alone, and squared lengths, shape (k,) each.

    Args:
        left: columns beyond what is free, shape (rows, k).
        gap: shape (rows,).
        length: squared lengths of the columns before, shape (k,).
    """
    squares = np.einsum("ij,ij->j", left, left)
    usable = squares > _ABSORBED * length
    return np.where(usable, (left.T @ gap) ** 2 / np.where(usable, squares, 1.0), 0.0), squares


def _least(gap: Vector) -> float:
    """Return what χ² must lose by a column that is worth it."""
    return 2.0 * float(np.log(len(gap)))


def _lines(trial: _Trial, chosen: list[int], stops: Stops) -> tuple[str, ...]:
    """Return the names of the lines, in the order of the run; one word where it is all."""
    names = [trial.lines[one] for one in chosen]
    if set(names) == {_EVERYWHERE}:
        return ()
    order = list(dict.fromkeys(line.name for line in stops.lines))
    return tuple(sorted(names, key=lambda name: order.index(name) if name in order else 0))


def _trials(stops: Stops) -> Iterator[_Trial]:
    """Yield every place with everything that it may go with."""
    names = np.array([line.name for line in stops.lines])[stops.pass_index]
    lines = tuple(dict.fromkeys(names.tolist()))
    each = np.column_stack([names == line for line in lines])
    places = list(_places(stops))
    for place, column, shared in places:
        for with_what, factor in _companions(stops):
            own = (column * factor)[:, None] * each
            moving = np.any(own != 0.0, axis=0)
            here = tuple(line for line, is_moving in zip(lines, moving, strict=True) if is_moving)
            if here:
                yield _Trial(place, with_what, here, own[:, moving])
            if len(here) != 1 and np.any(shared != 0.0):
                yield _Trial(place, with_what, (_EVERYWHERE,), (shared * factor)[:, None])
    for with_what, pair in _swings(stops):
        for place, _, shared in places:
            if np.any(shared != 0.0):
                yield _Trial(place, with_what, (_EVERYWHERE,) * 2, shared[:, None] * pair)


def _places(stops: Stops) -> Iterator[tuple[str, Vector, Vector]]:
    """Yield places: words, the column of one line, and that which all lines would share."""
    yield ALONG, stops.along, stops.along
    for axis, letter in enumerate(AXES):
        way = (stops.position - stops.start)[:, axis] / max(stops.travel[axis], _FINE)
        beam = stops.direction[:, axis]
        # What all lines share is counted from the machine's zero, not from each line's start.
        whole = stops.position[:, axis] / max(stops.travel[axis], _FINE)
        yield f"the {letter} moves", way, whole * beam
        moved = stops.moved[:, axis]
        yield f"the stops right after a move of {letter}", moved, moved * beam
    ones = np.ones(len(stops.time))
    yield "whole passes", ones, ones
    for axis, letter in enumerate(AXES):
        # What moves the tool along an axis shows on each line as far as its beam goes that way.
        beam = stops.direction[:, axis]
        yield f"whole passes, as far as they go along {letter}", np.zeros_like(beam), beam
    share = _along(stops)
    bent = 4.0 * share * (1.0 - share)
    yield "the middle of lines, opposite to their ends", bent, bent


def _along(stops: Stops) -> Vector:
    """Return how far along its line each stop is, 0..1."""
    along = np.abs(stops.along)
    longest = np.zeros(len(stops.lines))
    np.maximum.at(longest, stops.pass_index, along)
    share: Vector = along / np.maximum(longest[stops.pass_index], _FINE)
    return share


def _companions(stops: Stops) -> Iterator[tuple[str, Vector]]:
    """Yield what a pattern may go with: words, and the factor at each stop."""
    yield "the same in every pass", np.ones(len(stops.time))
    sense = np.array([-1.0 if line.direction == BACKWARD else 1.0 for line in stops.lines])
    if len(set(sense.tolist())) > 1:
        yield TURNED, sense[stops.pass_index]
    yield "growing with time", stops.time - stops.time.min()
    for words, values in (
        ("growing with the material temperature", stops.material_temperature),
        ("growing with the air temperature", stops.air_temperature),
    ):
        if np.all(np.isfinite(values)) and np.ptp(values) > 0.0:
            yield words, values - values[0]
    for axis, letter in enumerate(AXES):
        yield f"growing with the place of {letter}", stops.position[:, axis]
    repeat = np.array([line.repeat for line in stops.lines], dtype=np.float64)
    if np.ptp(repeat) > 0.0:
        yield "different from repeat to repeat", (repeat - repeat.mean())[stops.pass_index]


def _swings(stops: Stops) -> Iterator[tuple[str, Vector]]:
    """Yield waves over the time of the run: words, and sine and cosine at each stop."""
    passed = stops.time - stops.time.min()
    for half_waves in range(_FEWEST_HALF_WAVES, _MOST_HALF_WAVES + 1):
        period = 2.0 * stops.duration / half_waves
        if period > 0.0:
            phase = 2.0 * np.pi * passed / period
            words = f"{SWING} with a period of about {_rounded(period)} s"
            yield words, np.column_stack([np.sin(phase), np.cos(phase)])


def _jumps(stops: Stops) -> Iterator[_Trial]:
    """Yield all that follows a stop in its setup, for every stop at which a jump could be."""
    order = np.lexsort((stops.time, stops.setup))
    every = -(-len(order) // _MOST_JUMPS)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    for index, line in enumerate(stops.lines):
        rows = np.flatnonzero(stops.pass_index == index)[::every]
        later = (stops.setup[:, None] == stops.setup[rows]) & (rank[:, None] >= rank[rows])
        for row, column in zip(rows, later.T, strict=True):
            yield _Trial(
                f"all that its setup measured from stop {stops.number[row]} of {line} on",
                JUMP,
                (_EVERYWHERE,),
                column[:, None].astype(np.float64),
            )


def _rounded(value: float) -> str:
    """Write two significant digits, without an exponent."""
    return f"{float(f'{value:.2g}'):,.10g}"
