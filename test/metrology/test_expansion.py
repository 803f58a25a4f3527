"""Correction to 20 degC: a steel machine measured warm gives what it is at 20 degC."""

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from refused import refused

from stepdiag_ros.metrology.expansion import (
    at_reference_temperature,
    expansion_remark,
    to_reference_temperature,
)
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve

STEEL = 11.5e-6


def measurement(temperature=None):
    made = simulate(make_plan(), make_cell(noise=0.0), seed=1)
    if temperature is not None:
        for line in made.lines:
            line.environment[:, 3] = temperature
    return made


def warm(cold, temperature):
    """Return what the laser would read of the same machine when it is as warm as that."""
    for line in cold.lines:
        line.environment[:, 3] = temperature
        line.displacement[:] *= 1.0 + STEEL * (temperature - 20.0)
    return cold


def test_a_metre_of_steel_at_30_degrees_is_115_micrometres_shorter_at_20():
    assert 1.0 - at_reference_temperature(1.0, STEEL, 30.0) == pytest.approx(115e-6, rel=2e-4)
    assert at_reference_temperature(1.0, STEEL, 20.0) == 1.0
    assert at_reference_temperature(1.0, STEEL, 10.0) > 1.0


def test_the_results_of_a_warm_machine_are_those_of_20_degrees():
    true = solve(measurement(20.0))
    uncorrected = warm(measurement(), 26.5)
    found = solve(to_reference_temperature(uncorrected, STEEL))
    for name, curve in true.curves.items():
        assert found.curves[name] == pytest.approx(curve, abs=1e-15)
    # Without it, every axis is 6.5 K · 11.5 µm/(m K) too long and squareness hardly changed.
    raw = solve(uncorrected)
    longer = raw.figure("positioning E_XX").value - true.figure("positioning E_XX").value
    assert longer == pytest.approx(0.06 * 6.5 * STEEL, rel=1e-3)
    assert raw.figure("C0Y").value == pytest.approx(true.figure("C0Y").value, rel=1e-3)


def test_a_given_temperature_goes_before_the_recorded_one():
    uncorrected = warm(measurement(), 30.0)
    for line in uncorrected.lines:
        line.environment[:, 3] = 25.0
    given = to_reference_temperature(uncorrected, STEEL, 30.0)
    assert solve(given).figure("positioning E_YY").value == pytest.approx(
        solve(measurement(20.0)).figure("positioning E_YY").value, abs=1e-15
    )


def test_the_uncorrected_values_are_kept():
    uncorrected = warm(measurement(), 30.0)
    before = [line.displacement.copy() for line in uncorrected.lines]
    corrected = to_reference_temperature(uncorrected, STEEL)
    for line, kept, changed in zip(uncorrected.lines, before, corrected.lines, strict=True):
        assert np.array_equal(line.displacement, kept)
        assert changed.displacement[-1] != kept[-1]
    words = expansion_remark(uncorrected, STEEL)
    assert "11.5 µm/(m K)" in words
    assert "30.00 to 30.00 degC as recorded" in words
    assert "the bag keeps the uncorrected readings" in words
    assert "28.00 degC as given" in expansion_remark(uncorrected, STEEL, 28.0)


def test_unknown_temperature_is_refused_and_rejected_stops_do_not_matter():
    unknown = measurement(22.0)
    unknown.lines[1].environment[3, 3] = np.nan
    with refused(Refusal, "undetermined", "3"):
        to_reference_temperature(unknown, STEEL)
    unknown.lines[1].displacement[3] = np.nan
    assert np.isnan(to_reference_temperature(unknown, STEEL).lines[1].displacement[3])


@pytest.mark.parametrize("coefficient", [-1e-6, 11.5, float("nan")])
def test_impossible_coefficients_are_refused(coefficient):
    with refused(Refusal, "out_of_range", "11.5e-6"):
        to_reference_temperature(measurement(20.0), coefficient)
