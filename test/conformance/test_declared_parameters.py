"""The parameters of our nodes as others see and set them, whatever the client library."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from patience import PATIENCE
from refused import refused
from ros_processes import wait_until

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.parameters.declaration import COMMON, Changeable
from stepdiag_ros.parameters.documents import parameter_file
from stepdiag_ros.parameters.nodes import NODES, declared_node


@pytest.fixture
def declare(ros: Any) -> Iterator[Callable[..., Any]]:
    """Return a function that makes a node which has the parameters of a role and nothing else."""
    assert ros.ok()
    from stepdiag_ros.nodes.declared import DeclaringNode

    made: list[Any] = []

    def make(role: str, *more: type) -> Any:
        kind = type("Declared", (DeclaringNode, *more), {"role": role})
        made.append(kind(role))
        return made[-1]

    yield make
    for item in made:
        item.destroy_node()


class Setter:
    """Sets parameters of another node by its services, as ``ros2 param set`` does."""

    def __init__(self, node: Any, target: str) -> None:
        from rcl_interfaces.srv import SetParameters, SetParametersAtomically

        self._each = node.create_client(SetParameters, f"/{target}/set_parameters")
        self._all = node.create_client(
            SetParametersAtomically, f"/{target}/set_parameters_atomically"
        )
        assert self._each.wait_for_service(timeout_sec=PATIENCE)
        assert self._all.wait_for_service(timeout_sec=PATIENCE)

    def set(self, name: str, value: Any) -> str:
        """Return why a value was refused; empty if it was not."""
        from rclpy.parameter import Parameter

        request = self._each.srv_type.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        (result,) = _answer(self._each, request).results
        assert result.successful is not bool(result.reason)
        return str(result.reason)

    def set_all(self, **values: Any) -> str:
        """Set all or none; return why they were refused."""
        from rclpy.parameter import Parameter

        request = self._all.srv_type.Request(
            parameters=[
                Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
            ]
        )
        result = _answer(self._all, request).result
        assert result.successful is not bool(result.reason)
        return str(result.reason)


def _answer(client: Any, request: Any) -> Any:
    future = client.call_async(request)
    assert wait_until(future.done)
    return future.result()


def test_every_node_describes_exactly_what_is_declared(declare: Any) -> None:
    from rclpy.parameter import Parameter

    types = {"boolean": "BOOL", "integer": "INTEGER", "double": "DOUBLE", "string": "STRING"}
    for declared in NODES:
        node = declare(declared.name)
        names = node.list_parameters([], 0).names
        own = [one.name for one in declared.parameters]
        common = {one.name for one in COMMON}
        assert sorted(set(names) - common - {"start_type_description_service"}) == sorted(own)
        for one in declared.parameters:
            told = node.describe_parameter(one.name)
            assert told.name == one.name and told.description.startswith(one.description)
            assert not one.unit or told.description.endswith(f" [{one.unit}]")
            assert told.type == Parameter.Type[types[one.type_name]].value
            assert told.read_only is (one.change is Changeable.AT_START)
            assert one.change.value in told.additional_constraints
            assert all(choice in told.additional_constraints for choice in one.allowed)
            assert node.parameter(one.name) == one.default
            ranges = [*told.floating_point_range, *told.integer_range]
            bounds = [] if one.low is None else [(one.low, one.high)]
            assert [(each.from_value, each.to_value) for each in ranges] == bounds


def test_a_wrong_value_is_refused_in_plain_words_and_nothing_is_changed(
    declare: Any, node: Any, spin: Any
) -> None:
    diagnosis, clock = declare("diagnosis"), declare("clock")
    spin(diagnosis, clock, node)
    setter, other = Setter(node, "diagnosis"), Setter(node, "clock")
    expected = "expected a number with a point, such as 10.0, from 0 to 3600 s"
    pause = "parameter 'pause_s' of node diagnosis is"
    assert setter.set("pause_s", 1) == f"{pause} 1; {expected}; write 1.0"
    assert setter.set("pause_s", "1e2") == f"{pause} '1e2'; {expected}; write 100.0"
    assert setter.set("pause_s", math.nan) == f"{pause} nan; {expected}"
    assert setter.set("pause_s", math.inf) == f"{pause} inf; {expected}"
    # Within rclpy's own tolerance for the end of a range, and refused all the same.
    assert setter.set("pause_s", 3600.0000001) == f"{pause} 3600.0000001; {expected}"
    assert setter.set("seed", -1).endswith("is -1; expected a whole number from 0 to 2147483647")
    assert "did you mean 'pause_s'?" in setter.set("pause", 1.0)
    assert setter.set("seed", None) == "parameter 'seed' of node diagnosis cannot be deleted"
    for name, value in (("period", 0.01), ("use_sim_time", True)):
        assert other.set(name, value) == (
            f"parameter '{name}' of node clock can be set at start only: restart the node with"
            f" --ros-args -p {name}:=VALUE"
        )
    for one in declared_node("diagnosis").parameters:
        assert diagnosis.parameter(one.name) == one.default
    for value in (0.0, 3600.0, 2.5):
        assert setter.set("pause_s", value) == ""
        assert diagnosis.parameter("pause_s") == value


def test_a_change_is_prepared_taken_or_refused_as_a_whole(
    declare: Any, node: Any, spin: Any
) -> None:
    diagnosis = declare("diagnosis")
    taken: list[Any] = []

    def prepare(value: str) -> str:
        if value == "missing":
            raise FileNotFoundError(2, "No such file or directory", "missing.yaml")
        if value == "wrong":
            raise ValueError("wrong.yaml, line 3: not\n  valid YAML")
        return value.upper()

    diagnosis.on_change("model", taken.append, prepare)
    diagnosis.on_change("seed", taken.append)
    spin(diagnosis, node)
    setter = Setter(node, "diagnosis")
    assert setter.set("model", "missing") == "missing.yaml: no such file or directory"
    assert setter.set("model", "wrong") == "wrong.yaml, line 3: not valid YAML"
    assert setter.set_all(seed=2, model="missing") == "missing.yaml: no such file or directory"
    assert "is -1" in setter.set_all(model="mill", seed=-1)
    assert (taken, diagnosis.parameter("seed")) == ([], 0)
    assert setter.set_all(seed=2, model="mill") == ""
    assert taken == [2, "MILL"]
    assert (diagnosis.parameter("seed"), diagnosis.parameter("model")) == (2, "mill")

    diagnosis.run_id, diagnosis.run_over = "20260102T030405-abcd", False
    assert setter.set("model", "other") == (
        "parameter 'model' of node diagnosis is set between runs only, and run"
        " 20260102T030405-abcd is going on: wait for its end or abort it"
    )
    assert setter.set("pause_s", 1.5) == ""
    assert "between runs only" in setter.set("seed", 5)
    diagnosis.run_over = True
    assert setter.set("model", "other") == ""
    assert taken == [2, "MILL", "OTHER"]


@pytest.mark.parametrize("namespace", ["/", "/hall/cell_1"])
def test_the_parameter_file_is_taken_in_any_namespace(
    ros: Any, declare: Any, tmp_path: Path, namespace: str
) -> None:
    text = parameter_file(NODES)
    assert text.count("    model: 'free'\n") == text.count("    pause_s: 10.0\n") == 1
    text = text.replace("model: 'free'", "model: 'on'").replace("pause_s: 10.0", "pause_s: 1.5e+01")
    file = tmp_path / "all.yaml"
    file.write_text(text)
    ros.shutdown()
    ros.init(args=["", "--ros-args", "--params-file", str(file), "-r", f"__ns:={namespace}"])
    for declared in NODES:
        node = declare(declared.name)
        for one in declared.parameters:
            changed = {"diagnosis.model": "on", "diagnosis.pause_s": 15.0}
            expected = changed.get(f"{declared.name}.{one.name}", one.default)
            assert node.parameter(one.name) == expected


@pytest.mark.parametrize(
    ("given", "fault", "names"),
    [
        ("pause_s:=1", "out_of_range", ["pause_s", "1", "1.0"]),
        ("pause_s:=.nan", "out_of_range", ["pause_s", "nan"]),
        ("pause_s:=-.inf", "out_of_range", ["pause_s", "-inf"]),
        ("seed:=1.0", "out_of_range", ["seed", "1.0", "2147483647"]),
        ("model:=3", "out_of_range", ["model", "3", "\"'3'\""]),
        ("model:=[a]", "out_of_range", ["model", "['a']"]),
        ("paus:=1.0", "unknown", ["paus", "pause_s"]),
        ("use_sim_time:=maybe", "out_of_range", ["use_sim_time", "maybe"]),
    ],
)
def test_a_node_does_not_start_with_a_wrong_value(
    ros: Any, declare: Any, given: str, fault: str, names: list[str]
) -> None:
    ros.shutdown()
    ros.init(args=["", "--ros-args", "-p", given])
    with refused(Refusal, fault, "diagnosis", *names):
        declare("diagnosis")


def test_what_is_meant_for_another_client_does_no_harm(ros: Any, declare: Any) -> None:
    from rclpy.parameter import Parameter

    name = "start_type_description_service"
    ros.shutdown()
    ros.init(args=["", "--ros-args", "-p", f"{name}:=true"])
    clock = declare("clock")
    assert clock.parameter("factor") == 1.0
    (result,) = clock.set_parameters([Parameter(name, value=1)])
    assert "declared" not in result.reason and "type" in result.reason


def test_what_a_later_client_declares_by_itself_does_no_harm(ros: Any, declare: Any) -> None:
    from rcl_interfaces.msg import ParameterDescriptor
    from rclpy.node import Node
    from rclpy.parameter import Parameter

    assert ros.ok()

    class Later(Node):
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, **kwargs)
            told = ParameterDescriptor(description="whether the client does something new")
            self.declare_parameter("something_new", False, told)

    clock = declare("clock", Later)
    (result,) = clock.set_parameters([Parameter("something_new", value=True)])
    assert result.successful and clock.get_parameter("something_new").value is True


def test_the_node_itself_sets_parameters_under_the_same_rules(declare: Any) -> None:
    from rclpy.parameter import Parameter

    clock = declare("clock")
    with refused(Refusal, "rejected", "period", "clock"):
        clock.on_change("period", print)
    with refused(Refusal, "unknown", "faktor", "factor"):
        clock.parameter("faktor")
    results = clock.set_parameters([Parameter("factor", value=2), Parameter("factor", value=3.0)])
    assert [result.successful for result in results] == [False, True]
    assert "write 2.0" in results[0].reason
    assert clock.parameter("factor") == 3.0
