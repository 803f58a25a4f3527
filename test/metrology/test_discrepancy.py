"""The discrepancy workflow on hidden effects: right names and sizes, silence on null data."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from cells_for_tests import make_cell
from hidden_runs import NOISE, hidden_run, with_change

from stepdiag_ros.bags.table import read_table
from stepdiag_ros.configuration import load_plan
from stepdiag_ros.metrology.discrepancy import (
    AMBIGUOUS,
    CONSISTENT,
    DESCRIBED,
    NAMED,
    NOT_TESTABLE,
    UNEXPLAINED,
    diagnose,
)
from stepdiag_ros.metrology.effects.backlash import EFFECT as BACKLASH
from stepdiag_ros.metrology.effects.effect import ActiveEffect, Change, Effect, Key, Size
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.effects.thermal_growth import EFFECT as GROWTH
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.plan import FORWARD
from stepdiag_ros.metrology.simulation import simulate

CASES = Path(__file__).parent.parent / "data" / "cases"


class Creep(Effect):
    """An effect that this project does not have: the reading creeps along the way of an axis."""

    name = "creep"
    sentence = "The reading creeps with the square root of time, times the place of an axis."
    source = "made up for this test"
    keys = (Key("axis", AXES),)
    sizes = (Size("rate", "1", -1e-3, 1e-3, "creep of a way in the first second"),)

    def settings(self, stops):
        for axis, letter in enumerate(AXES):
            if stops.travel[axis] > 0.0:
                yield {"axis": letter}

    def change(self, setting, sizes, stops):
        along = stops.position[:, AXES.index(setting["axis"])]
        return Change(reading=sizes["rate"] * along * np.sqrt(stops.time))


class Echo(Creep):
    """Another name for exactly the same."""

    name = "echo"


class AxisScale(Creep):
    """What the free curve of an axis does as well."""

    name = "axis scale"

    def change(self, setting, sizes, stops):
        axis = AXES.index(setting["axis"])
        translation = np.zeros_like(stops.position)
        translation[:, axis] = sizes["rate"] * stops.position[:, axis]
        return Change(translation=translation)


CATALOGUE = (BACKLASH, Creep())


def backlash(axis, size):
    return ActiveEffect(BACKLASH, {"axis": axis}, {"lost_motion": size})


def creep(axis, size):
    return ActiveEffect(Creep(), {"axis": axis}, {"rate": size})


@pytest.mark.parametrize("case", [f"effect_{letter}" for letter in "abcdef"])
def test_the_hidden_effect_of_each_case_is_named(case):
    run = read_table(CASES / case / "run.csv")
    (truth,) = yaml.safe_load((CASES / case / "truth.yaml").read_text())["effects"]
    diagnosis = diagnose(run)
    assert diagnosis.verdict == NAMED, diagnosis.sentence
    (finding,) = diagnosis.findings
    assert finding.candidate.effect.name == truth["effect"]
    for key in ("axis", "error", "from_stop"):
        if key in truth:
            assert finding.candidate.setting[key] == truth[key]
    for key in ("line", "order", "direction"):
        if key in truth:
            assert truth[key] in finding.label
    # Names of the sizes are those of the truth; units end some of them there.
    for name, (low, high) in finding.band.items():
        keys = [key for key in truth if key.startswith(name)]
        assert len(keys) == 1, (name, truth)
        assert low <= float(truth[keys[0]]) <= high
    assert finding.probability > 0.95
    assert diagnosis.lack_of_fit_p_after > 0.001
    uncertainty = np.sqrt(np.diag(finding.covariance))
    assert uncertainty == pytest.approx(list(finding.standard_uncertainty.values()))
    assert diagnosis.covariance == pytest.approx(finding.covariance)
    if case == "effect_c":
        # Neither part is told well by itself, the turn over the whole travel is.
        whole, spread, expanded = finding.over_travel
        assert (
            abs(whole - (float(truth["linear_rad"]) + float(truth["quadratic_rad"]))) < 2.6 * spread
        )
        assert spread < 0.2 * min(uncertainty)
        assert expanded == pytest.approx(1.96 * spread, rel=0.01)
    else:
        assert finding.over_travel is None


def test_nothing_is_named_where_nothing_is_hidden():
    diagnosis = diagnose(read_table(CASES / "null_rich" / "run.csv"))
    assert diagnosis.verdict == CONSISTENT
    assert diagnosis.findings == ()
    assert 0.085e-6 < diagnosis.noise < 0.115e-6
    # What the plan would have shown is said, and what it could not.
    assert diagnosis.detection_limits["backlash of X"] < 0.5e-6
    assert any("E_XX" in why for why in diagnosis.not_testable.values())


def test_an_effect_from_outside_the_package_is_named():
    run = hidden_run(creep("Y", 2.0e-6))
    diagnosis = diagnose(run, catalogue=CATALOGUE)
    assert diagnosis.verdict == NAMED
    (finding,) = diagnosis.findings
    assert finding.label == "creep of Y"
    low, high = finding.band["rate"]
    assert low < 2.0e-6 < high
    assert any("Y" in sentence or "time" in sentence for sentence in diagnosis.where)


def test_an_effect_of_temperature_is_named_in_a_run_whose_temperature_changes():
    grows = ActiveEffect(GROWTH, {"axis": "Y"}, {"per_K": 20e-6})
    waves = {"material_temperature_wave_K": 2.0, "wave_period_s": 300.0}
    (finding,) = diagnose(hidden_run(grows, weather=waves)).findings
    assert finding.label == GROWTH.label(grows.setting)
    low, high = finding.band["per_K"]
    assert low < grows.sizes["per_K"] < high


@pytest.mark.parametrize("told", [True, False], ids=["stated", "not stated"])
def test_backlash_is_named_where_every_axis_comes_to_the_first_stop_from_beyond(told):
    """As an NC program of somebody's own does; the table of its readings may not say so."""
    plain = hidden_run()
    begun = replace(plain, lines=tuple(replace(line, overrun=2e-3) for line in plain.lines))
    stops = stops_of(begun)
    sense = np.where(np.array([one.direction for one in stops.lines]) == FORWARD, 1.0, -1.0)
    assert np.all(stops.last_sense[:, 2] * stops.direction[:, 2] * sense[stops.pass_index] >= 0.0)
    run = with_change(begun, backlash("Z", 1.5e-6).readings(stops))
    if not told:
        run = replace(run, lines=tuple(replace(line, overrun=np.nan) for line in run.lines))
    diagnosis = diagnose(run)
    assert diagnosis.verdict == NAMED
    (finding,) = diagnosis.findings
    assert finding.label == "backlash of Z"
    low, high = finding.band["lost_motion"]
    assert low < 1.5e-6 < high


def test_two_effects_are_found_and_fitted_together():
    run = hidden_run(backlash("Z", 0.5e-6), creep("X", 3e-6), seed=6)
    diagnosis = diagnose(run, catalogue=CATALOGUE)
    assert diagnosis.verdict == NAMED
    assert {finding.label for finding in diagnosis.findings} == {"backlash of Z", "creep of X"}
    for finding, size in zip(
        sorted(diagnosis.findings, key=lambda one: one.label), (0.5e-6, 3e-6), strict=True
    ):
        ((low, high),) = finding.band.values()
        assert low < size < high


def test_effects_that_look_alike_are_ambiguous():
    run = hidden_run(creep("Y", 2.0e-6))
    diagnosis = diagnose(run, catalogue=(BACKLASH, Creep(), Echo()))
    assert diagnosis.verdict == AMBIGUOUS
    (finding,) = diagnosis.findings
    assert {finding.label, *finding.ambiguous} == {"creep of Y", "echo of Y"}
    assert 0.4 < finding.probability < 0.6


def test_what_the_catalogue_lacks_is_described_by_what_it_depends_on():
    run = hidden_run(creep("Y", 2.0e-6))
    diagnosis = diagnose(run, catalogue=(BACKLASH,))
    assert diagnosis.verdict == DESCRIBED
    (dependence,) = diagnosis.description.dependences
    assert {*dependence.drivers} == {"the place of Y", "time"}
    assert BACKLASH.name not in {one.candidate.effect.name for one in diagnosis.findings}
    assert diagnosis.lack_of_fit_p_before < 1e-4 < diagnosis.lack_of_fit_p_after


def test_a_shape_without_a_name_is_unexplained():
    def wander(stops):
        steps = np.random.default_rng(3).standard_normal(len(stops.time))
        return 0.1e-6 * np.cumsum(steps)

    diagnosis = diagnose(hidden_run(shape=wander, orders=("XYZ",)), catalogue=CATALOGUE)
    assert diagnosis.verdict == UNEXPLAINED
    assert diagnosis.where


def test_what_the_free_curves_do_is_not_testable():
    diagnosis = diagnose(hidden_run(), catalogue=(BACKLASH, AxisScale()))
    assert diagnosis.verdict == CONSISTENT
    assert "axis scale of X" not in diagnosis.detection_limits
    assert "E_XX" in diagnosis.not_testable["axis scale of X"]


def test_fixed_curves_make_it_testable():
    run = hidden_run(ActiveEffect(AxisScale(), {"axis": "X"}, {"rate": 40e-6}), seed=8)
    truth = make_cell(seed=8, noise=NOISE).truth(run.volume)
    curves = {"E_XX": truth["E_XX"] - truth["E_XX"][0]}
    diagnosis = diagnose(run, catalogue=(BACKLASH, AxisScale()), curves=curves)
    assert diagnosis.verdict == NAMED
    (finding,) = diagnosis.findings
    assert finding.label == "axis scale of X"
    assert finding.sizes["rate"] == pytest.approx(40e-6, abs=4e-6)


@pytest.mark.parametrize("how", ["known", "fitted"])
def test_an_effect_that_the_model_has_is_no_gap(how):
    run = hidden_run(backlash("X", 0.8e-6))
    assert diagnose(run, catalogue=CATALOGUE).verdict == NAMED
    diagnosis = diagnose(run, catalogue=CATALOGUE, **{how: [backlash("X", 0.8e-6)]})
    assert diagnosis.verdict == CONSISTENT


@pytest.mark.parametrize(("size", "verdict"), [(0.0, CONSISTENT), (1e-6, NAMED)])
def test_the_readings_of_the_plan_for_a_first_run_can_contradict_the_model(size, verdict):
    run = simulate(load_plan("check")[0], make_cell(noise=NOISE), 5)
    run = with_change(run, backlash("X", size).readings(stops_of(run)))
    diagnosis = diagnose(run, catalogue=CATALOGUE)
    assert diagnosis.verdict == verdict, diagnosis.sentence


def test_three_one_way_step_diagonals_can_contradict_nothing():
    run = hidden_run(
        backlash("X", 3e-6),
        diagonals=("ppp", "npp", "pnp"),
        linear=(),
        orders=("XYZ",),
        directions=("forward",),
        repeats=1,
    )
    diagnosis = diagnose(run, catalogue=CATALOGUE)
    assert diagnosis.verdict == NOT_TESTABLE
    lacks = ("linear lines", "both directions", "fourth diagonal", "move order", "again")
    assert all(words in diagnosis.sentence for words in lacks)
    # What the run has is no advice; one of what it lacks is enough.
    plan = load_plan("quick")[0]
    diagnosis = diagnose(simulate(plan, make_cell(noise=NOISE), 5), catalogue=CATALOGUE)
    assert diagnosis.verdict == NOT_TESTABLE and "linear" not in diagnosis.sentence


def test_passes_zeroed_one_by_one_share_the_noise_of_their_first_stop():
    run = hidden_run(directions=("forward",), repeats=3, seed=11)
    rezeroed = replace(
        run,
        lines=tuple(
            replace(line, displacement=line.displacement - line.displacement[0])
            for line in run.lines
        ),
    )
    diagnosis = diagnose(rezeroed, catalogue=CATALOGUE)
    assert diagnosis.verdict == CONSISTENT
    assert diagnosis.noise == pytest.approx(NOISE, rel=0.15)
    # A zero for each of the two later passes of 11 setups.
    before = diagnose(run, catalogue=CATALOGUE)
    lost = before.degrees_of_freedom_before - diagnosis.degrees_of_freedom_before
    assert lost == 2 * len(stops_of(run).setups)


def test_rejected_stops_are_left_out():
    run = hidden_run(backlash("X", 0.8e-6))
    line = run.lines[3]
    values = line.displacement.copy()
    values[2] = np.nan
    lines = (*run.lines[:3], replace(line, displacement=values), *run.lines[4:])
    diagnosis = diagnose(replace(run, lines=lines), catalogue=CATALOGUE)
    assert [finding.label for finding in diagnosis.findings] == ["backlash of X"]
    assert np.count_nonzero(np.isnan(diagnosis.residual_after)) == 1


def test_a_reversed_axis_is_said_before_anything_is_fitted():
    run = hidden_run()
    lines = tuple(
        replace(line, displacement=-line.displacement) if line.line.name == "x" else line
        for line in run.lines
    )
    diagnosis = diagnose(replace(run, lines=lines), catalogue=CATALOGUE)
    assert diagnosis.verdict == UNEXPLAINED
    assert "grossly" in diagnosis.sentence


def test_a_line_under_a_wrong_move_order_is_told():
    run = hidden_run(seed=9)
    lines = tuple(
        replace(line, line=other, target=other.stops(run.volume))
        if line.line.name == "npp" and line.line.order == "XYZ"
        else line
        for line in run.lines
        for other in [replace(line.line, order="ZYX")]
    )
    diagnosis = diagnose(replace(run, lines=lines), catalogue=CATALOGUE)
    assert diagnosis.verdict == UNEXPLAINED
    assert "was measured in the order XYZ" in diagnosis.sentence
