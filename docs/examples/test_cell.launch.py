"""Tests a simulated cell with launch_testing: the verdict of a run, the exit codes of all nodes.

    launch_test docs/examples/test_cell.launch.py

To test your own cell, include your launch file, and state your plan and its result.
"""

import tempfile
import time
import unittest
from collections.abc import Callable
from math import isfinite
from typing import Any

import stepdiag_ros.client  # noqa: F401 - without ROS 2, this makes the next imports possible

# isort: split
import launch_testing
import rclpy
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch_ros.substitutions import FindPackageShare
from launch_testing.actions import ReadyToTest
from launch_testing.asserts import assertExitCodes
from rclpy.action import ActionClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from stepdiag_ros.action import Measure
from stepdiag_ros.msg import RunVerdict

PLAN = "quick"
TIMEOUT = 120.0
"""Seconds that one step of the test may take."""


def generate_test_description() -> LaunchDescription:
    """Return the nodes of a simulated cell; the test itself waits until the sequencer is there."""
    arguments = {"plan": PLAN, "factor": "10.0", "folder": tempfile.mkdtemp()}
    file = [FindPackageShare("stepdiag_ros"), "/launch/simulated_cell.launch.py"]
    cell = IncludeLaunchDescription(file, launch_arguments=arguments.items())
    return LaunchDescription([cell, ReadyToTest()])


class TestRun(unittest.TestCase):
    """Is executed while the nodes run."""

    def setUp(self) -> None:
        """Make a node that keeps every verdict."""
        rclpy.init()
        self.node = rclpy.create_node("cell_test")
        self.verdicts: list[RunVerdict] = []
        latched = QoSProfile(depth=20, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.node.create_subscription(RunVerdict, "result/verdict", self.verdicts.append, latched)
        self.measure = ActionClient(self.node, Measure, "sequencer/measure")

    def tearDown(self) -> None:
        """End the node."""
        self.node.destroy_node()
        rclpy.try_shutdown()

    def wait_for(self, condition: Callable[[], bool], what: str) -> None:
        """Spin until a condition holds; the test fails if it does not within ``TIMEOUT``."""
        until = time.monotonic() + TIMEOUT
        while not condition():
            rclpy.spin_once(self.node, timeout_sec=0.1)
            self.assertLess(time.monotonic(), until, f"not within {TIMEOUT} s: {what}")

    def test_a_run_ends_with_its_verdict(self) -> None:
        """Measure the plan by the action, and read the verdict on this run."""
        self.wait_for(self.measure.server_is_ready, "the sequencer is there")
        goal = self.measure.send_goal_async(Measure.Goal(plan=PLAN))
        self.wait_for(goal.done, "the sequencer has answered")
        run = goal.result().get_result_async()
        self.wait_for(run.done, "the run has ended")
        result = run.result().result
        self.assertEqual(result.outcome, Measure.Result.OUTCOME_FINISHED, result.text)
        self.assertEqual(list(result.incomplete), [])
        self.assertTrue(result.bag_closed, result.bag_text)

        def over() -> list[RunVerdict]:
            return [one for one in self.verdicts if one.run_id == result.run_id and one.run_over]

        self.wait_for(lambda: bool(over()), "the verdict on the run has come")
        verdict = over()[-1]
        self.assertEqual(verdict.lines, verdict.lines_planned)
        self.assertTrue(isfinite(verdict.worst_error), "the largest error is not known")
        # The plan measures each line once: whether more acts than the errors cannot be tested.
        self.assertEqual(verdict.diagnosis, RunVerdict.DIAGNOSIS_NOT_TESTABLE)


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    """Is executed when all nodes have ended."""

    def test_every_node_ends_well(self, proc_info: Any) -> None:
        """Check the exit codes: 0 after Ctrl-C, which ends the launch."""
        assertExitCodes(proc_info)
