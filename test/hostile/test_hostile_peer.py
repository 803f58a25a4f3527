"""A peer that publishes without end: a node stays small, says so and goes on."""

import pytest
from nodes_here import node_here
from raw_web import resident
from rclpy.serialization import deserialize_message, serialize_message
from small_run import RUN_ID, small_stream

from stepdiag_ros import topics
from stepdiag_ros.messages.types import message_type
from stepdiag_ros.nodes.lines import MOST_KEPT
from stepdiag_ros.run.supervision import MOST_PEERS

ROUNDS = 2000
GROWTH = 60_000_000
"""Bytes that a node may grow while it is flooded."""


@pytest.mark.parametrize("name", ["assembler", "bridge", "recorder", "sequencer", "solver"])
def test_a_node_that_is_flooded_by_a_peer_stays_small_and_goes_on(name):
    """Heartbeats of ever other nodes, parameters of nodes that are not there, other runs' data."""
    array, status, pair = (
        message_type(f"diagnostic_msgs/msg/{one}")
        for one in ("DiagnosticArray", "DiagnosticStatus", "KeyValue")
    )
    event, parameter = (
        message_type(f"rcl_interfaces/msg/{one}") for one in ("ParameterEvent", "Parameter")
    )
    whole = small_stream()[:30]
    with node_here(name) as here:
        heard = {one.topic: one for one in here.hears}
        before = resident()
        for number in range(ROUNDS):
            values = [pair(key="role", value="recorder"), pair(key="session", value=f"{number}")]
            values.append(pair(key="stored", value="x" * 10_000))
            for node in (f"node_{number}", "recorder", "no name"):
                told = status(name=f"{node}: heartbeat", level=b"\0", values=values)
                here.give_to(heard["/diagnostics"], array(status=[told]))
            if "/parameter_events" in heard:
                changed = event(node=f"/n{number}", changed_parameters=[parameter(name="x" * 9000)])
                here.give_to(heard["/parameter_events"], changed)
            for topic in {topic.name: topic for _, topic, _ in whole}.values():
                for one in here.hears:
                    if one.topic == topics.absolute(topic):
                        odd = one.msg_type()
                        if hasattr(odd, "run_id"):
                            odd.run_id = f"another {number}"
                        if hasattr(odd, "command_id"):
                            odd.command_id = number
                        here.give_to(one, odd)
            if number % 100 == 0:
                here.work()
        here.work()
        assert len(here.node.watch.peers) <= MOST_PEERS
        assert resident() - before < GROWTH
        assert here.node.health._level > 0, "nothing is said"
        assert len(list(here.node.clients)) < 3 * MOST_PEERS


@pytest.fixture(autouse=True)
def alone(monkeypatch, tmp_path):
    """Let nobody else hear or be heard, and nothing be left behind."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("name", ["solver", "evaluator", "diagnosis", "scene"])
def test_lines_without_end_are_refused_at_a_limit(name):
    stream = {topic: one for _, topic, one in small_stream()}
    line = deserialize_message(stream[topics.LINE], message_type(topics.LINE.type_name))
    assert line.run_id == RUN_ID
    with node_here(name) as here:
        here.node.on_line = [].append
        here.give(topics.RUN_DESCRIPTION, stream[topics.RUN_DESCRIPTION])
        most = MOST_KEPT // len(line.time)
        before = resident()
        for number in range(most + 50):
            line.line_index, line.header.stamp.nanosec = number, number
            here.give(topics.LINE, serialize_message(line))
        assert len(here.node.lines) == most
        assert resident() - before < GROWTH
        assert here.node.health._level > 0, "nothing is said"
