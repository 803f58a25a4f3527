"""Eight kinds of faults of a robot under ros2_control, and whether a run bears them.

Each fault begins in a move of its own; ``mend`` puts everything right again. The checks raise
AssertionError where the run has not borne them.
"""

import random
import time

import numpy as np
from patience import PATIENCE
from peer_run import LEAST_MOVES, answers_of, numbered_commands_of

from stepdiag_ros.run.sequence import Answer, State

LAG = 0.01
"""s by which the axes follow; in half a move that is more than the path tolerance."""
SETTLED = 0.5
"""s."""
NAMED = {
    "another goal": ("preempted",),
    "controller": ("deactivate", "'gantry_controller' is inactive"),
    "hardware": ("'drives'",),
    "path tolerance": ("path",),
    "goal tolerance": ("goal_time_tolerance",),
    "joint states": ("/gantry/joint_states",),
    "manager": ("/gantry/controller_manager",),
    "gantry": ("Y",),
}
"""Kind of a fault → what names it in the words with which the run is held.

A deactivated controller is reported by the end of the goal, or by the manager if it is asked just
then.
"""
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


def in_turn():
    """Return (kind, number of its move from 1, part of the move's time) of each fault."""
    return [(kind, 5 + 4 * number, 0.5) for number, kind in enumerate(NAMED)]


def at_random(seed):
    """Return the eight kinds in a random order, in random moves, at random moments."""
    chance = random.Random(seed)
    kinds = chance.sample(list(NAMED), len(NAMED))
    # Not in two moves in a row: a fault late in a move may be noticed in the next.
    moves = sorted(chance.sample(range(LEAST_MOVES - 2 * len(kinds)), len(kinds)))
    return [
        (kind, 2 + move + 2 * number, chance.uniform(0.2, 0.6))
        for number, (kind, move) in enumerate(zip(kinds, moves, strict=True))
    ]


class Faults:
    """What goes wrong with a peer, each in a move of its own.

    Args:
        peer: a ``TrajectoryPeer``.
        course: kind, move and moment of each fault, as ``in_turn`` has them.

    Attributes:
        begun: kinds of the faults that have begun, in their order.
    """

    def __init__(self, peer, course):
        self.peer, self.begun = peer, []
        for kind, move, share in course:
            peer.during[move] = (share, lambda kind=kind: self._begin(kind))

    def _begin(self, kind):
        self.begun.append(kind)
        peer, robot = self.peer, self.peer.robot
        if kind in ("hardware", "joint states", "manager"):
            # The move goes on for so long that the fault is noticed in it.
            robot.override = 1e-3
        if kind == "another goal":
            here, still = list(robot.positions().values()), [0.0] * 4
            allowed = ([1.0] * 4, [1.0] * 4, 1.0)
            robot.accept("other", robot.names, [(0.2, here, still)], allowed, time.monotonic())
        elif kind == "controller":
            robot.deactivate(time.monotonic())
        elif kind == "hardware":
            robot.hardware = "unconfigured"
        elif kind == "path tolerance":
            robot.lag = LAG
        elif kind == "goal tolerance":
            robot.offsets.update(x=1e-4)
        elif kind == "gantry":
            robot.offsets.update(y1=6e-4)
        else:
            setattr(peer, {"joint states": "sampling", "manager": "managing"}[kind], False)

    def mend(self):
        """Put everything right again, and wait until the axes stand."""
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


def check_holds(finished, faults):
    """Each of the eight faults held the run, and is named by what the run says."""
    assert sorted(faults.begun) == sorted(NAMED)
    assert [state for state, _ in finished.held] == [State.FAULT] * len(NAMED), finished.held
    for (_, text), kind in zip(finished.held, faults.begun, strict=True):
        assert any(name in text for name in NAMED[kind]), (kind, text)


def check_moves(finished, peer):
    """Each command that ended in position is a goal reached, and each goal reached a command."""
    reached = np.array(peer.targets)
    np.testing.assert_allclose(reached[:, 1], reached[:, 2], rtol=1e-6)
    reached = _moves(reached[:, [0, 1, 3]] * [1, 1, -1])
    commands = numbered_commands_of(finished.bag)
    arrived = {number for number, _ in answers_of(finished.bag, Answer.IN_POSITION)}
    done = _moves(np.array([place for number, place in commands if number in arrived]))
    assert len(done) > LEAST_MOVES
    assert _in_order(done, reached)
    assert _in_order(reached, [place for _, place in commands])


def check_lines(finished, recorded):
    """Only lines that were broken off are measured again, and none is missing."""
    attempts = {str(line.line): line.attempt for line in recorded.lines}
    assert len(recorded.lines) == len(attempts) == len(recorded.plan.lines)
    assert sum(attempts.values()) - len(attempts) <= finished.resumed


def _moves(places):
    """Return the places but for those at which the machine stood already: no goal is sent then."""
    moved = np.abs(np.diff(places, axis=0)).max(axis=1) > 1e-9
    return places[np.concatenate([[True], moved])]


def _in_order(some, of_all):
    """Say whether all of some places come in a list of places, in the same order."""
    rest = iter(of_all)
    return all(any(np.abs(place - other).max() < 1e-9 for other in rest) for place in some)
