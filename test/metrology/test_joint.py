"""Several runs diagnosed together: what they share, what is kept apart, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from refused import a_fault, refused

from stepdiag_ros.metrology.discrepancy import CONSISTENT, NAMED, diagnose
from stepdiag_ros.metrology.discrepancy.baseline import fit_baseline
from stepdiag_ros.metrology.discrepancy.joint import appended, joined, run_scales
from stepdiag_ros.metrology.effects.axis_scale import EFFECT as SCALE
from stepdiag_ros.metrology.effects.backlash import EFFECT as BACKLASH
from stepdiag_ros.metrology.effects.cosine_error import EFFECT as COSINE
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.fringe_slip import EFFECT as SLIP
from stepdiag_ros.metrology.effects.growth_with_time import EFFECT as GROWTH
from stepdiag_ros.metrology.effects.squareness import EFFECT as SQUARENESS
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.effects.thermal_growth import EFFECT as THERMAL
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate

CATALOGUE = (BACKLASH, COSINE, GROWTH, SCALE, SLIP, SQUARENESS, THERMAL)
PLAN = make_plan(blocks=5, repeats=2, directions=("forward", "backward"))
CELL = make_cell(high=(0.05, 0.05, 0.05))


def acting(effect, setting, **sizes):
    return ActiveEffect(effect, setting, sizes)


def run(seed, *effects, plan=PLAN, cell=CELL):
    return simulate(plan, replace(cell, effects=effects), seed=seed)


def longer(microns_per_metre):
    """Axes of another temperature."""
    return [acting(SCALE, {"axis": axis}, scale=microns_per_metre * 1e-6) for axis in "XYZ"]


@pytest.fixture(scope="module")
def two():
    return joined([run(1), run(2, *longer(8.0))])


def test_setups_and_passes_of_each_run_keep_its_number(two):
    stops = stops_of(two)
    count = len(PLAN.lines)
    assert stops.setups[:7] == tuple(dict.fromkeys(line.setup for line in PLAN.lines))
    assert stops.setups[7:] == tuple(f"run 2: {name}" for name in stops.setups[:7])
    assert [line.run for line in stops.lines] == [1] * count + [2] * count
    assert len({(str(line), line.offset) for line in stops.lines}) == 2 * count
    assert len({line.line_index for line in two.lines}) == 2 * count
    assert np.count_nonzero(stops.run == 2) == len(stops.run) // 2


def test_time_counts_from_the_start_of_each_run(two):
    stops = stops_of(two)
    first, second = (stops.time[stops.run == number] for number in (1, 2))
    np.testing.assert_array_equal(first, second)


def test_a_run_alone_is_what_it_was():
    alone = run(1)
    assert joined([alone]) == Measurement(alone.volume, alone.lines, alone.chain)
    assert run_scales(stops_of(alone)).shape == (len(stops_of(alone).time), 0)


def test_joining_in_steps_is_joining_at_once():
    runs = [run(seed) for seed in (1, 2, 3)]
    at_once, in_steps = joined(runs), joined([joined(runs[:2]), runs[2]])
    behind = joined([runs[0], joined(runs[1:])])
    for other in (in_steps, behind):
        assert [line.setup for line in other.lines] == [line.setup for line in at_once.lines]
        assert [line.line for line in other.lines] == [line.line for line in at_once.lines]
        assert [one.line_index for one in other.lines] == [one.line_index for one in at_once.lines]
    assert stops_of(at_once).setups[-1] == "run 3: ppn XYZ"


def test_stops_put_behind_others_are_those_of_both_runs_joined(two):
    runs = [run(1), run(2, *longer(8.0))]
    first = stops_of(runs[0])
    second = stops_of(replace(two, lines=two.lines[len(PLAN.lines) :]))
    together, expected = appended(first, second), stops_of(two)
    for name, value in vars(expected).items():
        np.testing.assert_array_equal(getattr(together, name), value, err_msg=name)


def test_each_axis_has_a_length_of_its_own_in_each_later_run(two):
    stops = stops_of(two)
    scales = run_scales(stops)
    assert scales.shape == (len(stops.time), 3)
    assert not np.any(scales[stops.run == 1])
    growth = SCALE.columns({"axis": "Y"}, stops)[:, 0]
    np.testing.assert_allclose(scales[stops.run == 2, 1], growth[stops.run == 2])
    parts = fit_baseline(two, stops).parts
    assert "the lengths of the axes in later runs" in parts
    assert "the lengths of the axes in later runs" not in fit_baseline(run(1), first_of(two)).parts


def first_of(two):
    return stops_of(replace(two, lines=two.lines[: len(PLAN.lines)]))


def test_axes_of_another_length_make_no_false_name(two):
    """8 µm/m between the days: without a free scale a hundred times the detection limit."""
    diagnosis = diagnose(two, catalogue=CATALOGUE)
    assert diagnosis.verdict == CONSISTENT, diagnosis.sentence
    assert "scale of X" in diagnosis.not_testable


def test_what_is_shared_is_found_with_the_readings_of_both():
    backlash = acting(BACKLASH, {"axis": "Z"}, lost_motion=0.15e-6)
    runs = [run(1, backlash), run(2, backlash, *longer(-5.0))]
    alone = diagnose(runs[0], catalogue=CATALOGUE)
    both = diagnose(joined(runs), catalogue=CATALOGUE)
    assert both.verdict == NAMED, both.sentence
    (finding,) = both.findings
    assert finding.label == "backlash of Z"
    uncertainty = finding.standard_uncertainty["lost_motion"]
    assert abs(finding.sizes["lost_motion"] - 0.15e-6) < 4.0 * uncertainty < 0.1e-6
    limit = alone.detection_limits["backlash of Z"]
    assert both.detection_limits["backlash of Z"] < 0.85 * limit


def test_an_event_of_the_second_run_is_named_there():
    slip = acting(
        SLIP,
        {"line": "ppp", "order": "XYZ", "repeat": 0, "direction": "backward", "from_stop": 4},
        size=0.6e-6,
    )
    diagnosis = diagnose(joined([run(1), run(2, slip, *longer(5.0))]), catalogue=CATALOGUE)
    assert diagnosis.verdict == NAMED, diagnosis.sentence
    assert "run 2: ppp XYZ backward, repeat 0" in diagnosis.findings[0].label


def test_a_growth_that_starts_anew_in_each_run_is_one_effect():
    growth = acting(GROWTH, {"axis": "X"}, per_s=3e-7)
    diagnosis = diagnose(
        joined([run(1, growth), run(2, growth, *longer(4.0))]), catalogue=(BACKLASH, COSINE, GROWTH)
    )
    assert [one.label for one in diagnosis.findings] == ["growth with time of X"]
    low, high = diagnosis.findings[0].band["per_s"]
    assert low < 3e-7 < high


def test_an_unknown_chain_is_told_by_another_run():
    assert joined([replace(run(1), chain=""), run(2)]).chain == "YXZ"


@pytest.mark.parametrize(
    ("second", "words"),
    [
        (lambda: run(2, plan=make_plan(blocks=6)), a_fault("mismatch", "b.csv", "6", "a.csv", "5")),
        (
            lambda: run(2, plan=make_plan(blocks=5, step=(0.01, 0.011, 0.01))),
            a_fault("mismatch", "Y"),
        ),
        (
            lambda: run(2, plan=make_plan(blocks=5, origin=(0.0, 0.0, 0.01))),
            a_fault("mismatch", "Z"),
        ),
        (lambda: replace(run(2), chain="XYZ"), a_fault("mismatch", "b.csv", "XYZ", "a.csv")),
        (lambda: replace(run(2), lines=()), a_fault("too_few", "b.csv", aspect="line")),
    ],
)
def test_runs_that_do_not_go_together_are_refused(second, words):
    with refused(Refusal, words):
        joined([run(1), second()], ["a.csv", "b.csv"])
    with refused(Refusal, "too_few", aspect="run"):
        joined([])


def test_rounding_of_a_table_is_no_other_box():
    other = run(2)
    near = Volume((1e-7, 0.0, 0.0), (0.01, 0.0100001, 0.01), 5)
    assert len(joined([run(1), replace(other, volume=near)]).lines) == 2 * len(PLAN.lines)
