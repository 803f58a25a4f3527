"""What the command line of a real ROS 2 sees of nodes on the embedded client, and on its own.

Skipped where no ROS 2 is sourced; how to run it stands in docs/ros2.md.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator

import pytest
import two_clients
from echo_server import ACTION, LATCHED_SENT, MANAGED, SERVER, SPACE, topic
from patience import PATIENCE

from stepdiag_ros.embedded import registry

LOOK = ("--no-daemon", "--spin-time", "2")
"""A daemon would be left behind, and would know the nodes of the test before."""


@pytest.fixture(scope="module", autouse=True, params=["embedded", "real"])
def server(request: pytest.FixtureRequest) -> Iterator[None]:
    try:
        middleware = two_clients.middleware()
    except two_clients.NotThere as why:
        pytest.skip(str(why))
    if "cyclone" not in middleware:
        pytest.skip(f"services do not cross between {middleware} and Cyclone DDS")
    with two_clients.serving(request.param):
        yield
    ros2("daemon", "stop")


def ros2(*arguments: str) -> str:
    """Return what a ROS 2 command prints."""
    done = subprocess.run(
        ["ros2", *arguments],
        env=two_clients.environment("real"),
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_nodes_and_services() -> None:
    assert {f"/{SERVER}", f"/{MANAGED}"} <= set(ros2("node", "list", *LOOK).split())
    told = ros2("node", "info", f"/{SERVER}", *LOOK)
    assert f"{SPACE}/latched: std_msgs/msg/String" in told
    assert f"{SPACE}/trigger: std_srvs/srv/Trigger" in told
    assert f"{SPACE}/measure: {ACTION}" in told
    assert "Trigger" in ros2("service", "list", "-t", *LOOK)
    answer = ros2("service", "call", f"{SPACE}/trigger", "std_srvs/srv/Trigger")
    assert "success=True" in answer and "served" in answer


def test_a_topic_with_its_type_hash_and_qos() -> None:
    type_name = "stepdiag_ros/msg/VolumetricErrors"
    told = ros2("topic", "info", "-v", topic("back", type_name), *LOOK)
    assert re.search(rf"Topic type: {type_name}$", told, re.MULTILINE)
    assert f"Topic type hash: {registry.hash_of(registry.message_class(type_name))}" in told
    assert f"Node name: {SERVER}" in told and "Reliability: RELIABLE" in told
    told = ros2("topic", "info", "-v", f"{SPACE}/latched", *LOOK)
    assert "Durability: TRANSIENT_LOCAL" in told
    late = ("--qos-durability", "transient_local", "--qos-reliability", "reliable")
    heard = ros2("topic", "echo", "--once", f"{SPACE}/latched", "std_msgs/msg/String", *late)
    assert re.search(rf"data: latched [0-{LATCHED_SENT - 1}]", heard)


def test_parameters() -> None:
    node = f"/{SERVER}"
    assert {"speed", "count", "fixed"} <= set(ros2("param", "list", node, *LOOK).split())
    assert "Integer value is: 3" in ros2("param", "get", node, "count", *LOOK)
    told = ros2("param", "describe", node, "speed", *LOOK)
    assert "a speed, m/s" in told and "Max value: 2.0" in told
    assert "never faster than the machine" in told
    assert "successful" in ros2("param", "set", node, "speed", "1.25", *LOOK)
    assert "speed: 1.25" in ros2("param", "dump", node, *LOOK)


def test_actions_and_managed_nodes() -> None:
    assert f"{SPACE}/measure [{ACTION}]" in ros2("action", "list", "-t")
    assert f"/{SERVER}" in ros2("action", "info", f"{SPACE}/measure")
    goal = ros2("action", "send_goal", f"{SPACE}/measure", ACTION, "{plan: foreign}")
    assert "Goal was rejected" in goal
    assert f"/{MANAGED}" in ros2("lifecycle", "nodes", *LOOK).split()
    for transition, state in (("configure", "inactive"), ("activate", "active")):
        assert "successful" in ros2("lifecycle", "set", f"/{MANAGED}", transition, *LOOK)
        assert state in ros2("lifecycle", "get", f"/{MANAGED}", *LOOK)
