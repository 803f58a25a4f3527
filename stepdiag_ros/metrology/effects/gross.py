"""Gross errors: axes that run backwards or are swapped, lines under a wrong name or move order.

They are not effects of some size: a run has them or not, and it is better said before anything is
fitted. Two ways show them.

- ``gross_errors`` compares each axis's moves with their nominal displacements. A reversed axis, a
  wrong sign or unit, and, where the steps of the axes differ by more than a few per cent, swapped
  axes and wrong move orders are off by a large factor.
- With equal steps a wrong order or line changes readings by the error curves alone, a few
  micrometres. ``renamed`` gives the run again under every other name of each setup: if one of them
  fits to within the noise and the run's own name does not, that is the line that was measured.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from stepdiag_ros.metrology.geometry import (
    AXES,
    BODY_DIAGONALS,
    FACE_DIAGONALS,
    beam_direction,
    move_orders,
)
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import Line, Volume

_TOLERANCE = 0.01
"""Larger than any error of a machine or a setup over its nominal displacement."""
_TELL_APART = 0.03
_UNITS = ((1e3, "mm"), (1e6, "µm"), (1 / 0.0254, "inches"), (0.5, "half"), (2.0, "double"))


@dataclass(frozen=True)
class _Pass:
    """Measured over nominal displacement of the moves along each set of axes in one pass."""

    line: Line
    ratios: dict[str, float]


def gross_errors(measurement: Measurement) -> tuple[str, ...]:
    """Return a sentence for every gross error that the nominal displacements show; empty if none.

    Moves count by the median over their pass, so that a fringe slip is not a gross error.
    """
    passes = [_pass(line, measurement.volume) for line in measurement.lines]
    wrong = [one for one in passes if any(abs(r - 1.0) > _TOLERANCE for r in one.ratios.values())]
    if not wrong:
        return ()
    reversed_axes = [letter for letter in AXES if _runs_backwards(letter, passes)]
    if len(reversed_axes) == len({name for one in passes for name in "".join(one.ratios)}):
        return ("every reading shrinks where it should grow: the sign of the readings is wrong",)
    found = [
        f"{letter} runs backwards on every line: its readings have the wrong sign there"
        for letter in reversed_axes
    ]
    for one in wrong:
        ratios = {
            name: -ratio if name in reversed_axes else ratio for name, ratio in one.ratios.items()
        }
        if any(abs(ratio - 1.0) > _TOLERANCE for ratio in ratios.values()):
            found.append(f"{one.line}: {_reason(ratios, one.line, measurement.volume)}")
    return tuple(found)


def renamed(measurement: Measurement) -> Iterator[tuple[str, Measurement]]:
    """Yield the run with one setup's passes taken as another line or another move order.

    Yields:
        what is supposed, in words, and the measurement under that supposition: the setup keeps its
        identity, its lines have other commanded positions.
    """
    for setup in dict.fromkeys(line.setup for line in measurement.lines):
        first = next(line.line for line in measurement.lines if line.setup == setup)
        orders = {line.line.order for line in measurement.lines if line.setup == setup}
        if not first.order:
            continue
        for name in (*BODY_DIAGONALS, *FACE_DIAGONALS):
            if name != first.name and first.order in move_orders(name):
                yield (
                    f"what is called {setup} was measured as {name}",
                    _taken_as(measurement, setup, name, ""),
                )
        for order in move_orders(first.name) if len(orders) == 1 else ():
            if order != first.order:
                yield (
                    f"what is called {setup} was measured in the order {order}",
                    _taken_as(measurement, setup, "", order),
                )


def _taken_as(measurement: Measurement, setup: str, name: str, order: str) -> Measurement:
    lines = []
    for line in measurement.lines:
        if line.setup == setup:
            other = replace(line.line, name=name or line.line.name, order=order or line.line.order)
            line = replace(line, line=other, target=other.stops(measurement.volume))
        lines.append(line)
    return replace(measurement, lines=tuple(lines))


def _pass(line: MeasuredLine, volume: Volume) -> _Pass:
    direction = beam_direction(line.line.name, np.asarray(volume.step))
    change = np.diff(line.target, axis=0)
    nominal, measured = change @ direction, np.diff(line.displacement)
    moved = np.abs(change) > 1e-9
    ratios = {}
    for which in np.unique(moved, axis=0):
        rows = np.all(moved == which, axis=1) & np.isfinite(measured) & (np.abs(nominal) > 1e-9)
        if np.any(rows):
            name = "".join(letter for letter, moves in zip(AXES, which, strict=True) if moves)
            ratios[name] = float(np.median(measured[rows] / nominal[rows]))
    return _Pass(line.line, ratios)


def _runs_backwards(letter: str, passes: list[_Pass]) -> bool:
    ratios = [one.ratios[letter] for one in passes if letter in one.ratios]
    return bool(ratios) and all(abs(ratio + 1.0) <= _TOLERANCE for ratio in ratios)


def _reason(ratios: dict[str, float], line: Line, volume: Volume) -> str:
    values = np.array(list(ratios.values()))
    if np.all(np.abs(values + 1.0) <= _TOLERANCE):
        return "its readings shrink where they should grow: forward and backward are exchanged"
    backwards = [name for name, ratio in ratios.items() if abs(ratio + 1.0) <= _TOLERANCE]
    if backwards and all(abs(abs(ratio) - 1.0) <= _TOLERANCE for ratio in ratios.values()):
        other = "".join(
            {"p": "n", "n": "p"}[sense] if letter in backwards else sense
            for letter, sense in zip(AXES, line.name, strict=True)
        )
        return f"{' and '.join(backwards)} moves the other way: another line, perhaps {other}"
    factor = float(np.median(values))
    if np.all(np.abs(values / factor - 1.0) <= _TOLERANCE):
        for unit, word in _UNITS:
            if abs(factor / unit - 1.0) <= _TOLERANCE:
                return (
                    f"its readings are {word} of what they should be"
                    if word in ("half", "double")
                    else f"its readings are in {word}, not in m"
                )
        return f"its readings are {factor:.3g} times what they should be"
    swapped = _swapped(ratios, line, volume) if len(ratios) == len(AXES) else ""
    worst = max(ratios, key=lambda name: abs(ratios[name] - 1.0))
    return swapped or (
        f"the moves of {worst} read {ratios[worst]:.3g} times what they should: wrong step, line"
        " or axis"
    )


def _swapped(ratios: dict[str, float], line: Line, volume: Volume) -> str:
    """Name the exchange of axes that explains the sizes of the moves; empty if none or several.

    A move of axis i by its step a_i reads a_i²/‖a‖. If axis j moves in its stead by a_i, it reads
    a_i·a_j/‖a‖; if the moves came in another order, so that j's own move stands there, a_j²/‖a‖.
    """
    step = np.asarray(volume.step)
    seen = np.array([ratios[letter] for letter in AXES])
    explanations = []
    for order in permutations(range(3)):
        if order == (0, 1, 2):
            continue
        other = step[list(order)] / step
        if np.all(np.abs(seen / other - 1.0) <= _TELL_APART):
            pairs = [AXES[i] for i in range(3) if order[i] != i]
            explanations.append(f"{', '.join(pairs)} are exchanged in the machine")
        if np.all(np.abs(seen / other**2 - 1.0) <= _TELL_APART):
            made = "".join(AXES[order[AXES.index(letter)]] for letter in line.order)
            explanations.append(f"its moves came in the order {made}, not {line.order}")
    return explanations[0] if len(explanations) == 1 else ""
