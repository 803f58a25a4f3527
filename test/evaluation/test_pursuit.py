"""When a run has reached its target: by its lines alone, and never earlier than it may."""

import sys
from dataclasses import replace
from math import isfinite, isnan
from pathlib import Path

import numpy as np
import pytest

from stepdiag_ros.bags.passes import Completeness
from stepdiag_ros.configuration import load_cell, load_machine, plan_from_text, target_from_text
from stepdiag_ros.evaluation.budget import with_budget
from stepdiag_ros.evaluation.decision import lead_of_results
from stepdiag_ros.evaluation.lead import lead_of
from stepdiag_ros.evaluation.pursuit import Pursuit, outlook, reached, standing
from stepdiag_ros.evaluation.report import Report
from stepdiag_ros.evaluation.solving import solve_run
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plausible import Plausible
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.solvers.result import NotDeterminable
from stepdiag_ros.metrology.target import Target, TargetState
from stepdiag_ros.run.target_words import end_words, standing_words
from stepdiag_ros.text.numbers import in_micro

sys.path.append(str(Path(__file__).parents[1] / "bands"))
from plausible_machines import ANGLE, draw

NOTHING_MISSING = Completeness(1, 1)
PLAN = """\
name: small box
step_m: [0.03, 0.02, 0.025]
blocks: 3
repeats: {repeats}
directions: [forward, backward]
feed_m_per_s: 0.05
lines:
  - {{kind: linear, names: [x, y, z]}}
  - {{kind: step_diagonal, names: [ppp, npp, pnp, ppn], orders: [XYZ]}}
"""
TEST_PLAN = """\
name: positioning
step_m: [0.02, 0.02, 0.02]
blocks: 5
repeats: 7
directions: [forward, backward]
feed_m_per_s: 0.05
overrun_m: 0.002
lines:
  - {kind: linear, names: [x]}
"""
CONDITIONS = """\
until: {until}
conditions:
  device_U_m_per_m: 1.0e-6
  misalignment_m: 1.0e-4
  temperature_range_K: 0.1
  expansion_coefficient_per_K: 1.15e-5
  expansion_range_per_K: 1.0e-6
  temperature_difference_K: 0.1
  environmental_variation_m: {drift}
"""


def demo(plan_text, until):
    """Return the pursuit of a run on the demonstration's machine, and all lines of the run."""
    plan, machine = plan_from_text(plan_text, "plan"), load_machine("demo")[0]
    measurement = simulate(plan, load_cell("demo")[0], seed=4)
    plausible = Plausible(rotation=machine.rotations)
    measurement = replace(measurement, chain=machine.chain, plausible=plausible)
    return Pursuit(target_from_text(until), plan, machine), measurement


def after(pursuit, measurement, count):
    first = replace(measurement, lines=measurement.lines[:count])
    results = solve_run(pursuit.plan, first, first.lines[-1]).results
    return standing(pursuit, first, results, lead_of_results(results, first, NOTHING_MISSING))


def course(pursuit, measurement):
    """Return the standing after each line until the target is reached."""
    said = []
    for count in range(1, len(measurement.lines) + 1):
        said.append(after(pursuit, measurement, count))
        if said[-1].state is TargetState.REACHED:
            break
    return said


@pytest.mark.parametrize(("until", "end"), [("E_XX=1um", 4), ("C0Y=100urad", 24), ("20um", 24)])
def test_a_run_ends_at_the_first_line_end_at_which_all_holds(until, end):
    said = course(*demo(PLAN.format(repeats=2), until))
    assert [one.state for one in said[:-1]] == [TargetState.OPEN] * (end - 1)
    last = said[-1]
    assert (last.state, last.lines, last.text) == (TargetState.REACHED, end, "")
    assert last.reached <= last.demanded and last.time_left == 0.0


def test_what_is_not_determined_is_unknown_and_has_its_time():
    pursuit, measurement = demo(PLAN.format(repeats=2), "20um")
    first = after(pursuit, measurement, 3)
    assert isnan(first.reached) and first.expected > 0.0
    assert first.time_left == pytest.approx(sum(pursuit.line_times[3:24]), rel=0.2)
    early, late = after(pursuit, measurement, 18), after(pursuit, measurement, 22)
    assert early.time_left > late.time_left > 0.0


def test_before_the_first_line_the_plan_tells_what_to_expect():
    pursuit, _ = demo(PLAN.format(repeats=2), "20um")
    foretold = outlook(pursuit)
    assert (foretold.state, foretold.lines) == (TargetState.OPEN, 0)
    assert isnan(foretold.reached)
    assert foretold.time_left == pytest.approx(sum(pursuit.line_times[:24]))
    with_more = outlook(replace(pursuit, target=target_from_text("E_XX=1nm")))
    assert with_more.state is TargetState.BEYOND_PLAN and isnan(with_more.time_left)
    assert 1e-9 < with_more.expected < 1e-6
    # The quantity is named as people call it.
    assert pursuit.target.words in standing_words(foretold)


def test_a_target_beyond_the_plan_is_never_reached_and_has_a_reason():
    pursuit, measurement = demo(PLAN.format(repeats=2), "E_XX=1nm")
    for count in (4, 12, 28):
        said = after(pursuit, measurement, count)
        assert said.state is TargetState.BEYOND_PLAN and isnan(said.time_left)
        assert said.reached > 1e-9 and said.text
    assert said.expected == said.reached
    # At the end of the plan there is one number, which is told once.
    assert end_words(said, count).count(in_micro(said.reached, "m")) == 1


def test_lines_that_were_not_repeated_end_no_run():
    pursuit, measurement = demo(PLAN.format(repeats=1), "1mm")
    only = replace(pursuit.plan, lines=pursuit.plan.lines[::2])
    pursuit = replace(pursuit, plan=only)
    lines = tuple(
        replace(line, line_index=number) for number, line in enumerate(measurement.lines[::2])
    )
    said = after(pursuit, replace(measurement, lines=lines[:3]), 3)
    assert said.state is TargetState.OPEN
    x = replace(pursuit, target=target_from_text("E_XX=1mm"))
    assert after(x, replace(measurement, lines=lines[:1]), 1).state is not TargetState.REACHED


def test_an_incomplete_pass_is_not_a_run():
    pursuit, measurement = demo(PLAN.format(repeats=2), "E_XX=1um")
    one = measurement.lines[3]
    holed = replace(one, displacement=np.where(np.arange(len(one.time)) == 2, np.nan, 0.0))
    lines = (*measurement.lines[:3], holed)
    assert after(pursuit, replace(measurement, lines=lines), 4).state is not TargetState.REACHED


def test_a_parameter_of_the_standard_is_known_by_its_conditions_after_five_runs():
    text = CONDITIONS.format(until="X:E=1um", drift="4.0e-7")
    said = course(*demo(TEST_PLAN, text))
    assert [one.lines for one in said if one.state is TargetState.REACHED] == [10]
    # U falls with every pair of runs, and is known before the standard's least number.
    known = [one.reached for one in said if isfinite(one.reached)]
    assert known[0] > known[-1] and len(known) > 5
    more = CONDITIONS.format(until=f"X:E={known[-1] * 0.97e6:.4f}um", drift="4.0e-7")
    assert course(*demo(TEST_PLAN, more))[-1].lines == 12
    pursuit, measurement = demo(TEST_PLAN, "X:E=1um")
    assert isnan(after(pursuit, measurement, 12).reached)


def test_the_decision_is_the_same_whenever_it_is_asked():
    pursuit, measurement = demo(PLAN.format(repeats=2), "20um")
    assert after(pursuit, measurement, 24) == after(pursuit, measurement, 24)
    assert repr(after(pursuit, measurement, 7)) == repr(after(pursuit, measurement, 7))


def machine_of(plausible):
    low, travel = np.array(plausible.origin), np.array(plausible.travel)
    return Machine(
        "any",
        plausible.chain,
        tuple(low - 0.1),
        tuple(low + travel + 0.1),
        0.5,
        2.0,
        rotations=ANGLE,
    )


def known_at(pursuit, measurement, count):
    """Return U by the lines so far, as the solver alone has it."""
    first = replace(measurement, lines=measurement.lines[:count])
    try:
        results = {"least_squares": solve(first)}
    except NotDeterminable:
        return np.nan
    lead = lead_of_results(results, first, NOTHING_MISSING)
    return reached(pursuit.target, first, results, lead)


@pytest.mark.parametrize("machines", [2, pytest.param(50, id="many")])
def test_whenever_a_run_says_that_its_target_is_reached_it_is(machines):
    overshoot = []
    for seed in range(machines):
        machine = draw(seed)
        plan = machine.steps(passes=3)
        quantity = ("volumetric", "C0Y")[seed % 2]
        pursuit = Pursuit(
            Target(quantity, 1.0, "m" if seed % 2 == 0 else "rad"), plan, machine_of(machine)
        )
        ends = [count for count in pursuit.line_ends if count > 30]
        # What the same machine reached on another day is asked for.
        other = machine.measure(plan, day=1)
        asked = known_at(pursuit, other, ends[seed % len(ends)])
        pursuit = replace(pursuit, target=replace(pursuit.target, size=asked))
        measurement = machine.measure(plan)
        best = next((end for end in ends if known_at(pursuit, measurement, end) <= asked), None)
        said = next(
            (
                one
                for one in (after(pursuit, measurement, end) for end in ends)
                if one.state is TargetState.REACHED
            ),
            None,
        )
        assert (said is None) == (best is None), seed
        if said is None:
            continue
        assert said.reached <= asked
        if quantity == "volumetric":
            first = replace(measurement, lines=measurement.lines[: said.lines])
            report = Report((solve(first),), chain=machine.chain, measurement=first)
            assert lead_of(with_budget(report)).expanded_uncertainty <= asked
        times = np.cumsum(pursuit.line_times)
        overshoot.append(times[said.lines - 1] / times[best - 1] - 1.0)
    assert overshoot and max(overshoot) <= 0.15
