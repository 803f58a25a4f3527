"""A wrong reading in words, as somebody looks for it in a table."""

from dataclasses import replace

import pytest
from cells_for_tests import make_cell, make_plan

from stepdiag_ros.metrology.discrepancy import diagnose
from stepdiag_ros.metrology.simulation import simulate


@pytest.fixture(scope="module")
def run():
    plan = make_plan(repeats=2, directions=("forward", "backward"))
    return simulate(plan, make_cell(), seed=1)


@pytest.mark.parametrize(
    ("size", "words"), [(900e-6, "+900 µm"), (-90e-6, "-90 µm"), (1.5e-3, "+1500 µm")]
)
def test_the_size_of_a_wrong_reading_has_no_exponent(run, size, words):
    first = run.lines[0]
    displacement = first.displacement.copy()
    displacement[3] += size
    lines = (replace(first, displacement=displacement), *run.lines[1:])
    found = diagnose(replace(run, lines=lines))
    (which,) = found.wrong_readings
    assert f"{which} is off by about {words}" in found.sentence
