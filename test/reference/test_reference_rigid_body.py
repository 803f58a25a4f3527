"""The rigid-body solver against certified values (see certify_rigid_body.py), and what is none."""

import numpy as np
import pytest
from certified import matching_digits, names_of, read

from stepdiag_ros.metrology.geometry import ROTATIONS, TRANSLATIONS
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import LINEAR, STEP_DIAGONAL, Line, Volume
from stepdiag_ros.metrology.plausible import NOTHING
from stepdiag_ros.metrology.solvers import solve

DEMANDED = 4.5
"""Five digits are certified; the noise is a thousandth of the errors, so these are the estimate's.
"""


def measurement_of(problem):
    volume = Volume((0.0, 0.0, 0.0), tuple(problem["step_m"]), problem["blocks"])
    extent = np.array(problem["step_m"]) * problem["blocks"]
    lines = []
    for index, posed in enumerate(problem["lines"]):
        offset = tuple(float(v) for v in extent * np.array(posed["corner"]))
        kind = STEP_DIAGONAL if posed["order"] else LINEAR
        line = Line(kind, posed["name"], posed["order"], 0, "forward", offset)
        values = np.array(posed["reading_m"])
        lines.append(
            MeasuredLine(
                line=line,
                line_index=index,
                attempt=1,
                setup=posed["setup"],
                time=np.arange(len(values), dtype=float),
                end_time=index,
                target=line.stops(volume),
                displacement=values,
                standard_uncertainty=np.full(len(values), problem["noise_m"]),
                environment=np.full((len(values), 4), np.nan),
            )
        )
    return Measurement(volume, tuple(lines), problem["chain"], NOTHING)


@pytest.mark.parametrize("name", names_of("rigid_body"))
def test_digits(name):
    problem = read(name)
    result = solve(measurement_of(problem), "rigid_body")
    digits = {}
    for curve in (*TRANSLATIONS, *ROTATIONS):
        values = problem["certified"][curve]
        told = [k for k, value in enumerate(values) if value is not None and k > 0]
        if told:
            digits[curve] = matching_digits(
                result.curves[curve][told], [values[k] for k in told], problem["size"]
            )
    print(f"\n{name}: {len(digits)} curves, {min(digits.values()):.1f} digits at least", end="")
    assert len(digits) >= 9
    assert min(digits.values()) >= DEMANDED, digits
