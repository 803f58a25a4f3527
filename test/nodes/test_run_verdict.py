"""The solver's verdict: one message that holds all that a supervisor decides on."""

from dataclasses import replace
from math import isnan, nan
from pathlib import Path

import numpy as np
import pytest
import rclpy
from patience import PATIENCE
from tracker_runs import tracker_run

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros import topics
from stepdiag_ros.bags.passes import Completeness
from stepdiag_ros.configuration import load_cell, load_machine, plan_from_text
from stepdiag_ros.evaluation.decision import decide, lead_of_results
from stepdiag_ros.evaluation.solving import solve_reproducibly, solve_run
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.decision import from_decision
from stepdiag_ros.messages.types import message_type
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.standards.conformity import Conformity
from stepdiag_ros.metrology.standards.decision import Agreement
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.run.conclusion import LAST_WORD_LIMIT, LastWord, Outcome
from stepdiag_ros.run.supervision import Peer, Watch

RUN_ID = "20260102T030405-abcd"
PLAN = """\
name: small box
step_m: [0.01, 0.01, 0.01]
blocks: 3
repeats: 1
feed_m_per_s: 0.05
lines:
  - {kind: linear, names: [x, y, z]}
  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn], orders: [XYZ]}
"""


@pytest.fixture(scope="module")
def measured():
    return simulate(plan_from_text(PLAN, "plan"), load_cell("demo")[0])


def solved(measured):
    """Return the summary of all that was planned."""
    results, _ = solve_reproducibly(measured)
    count = len(measured.lines)
    return lead_of_results(results, measured, Completeness(count, count)), results


def test_lines_of_a_tracker_have_a_verdict_without_a_figure():
    plan, lines = tracker_run()
    measurement = Measurement(plan.volume, lines)
    found = solve_run(plan, measurement, lines[-1])
    lead = lead_of_results(found.results, measurement, Completeness(len(lines), len(lines)))
    decision = decide(lead, "seven_lines", 1e-6)
    assert lead.tracked and isnan(decision.worst_error)
    assert decision.conformity is Conformity.UNDECIDED


def rotation(label):
    """Return a finding of 5 µrad."""
    one = message_type("stepdiag_ros/msg/EffectFinding")(label=label)
    one.size, one.unit, one.meaning = ["linear"], ["rad"], ["turn over the travel"]
    for field in ("value", "standard_uncertainty", "band_low", "band_high"):
        setattr(one, field, np.array([5e-6]))
    return one


def test_the_decision_has_the_numbers_of_the_result(measured):
    # In this chain rotations may do more than the readings alone say, and a tolerance may be met
    # with U of the readings alone.
    measured = replace(measured, chain="ZXY")
    lead, results = solved(measured)
    found = of_result(results["least_squares"], measured.chain)
    expanded = lead.expanded_uncertainty
    assert lead.budgeted and expanded > 1.01 * COVERAGE_FACTOR * found.standard_uncertainty
    for tolerance, proven in (
        (nan, Conformity.NOT_ASKED),
        (found.value + 1.02 * expanded, Conformity.WITHIN),
        (found.value, Conformity.UNDECIDED),
        (found.value - 1.02 * expanded, Conformity.NOT_WITHIN),
    ):
        decision = decide(lead, "least_squares", tolerance)
        assert decision.conformity is proven, tolerance
    assert decision.diagnosis is Agreement.UNKNOWN and decision.not_determined == ()
    assert decision.worst_error == found.value and decision.worst_place == found.position
    assert decision.expanded_uncertainty == expanded and decision.budgeted
    assert decision.upper_bound >= found.value + expanded


def test_what_is_not_determined_is_unknown_and_named(measured):
    lines = Measurement(measured.volume, measured.lines[:2], measured.chain)
    decision = decide(solved(lines)[0], "least_squares", 1.0)
    assert isnan(decision.worst_error) and isnan(decision.worst_place[0])
    assert isnan(decision.expanded_uncertainty) and isnan(decision.upper_bound)
    assert not decision.budgeted
    assert decision.conformity is Conformity.UNDECIDED
    assert {"E_ZZ", "C0Y"} <= set(decision.not_determined)


def test_the_numbers_of_the_message_are_those_of_the_enumerations():
    kind = message_type(topics.RUN_VERDICT.type_name)
    for begin, codes in (
        ("CONFORMITY", Conformity),
        ("DIAGNOSIS", Agreement),
        ("OUTCOME", Outcome),
    ):
        # A run that was refused has no verdict.
        names = [name for name in codes.__members__ if name != "REFUSED"]
        assert {n: getattr(kind, f"{begin}_{n}") for n in names} == {
            n: int(codes[n]) for n in names
        }


def test_a_verdict_waits_for_the_last_word_of_a_diagnosis():
    watch, word = Watch(), LastWord(RUN_ID)
    assert not word.awaited(watch, 10.0)
    watch.heard("diagnosis", Peer("diagnosis", 10.0, "s", RUN_ID, facts={"work_left": "1"}))
    assert word.awaited(watch, 10.0) and word.awaited(watch, 100.0)
    watch.heard("diagnosis", Peer("diagnosis", 100.0, "s", RUN_ID, facts={"work_left": "0"}))
    assert word.awaited(watch, 100.0 + 0.9 * LAST_WORD_LIMIT)
    assert not word.awaited(watch, 100.1 + LAST_WORD_LIMIT)


@pytest.mark.parametrize("outcome", [Outcome.FINISHED, Outcome.ABORTED])
def test_the_solver_publishes_the_verdict_after_each_line_and_once_more_at_the_end(
    tmp_path: Path, measured, outcome
):
    from stepdiag_ros.nodes.operator import OperatorNode
    from stepdiag_ros.processes.node_process import NodeProcess, Processes

    rclpy.init(args=[])
    operator = OperatorNode()
    heard = []
    operator.listen(topics.RUN_VERDICT, heard.append)
    describe, tell = operator.announce(topics.RUN_DESCRIPTION), operator.announce(topics.LINE)
    diagnose, state = operator.announce(topics.DIAGNOSIS), operator.announce(topics.RUN_STATE)
    try:
        with Processes([NodeProcess("solver", {"tolerance": 1e-3})], tmp_path):
            description = conversion.new_message(topics.RUN_DESCRIPTION.type_name)
            description.run_id, description.plan = RUN_ID, PLAN
            description.machine = load_machine("demo")[1]
            describe.publish(description)
            for line in measured.lines:
                tell.publish(conversion.from_measured_line(line, RUN_ID))
            count = len(measured.lines)
            assert operator.spin_until(lambda: heard and heard[-1].lines == count, PATIENCE)
            assert heard[-1].conformity == Conformity.WITHIN and not heard[-1].run_over
            for verdict, label, proven in (
                ("NAMED", "backlash of X", Conformity.UNDECIDED),
                # Which uncertainties contain.
                ("NAMED", "angular error E_CZ", Conformity.WITHIN),
                ("CONSISTENT", "", Conformity.WITHIN),
            ):
                heard.clear()
                kind = message_type(topics.DIAGNOSIS.type_name)
                findings = [rotation(label)] if label else []
                diagnose.publish(
                    kind(run_id=RUN_ID, verdict=verdict, run_over=True, findings=findings)
                )
                agreed = Agreement[verdict]
                assert operator.spin_until(
                    lambda a=agreed: heard and heard[-1].diagnosis == a, PATIENCE
                )
                assert heard[-1].conformity == proven
                assert heard[-1].outcome == Outcome.UNKNOWN
            kind = message_type(topics.RUN_STATE.type_name)
            state.publish(kind(run_id=RUN_ID, state=getattr(kind, f"STATE_{outcome.name}")))
            assert operator.spin_until(lambda: heard[-1].run_over, PATIENCE)
    finally:
        operator.destroy_node()
        rclpy.shutdown()
    last = heard[-1]
    assert last.lines == last.lines_planned == count and last.tolerance == 1e-3
    # Who decides by this message alone is not told to go on after a run that was aborted.
    proven = {Outcome.FINISHED: Conformity.WITHIN, Outcome.ABORTED: Conformity.UNDECIDED}
    assert (last.outcome, last.conformity) == (outcome, proven[outcome])
    decision = decide(solved(measured)[0], "least_squares", 1e-3)
    again = from_decision(decision, RUN_ID, 0, (count, count), True, outcome)
    for field in (
        "worst_error",
        "expanded_uncertainty",
        "coverage_factor",
        "upper_bound",
        "budgeted",
        "method",
    ):
        assert getattr(last, field) == getattr(again, field), field
    assert np.array_equal(last.worst_place, again.worst_place)
