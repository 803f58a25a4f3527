"""The sequencer asks the bridge to accept commands again after a stop, as often as it takes."""

import time

import pytest
import rclpy
from patience import PATIENCE
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from stepdiag_ros.nodes import sequencer
from stepdiag_ros.nodes.sequencer import RESET_TRIES, SequencerNode


@pytest.fixture
def ask(monkeypatch):
    """Return what resets a bridge that refuses so often, and tells what became of it."""
    monkeypatch.setattr(sequencer, "RESET_LIMIT", 0.05)
    rclpy.init(args=[])
    node, bridge = SequencerNode(), rclpy.create_node("cnc_bridge")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    executor.add_node(bridge)

    def reset(refusals):
        asked, done = [], []

        def answer(_, response):
            asked.append(True)
            response.success = len(asked) > refusals
            response.message = "ready" if response.success else "the axes still move"
            return response

        bridge.create_service(Trigger, "cnc_bridge/reset", answer)
        assert node._reset_client.wait_for_service(5.0)
        node._reset_machine(lambda: done.append(True))
        deadline = time.monotonic() + PATIENCE
        while node._after_reset is not None and time.monotonic() < deadline:
            executor.spin_once(0.02)
            node._insist_on_reset()
        return len(asked), len(done), node.health._text

    yield reset
    rclpy.try_shutdown()


def test_a_machine_that_still_brakes_is_reset_when_it_stands(ask):
    assert ask(refusals=2)[:2] == (3, 1)


def test_a_machine_that_cannot_be_reset_is_told_of(ask):
    asked, done, text = ask(refusals=100)
    assert (asked, done) == (RESET_TRIES, 0)
    assert text == "the CNC bridge cannot be reset: the axes still move"
