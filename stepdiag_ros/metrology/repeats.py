"""Results of the repeats of a measurement, each solved alone: mean and spread of every curve.

Ibaraki & Hata 2010 measure every line five times and draw the mean of the estimates and their
variation at each point (section 4.1, Figs. 7 to 10). The spread among repeats is what the machine
and the laser did from one repeat to the next; what stays the same in all of them, such as an
alignment, is not in it.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.geometry import Vector, beam_direction
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import BACKWARD, Line
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.solvers.result import NotDeterminable, VolumetricErrors


@dataclass(frozen=True)
class RepeatSpread:
    """A curve over the repeats.

    Attributes:
        values: of each repeat, m or rad, shape (repeats, N + 1).
    """

    values: Vector

    @property
    def mean(self) -> Vector:
        """Return the mean of the repeats, shape (N + 1,)."""
        found: Vector = np.mean(self.values, axis=0)
        return found

    @property
    def low(self) -> Vector:
        """Return the smallest value at each node, shape (N + 1,)."""
        found: Vector = np.min(self.values, axis=0)
        return found

    @property
    def high(self) -> Vector:
        """Return the largest value at each node, shape (N + 1,)."""
        found: Vector = np.max(self.values, axis=0)
        return found

    @property
    def standard_deviation(self) -> Vector:
        """Return the experimental standard deviation of a single repeat, shape (N + 1,)."""
        found: Vector = np.std(self.values, axis=0, ddof=1)
        return found

    @property
    def standard_uncertainty_of_mean(self) -> Vector:
        """Return the type A standard uncertainty of the mean (JCGM 100:2008, 4.2.3), (N + 1,)."""
        found: Vector = self.standard_deviation / np.sqrt(len(self.values))
        return found


@dataclass(frozen=True)
class RepeatResults:
    """What one method makes of each repeat.

    Attributes:
        results: one for each repeat, in their order.
    """

    results: tuple[VolumetricErrors, ...]

    def spread(self, curve: str) -> RepeatSpread:
        """Return a curve over the repeats.

        Raises:
            KeyError: the method does not estimate this curve.
        """
        return RepeatSpread(np.stack([result.curves[curve] for result in self.results]))


def split_repeats(measurement: Measurement) -> tuple[Measurement, ...]:
    """Return one measurement for each repeat that every line of the plan has, in their order.

    Both directions of a repeat stay together. Repeats that only some lines have are left out, so
    that every part has all the lines; the number is 0 where the lines have no repeat in common.
    """
    by_line: dict[Line, set[int]] = {}
    for line in measurement.lines:
        by_line.setdefault(replace(line.line, repeat=0), set()).add(line.line.repeat)
    common = set.intersection(*by_line.values()) if by_line else set()
    return tuple(
        replace(
            measurement,
            lines=tuple(line for line in measurement.lines if line.line.repeat == repeat),
        )
        for repeat in sorted(common)
    )


def solve_repeats(
    measurement: Measurement, methods: Iterable[str]
) -> tuple[dict[str, RepeatResults], dict[str, str]]:
    """Solve each repeat alone by each method.

    Returns:
        method → results, for those that can be determined from every repeat, and method → why not,
        for the rest.

    Raises:
        ValueError: there are fewer than two repeats; no such method; the lines contradict the
            volume.
    """
    parts = split_repeats(measurement)
    if len(parts) < 2:
        raise Refusal(
            f"the lines have {len(parts)} repeats in common; a spread needs two or more",
            fault="too_few",
        )
    found: dict[str, RepeatResults] = {}
    reasons: dict[str, str] = {}
    for method in methods:
        try:
            found[method] = RepeatResults(tuple(solve(part, method) for part in parts))
        except NotDeterminable as missing:
            reasons[method] = str(missing)
    return found, reasons


@dataclass(frozen=True)
class LineErrors:
    """Errors of the displacement along a line, of all its passes.

    Attributes:
        name: of the line, with its move order.
        path: nominal displacement along the beam of each stop, m, shape (stops,).
        errors: reading minus nominal displacement, from the first stop, m, shape (passes, stops).
    """

    name: str
    path: Vector
    errors: Vector


def line_errors(measurement: Measurement) -> tuple[LineErrors, ...]:
    """Return what every line reads beyond its nominal displacement (KIMM, Fig. 2).

    Backward passes are turned round; passes with rejected stops are left out.
    """
    step = np.asarray(measurement.volume.step)
    found: dict[str, tuple[Vector, list[Vector]]] = {}
    for line in measurement.lines:
        if not line.complete:
            continue
        name = f"{line.line.name} {line.line.order}".strip()
        beam = beam_direction(line.line.name, step)
        way = (line.target - line.target[0]) @ beam
        error = line.displacement - line.displacement[0] - way
        if line.line.direction == BACKWARD:
            way, error = (way - way[-1])[::-1], (error - error[-1])[::-1]
        path, errors = found.setdefault(name, (way, []))
        if len(path) == len(error):
            errors.append(error)
    return tuple(LineErrors(name, path, np.stack(errors)) for name, (path, errors) in found.items())
