"""Two measurements of which only one was begun beyond the ends of its lines (overrun).

The first stop of a run without overrun is approached from elsewhere, mostly against the sense of
the run. Its reading is then off by up to the reversal error of the axis, and with it the
curves: the machine would be called changed because it was measured in another way. The sense of
approach is not known; so such a stop has one standard uncertainty more, the reversal error of the
axis (rms over the targets that determine it; of both measurements the larger). Where neither
determines one (unidirectional runs), it is ``UNKNOWN_REVERSAL``. Measured in the same way twice,
the effect is in both, and cancels.
"""

from dataclasses import replace

import numpy as np

from stepdiag_ros.metrology.agreement.measured import ComparedMeasurement
from stepdiag_ros.metrology.agreement.reversal import ReversedAxis, reversed_axes
from stepdiag_ros.metrology.geometry import AXES, LINEAR_LINES, Vector
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD, LINEAR
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.solvers.result import VolumetricErrors

UNKNOWN_REVERSAL = 1e-5
"""m: more than the reversal error of most axes; so what depends on it is hardly determined."""


def by_their_approach(
    before: ComparedMeasurement, after: ComparedMeasurement
) -> tuple[ComparedMeasurement, ComparedMeasurement, list[str]]:
    """Return two measurements with what their different overrun adds, and remarks.

    Args:
        before: the first.
        after: the second.
    """
    measurements = [one.measurement for one in (before, after) if one.measurement is not None]
    if len(measurements) < 2:
        return before, after, []
    sides, told = [before, after], [reversed_axes(one) for one in measurements]
    lacking = [_without_overrun(one) for one in measurements]
    remarks = []
    for row, when in enumerate(("before", "after")):
        without = lacking[row] - lacking[1 - row]
        names = [letter for letter in AXES if letter in without]
        if not names:
            continue
        sizes = {name: _reversal(name, told) for name in names}
        sides[row] = replace(sides[row], approach=_covariance(sides[row], measurements[row], sizes))
        unknown = [name for name in names if sizes[name] == UNKNOWN_REVERSAL]
        remarks.append(
            f"the runs of {', '.join(names)} {when} do not begin beyond their ends, the others do"
            " (overrun): by the reversal error of the axis alone the two may differ. The first"
            f" stop of these runs {when} has the reversal error as a further standard uncertainty"
            + (
                f"; of {', '.join(unknown)} it was not measured, and"
                f" {UNKNOWN_REVERSAL * 1e6:g} µm is taken"
                if unknown
                else ""
            )
        )
    return sides[0], sides[1], remarks


def _without_overrun(measurement: Measurement) -> set[str]:
    """Return the axes of which a run is not known to begin beyond its first stop."""
    return {
        AXES[LINEAR_LINES.index(one.line.name)]
        for one in measurement.lines
        if one.line.kind == LINEAR and not one.overrun > 0.0
    }


def _reversal(name: str, told: list[dict[str, ReversedAxis]]) -> float:
    """Return the rms of the axis' reversal errors, m, the larger one of both measurements."""
    errors = [one[name].errors for one in told if name in one]
    known = [float(np.sqrt(np.mean(one**2))) for one in errors if one.size]
    return max(known, default=UNKNOWN_REVERSAL)


def _covariance(
    one: ComparedMeasurement, measurement: Measurement, sizes: dict[str, float]
) -> Vector:
    """Return what the first stops add to the covariance of the stacked curves, shape (k, k)."""
    stacked = _stacked(one.result, measurement)
    made = np.zeros((stacked.size, stacked.size))
    for name, size in sizes.items():
        for direction in (FORWARD, BACKWARD):
            lines = tuple(
                _shifted(line, size) if _is_of(line, name, direction) else line
                for line in measurement.lines
            )
            effect = _stacked(one.result, replace(measurement, lines=lines)) - stacked
            made += np.outer(effect, effect)
    return made


def _is_of(line: MeasuredLine, name: str, direction: str) -> bool:
    return (
        line.line.kind == LINEAR
        and AXES[LINEAR_LINES.index(line.line.name)] == name
        and line.line.direction == direction
        and not line.overrun > 0.0
    )


def _shifted(line: MeasuredLine, size: float) -> MeasuredLine:
    displacement = line.displacement.copy()
    displacement[0] += size
    return replace(line, displacement=displacement)


def _stacked(result: VolumetricErrors, measurement: Measurement) -> Vector:
    """Return the curves of a result's method from a measurement, stacked; 0 where unknown."""
    curves = solve(measurement, result.method).curves
    made: Vector = np.nan_to_num(np.concatenate([curves[name] for name in result.curves]))
    return made
