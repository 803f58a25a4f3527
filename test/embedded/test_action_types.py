"""Action classes and what they look like on the wire, and where the embedded client does more."""

from __future__ import annotations

import hashlib
import json
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from patience import PATIENCE
from refused import refused
from ros_processes import spin_until, wait_until

from stepdiag_ros.embedded import actions, dds, definitions, packages, registry

HASHES = Path(__file__).parents[1] / "data" / "jazzy_type_hashes.json"
FIBONACCI = "example_interfaces/action/Fibonacci"


def test_hashes_equal_those_of_a_real_jazzy() -> None:
    """Those of ros2_control: by Jazzy's own generator, of control_msgs 5.8.0 and its own jazzy."""
    known: dict[str, str] = json.loads(HASHES.read_text())
    packages_used = {name.split("/")[0] for name in known}
    assert {"control_msgs", "controller_manager_msgs", "trajectory_msgs"} <= packages_used
    assert f"{FIBONACCI}_SendGoal_Request" in known and len(known) > 110
    for name, value in known.items():
        assert registry.hash_of(registry.message_class(name)) == value, name


def test_the_hash_of_a_derived_message_is_that_of_its_description() -> None:
    """Written out by hand, as REP-2016 describes a type."""

    def field(name: str, number: int, nested: str = "", capacity: int = 0) -> dict[str, Any]:
        kind = {
            "type_id": number,
            "capacity": capacity,
            "string_capacity": 0,
            "nested_type_name": nested,
        }
        return {"name": name, "type": kind}

    identity = "unique_identifier_msgs/msg/UUID"
    description = {
        "type_description": {
            "type_name": f"{FIBONACCI}_FeedbackMessage",
            "fields": [
                field("goal_id", 1, identity),
                field("feedback", 1, f"{FIBONACCI}_Feedback"),
            ],
        },
        "referenced_type_descriptions": [
            {"type_name": f"{FIBONACCI}_Feedback", "fields": [field("sequence", 150)]},
            {"type_name": identity, "fields": [field("uuid", 51, capacity=16)]},
        ],
    }
    expected = hashlib.sha256(json.dumps(description).encode()).hexdigest()
    cls = registry.message_class(f"{FIBONACCI}_FeedbackMessage")
    assert registry.hash_of(cls) == f"RIHS01_{expected}"


def test_action_classes() -> None:
    from action_msgs.msg import GoalStatusArray
    from action_msgs.srv import CancelGoal
    from example_interfaces import action
    from example_interfaces.action import Fibonacci

    assert action.__all__ == ["Fibonacci"]
    assert Fibonacci.Goal(order=3).order == 3
    assert Fibonacci.Impl.CancelGoalService is CancelGoal
    assert Fibonacci.Impl.GoalStatusMessage is GoalStatusArray
    request = Fibonacci.Impl.SendGoalService.Request(goal=Fibonacci.Goal(order=3))
    data = registry.serializer(type(request))(request)
    # Identity first, then the goal, without padding.
    assert data[4:20] == bytes(16) and data[20:] == b"\3\0\0\0"
    # A bag gives the message by its name alone.
    assert registry.message_class(f"{FIBONACCI}_FeedbackMessage") is Fibonacci.Impl.FeedbackMessage
    with refused(ImportError, None, "Missing"):
        from example_interfaces.action import Missing  # noqa: F401
    for name in (f"{FIBONACCI}_Nothing", FIBONACCI, "std_srvs/srv/Trigger"):
        with refused(registry.UnknownTypeError, None, name):
            registry.message_class(name)
    assert actions.action_of("a/action/Go_SendGoal_Request") == "a/action/Go"
    assert actions.action_of("a/action/Go_Result") == "a/action/Go"


def test_own_actions_come_from_the_packages_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "Probe.action").write_text(
        "# what to probe\nstring<=8 axis\n---\nfloat64[3] found\n---\nuint8 DONE=1\nuint8 done 1\n"
    )
    (tmp_path / "Ask.srv").write_text("bool loud\n---\nstring answer\n")

    def folder(package: str, kind: str) -> Path:
        return tmp_path if package == packages.OWN else packages.TEXTS / package / kind

    monkeypatch.setattr(registry, "_folder", folder)
    import stepdiag_ros.action
    import stepdiag_ros.srv

    assert stepdiag_ros.action.__all__ == ["Probe"] and stepdiag_ros.srv.__all__ == ["Ask"]
    probe = stepdiag_ros.action.Probe
    assert probe.Feedback().done == probe.Feedback.DONE == 1
    assert probe.Impl.GetResultService.Response().result.found.tolist() == [0, 0, 0]
    with refused(AssertionError, None, "'axis'", "8"):
        probe.Goal(axis="X" * 9)
    assert stepdiag_ros.srv.Ask.Request(loud=True).loud


@pytest.mark.parametrize("text", ["int32 x", "int32 x\n---\nint32 y", "---\n---\n---"])
def test_an_action_needs_two_separators(text: str) -> None:
    with refused(definitions.DefinitionError, None, "test_msgs/action/Do", "---"):
        definitions.parse_action("test_msgs/action/Do", text)


def test_frames_have_no_rotation_by_default() -> None:
    from geometry_msgs.msg import TransformStamped
    from visualization_msgs.msg import Marker

    assert TransformStamped().transform.rotation.w == 1.0
    assert Marker().pose.orientation.w == 1.0


def test_names_types_and_qualities_on_the_wire(node: Any) -> None:
    from example_interfaces.action import Fibonacci
    from rclpy.action import ActionClient, ActionServer

    def endpoints() -> dict[tuple[str, str], dds.EndpointInfo]:
        found = node._ros_graph.endpoints_of(True)
        return {
            (item.topic, item.type_name): item for item in found if "/count/_action" in item.topic
        }

    ActionServer(node, Fibonacci, "count", print)
    kinds = "example_interfaces::action::dds_::Fibonacci_"
    server = {
        ("rt/count/_action/feedback", f"{kinds}FeedbackMessage_"),
        ("rt/count/_action/status", "action_msgs::msg::dds_::GoalStatusArray_"),
        ("rr/count/_action/send_goalReply", f"{kinds}SendGoal_Response_"),
        ("rr/count/_action/get_resultReply", f"{kinds}GetResult_Response_"),
        ("rr/count/_action/cancel_goalReply", "action_msgs::srv::dds_::CancelGoal_Response_"),
    }
    assert wait_until(lambda: set(endpoints()) == server)
    for (topic, _), item in endpoints().items():
        assert item.qos.reliable
        assert item.qos.transient_local == topic.endswith("status"), topic
        assert "typehash=RIHS01_" in item.user_data
    ActionClient(node, Fibonacci, "count")
    client = {
        ("rq/count/_action/send_goalRequest", f"{kinds}SendGoal_Request_"),
        ("rq/count/_action/get_resultRequest", f"{kinds}GetResult_Request_"),
        ("rq/count/_action/cancel_goalRequest", "action_msgs::srv::dds_::CancelGoal_Request_"),
    }
    assert wait_until(lambda: set(endpoints()) == server | client)
    # Both belong to the node and to nobody else.
    entry = next(item for item in node._ros_graph.nodes() if item.name == "tester")
    assert {item.guid for item in endpoints().values()} <= set(entry.writers)


def test_feedback_is_never_overtaken_by_the_result(ros: Any, node: Any) -> None:
    """Which rclpy does not promise, because they come on different topics."""
    from example_interfaces.action import Fibonacci
    from rclpy.action import ActionClient, ActionServer

    asked, ended = threading.Event(), threading.Event()

    def execute(handle: Any) -> Any:
        asked.wait(PATIENCE)
        for number in range(10):
            handle.publish_feedback(Fibonacci.Feedback(sequence=[number]))
        handle.succeed()
        ended.set()
        return Fibonacci.Result()

    server = ros.create_node("server")
    ActionServer(server, Fibonacci, "count", execute)
    executor = ros.executors.SingleThreadedExecutor()
    executor.add_node(server)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    client = ActionClient(node, Fibonacci, "count")
    assert client.wait_for_server(timeout_sec=PATIENCE)
    heard: list[int] = []
    sent = client.send_goal_async(
        Fibonacci.Goal(), lambda message: heard.extend(message.feedback.sequence)
    )
    ros.spin_until_future_complete(node, sent, timeout_sec=PATIENCE)
    result = sent.result().get_result_async()
    # The client looks only when all feedback and the result have come.
    asked.set()
    assert ended.wait(PATIENCE)
    time.sleep(0.2)
    ros.spin_until_future_complete(node, result, timeout_sec=PATIENCE)
    assert result.result().status == 4
    assert heard == list(range(10))
    executor.shutdown()
    thread.join(PATIENCE)
    server.destroy_node()


def test_a_goal_executed_while_nobody_spins_is_executed_later(ros: Any, node: Any) -> None:
    from example_interfaces.action import Fibonacci
    from rclpy.action import ActionClient, ActionServer

    handles: list[Any] = []

    def execute(handle: Any) -> Any:
        handle.succeed()
        return Fibonacci.Result(sequence=[1])

    ActionServer(node, Fibonacci, "count", execute, handle_accepted_callback=handles.append)
    client = ActionClient(node, Fibonacci, "count")
    assert client.wait_for_server(timeout_sec=PATIENCE)
    sent = client.send_goal_async(Fibonacci.Goal())
    ros.spin_until_future_complete(node, sent, timeout_sec=PATIENCE)
    assert node.executor is None
    handles[0].execute()
    result = sent.result().get_result_async()
    ros.spin_until_future_complete(node, result, timeout_sec=PATIENCE)
    assert list(result.result().result.sequence) == [1]


def test_a_long_goals_result_is_kept_from_its_end_on(ros: Any, node: Any) -> None:
    """Early rclpy of Jazzy counts from the acceptance and forgets such a result at once."""
    from example_interfaces.action import Fibonacci
    from rclpy.action import ActionClient, ActionServer

    def execute(handle: Any) -> Any:
        time.sleep(2.2)
        handle.succeed()
        return Fibonacci.Result(sequence=[1])

    ActionServer(node, Fibonacci, "count", execute, result_timeout=2.0)
    client = ActionClient(node, Fibonacci, "count")
    assert client.wait_for_server(timeout_sec=PATIENCE)
    sent = client.send_goal_async(Fibonacci.Goal())
    ros.spin_until_future_complete(node, sent, timeout_sec=PATIENCE)
    handle = sent.result()
    assert spin_until(node, lambda: handle.status == 4)
    result = handle.get_result_async()
    ros.spin_until_future_complete(node, result, timeout_sec=PATIENCE)
    assert result.result().status == 4 and list(result.result().result.sequence) == [1]


def test_rubbish_on_the_wire_harms_nobody(ros: Any, node: Any, domain: int) -> None:
    from example_interfaces.action import Fibonacci
    from rclpy.action import ActionClient, ActionServer

    def execute(handle: Any) -> Any:
        handle.succeed()
        return Fibonacci.Result()

    ActionServer(node, Fibonacci, "count", execute)
    client = ActionClient(node, Fibonacci, "count")
    assert client.wait_for_server(timeout_sec=PATIENCE)
    stranger = dds.Participant(domain)
    kinds = "example_interfaces::action::dds_::Fibonacci_"
    writers = [
        stranger.create_writer(topic, kind, dds.Qos(transient_local=True))
        for topic, kind in (
            ("rq/count/_action/send_goalRequest", f"{kinds}SendGoal_Request_"),
            ("rq/count/_action/get_resultRequest", f"{kinds}GetResult_Request_"),
            ("rq/count/_action/cancel_goalRequest", "action_msgs::srv::dds_::CancelGoal_Request_"),
            ("rr/count/_action/send_goalReply", f"{kinds}SendGoal_Response_"),
            ("rt/count/_action/feedback", f"{kinds}FeedbackMessage_"),
            ("rt/count/_action/status", "action_msgs::msg::dds_::GoalStatusArray_"),
        )
    ]
    assert wait_until(lambda: all(writer.matched() for writer in writers))
    for writer in writers:
        for content in (b"\1", b"\2" * 24, b"\3" * 100):
            writer.write(b"\0\1\0\0" + content)
    sent = client.send_goal_async(Fibonacci.Goal())
    ros.spin_until_future_complete(node, sent, timeout_sec=PATIENCE)
    result = sent.result().get_result_async()
    ros.spin_until_future_complete(node, result, timeout_sec=PATIENCE)
    assert result.result().status == 4
    stranger.close()


def test_an_impossible_transition_asked_for_by_number_is_refused(ros: Any, node: Any) -> None:
    """Which ends the spinning of rclpy's node, as of Jazzy."""
    from lifecycle_msgs.srv import ChangeState
    from rclpy.lifecycle import LifecycleNode

    with LifecycleNode("managed") as managed:
        executor = ros.executors.SingleThreadedExecutor()
        executor.add_node(managed)
        executor.add_node(node)
        client = node.create_client(ChangeState, "/managed/change_state")
        assert client.wait_for_service(timeout_sec=PATIENCE)
        for number in (3, 10, 97, 255):
            request = ChangeState.Request()
            request.transition.id = number
            future = client.call_async(request)
            executor.spin_until_future_complete(future, timeout_sec=PATIENCE)
            assert future.result().success is False
        assert managed._state_machine.current_state == (1, "unconfigured")
        executor.shutdown()


def test_the_reason_of_a_failed_transition_is_logged(
    node: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

    class Laser(LifecycleNode):
        def on_configure(self, _state: Any) -> Any:
            raise OSError("no laser at /dev/ttyUSB0")

        def on_error(self, _state: Any) -> Any:
            return None

    assert node is not None
    with Laser("laser") as laser:
        with refused(AttributeError, None, "on_error()", "None"):
            laser.trigger_configure()
        assert laser._state_machine.current_state[1] == "errorprocessing"
    assert "on_configure() raised OSError: no laser at /dev/ttyUSB0" in capfd.readouterr().err
    assert TransitionCallbackReturn.SUCCESS.value == int(TransitionCallbackReturn.SUCCESS) == 97


def test_a_node_takes_its_servers_and_clients_with_it(ros: Any) -> None:
    from example_interfaces.action import Fibonacci
    from rclpy.action import ActionClient, ActionServer
    from rclpy.exceptions import InvalidHandle

    node = ros.create_node("short")
    server = ActionServer(node, Fibonacci, "count", print)
    client = ActionClient(node, Fibonacci, "count")
    assert list(node.timers) == [] and list(node.publishers)
    node.destroy_node()
    server.destroy()
    client.destroy()
    with pytest.raises(InvalidHandle):
        client.send_goal_async(Fibonacci.Goal())
    with refused(ValueError, None, "result_timeout", "-1"):
        ActionServer(ros.create_node("wrong"), Fibonacci, "count", print, result_timeout=-1)
    with refused(TypeError, None, "Fibonacci_Goal"):
        ActionClient(ros.create_node("wrong"), Fibonacci.Goal, "count")
