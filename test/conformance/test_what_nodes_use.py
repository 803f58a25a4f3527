"""The rest of rclpy that the nodes use, and that nothing of it goes untested here."""

from __future__ import annotations

import ast
import re
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from ros_processes import Peer, spin_until

import stepdiag_ros

Start = Callable[..., Peer]


def test_all_that_the_suite_imports_of_rclpy_is_tested_here() -> None:
    package = Path(stepdiag_ros.__file__).parent
    used: dict[str, Path] = {}
    for path in package.rglob("*.py"):
        if "embedded" in path.relative_to(package).parts:
            continue
        for part in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(part, ast.ImportFrom) and str(part.module).split(".")[0] == "rclpy":
                used.update({alias.name: path for alias in part.names})
            elif isinstance(part, ast.Attribute) and ast.unparse(part.value) == "rclpy":
                used[part.attr] = path
    here = Path(__file__).parent
    tested = "".join(path.read_text(encoding="utf-8") for path in here.glob("*.py"))
    tested += (here.parent / "ros_processes.py").read_text(encoding="utf-8")
    missing = [name for name in used if not re.search(rf"\b{name}\b", tested)]
    assert len(used) > 20 and not missing, missing


@pytest.mark.parametrize("name", ["a b", "1a", "a/b"])
def test_wrong_node_names_have_one_base_error(ros: Any, name: str) -> None:
    from rclpy.exceptions import NameValidationException

    with pytest.raises(NameValidationException):
        ros.create_node(name)


def test_parameters_are_found_asked_for_and_taken_back(ros: Any) -> None:
    from rcl_interfaces.msg import ParameterDescriptor
    from rclpy.exceptions import ParameterImmutableException

    given = [ros.Parameter("laser.rate", value=5.0), ros.Parameter("laser.seed", value=1)]
    node = ros.create_node(
        "tester",
        parameter_overrides=given,
        automatically_declare_parameters_from_overrides=True,
    )
    assert node.has_parameter("laser.rate") and not node.has_parameter("laser")
    found = node.get_parameters_by_prefix("laser")
    assert {name: each.value for name, each in found.items()} == {"rate": 5.0, "seed": 1}
    assert {"laser.rate", "laser.seed", "use_sim_time"} <= set(node.get_parameters_by_prefix(""))
    node.undeclare_parameter("laser.seed")
    assert not node.has_parameter("laser.seed")
    # What was given at the start counts again when it is declared again.
    assert node.declare_parameter("laser.seed", 7).value == 1
    node.declare_parameter("fixed", 1, ParameterDescriptor(read_only=True))
    with pytest.raises(ParameterImmutableException):
        node.undeclare_parameter("fixed")
    node.destroy_node()


def test_changes_of_parameters_are_heard_of(ros: Any, node: Any) -> None:
    from rcl_interfaces.msg import ParameterEvent
    from rclpy.qos import qos_profile_parameter_events

    got: list[Any] = []
    node.create_subscription(
        ParameterEvent, "/parameter_events", got.append, qos_profile_parameter_events
    )
    other = ros.create_node("other")
    assert spin_until(node, lambda: node.count_publishers("/parameter_events") >= 2)
    other.declare_parameter("size", 1)
    other.set_parameters([ros.Parameter("size", value=2)])

    def changed() -> list[Any]:
        return [event for event in got if event.node == "/other" and event.changed_parameters]

    assert spin_until(node, lambda: bool(changed()))
    (parameter,) = changed()[0].changed_parameters
    assert (parameter.name, parameter.value.integer_value) == ("size", 2)
    other.destroy_node()


def test_liveliness_is_part_of_what_is_told_of_an_end(node: Any) -> None:
    from rclpy.qos import LivelinessPolicy, QoSProfile
    from std_msgs.msg import String

    node.create_publisher(String, "chat", QoSProfile(depth=1))
    assert spin_until(node, lambda: bool(node.get_publishers_info_by_topic("/chat")))
    (info,) = node.get_publishers_info_by_topic("/chat")
    assert info.qos_profile.liveliness == LivelinessPolicy.AUTOMATIC


def test_the_middleware_has_a_name(ros: Any) -> None:
    assert re.fullmatch(r"[a-z_]*[a-z]+", ros.get_rmw_implementation_identifier())


def test_who_handles_signals_keeps_the_context(peer: Start) -> None:
    other = peer(
        """
        import signal, time
        from rclpy.signals import SignalHandlerOptions
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node('stayer')
        node.create_timer(0.05, lambda: None)
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        try:
            print('ready', flush=True)
            rclpy.spin(node)
        except KeyboardInterrupt:
            time.sleep(0.2)
            print('stopped', rclpy.ok(), flush=True)
        rclpy.try_shutdown()
        """
    )
    other.wait_for_line("ready")
    other.process.send_signal(signal.SIGTERM)
    code, out, err = other.finish()
    assert (code, out.split()) == (0, ["stopped", "True"]), err
