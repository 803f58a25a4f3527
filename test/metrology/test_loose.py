"""What scatters in every run is no effect: the zero from pass to pass, rotations of all axes."""

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from hidden_runs import with_change

from stepdiag_ros.configuration import load_cell, load_plan
from stepdiag_ros.metrology.discrepancy import CONSISTENT, NAMED, diagnose
from stepdiag_ros.metrology.discrepancy.extension import ModelComparison, extend
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.several_angular_errors import EFFECT as SEVERAL
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.geometry import CHAINS
from stepdiag_ros.metrology.model import FITTED, MachineModel, Provenance
from stepdiag_ros.metrology.simulation import simulate

BOTH = ("forward", "backward")


def wandering(run, size, seed):
    rng = np.random.default_rng(seed)
    for line in run.lines:
        line.displacement[:] += size * rng.standard_normal()
    return run


@pytest.mark.parametrize("seed", range(4))
def test_a_zero_that_scatters_from_pass_to_pass_is_no_effect(seed):
    plan = make_plan(7, repeats=3, directions=BOTH)
    run = wandering(simulate(plan, make_cell(seed=seed, high=(0.07,) * 3), seed), 0.15e-6, seed)
    found = diagnose(run)
    assert found.verdict == CONSISTENT
    # Estimated, and enlarged for the few passes that tell it.
    assert 0.1e-6 < found.loose.zero < 0.3e-6
    assert found.loose.rotation == 0.0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("repeats", "directions"), [(2, BOTH[:1]), (1, BOTH)])
def test_few_passes_that_scatter_are_no_effect_either(seed, repeats, directions):
    # Seven passes that repeat another one: several drifts or a swing can be laid through them.
    plan = make_plan(7, repeats=repeats, directions=directions)
    run = wandering(simulate(plan, make_cell(seed=seed, high=(0.07,) * 3), seed), 0.15e-6, seed)
    assert diagnose(run).verdict == CONSISTENT


@pytest.mark.parametrize("repeats", [2, 3])
def test_a_drift_stays_a_drift_where_the_passes_tell_it_from_scatter(repeats):
    plan = make_plan(7, repeats=repeats, directions=BOTH)
    run = simulate(plan, make_cell(high=(0.07,) * 3), 1)
    stops = stops_of(run)
    drift = ActiveEffect(catalogue()["drift"], {"along": "X"}, {"m_per_s": 1.5e-6 / stops.duration})
    found = diagnose(with_change(run, drift.readings(stops)))
    assert found.findings, found.sentence
    assert all("drift along X" in (one.label, *one.ambiguous) for one in found.findings)


def test_an_effect_stands_out_from_a_zero_that_scatters():
    plan = make_plan(7, repeats=3, directions=BOTH)
    run = wandering(simulate(plan, make_cell(high=(0.07,) * 3), 1), 0.15e-6, 1)
    backlash = ActiveEffect(catalogue()["backlash"], {"axis": "X"}, {"lost_motion": 0.8e-6})
    found = diagnose(with_change(run, backlash.readings(stops_of(run))))
    assert found.verdict == NAMED
    assert [one.label for one in found.findings] == ["backlash of X"]
    low, high = found.findings[0].band["lost_motion"]
    assert low < 0.8e-6 < high


@pytest.fixture(scope="module")
def paper():
    """The plan of Ibaraki & Hata on a machine with nine angles of 1 to 4 µrad and nothing else."""
    plan, cell = load_plan("ibaraki_hata_2010")[0], load_cell("ibaraki_hata_2010")[0]
    return simulate(plan, cell, seed=1, readings_per_stop=50)


def test_several_angular_errors_are_named_and_close_the_gap(paper):
    comparison = ModelComparison(paper)
    made = extend(comparison, MachineModel(name="free"), Provenance("a run", "", "now", ""))
    (finding,) = made.diagnosis.findings
    assert made.diagnosis.verdict == NAMED and finding.candidate.effect is SEVERAL
    assert 1e-6 < finding.sizes["size"] < 6e-6
    assert made.diagnosis.lack_of_fit_p_after > made.diagnosis.lack_of_fit_p_before
    assert made.held_out is not None and made.held_out.gain_p_value < 0.01
    assert [one.status for one in made.model.effects] == [FITTED]
    assert made.rounds[-1].verdict == CONSISTENT


@pytest.mark.parametrize("chain", CHAINS[:2])
def test_one_angular_error_stays_one(chain):
    plan = make_plan(7, repeats=2, directions=BOTH, orders=("XYZ", "YZX", "ZXY"))
    run = simulate(plan, make_cell(chain=chain, high=(0.07,) * 3), 3)
    turn = ActiveEffect(
        catalogue()["angular error"], {"error": "E_CY"}, {"linear": 60e-6, "quadratic": 0.0}
    )
    found = diagnose(with_change(run, turn.readings(stops_of(run))))
    assert all(one.candidate.effect is not SEVERAL for one in found.findings)
    assert any("E_CY" in words for one in found.findings for words in (one.label, *one.ambiguous))
