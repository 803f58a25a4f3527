"""Actions between nodes: goals, feedback and results, as any rclpy has them."""

from __future__ import annotations

import time
import uuid
from typing import Any

import pytest
from patience import PATIENCE
from ros_processes import wait_until

from .action_cell import (
    ABORTED,
    CANCELED,
    SUCCEEDED,
    UNKNOWN,
    Cell,
    Spin,
    accept_cancel,
    get,
    identity,
)


def test_a_goal_is_reached(cell: Cell) -> None:
    cell.serve()
    client = cell.call()
    feedback: list[list[int]] = []
    handle = get(
        client.send_goal_async(
            cell.goal(5), feedback_callback=lambda m: feedback.append(list(m.feedback.sequence))
        )
    )
    assert handle.accepted and handle.stamp.sec > 0 and "accepted=True" in repr(handle)
    response = get(handle.get_result_async())
    assert response.status == SUCCEEDED
    assert list(response.result.sequence) == [0, 1, 2, 3, 4]
    assert wait_until(lambda: handle.status == SUCCEEDED)
    # In order, none twice; rclpy may lose the last ones to the result, which is another topic.
    assert feedback == [list(range(size + 1)) for size in range(len(feedback))] and feedback
    server_handle = cell.handles[0]
    assert not server_handle.is_active and server_handle.status == SUCCEEDED
    assert identity(server_handle) == identity(handle) and server_handle.request.order == 5


def test_blocking_calls(cell: Cell) -> None:
    cell.serve(cancel_callback=accept_cancel)
    client = cell.call()
    response = client.send_goal(cell.goal(2))
    assert response.status == SUCCEEDED and list(response.result.sequence) == [0, 1]
    handle = get(client.send_goal_async(cell.goal(1000)))
    assert len(handle.cancel_goal().goals_canceling) == 1
    assert handle.get_result().status == CANCELED


def test_the_caller_may_choose_the_identity(cell: Cell) -> None:
    from rclpy.action import GoalResponse
    from unique_identifier_msgs.msg import UUID

    asked: list[int] = []

    def decide(goal: Any) -> Any:
        asked.append(goal.order)
        return GoalResponse.ACCEPT

    cell.serve(goal_callback=decide)
    client = cell.call()
    chosen = UUID(uuid=list(uuid.uuid4().bytes))
    handle = get(client.send_goal_async(cell.goal(1), goal_uuid=chosen))
    assert handle.accepted and identity(handle) == bytes(chosen.uuid)
    again = get(client.send_goal_async(cell.goal(2), goal_uuid=chosen))
    assert not again.accepted
    other = get(client.send_goal_async(cell.goal(3)))
    assert other.accepted and identity(other) != identity(handle)
    # What is known is refused without asking.
    assert asked == [1, 3]


def test_goals_are_refused(cell: Cell) -> None:
    from rclpy.action import GoalResponse

    answers = [GoalResponse.REJECT, "no answer", GoalResponse.ACCEPT]
    asked: list[int] = []

    def decide(goal: Any) -> Any:
        asked.append(goal.order)
        return answers[len(asked) - 1]

    cell.serve(goal_callback=decide)
    client = cell.call()
    accepted = [get(client.send_goal_async(cell.goal(order))).accepted for order in (1, 2, 3)]
    assert accepted == [False, False, True] and asked == [1, 2, 3]
    assert wait_until(lambda: len(cell.handles) == 1)


def test_a_goal_fails(cell: Cell) -> None:
    ends: list[Any] = [
        lambda handle: handle.abort(),
        lambda _handle: None,
    ]

    def execute(handle: Any) -> Any:
        if handle.request.order == 2:
            raise ValueError("no beam")
        ends[handle.request.order](handle)
        return cell.action.Result(sequence=[1])

    cell.serve(execute)
    client = cell.call()
    for order, sequence in ((0, [1]), (1, [1]), (2, [])):
        handle = get(client.send_goal_async(cell.goal(order)))
        response = get(handle.get_result_async())
        assert response.status == ABORTED and list(response.result.sequence) == sequence


def test_a_goal_ends_but_once(cell: Cell) -> None:
    refused: list[str] = []

    def attempt(handle: Any, *names: str) -> None:
        for name in names:
            try:
                getattr(handle, name)()
            except RuntimeError:
                refused.append(name)

    def execute(handle: Any) -> Any:
        attempt(handle, "canceled", "execute")
        handle.succeed()
        attempt(handle, "succeed", "abort", "canceled", "execute")
        return cell.action.Result()

    cell.serve(execute)
    handle = get(cell.call().send_goal_async(cell.goal()))
    assert get(handle.get_result_async()).status == SUCCEEDED
    assert refused == ["canceled", "execute", "succeed", "abort", "canceled", "execute"]


def test_a_result_is_asked_for_late_and_by_anybody(cell: Cell) -> None:
    cell.serve()
    client = cell.call()
    handle = get(client.send_goal_async(cell.goal(2)))
    assert wait_until(lambda: handle.status == SUCCEEDED)
    for _ in range(2):
        assert list(get(handle.get_result_async()).result.sequence) == [0, 1]
    service = cell.action.Impl.GetResultService
    stranger = cell.client_node.create_client(service, "count/_action/get_result")
    assert stranger.wait_for_service(timeout_sec=PATIENCE)
    answer = get(stranger.call_async(service.Request(goal_id=handle.goal_id)))
    assert answer.status == SUCCEEDED and list(answer.result.sequence) == [0, 1]
    request = service.Request()
    request.goal_id.uuid = list(uuid.uuid4().bytes)
    answer = get(stranger.call_async(request))
    assert answer.status == UNKNOWN and list(answer.result.sequence) == []


def test_a_result_is_kept_for_a_while(cell: Cell) -> None:
    cell.serve(result_timeout=5)
    client = cell.call()
    handle = get(client.send_goal_async(cell.goal(1)))
    assert get(handle.get_result_async()).status == SUCCEEDED
    time.sleep(0.3)
    assert get(handle.get_result_async()).status == SUCCEEDED
    assert wait_until(lambda: get(handle.get_result_async()).status == UNKNOWN)
    forgotten = cell.handles[0]
    assert forgotten.status == UNKNOWN and not forgotten.is_active
    # What is forgotten cannot be changed, and does not mind.
    forgotten.abort()
    assert forgotten.status == UNKNOWN


def test_two_clients_get_what_is_theirs(cell: Cell) -> None:
    from rclpy.callback_groups import ReentrantCallbackGroup

    cell.serve(callback_group=ReentrantCallbackGroup())
    clients = [cell.call(), cell.call()]
    feedback: list[list[int]] = [[], []]

    def note(which: int) -> Any:
        return lambda message: feedback[which].append(len(message.feedback.sequence))

    futures = [
        client.send_goal_async(cell.goal(3 + which), feedback_callback=note(which))
        for which, client in enumerate(clients)
    ]
    handles = [get(future) for future in futures]
    wanted = [handle.get_result_async() for handle in handles]
    results = [get(future) for future in wanted]
    assert [len(response.result.sequence) for response in results] == [3, 4]
    for which, sizes in enumerate(feedback):
        assert sizes == list(range(1, len(sizes) + 1)) and 1 <= len(sizes) <= 3 + which


def test_status_reaches_who_comes_late(cell: Cell) -> None:
    from rclpy.qos import qos_profile_action_status_default
    from rclpy.time import Time

    cell.serve()
    client = cell.call()
    handles = [get(client.send_goal_async(cell.goal(1))) for _ in range(2)]
    assert wait_until(lambda: all(handle.status == SUCCEEDED for handle in handles))
    heard: list[Any] = []
    cell.client_node.create_subscription(
        cell.action.Impl.GoalStatusMessage,
        "count/_action/status",
        heard.append,
        qos_profile_action_status_default,
    )
    assert wait_until(lambda: bool(heard))
    found = [(identity(entry.goal_info), entry.status) for entry in heard[-1].status_list]
    assert found == [(identity(handle), SUCCEEDED) for handle in handles]
    for entry, handle in zip(heard[-1].status_list, handles, strict=True):
        later = Time.from_msg(entry.goal_info.stamp) - Time.from_msg(handle.stamp)
        assert 0 <= later.nanoseconds < 100_000_000


def test_wrong_types_are_refused(cell: Cell) -> None:
    from rclpy.action import ActionServer

    refused: list[type] = []

    def execute(handle: Any) -> Any:
        try:
            handle.publish_feedback("halfway")
        except TypeError:
            refused.append(TypeError)
        handle.succeed()
        return cell.action.Result()

    cell.serve(execute)
    client = cell.call()
    with pytest.raises(TypeError):
        client.send_goal_async("count to three")
    with pytest.raises(TypeError):
        client.send_goal(cell.action.Result())
    handle = get(client.send_goal_async(cell.goal()))
    assert get(handle.get_result_async()).status == SUCCEEDED and refused
    with pytest.raises(TypeError):
        ActionServer(cell.server_node, cell.action, "other", "no function")
    with pytest.raises(ValueError):
        ActionServer(cell.server_node, cell.action, "no good name", execute)


def test_actions_are_seen_in_the_graph(ros: Any, node: Any) -> None:
    from example_interfaces.action import Fibonacci
    from rclpy.action import (
        ActionClient,
        ActionServer,
        get_action_client_names_and_types_by_node,
        get_action_names_and_types,
        get_action_server_names_and_types_by_node,
    )

    wanted = [("/count", ["example_interfaces/action/Fibonacci"])]
    other = ros.create_node("other")
    server = ActionServer(other, Fibonacci, "count", print)
    client = ActionClient(node, Fibonacci, "count")
    assert wait_until(
        lambda: get_action_server_names_and_types_by_node(node, "other", "/") == wanted
    )
    assert wait_until(
        lambda: get_action_client_names_and_types_by_node(node, "tester", "/") == wanted
    )
    assert get_action_names_and_types(node) == wanted
    assert get_action_server_names_and_types_by_node(node, "tester", "/") == []
    # The parts of an action are none of the node's own services, clients, timers and topics.
    assert "count" not in " ".join(item.srv_name for item in other.services)
    assert "count" not in " ".join(item.topic_name for item in other.publishers)
    assert list(other.timers) == [] and list(node.clients) == []
    client.destroy()
    server.destroy()
    assert wait_until(lambda: get_action_names_and_types(node) == [])
    other.destroy_node()


def test_a_destroyed_server_is_gone(ros: Any, node: Any, spin: Spin) -> None:
    from example_interfaces.action import Fibonacci
    from rclpy.action import ActionClient, ActionServer

    def execute(handle: Any) -> Any:
        handle.succeed()
        return Fibonacci.Result()

    other = ros.create_node("other")
    server = ActionServer(other, Fibonacci, "count", execute)
    client = ActionClient(node, Fibonacci, "count")
    assert client.wait_for_server(timeout_sec=PATIENCE) and client.server_is_ready()
    # rclpy's executors do not bear that a server goes while they wait.
    server.destroy()
    assert wait_until(lambda: not client.server_is_ready())
    assert not client.wait_for_server(timeout_sec=0.1)
    ActionServer(other, Fibonacci, "count", execute)
    assert client.wait_for_server(timeout_sec=PATIENCE)
    spin(node, other)
    assert client.send_goal(Fibonacci.Goal()).status == SUCCEEDED
    other.destroy_node()


def test_names_are_resolved_in_the_nodes_namespace(ros: Any, spin: Spin) -> None:
    from example_interfaces.action import Fibonacci
    from rclpy.action import ActionClient, ActionServer

    node = ros.create_node("inner", namespace="/cell")

    def execute(handle: Any) -> Any:
        handle.succeed()
        return Fibonacci.Result()

    ActionServer(node, Fibonacci, "~/count", execute)
    outside = ros.create_node("outer")
    client = ActionClient(outside, Fibonacci, "/cell/inner/count")
    assert client.wait_for_server(timeout_sec=PATIENCE)
    spin(node, outside)
    assert client.send_goal(Fibonacci.Goal()).status == SUCCEEDED
    node.destroy_node()
    outside.destroy_node()
