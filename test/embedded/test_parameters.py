"""Parameters: declaring, checking, command line, files and services."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from patience import PATIENCE
from refused import refused

from .conftest import Peer, spin_until

Start = Callable[..., Peer]


@pytest.fixture
def make_node() -> Any:
    import rclpy

    made: list[Any] = []

    def make(*args: str, name: str = "tester", **kwargs: Any) -> Any:
        rclpy.init(args=["program", "--ros-args", *args] if args else [])
        made.append(rclpy.create_node(name, **kwargs))
        return made[-1]

    yield make
    for node in made:
        node.destroy_node()
    rclpy.try_shutdown()


def test_declare_and_get(node: Any) -> None:
    from rclpy.exceptions import (
        ParameterAlreadyDeclaredException,
        ParameterNotDeclaredException,
        ParameterUninitializedException,
    )
    from rclpy.parameter import Parameter

    assert node.declare_parameter("speed", 2.5).value == 2.5
    assert node.has_parameter("speed") and not node.has_parameter("other")
    with pytest.raises(ParameterAlreadyDeclaredException):
        node.declare_parameter("speed", 1.0)
    with pytest.raises(ParameterNotDeclaredException):
        node.get_parameter("other")
    node.declare_parameter("later", Parameter.Type.DOUBLE)
    with pytest.raises(ParameterUninitializedException):
        node.get_parameter("later")
    fallback = Parameter("later", value=3.0)
    assert node.get_parameter_or("later", fallback).value == 3.0
    names = [p.name for p in node.declare_parameters("axis", [("x", 1), ("y", [1.0, 2.0])])]
    assert names == ["axis.x", "axis.y"]
    assert {k: p.value for k, p in node.get_parameters_by_prefix("axis").items()} == {
        "x": 1,
        "y": [1.0, 2.0],
    }


def test_ranges_types_and_read_only(node: Any) -> None:
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
    from rclpy.exceptions import InvalidParameterValueException
    from rclpy.parameter import Parameter

    whole = ParameterDescriptor(integer_range=[IntegerRange(from_value=0, to_value=10, step=5)])
    node.declare_parameter("whole", 5, whole)
    real = ParameterDescriptor(
        floating_point_range=[FloatingPointRange(from_value=0.0, to_value=1.0, step=0.25)]
    )
    node.declare_parameter("real", 0.5, real)
    node.declare_parameter("fixed", "a", ParameterDescriptor(read_only=True))
    node.declare_parameter("free", 1, ParameterDescriptor(dynamic_typing=True))

    def refused(name: str, value: Any) -> str:
        result = node.set_parameters([Parameter(name, value=value)])[0]
        assert result.successful or node.get_parameter(name).value != value
        return "" if result.successful else result.reason

    assert refused("whole", 10) == "" and "out of range" in refused("whole", 11)
    assert "step" in refused("whole", 3)
    assert refused("real", 0.75) == "" and "out of range" in refused("real", 1.5)
    assert "step" in refused("real", 0.6)
    assert "Wrong parameter type" in refused("real", 1)
    assert "read-only" in refused("fixed", "b")
    assert refused("free", "text") == ""
    with pytest.raises(InvalidParameterValueException):
        node.declare_parameter("high", 11, ParameterDescriptor(integer_range=whole.integer_range))


def test_callbacks_refuse_and_follow(node: Any) -> None:
    from rcl_interfaces.msg import SetParametersResult
    from rclpy.parameter import Parameter

    node.declare_parameter("a", 1)
    node.declare_parameter("b", 1)
    after: list[str] = []

    def check(parameters: list[Any]) -> Any:
        bad = any(p.name == "a" and p.value < 0 for p in parameters)
        return SetParametersResult(successful=not bad, reason="negative" if bad else "")

    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(lambda ps: after.extend(p.name for p in ps))
    both = [Parameter("b", value=5), Parameter("a", value=-1)]
    result = node.set_parameters_atomically(both)
    assert not result.successful and result.reason == "negative"
    assert node.get_parameter("b").value == 1 and after == []
    results = node.set_parameters(both)
    assert [r.successful for r in results] == [True, False]
    assert node.get_parameter("b").value == 5 and after == ["b"]
    node.remove_on_set_parameters_callback(check)
    assert node.set_parameters([Parameter("a", value=-1)])[0].successful


def test_command_line_and_file(make_node: Any, tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    common: 1\n    text: all\n"
        "tester:\n  ros__parameters:\n    text: mine\n    axis: {x: 1.5, names: [a, b]}\n"
        "/other/tester:\n  ros__parameters:\n    text: not mine\n"
        "/*:\n  tester:\n    ros__parameters: {deep: 1}\n"
    )
    node = make_node("--params-file", str(file), "-p", "common:=7", "-p", "flag:=true")
    assert node.declare_parameter("common", 0).value == 7
    assert node.declare_parameter("flag", False).value is True
    assert node.declare_parameter("text", "").value == "mine"
    assert node.declare_parameter("axis.x", 0.0).value == 1.5
    assert node.declare_parameter("axis.names", [""]).value == ["a", "b"]
    assert node.declare_parameter("deep", 0).value == 0
    assert node.declare_parameter("text2", "d", ignore_override=True).value == "d"


def test_node_prefix_and_wrong_type_from_command_line(make_node: Any) -> None:
    from rclpy.exceptions import InvalidParameterTypeException

    node = make_node("-p", "other:speed:=1.0", "-p", "tester:gain:=2.0", "-p", "count:=2.5")
    assert node.declare_parameter("speed", 9.0).value == 9.0
    assert node.declare_parameter("gain", 0.0).value == 2.0
    with refused(InvalidParameterTypeException, None, "count", "2.5"):
        node.declare_parameter("count", 1)


def test_declared_from_overrides(make_node: Any) -> None:
    from rclpy.parameter import Parameter

    node = make_node(
        "-p",
        "a:=1",
        automatically_declare_parameters_from_overrides=True,
        parameter_overrides=[Parameter("b", value="x")],
    )
    assert node.get_parameter("a").value == 1 and node.get_parameter("b").value == "x"


def test_services_and_events(ros: Any, node: Any, peer: Start) -> None:
    from rcl_interfaces.msg import ParameterEvent, ParameterType
    from rcl_interfaces.srv import (
        DescribeParameters,
        GetParameters,
        GetParameterTypes,
        ListParameters,
        SetParameters,
        SetParametersAtomically,
    )
    from rclpy.parameter import Parameter

    events: list[Any] = []
    node.create_subscription(ParameterEvent, "/parameter_events", events.append, 100)
    peer(
        """
        from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
        rclpy.init()
        node = rclpy.create_node('owner')
        bounds = [FloatingPointRange(from_value=0.0, to_value=5.0)]
        node.declare_parameter('axis.speed', 1.0,
            ParameterDescriptor(description='how fast', floating_point_range=bounds))
        node.declare_parameter('list', [1, 2, 3])
        rclpy.spin(node)
        """
    )

    def call(kind: Any, name: str, **request: Any) -> Any:
        client = node.create_client(kind, f"/owner/{name}")
        assert client.wait_for_service(timeout_sec=PATIENCE)
        future = client.call_async(kind.Request(**request))
        ros.spin_until_future_complete(node, future, timeout_sec=PATIENCE)
        assert future.done()
        node.destroy_client(client)
        return future.result()

    listed = call(ListParameters, "list_parameters").result
    assert set(listed.names) == {"axis.speed", "list", "use_sim_time"}
    assert list(listed.prefixes) == ["axis"]
    got = call(GetParameters, "get_parameters", names=["axis.speed", "list"]).values
    assert got[0].double_value == 1.0 and list(got[1].integer_array_value) == [1, 2, 3]
    assert list(call(GetParameters, "get_parameters", names=["none"]).values) == []
    types = call(GetParameterTypes, "get_parameter_types", names=["list"]).types
    assert list(types) == [ParameterType.PARAMETER_INTEGER_ARRAY]
    described = call(DescribeParameters, "describe_parameters", names=["axis.speed"])
    assert described.descriptors[0].description == "how fast"
    assert described.descriptors[0].floating_point_range[0].to_value == 5.0

    good = Parameter("axis.speed", value=2.0).to_parameter_msg()
    bad = Parameter("axis.speed", value=9.0).to_parameter_msg()
    unknown = Parameter("nothing", value=1).to_parameter_msg()
    results = call(SetParameters, "set_parameters", parameters=[good, bad, unknown]).results
    assert [r.successful for r in results] == [True, False, False]
    result = call(SetParametersAtomically, "set_parameters_atomically", parameters=[good, bad])
    assert not result.result.successful and "out of range" in result.result.reason

    def changed() -> list[Any]:
        return [e for e in events if e.node == "/owner" and e.changed_parameters]

    assert spin_until(node, lambda: bool(changed()))
    assert changed()[0].changed_parameters[0].value.double_value == 2.0


@pytest.mark.parametrize(
    ("args", "names"),
    [
        (["-p", "a"], ["a", "name:=value"]),
        (["-p", "a:=[1, b]"], ["a:=[1, b]"]),
        (["-p", "a:={x: 1}"], ["a:={x: 1}"]),
        (["-p", "a:="], ["a:=", "''"]),
        (["-p", "a:=[x"], ["a:=[x", "YAML"]),
        (["--params-file", "/no/such/file.yaml"], ["/no/such/file.yaml"]),
        (["-r", "a"], ["a", "from:=to"]),
        (["--log-level", "loud"], ["loud", "debug", "fatal"]),
        (["--what", "x"], ["--what"]),
        (["-r"], ["-r"]),
    ],
)
def test_wrong_arguments_are_explained(args: list[str], names: list[str]) -> None:
    import rclpy

    with refused(ValueError, None, *names):
        rclpy.init(args=["program", "--ros-args", *args])
    assert not rclpy.ok()


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("a: [", ["1"]),
        ("- a", ["ros__parameters"]),
        ("tester: 3", ["/tester", "ros__parameters"]),
        ("tester:\n  ros__parameters: 3", ["/tester", "ros__parameters"]),
        ("tester:\n  ros__parameters:\n    a:\n    b: 1", ["3"]),
        ("tester:\n  ros__parameters: {a: [1, 2.0]}", ["/tester", "a", "[1, 2.0]"]),
    ],
)
def test_wrong_files_are_explained(tmp_path: Path, text: str, names: list[str]) -> None:
    import rclpy

    file = tmp_path / "p.yaml"
    file.write_text(text)
    with refused(ValueError, None, str(file), *names):
        rclpy.init(args=["program", "--ros-args", "--params-file", str(file)])
