"""Names, remapping, namespaces, the graph of nodes, and logging."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest
from ros_processes import Peer, spin_until, wait_until

Start = Callable[..., Peer]

NODE = """
from std_msgs.msg import String
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node('original', namespace='cell')
node.create_publisher(String, 'chat', 10)
node.create_publisher(String, '~/own', 10)
node.create_publisher(String, '/absolute', 10)
node.create_service(Trigger, 'go', lambda q, r: r)
print(node.get_fully_qualified_name(), flush=True)
rclpy.spin(node)
"""

PARAMETER_SERVICES = (
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
)


def run(peer: Start, *arguments: str) -> Peer:
    return peer(NODE, "--ros-args", *arguments)


def topics(node: Any, name: str, namespace: str) -> set[str]:
    found = node.get_publisher_names_and_types_by_node(name, namespace)
    return {topic for topic, _ in found} - {"/rosout", "/parameter_events"}


def test_graph_of_another_process(node: Any, peer: Start) -> None:
    run(peer).wait_for_line("/cell/original")
    assert spin_until(node, lambda: ("original", "/cell") in node.get_node_names_and_namespaces())
    wanted = {"/cell/chat", "/cell/original/own", "/absolute"}
    assert spin_until(node, lambda: topics(node, "original", "/cell") == wanted)
    # Endpoints become known one after another.
    services = node.get_service_names_and_types_by_node
    six = {f"/cell/original/{name}" for name in PARAMETER_SERVICES}
    offered = lambda: {service for service, _ in services("original", "/cell")}  # noqa: E731
    assert spin_until(node, lambda: offered() >= six | {"/cell/go"})
    assert ("/cell/chat", ["std_msgs/msg/String"]) in node.get_topic_names_and_types()
    assert ("/cell/go", ["std_srvs/srv/Trigger"]) in node.get_service_names_and_types()
    assert ("/cell/go", ["std_srvs/srv/Trigger"]) in services("original", "/cell")
    assert node.count_publishers("/cell/chat") == 1 and node.count_subscribers("/cell/chat") == 0
    assert spin_until(node, lambda: node.count_services("/cell/go") == 1)
    (info,) = node.get_publishers_info_by_topic("/cell/chat")
    assert (info.node_name, info.node_namespace) == ("original", "/cell")
    assert info.topic_type == "std_msgs/msg/String"
    assert "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18" in str(
        info.topic_type_hash
    )
    assert info.qos_profile.reliability.name == "RELIABLE"


def test_remapping(node: Any, peer: Start) -> None:
    arguments = ("-r", "__node:=renamed", "-r", "__ns:=/hall/one", "-r", "chat:=talk")
    more = ("-r", "renamed:~/own:=mine", "-r", "other:/absolute:=no", "-r", "go:=/run")
    run(peer, *arguments, *more).wait_for_line("/hall/one/renamed")
    wanted = {"/hall/one/talk", "/hall/one/mine", "/absolute"}
    assert spin_until(node, lambda: topics(node, "renamed", "/hall/one") == wanted)
    assert spin_until(node, lambda: node.count_services("/run") == 1)


def test_a_parameter_for_a_name_is_for_the_node_without_namespace(peer: Start) -> None:
    code = """
    rclpy.init()
    for space in ("", "cell"):
        node = rclpy.create_node("one", namespace=space)
        node.declare_parameter("size", 1)
        node.declare_parameter("rate", 2)
        print(node.get_parameter("size").value, node.get_parameter("rate").value)
    """
    _, out, err = peer(code, "--ros-args", "-p", "one:size:=5", "-p", "rate:=6").finish()
    assert out.splitlines() == ["5 6", "1 6"], err


def test_topic_and_service_rules(node: Any, peer: Start) -> None:
    arguments = (
        "-r",
        "rostopic://chat:=only_topic",
        "-r",
        "rosservice://chat:=x",
        "-r",
        "go:=chat",
    )
    run(peer, *arguments).wait_for_line("/cell/original")
    assert spin_until(node, lambda: node.count_publishers("/cell/only_topic") == 1)
    assert spin_until(node, lambda: node.count_services("/cell/chat") == 1)


def test_resolving_names(node: Any, ros: Any) -> None:
    assert node.resolve_topic_name("a/b") == "/a/b"
    assert node.resolve_topic_name("~/a") == "/tester/a"
    assert node.resolve_topic_name("~") == "/tester"
    assert node.resolve_topic_name("{node}/x") == "/tester/x"
    inner = ros.create_node("inner", namespace="/deep/space")
    assert inner.resolve_topic_name("a") == "/deep/space/a"
    assert inner.resolve_service_name("~/a") == "/deep/space/inner/a"
    assert inner.get_logger().name == "deep.space.inner"
    inner.destroy_node()


@pytest.mark.parametrize("name", ["", "a/b", "1a", "a b", "ä", "x" * 256])
def test_wrong_node_names(ros: Any, name: str) -> None:
    from rclpy.exceptions import InvalidNodeNameException

    with pytest.raises((InvalidNodeNameException, ValueError)):
        ros.create_node(name)


@pytest.mark.parametrize("namespace", ["a b", "/a//b", "/1", "/a/"])
def test_wrong_namespaces(ros: Any, namespace: str) -> None:
    from rclpy.exceptions import InvalidNamespaceException

    with pytest.raises((InvalidNamespaceException, ValueError)):
        ros.create_node("tester", namespace=namespace)


def test_destroyed_node_leaves_the_graph(ros: Any, node: Any) -> None:
    from std_msgs.msg import String

    other = ros.create_node("other")
    other.create_publisher(String, "chat", 10)
    assert "other" in node.get_node_names()
    # rclpy hears of its own endpoints from the middleware, and some time later.
    assert wait_until(lambda: node.count_publishers("chat") == 1)
    other.destroy_node()
    assert wait_until(lambda: "other" not in node.get_node_names())
    assert wait_until(lambda: node.count_publishers("chat") == 0)


def test_wait_for_node(node: Any, peer: Start) -> None:
    assert not node.wait_for_node("/cell/original", 0.05)
    run(peer)
    assert node.wait_for_node("/cell/original", 10)


def test_killed_process_leaves_no_ghost_after_its_lease(node: Any, peer: Start) -> None:
    other = run(peer)
    other.wait_for_line("/cell/original")
    assert spin_until(node, lambda: "original" in node.get_node_names())
    other.process.terminate()
    other.finish()
    assert wait_until(lambda: "original" not in node.get_node_names())


def test_log_reaches_console_and_rosout(node: Any, peer: Start) -> None:
    from rcl_interfaces.msg import Log
    from rclpy.qos import DurabilityPolicy, QoSProfile

    got: list[Any] = []
    qos = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(Log, "/rosout", got.append, qos)
    other = peer(
        """
        import time
        rclpy.init()
        node = rclpy.create_node('logger')
        log = node.get_logger()
        log.debug('hidden')
        log.warning('shown')
        log.get_child('part').error('of a part')
        for _ in range(3):
            log.info('once only', once=True)
            log.info('not the first', skip_first=True)
            log.info('throttled', throttle_duration_sec=10.0)
        time.sleep(0.6)
        """
    )
    assert spin_until(node, lambda: len(got) >= 6)
    _, _, err = other.finish()
    lines = [line for line in err.splitlines() if "[rclpy]" not in line]
    texts = ["shown", "of a part", "once only", "throttled", "not the first", "not the first"]
    assert [line.split("]: ")[1] for line in lines] == texts
    assert re.fullmatch(r"\[WARN\] \[\d{10}\.\d{9}\] \[logger\]: shown", lines[0])
    assert "[ERROR]" in lines[1] and "[logger.part]" in lines[1]
    assert [entry.msg for entry in got] == texts
    assert got[0].level == Log.WARN and got[0].name == "logger" and got[0].line > 0


def test_log_levels_from_the_command_line(peer: Start) -> None:
    other = peer(
        """
        rclpy.init()
        one, two = rclpy.create_node('one').get_logger(), rclpy.create_node('two').get_logger()
        one.debug('one debug'); one.info('one info')
        two.info('two info'); two.error('two error')
        two.set_level(rclpy.logging.LoggingSeverity.DEBUG)
        two.debug('two debug')
        """,
        "--ros-args",
        "--log-level",
        "debug",
        "--log-level",
        "two:=error",
    )
    code, _, err = other.finish()
    assert code == 0
    # A client library may log at this level, too.
    lines = [line for line in err.splitlines() if "] [one]: " in line or "] [two]: " in line]
    assert [line.split("]: ")[1] for line in lines] == [
        "one debug",
        "one info",
        "two error",
        "two debug",
    ]


@pytest.mark.usefixtures("ros")
def test_ros_arguments_are_removed() -> None:
    from rclpy.utilities import remove_ros_args

    args = ["prog", "a", "--ros-args", "-r", "x:=y", "--", "b"]
    assert remove_ros_args(args) == ["prog", "a", "b"]
