"""Where the gap is: split over line, moved axis, block, direction, repeat, time and temperature."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.discrepancy.baseline import Whitened
from stepdiag_ros.metrology.discrepancy.chance import tail
from stepdiag_ros.metrology.discrepancy.findings import Pattern, Share
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.plan import BACKWARD

_LEVEL = 0.001
"""Chance, times the number of parts, below which a part is called conspicuous."""
_APART = 1.3
"""Factor by which a part's rms must exceed that of the rest to be where the gap is."""
_TREND = 0.6
_THIRDS = ("first third", "second third", "last third")

Part = tuple[str, str, NDArray[np.bool_]]


def gap_map(
    problem: Whitened, gap: Vector, span: Vector, stops: Stops, noise_freedom: float
) -> tuple[Share, ...]:
    """Split a gap in several ways.

    Args:
        problem: whitened.
        gap: whitened, baseline and findings projected out, shape (rows,).
        span: orthonormal columns of the findings, shape (rows, k).
        stops: of the run.
        noise_freedom: degrees of freedom of the noise.
    """
    count = len(problem.baseline.gap)
    readings = problem.readings(gap)
    taken = np.sum(problem.span[:count] ** 2, axis=1) + np.sum(span[:count] ** 2, axis=1)
    free = np.maximum(1.0 - taken, 0.0)
    squares = gap[:count] ** 2
    shares = []
    for split, part, whole in _parts(stops):
        here = whole[problem.baseline.good]
        number = int(np.count_nonzero(here))
        expected = float(np.sum(free[here]))
        if not number or expected < 0.5:
            continue
        values = readings[here]
        chance = tail(np.array(float(np.sum(squares[here]))), expected, noise_freedom)
        shares.append(
            Share(
                split,
                part,
                float(np.mean(values)),
                float(np.sqrt(np.mean(values**2))),
                number,
                float(chance),
            )
        )
    return tuple(shares)


def _parts(stops: Stops) -> Iterator[Part]:
    """Yield every way of splitting the stops: its name, the part's name, the stops in it."""
    of_pass = stops.pass_index
    lines = stops.lines

    def grouped(split: str, names: list[str]) -> Iterator[Part]:
        each = np.array(names)
        for name in dict.fromkeys(names):
            yield split, name, (each == name)[of_pass]

    yield from grouped("line", [line.name for line in lines])
    yield from grouped("setup", [f"{line.name} {line.order}".strip() for line in lines])
    yield from grouped("pass", [str(line) for line in lines])
    yield from grouped("direction", [line.direction for line in lines])
    yield from grouped("repeat", [str(line.repeat) for line in lines])
    moved = [
        "".join(axis for axis, sense in zip(AXES, row, strict=True) if sense) for row in stops.moved
    ]
    after = np.array(moved)
    for axes in sorted(set(moved) - {""}):
        yield "moved axis", axes, after == axes
    names = np.array([line.name for line in lines])[of_pass]
    for axes in sorted(set(moved) - {""}):
        for name in dict.fromkeys(names.tolist()):
            yield "moved axis and line", f"{axes} of {name}", (after == axes) & (names == name)
    block = _blocks(stops)
    for number in range(1, int(block.max()) + 1):
        yield "block", str(number), block == number
    along = np.sum(stops.direction * (stops.position - stops.start), axis=1)
    length = np.array([np.ptp(along[of_pass == i]) for i in range(len(lines))])[of_pass]
    third = np.minimum(3.0 * along / np.maximum(length, 1e-9) + 1e-6, 2.0).astype(np.int64)
    yield from _in_thirds("place along the line", third)
    yield from _in_thirds("time", _ranks(stops.time))
    if np.all(np.isfinite(stops.material_temperature)) and np.ptp(stops.material_temperature) > 0.0:
        yield from _in_thirds("material temperature", _ranks(stops.material_temperature))
    if np.all(np.isfinite(stops.air_temperature)) and np.ptp(stops.air_temperature) > 0.0:
        yield from _in_thirds("air temperature", _ranks(stops.air_temperature))


def _blocks(stops: Stops) -> NDArray[np.int64]:
    """Return the block that each stop ends, counted from its line's start; 0 at that start."""
    block = np.zeros(len(stops.number), dtype=np.int64)
    for index, line in enumerate(stops.lines):
        rows = np.flatnonzero(stops.pass_index == index)
        moves = {tuple(row) for row in np.abs(stops.moved[rows]).tolist() if any(row)}
        stop = stops.number[rows] - stops.number[rows].min()
        if line.direction == BACKWARD:
            stop = stop.max() - stop
        block[rows] = -(-stop // max(len(moves), 1))
    return block


def _ranks(values: Vector) -> NDArray[np.int64]:
    order = np.argsort(np.argsort(values, kind="stable"), kind="stable")
    ranks: NDArray[np.int64] = (3 * order) // max(len(values), 1)
    return ranks


def _in_thirds(split: str, third: NDArray[np.int64]) -> Iterator[Part]:
    for number, words in enumerate(_THIRDS):
        yield split, words, third == number


def sentences(
    shares: tuple[Share, ...], looks: tuple[Pattern, ...], shape: str, noise: float
) -> tuple[str, ...]:
    """Say where a gap is.

    Args:
        shares: of ``gap_map``.
        looks: of ``patterns``.
        shape: in which the fit is worst, from the lack-of-fit test.
        noise: standard deviation of a reading, m.
    """
    words = [_pattern_sentence(number, look) for number, look in enumerate(looks)]
    if not looks:
        words.append(f"The gap is clearest in: {shape}.")
    bad = [share for share in shares if share.p_value * len(shares) < _LEVEL]
    if not bad:
        return (*words, "It is spread thinly: no part of the run stands out by itself.")
    single = _single_pass(shares)
    if single:
        return (*words, single)
    for split in _KINDS:
        found = _sentence(split, shares, noise)
        if found:
            words.append(found)
    words.extend(_trends(shares))
    worst = max(bad, key=lambda share: share.rms)
    words.append(
        f"It is largest in {worst.split} {worst.part}: rms {worst.rms * 1e6:.2f} µm "
        f"beside a noise of {noise * 1e6:.2f} µm."
    )
    return tuple(words)


_PARTS = ("The gap", "A second part", "A third part")


def _pattern_sentence(number: int, look: Pattern) -> str:
    start = f"{_PARTS[number]} is in" if number < len(_PARTS) else "A further part is in"
    share = f", {100.0 * look.share:.0f} % of what exceeds noise" if look.share > 0.0 else ""
    other = f"; or as well: {'; '.join(look.or_else)}" if look.or_else else ""
    return f"{start} {look.words} ({look.rms * 1e6:.2f} µm rms{share}){other}."


def _single_pass(shares: tuple[Share, ...]) -> str:
    passes = [share for share in shares if share.split == "pass"]
    squares = np.array([share.rms**2 * share.readings for share in passes])
    if len(passes) < 3:
        return ""
    worst = int(np.argmax(squares))
    others = np.delete(squares / np.array([share.readings for share in passes]), worst)
    own = passes[worst].rms ** 2
    if own > 3.0 * float(np.max(others)) and passes[worst].p_value * len(shares) < _LEVEL:
        return (
            f"It is in a single pass: {passes[worst].part}, rms {passes[worst].rms * 1e6:.2f} µm, "
            f"the other passes at most {float(np.sqrt(np.max(others))) * 1e6:.2f} µm."
        )
    return ""


_KINDS = {
    "line": ("line", "lines"),
    "moved axis": ("the moves of", "the moves of"),
    "block": ("block", "blocks"),
    "direction": ("the direction", "the directions"),
    "repeat": ("repeat", "repeats"),
}
"""Split → what one part of it is called, and what several are."""


def _sentence(split: str, shares: tuple[Share, ...], noise: float) -> str:
    parts = [share for share in shares if share.split == split]
    if len(parts) < 2:
        return ""
    bad = [
        share
        for share in parts
        if share.p_value * len(shares) < _LEVEL and share.rms > _APART * _rest(share, parts)
    ]
    if not bad:
        return ""
    *first, last = (
        f"{share.part} ({share.rms * 1e6:.2f} µm)"
        for share in sorted(bad, key=lambda share: -share.rms)[:4]
    )
    named = f"{', '.join(first)} and {last}" if first else last
    kind = _KINDS[split][len(first) > 0]
    rest = [share for share in parts if share not in bad]
    others = float(np.sqrt(np.mean([share.rms**2 for share in rest]))) if rest else noise
    return f"It is in {kind} {named}; elsewhere {others * 1e6:.2f} µm (rms)."


def _rest(share: Share, parts: list[Share]) -> float:
    squares = sum(other.rms**2 * other.readings for other in parts if other is not share)
    readings = sum(other.readings for other in parts if other is not share)
    return float(np.sqrt(squares / readings))


def _trends(shares: tuple[Share, ...]) -> list[str]:
    words = []
    for split in ("time", "material temperature", "air temperature", "place along the line"):
        parts = [share for share in shares if share.split == split]
        if len(parts) != len(_THIRDS) or min(p.p_value for p in parts) * len(shares) > _LEVEL:
            continue
        first, _, last = (share.rms for share in parts)
        if min(first, last) < _TREND * max(first, last):
            way = "grows" if last > first else "shrinks"
            words.append(
                f"It {way} with {split}: {first * 1e6:.2f} µm in the first third, "
                f"{last * 1e6:.2f} µm in the last (rms)."
            )
    return words
