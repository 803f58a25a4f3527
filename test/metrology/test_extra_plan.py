"""Ask the machine: a confounded pair, the plan that separates it, and the name that comes of it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import standard_runs
import yaml
from cells_for_tests import make_cell, make_plan
from refused import refused

from stepdiag_ros.metrology.discrepancy import AMBIGUOUS, NAMED, diagnose
from stepdiag_ros.metrology.discrepancy.baseline import fit_baseline, whitened
from stepdiag_ros.metrology.discrepancy.extra_lines import (
    Weather,
    alignments,
    blank,
    parts,
    plan_of,
)
from stepdiag_ros.metrology.discrepancy.findings import Candidate
from stepdiag_ros.metrology.discrepancy.joint import joined
from stepdiag_ros.metrology.discrepancy.judging import CERTAINTY, Judge, chances_of
from stepdiag_ros.metrology.discrepancy.rivals import Contest, FurtherReadings, Rival
from stepdiag_ros.metrology.effects.abbe_offset import EFFECT as ABBE
from stepdiag_ros.metrology.effects.angular_error import EFFECT as ANGULAR
from stepdiag_ros.metrology.effects.axis_scale import EFFECT as SCALE
from stepdiag_ros.metrology.effects.backlash import EFFECT as BACKLASH
from stepdiag_ros.metrology.effects.cosine_error import EFFECT as COSINE
from stepdiag_ros.metrology.effects.dead_path import EFFECT as DEAD_PATH
from stepdiag_ros.metrology.effects.drift import EFFECT as DRIFT
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.sag import EFFECT as SAG
from stepdiag_ros.metrology.effects.servo_lag import EFFECT as LAG
from stepdiag_ros.metrology.effects.several_angular_errors import EFFECT as TURNING
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.effects.trigger_delay import EFFECT as DELAY
from stepdiag_ros.metrology.forward import ErrorCurves
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.planning.duration import duration
from stepdiag_ros.planning.separation import conditions_of, proposal_text, propose_extra

CATALOGUE = (ANGULAR, BACKLASH, COSINE, DEAD_PATH, DRIFT, SAG)
PLAN = make_plan(blocks=6, step=(0.02, 0.02, 0.02), repeats=2, directions=("forward", "backward"))
CELL = make_cell(high=(0.12, 0.12, 0.12))
SHIFT = 0.12


def cell_with(effect, setting, drift=0.0, **sizes):
    every = {size.name: 0.0 for size in effect.sizes}
    weather = replace(CELL.weather, air_temperature_drift=drift)
    return replace(
        CELL, effects=(ActiveEffect(effect, setting, {**every, **sizes}),), weather=weather
    )


HIDDEN = {
    "angular": cell_with(ANGULAR, {"error": "E_BX"}, linear=40e-6),
    "sag": cell_with(SAG, {"error": "X", "over": "XY"}, corner=-5e-6),
    "drift": cell_with(DRIFT, {"along": "beam"}, drift=1.0 / 3600.0, m_per_s=1e-8),
}


@cache
def first(name):
    run = simulate(PLAN, HIDDEN[name], seed=1)
    return run, diagnose(run, catalogue=CATALOGUE)


@cache
def proposed(name):
    run, diagnosis = first(name)
    return propose_extra(run, diagnosis, PLAN, catalogue=CATALOGUE)


def another_day(cell, drift=0.0):
    """Axes of other lengths, air of another temperature."""
    grown = [ActiveEffect(SCALE, {"axis": axis}, {"scale": 6e-6}) for axis in "XYZ"]
    weather = replace(cell.weather, air_temperature=21.5, air_temperature_drift=drift)
    return replace(cell, effects=(*cell.effects, *grown), weather=weather)


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("angular", "angular error E_BX"),
        ("sag", "sag along X over X and Y"),
        ("drift", "drift of the reading"),
    ],
)
def test_ambiguous_then_asked_then_named(name, label):
    run, diagnosis = first(name)
    assert diagnosis.verdict == AMBIGUOUS, diagnosis.sentence
    (finding,) = diagnosis.findings
    assert label in (finding.label, *finding.ambiguous)
    proposal = proposed(name)
    assert proposal.plan is not None, proposal.sentence
    assert proposal.certainty >= CERTAINTY
    # The plan goes through its file, as a user's does.
    plan = Plan.from_mapping(yaml.safe_load(proposal_text(proposal)), "extra.yaml")
    assert plan == proposal.plan
    again = simulate(plan, another_day(HIDDEN[name]), seed=2)
    both = diagnose(joined([run, again]), catalogue=CATALOGUE)
    assert both.verdict == NAMED, both.sentence
    assert [one.label for one in both.findings] == [label]


def test_the_extra_plan_has_the_conditions_of_the_run_and_is_shorter():
    plan = proposed("angular").plan
    assert (plan.volume, plan.feed, plan.sampling) == (PLAN.volume, PLAN.feed, PLAN.sampling)
    machine = Machine("m", "YXZ", (0.0,) * 3, (0.2,) * 3, 0.5, 1.0)
    assert proposed("angular").seconds < 0.5 * duration(PLAN, machine).total
    assert len({plan.setup_of(line) for line in plan.lines}) <= 4


def test_nothing_of_the_extra_plan_can_be_left_out():
    run, diagnosis = first("sag")
    proposal = proposed("sag")
    judge = _judge(run, diagnosis, proposal)
    chosen = _options(proposal)
    assert judge.good(chosen)
    assert len(chosen) > 1
    for option in chosen:
        assert not judge.good(tuple(one for one in chosen if one is not option))


def _options(proposal):
    """Return the alignments of a plan as options."""
    pool = [
        one
        for whole in alignments(PLAN.volume, True)
        for one in (*parts(whole), whole)
        if set(one.lines) <= set(proposal.plan.lines)
    ]
    largest = []
    for one in sorted(pool, key=lambda option: -len(option.lines)):
        if not any(set(one.lines) & set(other.lines) for other in largest):
            largest.append(one)
    return tuple(largest)


def _judge(run, diagnosis, proposal):
    (labels,) = proposal.rivals
    stops = diagnosis.stops
    known = {
        effect.label(setting): Candidate(effect, setting, effect.label(setting))
        for effect in CATALOGUE
        for setting in effect.settings(stops)
    }
    chances = {one.label: one.probability for one in diagnosis.findings[0].runners_up}
    chances[diagnosis.findings[0].label] = diagnosis.findings[0].probability
    rivals = [Rival(known[label], chances.get(label, 1e-4)) for label in labels]
    contest = Contest(rivals, [], fit_baseline(run, stops), stops, diagnosis)
    return Judge([contest], run, stops, diagnosis, PLAN, {})


def test_the_expected_separation_is_that_of_the_fits():
    """δ² by the compressed problem is what χ² of the wrong rival grows by, noise apart."""
    run, diagnosis = first("sag")
    stops = diagnosis.stops
    names = ({"error": "X", "over": "XY"}, {"error": "Z", "over": "YZ"})
    rivals = [Rival(Candidate(SAG, name, SAG.label(name)), 0.5) for name in names]
    baseline = fit_baseline(run, stops)
    contest = Contest(rivals, [], baseline, stops, diagnosis)
    options = alignments(PLAN.volume, False)
    plan = plan_of((options[0], options[4], options[7]), PLAN, "a few lines")
    lines = blank(plan, run.chain, Weather.of(stops), 2)
    told = contest.separation(FurtherReadings(lines, stops, diagnosis, {}))
    assert told.distance[0, 0] == told.distance[1, 1] == 0.0
    # χ² of each rival, fitted by the engine itself to the run, and to the run with the further
    # readings as the machine has them, without noise.
    column = SAG.columns(names[0], stops)
    free = np.column_stack([baseline.matrix, column[baseline.good]])
    size = float(np.linalg.lstsq(free, baseline.gap, rcond=1e-10)[0][-1])
    assert size == pytest.approx(-5e-6, abs=0.4e-6)
    ghost = ActiveEffect(SAG, names[0], {"corner": size})
    silent = replace(CELL, effects=(ghost,), reading_noise=1e-12)
    both = joined([run, simulate(plan, silent, seed=3)])
    (one, other), (one_both, other_both) = (
        [_squares(measurement, name, diagnosis) for name in names] for measurement in (run, both)
    )
    grown = (other_both - one_both) - (other - one)
    assert told.distance[0, 1] == pytest.approx(grown, rel=0.15)
    assert told.distance[0, 1] > 30.0


def _squares(measurement, setting, diagnosis):
    stops = stops_of(measurement)
    # No uncertainty is stated, so that silent readings count no more than others.
    plain = replace(
        measurement,
        lines=tuple(
            replace(line, standard_uncertainty=np.full_like(line.time, np.nan))
            for line in measurement.lines
        ),
    )
    baseline = fit_baseline(plain, stops, fitted=[ActiveEffect(SAG, setting, {})])
    gap = whitened(baseline, diagnosis.noise, diagnosis.noise_correlation).gap
    return float(gap @ gap)


def test_the_chance_to_tell_is_that_of_odds_of_twenty():
    """Evidence e + δ²/2 ± δ against ln 20, drawn at random."""
    run, diagnosis = first("sag")
    stops = diagnosis.stops
    names = ({"error": "X", "over": "XY"}, {"error": "Z", "over": "YZ"})
    rivals = [
        Rival(Candidate(SAG, name, SAG.label(name)), chance)
        for name, chance in zip(names, (0.25, 0.75), strict=True)
    ]
    contest = Contest(rivals, [], fit_baseline(run, stops), stops, diagnosis)
    for distance in (4.0, 16.0, 36.0):
        chance = chances_of(contest, np.full((2, 2), distance))
        readings = np.random.default_rng(0).standard_normal(100_000)
        # Prediction of j stands at 0, that of i, which is true, at δ.
        apart = np.sqrt(distance)
        evidence = 0.5 * (readings + apart) ** 2 - 0.5 * readings**2
        for (i, j), odds in (((0, 1), 1.0 / 3.0), ((1, 0), 3.0)):
            drawn = np.mean(odds * np.exp(evidence) > 20.0)
            assert chance[i, j] == pytest.approx(drawn, abs=0.006)


def test_a_drift_is_told_from_the_dead_path_only_in_other_weather():
    proposal = proposed("drift")
    (condition,) = proposal.conditions
    assert "air temperature" in condition
    assert "half as fast" in condition
    assert any("dead path" in pair.labels for pair in proposal.pairs)


def test_the_same_weather_again_does_not_tell_a_drift_from_the_dead_path():
    run, _ = first("drift")
    cell = another_day(HIDDEN["drift"], drift=1.0 / 3600.0)
    both = joined([run, simulate(proposed("drift").plan, cell, seed=2)])
    assert diagnose(both, catalogue=CATALOGUE).verdict == AMBIGUOUS


def test_which_alignment_it_was_need_not_be_told():
    proposal = proposed("angular")
    (words,) = proposal.left_open
    assert all(label.startswith("cosine error") for label in words.labels)
    assert len(words.labels) > 1
    assert "align and measure that line again" in words.why
    for pair in proposal.pairs:
        assert not all(label.startswith("cosine error") for label in pair.labels)


def test_a_longer_dwell_is_taken_where_the_same_tells_nothing():
    catalogue = (LAG, DELAY)
    cell = cell_with(LAG, {}, short_by=0.3e-6)
    run = simulate(PLAN, cell, seed=4)
    diagnosis = diagnose(run, catalogue=catalogue)
    assert diagnosis.verdict == AMBIGUOUS, diagnosis.sentence
    proposal = propose_extra(run, diagnosis, PLAN, catalogue=catalogue)
    assert proposal.plan is not None, proposal.sentence
    assert proposal.plan.sampling.dwell > PLAN.sampling.dwell
    both = joined([run, simulate(proposal.plan, another_day(cell), seed=5)])
    final = diagnose(both, catalogue=catalogue)
    assert [one.label for one in final.findings if not one.ambiguous] == ["servo lag"]


def test_where_nothing_is_open_nothing_is_proposed():
    run = simulate(PLAN, cell_with(BACKLASH, {"axis": "X"}, lost_motion=1e-6), seed=1)
    diagnosis = diagnose(run, catalogue=(BACKLASH,))
    proposal = propose_extra(run, diagnosis, PLAN, catalogue=(BACKLASH,))
    assert diagnosis.verdict == NAMED
    assert proposal.plan is None
    assert "Nothing is open" in proposal.sentence
    with refused(Refusal, "too_few"):
        proposal_text(proposal)


def test_feed_and_dwell_of_a_table_are_those_of_its_times():
    uneven = make_plan(blocks=5, step=(0.01, 0.02, 0.03))
    found = conditions_of(simulate(uneven, CELL))
    assert found.feed == pytest.approx(uneven.feed, rel=0.02)
    assert found.sampling.dwell == pytest.approx(uneven.sampling.dwell, rel=0.02)
    untold = simulate(uneven, CELL)
    untold = replace(
        untold,
        lines=tuple(replace(line, time=np.full_like(line.time, np.nan)) for line in untold.lines),
    )
    assert conditions_of(untold).feed > 0.0


def test_moves_of_any_length_that_take_as_long_do_not_show_the_feed():
    uneven = make_plan(blocks=6, step=(0.02, 0.01, 0.03))
    run = simulate(uneven, CELL)
    lines = tuple(replace(one, time=3.1 * np.arange(len(one.time))) for one in run.lines)
    found = conditions_of(replace(run, lines=lines))
    assert found.feed == 0.033
    assert 2.0 < found.sampling.dwell < 3.1


def test_axes_that_turn_are_no_rival_that_lines_are_sought_for_but_are_said_to_be_left_open():
    _, run = standard_runs.measured(rotation=12e-6, seed=5)
    diagnosis = diagnose(run)
    assert any(TURNING.name in finding.ambiguous for finding in diagnosis.findings)
    proposal = propose_extra(run, diagnosis)
    assert all(TURNING.name not in labels for labels in proposal.rivals)
    assert any(TURNING.name in left.labels for left in proposal.left_open)


@pytest.mark.parametrize("mount", [(0.1, 0.0, 0.0), (0.0, -0.05, 0.1)])
def test_a_mirror_mounted_elsewhere_reads_the_rotations_by_its_arm(mount):
    """The exact walk along the chain of a machine that turns agrees with the effect's column."""
    plan = make_plan(blocks=6, step=(0.02, 0.02, 0.02), diagonals=("ppn",), linear=())
    plan = replace(plan, lines=tuple(replace(one, mirror_offset=mount) for one in plan.lines))
    turn = np.linspace(0.0, 40e-6, 7)
    nodes = tuple(np.linspace(0.0, 0.12, 7) for _ in range(3))
    plain = replace(CELL, errors=ErrorCurves.from_curves(nodes, {}))
    turning = replace(plain, errors=ErrorCurves.from_curves(nodes, {"E_CZ": turn}))
    found = simulate(plan, replace(turning, reading_noise=0.0), seed=1)
    straight = simulate(plan, replace(plain, reading_noise=0.0), seed=1)
    difference = np.concatenate(
        [
            one.displacement - other.displacement
            for one, other in zip(found.lines, straight.lines, strict=True)
        ]
    )
    column = ANGULAR.columns({"error": "E_CZ"}, stops_of(found))[:, 0] * 40e-6
    np.testing.assert_allclose(difference, column - column[0], atol=2e-9)
    elsewhere = replace(stops_of(found), mirror_offset=np.zeros((len(column), 3)))
    usual = ANGULAR.columns({"error": "E_CZ"}, elsewhere)[:, 0] * 40e-6
    assert np.ptp(column - usual) > 1e-6


def test_a_turn_that_any_alignment_could_be_is_told_with_the_mirror_mounted_elsewhere():
    cell = replace(CELL, chain="YXZ", effects=_acting(ANGULAR, {"error": "E_AX"}, linear=60e-6))
    plan = replace(
        make_plan(blocks=6, step=(0.02,) * 3, orders=("XYZ", "ZXY"), repeats=2), feed=0.05
    )
    catalogue = (ANGULAR, SAG)
    run = simulate(plan, cell, seed=1)
    diagnosis = diagnose(run, catalogue=catalogue)
    (finding,) = diagnosis.findings
    assert {"angular error E_AX", "sag along Z over X and Y"} <= {finding.label, *finding.ambiguous}
    proposal = propose_extra(run, diagnosis, plan, catalogue=catalogue)
    assert not proposal.left_open
    assert proposal.certainty >= CERTAINTY
    read = Plan.from_mapping(yaml.safe_load(proposal_text(proposal)), "extra.yaml")
    assert read == proposal.plan
    mounts = {line.mirror_offset for line in read.lines}
    assert any(any(mount) for mount in mounts)
    assert len({read.setup_of(line) for line in read.lines}) >= len(mounts)
    both = diagnose(joined([run, simulate(read, another_day(cell), seed=2)]), catalogue=catalogue)
    assert [(both.verdict, one.label) for one in both.findings] == [(NAMED, "angular error E_AX")]


def test_servo_lag_and_trigger_delay_are_told_at_another_pace():
    cell = replace(CELL, effects=_acting(DELAY, {}, delay=1e-3))
    run = simulate(PLAN, cell, seed=1)
    catalogue = (LAG, DELAY)
    diagnosis = diagnose(run, catalogue=catalogue)
    assert diagnosis.verdict == AMBIGUOUS, diagnosis.sentence
    plan = propose_extra(run, diagnosis, PLAN, catalogue=catalogue).plan
    assert plan.feed < PLAN.feed
    assert plan.sampling.dwell > PLAN.sampling.dwell
    both = diagnose(joined([run, simulate(plan, another_day(cell), seed=2)]), catalogue=catalogue)
    assert [(both.verdict, one.label) for one in both.findings] == [
        (NAMED, "position-trigger delay")
    ]


def test_names_of_one_alignment_that_is_over_are_one():
    cell = replace(CELL, effects=_acting(COSINE, {"setup": "ppn XYZ"}, scale=40e-6))
    one_order = diagnose(simulate(PLAN, cell, seed=1), catalogue=(COSINE, ABBE))
    assert one_order.verdict == AMBIGUOUS, one_order.sentence
    assert all(one.over and not one.equivalent for one in one_order.findings)
    plan = make_plan(blocks=6, step=(0.02,) * 3, orders=("XYZ", "ZXY"), repeats=2)
    diagnosis = diagnose(simulate(plan, cell, seed=1), catalogue=(COSINE, ABBE))
    (finding,) = diagnosis.findings
    assert diagnosis.verdict == NAMED, diagnosis.sentence
    names = {finding.label, *finding.equivalent}
    assert "cosine error of ppn XYZ" in names
    assert len(names) > 1 and not finding.ambiguous
    assert all("ppn XYZ" in name for name in names)
    assert all(name in diagnosis.sentence for name in names)
    assert finding.over


def _acting(effect, setting, **sizes):
    every = {size.name: 0.0 for size in effect.sizes}
    return (ActiveEffect(effect, setting, {**every, **sizes}),)
