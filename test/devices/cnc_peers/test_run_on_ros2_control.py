"""A whole measurement through the ros2_control driver, with eight kinds of faults on the way."""

import time

import numpy as np
import pytest
from patience import PATIENCE
from peer_run import (
    LEAST_MOVES,
    PeerRun,
    answers_of,
    check_displacements,
    check_result,
    numbered_commands_of,
)
from trajectory_peer import TrajectoryPeer

import stepdiag_ros.client  # noqa: F401
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.run.sequence import Answer, State

pytestmark = pytest.mark.timeout(600)
LAG = 0.01
"""s by which the axes follow; in half a move that is more than the path tolerance."""
SETTLED = 0.5
"""s."""
SETTINGS = {
    "controller": "/gantry/gantry_controller",
    "controller_manager": "/gantry/controller_manager",
    "joint_states": "/gantry/joint_states",
    "robot_description": "/gantry/robot_description",
    "joints": {
        "X": [{"name": "x"}],
        "Y": [{"name": "y1"}, {"name": "y2"}],
        "Z": [{"name": "z", "factor": -1.0}],
    },
    "acceleration_m_per_s2": [1.0, 1.0, 1.0],
    "path_tolerance_m": 0.2e-3,
    # A computer that is busy with all nodes at once is no danger to this machine.
    "silence_s": 3.0,
    "answer_limit_s": 3.0,
}


class Faults:
    """What goes wrong, each in a move of its own; ``mend`` puts everything right again."""

    def __init__(self, peer):
        self.peer, robot = peer, peer.robot
        kinds = {
            "another goal": self._preempt,
            "controller": lambda: robot.deactivate(time.monotonic()),
            "hardware": lambda: self._slowly(setattr, robot, "hardware", "unconfigured"),
            "path tolerance": lambda: setattr(robot, "lag", LAG),
            "goal tolerance": lambda: robot.offsets.update(x=1e-4),
            "joint states": lambda: self._slowly(setattr, peer, "sampling", False),
            "manager": lambda: self._slowly(setattr, peer, "managing", False),
            "gantry": lambda: robot.offsets.update(y1=6e-4),
        }
        self.begun, self._kinds = [], kinds
        for number, kind in enumerate(kinds):
            peer.halfway[5 + 4 * number] = lambda kind=kind: self._begin(kind)

    def _begin(self, kind):
        self.begun.append(kind)
        self._kinds[kind]()

    def _slowly(self, function, *arguments):
        """Let the move go on for so long that the fault is noticed in it."""
        self.peer.robot.override = 1e-3
        function(*arguments)

    def _preempt(self):
        robot = self.peer.robot
        here, still = list(robot.positions().values()), [0.0] * 4
        allowed = ([1.0] * 4, [1.0] * 4, 1.0)
        robot.accept("other", robot.names, [(0.2, here, still)], allowed, time.monotonic())

    def mend(self):
        peer, robot = self.peer, self.peer.robot
        with peer.lock:
            robot.controller = robot.hardware = "active"
            robot.lag, robot.offsets, robot.override = 0.0, {}, 1.0
            peer.sampling = peer.managing = True
        deadline = time.monotonic() + PATIENCE
        while robot.moving:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        # Nobody resumes before the axes are seen to stand where they are now.
        time.sleep(SETTLED)


@pytest.fixture(scope="module")
def peer():
    return TrajectoryPeer()


@pytest.fixture(scope="module")
def faults(peer):
    return Faults(peer)


@pytest.fixture(scope="module")
def finished(peer, faults, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    return PeerRun(folder, "ros2_control", SETTINGS, faults.mend, peer)


@pytest.fixture(scope="module")
def recorded(finished):
    return load_run(finished.bag)


def test_each_fault_holds_the_run_and_is_named(finished, faults):
    named = {
        "another goal": "preempted",
        "controller": "deactivate",
        "hardware": "'drives'",
        "path tolerance": "path",
        "goal tolerance": "goal_time_tolerance",
        "joint states": "/gantry/joint_states",
        "manager": "/gantry/controller_manager",
        "gantry": "Y",
    }
    assert faults.begun == list(named)
    assert [state for state, _ in finished.held] == [State.FAULT] * len(named), finished.held
    for (_, text), kind in zip(finished.held, named, strict=True):
        assert named[kind] in text, kind


def test_no_move_is_lost_and_none_is_made_twice(finished, peer):
    """Each command that ended in position is a goal reached, and each goal reached a command."""
    reached = np.array(peer.targets)
    assert reached[:, 1] == pytest.approx(reached[:, 2])
    reached = _moves(reached[:, [0, 1, 3]] * [1, 1, -1])
    commands = numbered_commands_of(finished.bag)
    arrived = {number for number, _ in answers_of(finished.bag, Answer.IN_POSITION)}
    done = _moves(np.array([place for number, place in commands if number in arrived]))
    assert len(done) > LEAST_MOVES
    assert _in_order(done, reached)
    assert _in_order(reached, [place for _, place in commands])


def _moves(places):
    """Return the places but for those at which the machine stood already: no goal is sent then."""
    moved = np.abs(np.diff(places, axis=0)).max(axis=1) > 1e-9
    return places[np.concatenate([[True], moved])]


def _in_order(some, of_all):
    """Say whether all of some places come in a list of places, in the same order."""
    rest = iter(of_all)
    return all(any(np.abs(place - other).max() < 1e-9 for other in rest) for place in some)


def test_only_lines_that_were_broken_off_are_measured_again(finished, recorded, faults):
    attempts = {str(line.line): line.attempt for line in recorded.lines}
    assert len(recorded.lines) == len(attempts) == len(recorded.plan.lines)
    assert sum(attempts.values()) - len(attempts) <= finished.resumed
    assert len(faults.begun) == 8


def test_the_lines_agree_with_the_twin_to_within_their_uncertainty(recorded):
    check_displacements(recorded)


def test_the_bag_gives_the_same_result_and_it_is_right(recorded):
    check_result(recorded)
