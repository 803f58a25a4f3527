"""A whole step-diagonal measurement on a real LinuxCNC, with an e-stop on the way."""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from domains import room_for_a_cell
from linuxcnc_watched import at_rest, until_all_are_up
from patience import PATIENCE

from stepdiag_ros import topics
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.processes.cell import twin_cell
from stepdiag_ros.processes.following import FollowedRun
from stepdiag_ros.processes.graph import in_graph
from stepdiag_ros.processes.node_process import Processes
from stepdiag_ros.run.sequence import Answer, State

PLAN = Path(__file__).parent / "measured_on_linuxcnc.yaml"
pytestmark = pytest.mark.timeout(2 * PATIENCE)


def stepdiag(*arguments):
    done = subprocess.run(
        [sys.executable, "-m", "stepdiag_ros.cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.returncode == 0, done.stderr + done.stdout
    return done.stdout


class Run:
    """One run of the plan: in its second diagonal somebody presses the e-stop, and releases it."""

    def __init__(self, instance, folder: Path) -> None:
        from stepdiag_ros.nodes.operator import OperatorNode

        self.instance = instance
        self.held: list[tuple[State, str]] = []
        self.position_in_hold: list[float] = []
        self.silences = 0
        device = folder / "linuxcnc.yaml"
        # A busy computer is no dead controller.
        device.write_text(f"socket: {instance.socket}\ndead_man_s: 2.0\nsilence_s: 20.0\n")
        nodes = twin_cell(str(PLAN), "demo", "demo", folder, "linuxcnc", str(device))
        with room_for_a_cell(), in_graph(), Processes(nodes, folder / "logs") as processes:
            operator = OperatorNode()
            until_all_are_up(operator, nodes)
            run = FollowedRun(operator, self.tell, lambda: self.check(processes), self.go_on)
            self.bag = run.measure().bag

    def check(self, processes: Processes) -> None:
        assert not processes.ended(), processes.ended()

    def tell(self, told) -> None:
        if told.done >= 25 and not self.held and not self.position_in_hold:
            self.position_in_hold.append(math.nan)
            self.instance.operate("STATE_ESTOP")

    def go_on(self, state: State, text: str) -> bool:
        if "e-stop" not in text:
            # This computer was too busy for a node.
            self.silences += 1
            return True
        for _ in range(2):
            self.position_in_hold.append(at_rest(self.instance))
        self.instance.operate("STATE_ESTOP_RESET", "STATE_ON")
        self.held.append((state, text))
        return True


@pytest.fixture(scope="module")
def finished(make_instance, tmp_path_factory):
    instance = make_instance()
    run = Run(instance, tmp_path_factory.mktemp("run"))
    instance.stop()
    return run


@pytest.fixture(scope="module")
def document(finished, tmp_path_factory):
    folder = tmp_path_factory.mktemp("solved")
    return json.loads(
        stepdiag("solve", finished.bag, "--json", "--pictures", "none", "--output", folder)
    )


def test_the_result_agrees_with_the_errors_of_the_twin_within_its_uncertainty(document):
    result = document["methods"]["least_squares"]
    comparison = result["comparison_with_truth"]
    assert comparison["rms"] < 0.1e-6
    assert comparison["coverage_95"] > 0.8
    truth = document["truth"]["curves"]
    for name, values in result["curves"].items():
        found, true = np.array(values, dtype=float), np.array(truth[name], dtype=float)
        uncertainty = np.array(result["standard_uncertainty"][name], dtype=float)
        assert np.nanmax(np.abs(found - true) - 5.0 * uncertainty) < 1e-9, name
    # And these are errors of micrometres: a solver that says zero would not pass.
    assert max(np.ptp(np.array(values, dtype=float)) for values in truth.values()) > 1e-6
    assert document["methods"]["conventional"]["comparison_with_truth"]["rms"] > 1e-6


def test_the_e_stop_held_the_run_until_somebody_let_it_go_on(finished):
    assert len(finished.held) == 1
    state, text = finished.held[0]
    assert state is State.FAULT and "e-stop" in text
    _, first, second = finished.position_in_hold
    assert first == second
    recorded = load_run(finished.bag)
    assert len(recorded.lines) == len(recorded.plan.lines)
    # The line that was broken was measured again, from its first stop.
    assert len(recorded.stops) > recorded.plan.stop_count


def test_every_command_was_executed_once_and_the_broken_one_failed_with_the_reason(finished):
    answers: dict[Answer, list[int]] = {answer: [] for answer in Answer}
    broken, positions, targets = [], [], []
    with BagReader(finished.bag) as bag:
        for record, message in bag.messages():
            if record.topic.endswith("command_status"):
                answers[Answer(message.status)].append(message.command_id)
                if message.status == Answer.FAULT:
                    broken.append(message.reason)
            elif record.topic == topics.absolute(topics.MACHINE_COMMAND):
                targets.append(message.target)
            elif record.topic.endswith("joint_states"):
                assert list(message.name) == ["X", "Y", "Z", "X_motor", "Y_motor", "Z_motor"]
                positions.append(message.position)
    for answer in (Answer.ACCEPTED, Answer.IN_POSITION):
        assert len(set(answers[answer])) == len(answers[answer]) >= 42
    # Between two moves there is nothing to break.
    assert sum("e-stop" in reason for reason in broken) <= 1
    assert sum("e-stop" not in reason for reason in broken) <= finished.silences
    # A silence of a busy computer stops the move that is under way.
    stopped = set(answers[Answer.STOPPED])
    assert len(stopped) <= finished.silences
    ended = {*answers[Answer.IN_POSITION], *answers[Answer.FAULT], *stopped}
    assert set(answers[Answer.ACCEPTED]) == ended
    # No compensation in this LinuxCNC: where an axis stands, its motor does. In a move, one is read
    # after the other, on a busy computer long after it; a position that stays is no sign of rest
    # there, but a target is.
    found = np.array(positions)
    assert len(found) > 500
    off = np.abs(found[:, np.newaxis, :3] - np.unique(np.array(targets), axis=0))
    standing = found[np.any(off.max(axis=2) < 1e-7, axis=1)]
    assert len(standing) > 42
    assert np.abs(standing[:, :3] - standing[:, 3:]).max() < 1e-6


def test_a_replay_of_the_bag_gives_the_same_to_the_last_bit(finished, document):
    assert all(method["equals_recorded"] for method in document["methods"].values())
    told = stepdiag("replay", finished.bag, "--rate", "100", "--check", "--json")
    same = json.loads(told)["same"]
    assert len(same) >= 6 and all(same.values())
