"""Runs with a target on real nodes: they end where it is reached, and their bags say the same."""

from dataclasses import replace
from pathlib import Path

import pytest
from refused import refused
from running_cell import nodes_of

from stepdiag_ros import topics
from stepdiag_ros.bags.passes import Completeness, completeness_of
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.cli import main
from stepdiag_ros.evaluation.decision import lead_of_results
from stepdiag_ros.evaluation.positioning import positioning_of, same_test
from stepdiag_ros.evaluation.pursuit import outlook, pursuit_from_text, standing
from stepdiag_ros.evaluation.recorded_run import report_of_run
from stepdiag_ros.evaluation.solving import solve_run
from stepdiag_ros.messages.target import target_of
from stepdiag_ros.metrology.target import TargetState
from stepdiag_ros.processes.following import RunFailed
from stepdiag_ros.processes.measure import MeasuringSession
from stepdiag_ros.run.sequence import State

PLAN = """\
name: two short lines
step_m: [0.02, 0.02, 0.02]
blocks: 3
repeats: {repeats}
directions: [forward, backward]
feed_m_per_s: 0.1
pause_for_setup: false
lines:
  - {{kind: linear, names: [x, y]}}
sampling: {{dwell_s: 0.1, settle_s: 0.1, window_s: 0.1}}
"""


def measured(folder, until, repeats=3):
    """Return the bag of a run, and how far it was from its target in all that was heard of it."""
    plan = folder / "plan.yaml"
    plan.write_text(PLAN.format(repeats=repeats))
    heard = []
    nodes = nodes_of(folder, plan=str(plan))
    session = MeasuringSession(nodes, folder, lambda news: heard.append(news.target), until=until)
    return session.measure(), [one for one in heard if one is not None]


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    return measured(tmp_path_factory.mktemp("reached"), "E_XX=1um")


def judged(bag, topic=topics.RUN_VERDICT):
    """Return how far the run was from its target by the messages of a topic in the bag."""
    said = []
    with BagReader(bag) as source:
        for record, message in source.messages():
            if record.topic.endswith(topic.name):
                said.append(target_of(message))
    return {one.lines: one for one in said if one is not None}


def test_the_run_ends_with_the_line_that_reaches_the_target(ended):
    run = load_run(ended[0])
    last = run.states[-1]
    assert (State(last.state), last.line_index) == (State.FINISHED, 4)
    assert last.target.state is TargetState.REACHED and last.target.reached <= 1e-6
    assert {line.line_index for line in run.lines} == set(range(4))
    assert {command.line_index for command in run.commands} == set(range(4))
    assert completeness_of(run, run.measurement).whole and not run.flaws


def test_the_test_of_a_line_that_was_not_repeated_to_its_end_is_recorded(ended):
    run = load_run(ended[0])
    (test,) = run.tests
    assert (test.name, test.runs) == ("X", (2, 2))
    (computed,) = positioning_of(run).tests
    assert same_test(test, computed)


def test_the_uncertainty_is_followed_from_the_start_to_the_target(ended):
    course = judged(ended[0], topics.RUN_STATE)
    assert {one.lines for one in ended[1]} <= set(course) and ended[1][-1].lines == 4
    assert set(course) == set(range(5))
    # How long the lines take depends on how busy the computer is.
    assert all(course[lines].time_left > 0.0 for lines in range(4)) and course[4].time_left == 0.0
    assert [one.state for one in course.values()][:4] == [TargetState.OPEN] * 4
    assert course[1].reached > course[4].reached


def test_the_bag_alone_gives_the_same_judgements_bit_for_bit(ended):
    run = load_run(ended[0])
    pursuit = pursuit_from_text(run.until, run.plan, run.machine_text)
    recorded = judged(ended[0])
    assert repr(recorded[0]) == repr(outlook(pursuit))
    for count in range(1, 5):
        first = replace(run.measurement, lines=run.measurement.lines[:count])
        results = solve_run(run.plan, first, first.lines[-1]).results
        lead = lead_of_results(results, first, Completeness(len(run.plan.lines), count))
        assert repr(standing(pursuit, first, results, lead)) == repr(recorded[count]), count
    assert repr(report_of_run(run).target) == repr(recorded[4])


def test_a_replay_on_nodes_comes_to_the_same_end(ended, capsys):
    assert main(["replay", str(ended[0]), "--rate", "0", "--check"]) == 0, capsys.readouterr().out


def test_a_target_that_is_not_reached_is_said_and_the_run_goes_to_its_end(tmp_path):
    bag, heard = measured(tmp_path, "E_XX=1nm", repeats=2)
    assert heard[0].lines == 0 and heard[0].state is TargetState.BEYOND_PLAN
    assert heard[0].expected > 1e-9
    last = load_run(bag).states[-1]
    assert (State(last.state), last.line_index) == (State.FINISHED, 8)
    assert last.target.state is TargetState.BEYOND_PLAN and last.target.lines == 8
    assert "0.001 µm" in last.text


def test_a_quantity_that_the_plan_does_not_determine_moves_nothing(tmp_path, capsys):
    with refused(RunFailed, None, "C0Y"):
        measured(tmp_path, "C0Y=1urad")
    for bag in tmp_path.glob("*.mcap"):
        assert load_run(bag).commands == ()
    plan, folder = tmp_path / "plan.yaml", tmp_path / "none"
    given = ["run", "--plan", str(plan), "--until", "C0Y=1urad", "--output", str(folder)]
    assert main(given) == 1
    assert "C0Y" in capsys.readouterr().err and not Path(folder).exists()
