"""Periods that show the same at stops of one distance: none of them is named alone."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from hidden_runs import with_change

from stepdiag_ros.metrology.discrepancy import AMBIGUOUS, NAMED, diagnose
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.simulation import simulate

PITCH = catalogue()["pitch-periodic error"]
SIZES = {"sine": 1e-6, "cosine": 0.5e-6}


def diagnosed(period, step):
    """Return the diagnosis of a run whose Z has an error with a period, its own curve known."""
    plan = make_plan(blocks=12, step=(step,) * 3, repeats=2, directions=("forward", "backward"))
    cell = make_cell(high=(0.12,) * 3, noise=0.02e-6)
    run = simulate(plan, cell, 3)
    hidden = ActiveEffect(PITCH, {"axis": "Z", "period_m": period}, SIZES)
    run = with_change(run, hidden.readings(stops_of(run)))
    known = cell.truth(plan.volume)["E_ZZ"]
    return diagnose(replace(run, chain="YXZ"), curves={"E_ZZ": known})


def test_a_period_that_another_one_looks_like_is_ambiguous():
    found = diagnosed(40e-3, 10e-3)
    assert found.verdict == AMBIGUOUS
    (finding,) = found.findings
    names = {finding.label, *finding.ambiguous}
    assert {f"pitch-periodic error of Z, period {mm} mm" for mm in (8, 40)} <= names


def test_a_period_that_nothing_looks_like_is_named_with_its_sizes():
    found = diagnosed(16e-3, 9e-3)
    assert found.verdict == NAMED
    (finding,) = found.findings
    assert finding.label == "pitch-periodic error of Z, period 16 mm"
    for name, size in SIZES.items():
        u = finding.standard_uncertainty[name]
        assert u < 0.1e-6 and abs(finding.sizes[name] - size) < 4.0 * u


def test_a_period_that_a_free_curve_takes_up_says_which_curve():
    plan = make_plan(blocks=12, step=(0.01,) * 3, repeats=2, directions=("forward", "backward"))
    found = diagnose(replace(simulate(plan, make_cell(high=(0.12,) * 3), 3), chain="YXZ"))
    for mm in (8, 20, 40):
        assert "E_ZZ" in found.not_testable[f"pitch-periodic error of Z, period {mm} mm"]


@pytest.mark.parametrize("period", [5, 10])
def test_a_period_of_whole_steps_is_seen_by_no_stop(period):
    found = diagnosed(16e-3, 10e-3)
    assert f"pitch-periodic error of Z, period {period} mm" in found.not_testable
    whole_turns = diagnosed(20e-3, 10e-3)
    sizes = [abs(size) for one in whole_turns.findings for size in one.sizes.values()]
    assert np.all(np.array(sizes) < 1e-4)
