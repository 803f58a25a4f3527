"""The ROS side of the ros2_control driver in front of the peer: goals of its own and of others."""

import time
from math import inf

import pytest
from domains import own_domain
from patience import PATIENCE
from trajectory_peer import TrajectoryPeer

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros.devices.cnc.joint_controller import (
    ControllerNames,
    GoalEnd,
    OtherGoals,
    Outcome,
    Trajectory,
    TrajectoryPoint,
)
from stepdiag_ros.processes.graph import in_graph

NAMES = ControllerNames(
    "/gantry/gantry_controller",
    "/gantry/controller_manager",
    "/gantry/joint_states",
    "/gantry/robot_description",
)
JOINTS = ("x", "y1", "y2", "z")


def move(x, seconds):
    """Return a trajectory of the joint x to a place."""
    end = TrajectoryPoint(seconds, (x, 0.0, 0.0, 0.0), (0.0,) * 4)
    return Trajectory(JOINTS, (end,), (0.1,) * 4, (1e-6,) * 4, 1.0)


class Client:
    """A node with the ROS side of the driver, and the news that have come."""

    def __init__(self, node):
        from stepdiag_ros.nodes.joint_controller import RosJointController

        self.node, self.controller, self.came = node, RosJointController(node, NAMES), []

    def until(self, condition, limit=PATIENCE):
        import rclpy

        end = time.monotonic() + limit
        while not condition() and time.monotonic() < end:
            rclpy.spin_once(self.node, timeout_sec=0.001)
            self.came += self.controller.news()
        return bool(condition())

    def of(self, kind):
        return [one for one in self.came if isinstance(one, kind)]


@pytest.fixture
def peer():
    with own_domain(), in_graph(), TrajectoryPeer() as peer:
        yield peer


@pytest.fixture
def client(peer):
    # It only has to be there.
    del peer
    import rclpy

    client = Client(rclpy.create_node("one"))
    assert client.until(lambda: client.controller.reachable)
    yield client
    client.controller.close()


def test_a_goal_that_is_cancelled_before_its_end_is_reported_is_no_other_clients(peer, client):
    import rclpy

    peer.reported = inf  # the end of the goal is not reported for the time being
    client.controller.send(1, move(0.01, 0.2))
    assert client.until(lambda: peer.robot.done)
    client.controller.cancel()
    assert client.until(lambda: not peer.robot.ended)
    peer.reported = 0.0
    assert not client.until(lambda: client.of(GoalEnd), 0.5)
    # Whoever opens the device anew does not know the goal.
    again = Client(rclpy.create_node("two"))
    assert again.until(lambda: again.controller.reachable)
    again.controller.send(2, move(0.0, 0.1))
    assert again.until(lambda: again.of(GoalEnd))
    assert [one.outcome for one in again.of(GoalEnd)] == [Outcome.SUCCEEDED]
    assert not again.of(OtherGoals)
    again.controller.close()


def test_the_move_after_a_goal_that_was_cancelled_before_its_report_can_be_stopped(peer, client):
    peer.reported = inf
    client.controller.send(1, move(0.01, 0.2))
    assert client.until(lambda: peer.robot.done)
    client.controller.cancel()
    assert client.until(lambda: not peer.robot.ended)
    peer.reported = 0.0
    client.controller.send(2, move(0.5, 60.0))
    assert client.until(lambda: [one.number for one in client.of(GoalEnd)] == [1])
    client.controller.cancel()
    assert client.until(lambda: len(client.of(GoalEnd)) == 2)
    assert client.of(GoalEnd)[1].number == 2
    assert client.of(GoalEnd)[1].outcome is Outcome.CANCELED
    assert peer.robot.positions()["x"] < 0.4


def test_a_goal_of_another_client_at_work_is_seen(client):
    import rclpy

    other = Client(rclpy.create_node("other"))
    assert other.until(lambda: other.controller.reachable)
    other.controller.send(1, move(0.01, 1.0))
    assert other.until(lambda: seen(client) == [1])
    assert other.until(lambda: seen(client) == [1, 0])
    other.controller.close()


def seen(client):
    """Return how many goals of others the client has seen, one after the other."""
    client.until(lambda: False, 0.01)
    return [one.active for one in client.of(OtherGoals)]
