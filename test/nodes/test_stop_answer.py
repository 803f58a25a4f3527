"""Whoever ends a run is told if the machine may still move."""

import time

import pytest
import rclpy
from patience import PATIENCE
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from std_srvs.srv import Trigger

from stepdiag_ros import topics
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.nodes import sequencer
from stepdiag_ros.nodes.links import message_class, quality
from stepdiag_ros.nodes.sequencer import SequencerNode
from stepdiag_ros.run.sequence import Command, Purpose, Sequence, State
from stepdiag_ros.run.supervision import Peer

REFUSAL = "the controller has failed: use the emergency stop"


class Rig:
    """A sequencer in a run, and a bridge that answers its wish to stop as the test says."""

    def __init__(self) -> None:
        rclpy.init(args=[])
        self.node, self.bridge = SequencerNode(), rclpy.create_node("cnc_bridge")
        self.executor = SingleThreadedExecutor()
        for node in (self.node, self.bridge):
            self.executor.add_node(node)
        self.states = []
        topic = topics.RUN_STATE
        self.bridge.create_subscription(
            message_class(topic), topic.name, self.states.append, quality(topic)
        )
        node = self.node
        node._sequence = Sequence(node._plan, (0.0, 0.0, 0.0), lambda _: None, node._stop_machine)
        node.run_id, node.run_over, node._needed = "a run", False, ()
        node._sequence.start(node.now(), node.real_time())

    def offer(self, success, message=""):
        def answer(_, response):
            response.success, response.message = success, message
            return response

        self.bridge.create_service(Trigger, "cnc_bridge/stop", answer)
        self.spin(self.node._stop_client.service_is_ready)

    def spin(self, done, limit=PATIENCE):
        end = time.monotonic() + limit
        while not done():
            assert time.monotonic() < end, "it does not happen"
            self.executor.spin_once(timeout_sec=0.02)

    def said(self, text):
        """Wait until the run state says a text, and return what the node says of itself."""
        self.spin(lambda: any(text in state.text for state in self.states))
        return self.node.health._text


def answered(response):
    response.success = True
    return response


@pytest.fixture
def rig():
    made = Rig()
    yield made
    made.executor.shutdown()
    rclpy.try_shutdown()


def test_a_run_ends_when_the_clock_is_set_back_and_the_next_is_commanded_by_the_new_time(
    rig, monkeypatch
):
    rig.offer(success=True)
    node, now, hour = rig.node, rig.node.now, 3_600_000_000_000
    node._not_before = now()
    node._update()
    monkeypatch.setattr(node, "now", lambda: now() - hour)
    assert "set back by 3600.0 s" in rig.said("set back")
    assert node.run_over and node._sequence.state is State.ABORTED
    commands = []
    monkeypatch.setattr(node._commands, "publish", commands.append)
    command = Command(1, Purpose.STOP, 0, 1, "x", 0, "X", (0.01, 0.0, 0.0), 0.01)
    node._send(command)
    assert to_nanoseconds(commands[0].header.stamp) <= now() - hour


def test_a_machine_that_was_stopped_is_not_spoken_of(rig):
    rig.offer(success=True)
    rig.node.abort()
    rig.spin(lambda: rig.node._stop_asked is None)
    assert rig.said("aborted by the operator") == "ready; last run: aborted by the operator"
    assert not any("may still move" in state.text for state in rig.states)


@pytest.mark.parametrize("ends", ["abort", "fault"])
def test_a_bridge_that_cannot_stop_the_machine_is_told_of(rig, ends):
    rig.offer(False, REFUSAL)
    if ends == "abort":
        rig.node.abort()
    else:
        rig.node._sequence.fault("the beam is lost")
        rig.node._publish_changes()
    said = rig.said(f"; the machine may still move: {REFUSAL}")
    assert REFUSAL in said and not said.startswith("ready")
    # Until it moves on because somebody has seen to it.
    if ends == "fault":
        rig.node._sequence.resume(rig.node.now(), rig.node.real_time(), (0.0, 0.0, 0.0))
        assert rig.node._sequence.state is State.RUNNING
        assert rig.node._progress().text == "measuring"


def test_a_bridge_that_does_not_answer_is_told_of_until_it_does(rig, monkeypatch):
    monkeypatch.setattr(sequencer, "STOP_LIMIT", 0.1)
    rig.offer(success=True)
    rig.executor.remove_node(rig.bridge)
    rig.node.abort()
    rig.spin(lambda: "does not answer" in rig.node.health._text)
    rig.executor.add_node(rig.bridge)
    rig.spin(lambda: rig.node.health._text == "ready; last run: aborted by the operator")
    assert rig.said("does not answer its stop service")


def test_a_wish_to_stop_that_a_dead_bridge_has_not_heard_is_no_news_once_the_run_goes_on(
    rig, monkeypatch
):
    monkeypatch.setattr(sequencer, "STOP_LIMIT", 0.3)
    rig.offer(success=True)
    rig.executor.remove_node(rig.bridge)
    sequence = rig.node._sequence
    sequence.fault("cnc_bridge is silent")
    sequence.resume(rig.node.now(), rig.node.real_time(), (0.0, 0.0, 0.0))
    rig.spin(lambda: rig.node._stop_asked is None)
    assert sequence.state is State.RUNNING and sequence.unstopped == ""


def test_nor_once_a_run_that_was_resumed_has_ended(rig, monkeypatch):
    monkeypatch.setattr(sequencer, "STOP_LIMIT", 0.3)
    rig.offer(success=True)
    rig.executor.remove_node(rig.bridge)
    rig.node._sequence.fault("cnc_bridge is silent")
    begun, resumed = time.monotonic(), []
    reset = Future()
    reset.set_result(answered(Trigger.Response()))
    rig.node._after_reset = lambda: resumed.append(True)
    rig.node._on_reset(reset)
    rig.spin(lambda: time.monotonic() - begun > 0.6)
    assert resumed and rig.node._sequence.unstopped == ""


def test_a_bridge_that_is_not_there_is_told_of(rig):
    rig.node.abort()
    assert "does not offer its stop service" in rig.said("does not offer its stop service")


def test_a_restarted_assembler_holds_the_run(rig):
    node, real = rig.node, rig.node.real_time()
    node._sessions = {"first"}
    node.on_heartbeat(Peer("assembler", real, "first", node.run_id))
    assert node._sequence.state is not State.FAULT
    node.on_heartbeat(Peer("assembler", real, "second", node.run_id))
    assert node._sequence.state is State.FAULT and "assembler" in node._sequence.text
