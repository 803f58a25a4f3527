"""The sequencer asks the bridge to accept commands again after a stop, as often as it takes."""

import time

import pytest
import rclpy
from patience import PATIENCE
from rclpy.executors import SingleThreadedExecutor
from refused import refused
from std_srvs.srv import Trigger

from stepdiag_ros.configuration import load_machine, load_plan
from stepdiag_ros.nodes import sequencer
from stepdiag_ros.nodes.sequencer import RESET_TRIES, SequencerNode
from stepdiag_ros.run.sequence import Sequence, State


@pytest.fixture
def ask(monkeypatch):
    """Return what resets a bridge that refuses so often, and tells what became of it."""
    monkeypatch.setattr(sequencer, "RESET_LIMIT", 0.05)
    rclpy.init(args=[])
    node, bridge = SequencerNode(), rclpy.create_node("cnc_bridge")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    executor.add_node(bridge)

    def reset(refusals, begun=True):
        asked, done = [], []

        def answer(_, response):
            asked.append(True)
            response.success = len(asked) > refusals
            response.message = "ready" if response.success else "the axes still move"
            return response

        bridge.create_service(Trigger, "cnc_bridge/reset", answer)
        assert node._reset_client.wait_for_service(PATIENCE)
        node._sequence = Sequence(node._plan, (0.0, 0.0, 0.0), lambda _: None, lambda: None)
        if begun:
            node._sequence.start(node.now(), node.real_time())
            node._sequence.fault("the controller is not active")
        node._reset_machine(lambda: done.append(True))
        deadline = time.monotonic() + PATIENCE
        while node._after_reset is not None and time.monotonic() < deadline:
            executor.spin_once(0.02)
            node._insist_on_reset()
        return len(asked), len(done), node

    yield reset
    rclpy.try_shutdown()


def test_a_machine_that_still_brakes_is_reset_when_it_stands(ask):
    assert ask(refusals=2)[:2] == (3, 1)


def test_a_machine_that_cannot_be_reset_is_told_of(ask):
    asked, done, node = ask(refusals=100)
    assert (asked, done) == (RESET_TRIES, 0)
    text = node.health._text
    assert "the axes still move" in text and "the controller is not active" in text
    assert node._sequence.state is State.FAULT, "another try may succeed"
    node._sequence.resume(node.now(), node.real_time(), (0.0, 0.0, 0.0))
    assert node._progress().text == "measuring"


def test_a_run_whose_machine_cannot_be_made_ready_never_begins(ask):
    _, done, node = ask(refusals=100, begun=False)
    assert done == 0 and node.run_over
    assert node._sequence.state is State.ABORTED and "the axes still move" in node._sequence.text


def test_a_plan_that_the_machine_cannot_execute_is_refused_with_the_name_of_the_machine(tmp_path):
    path = tmp_path / "mill.yaml"
    path.write_text(load_machine("demo")[1].replace("name: demo machine", "name: old-mill"))
    rclpy.init(args=["--ros-args", "-p", f"machine:={path}"])
    try:
        node = SequencerNode()
        with refused(ValueError, None, "old-mill", "machine") as info:
            node._executable(load_plan("demo")[1].replace("feed_m_per_s: 0.0", "feed_m_per_s: 2.0"))
        assert str(path) not in str(info.value)
    finally:
        rclpy.try_shutdown()
