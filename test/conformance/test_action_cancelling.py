"""Cancelling goals, before and while they are executed, as any rclpy does it."""

from __future__ import annotations

import time
import uuid
from typing import Any

from patience import PATIENCE
from ros_processes import wait_until

from .action_cell import (
    ACCEPTED,
    CANCELED,
    CANCELING,
    EXECUTING,
    SUCCEEDED,
    UNKNOWN,
    Cell,
    accept_cancel,
    get,
    identity,
)


def test_a_running_goal_is_cancelled(cell: Cell) -> None:
    cell.serve(cell.wait, cancel_callback=accept_cancel)
    client = cell.call()
    handle = get(client.send_goal_async(cell.goal()))
    assert wait_until(lambda: handle.status == EXECUTING)
    result = handle.get_result_async()
    answer = get(handle.cancel_goal_async())
    assert answer.return_code == answer.ERROR_NONE
    assert [identity(info) for info in answer.goals_canceling] == [identity(handle)]
    response = get(result)
    assert response.status == CANCELED and list(response.result.sequence) == [7]
    # It has ended, so that there is nothing to cancel any more.
    again = get(handle.cancel_goal_async())
    assert again.return_code == again.ERROR_GOAL_TERMINATED and not again.goals_canceling


def test_cancelling_is_refused_unless_the_server_agrees(cell: Cell) -> None:
    cell.serve(cell.wait)
    handle = get(cell.call().send_goal_async(cell.goal()))
    assert not get(handle.cancel_goal_async()).goals_canceling
    assert handle.status in (UNKNOWN, ACCEPTED, EXECUTING)
    cell.release.set()
    assert get(handle.get_result_async()).status == SUCCEEDED


def test_cancelling_an_unknown_goal(cell: Cell) -> None:
    from action_msgs.srv import CancelGoal

    cell.serve(cancel_callback=accept_cancel)
    service = cell.client_node.create_client(CancelGoal, "count/_action/cancel_goal")
    assert service.wait_for_service(timeout_sec=PATIENCE)
    request = CancelGoal.Request()
    request.goal_info.goal_id.uuid = list(uuid.uuid4().bytes)
    answer = get(service.call_async(request))
    assert answer.return_code == answer.ERROR_UNKNOWN_GOAL_ID and not answer.goals_canceling


def test_all_goals_and_goals_until_a_time_are_cancelled(cell: Cell) -> None:
    from action_msgs.srv import CancelGoal
    from rclpy.callback_groups import ReentrantCallbackGroup
    from rclpy.duration import Duration
    from rclpy.time import Time

    cell.serve(
        cell.wait,
        cancel_callback=accept_cancel,
        callback_group=ReentrantCallbackGroup(),
        handle_accepted_callback=cell.handles.append,
    )
    client = cell.call()
    service = cell.client_node.create_client(CancelGoal, "count/_action/cancel_goal")
    assert service.wait_for_service(timeout_sec=PATIENCE)
    first = get(client.send_goal_async(cell.goal()))
    time.sleep(1.0)
    second = get(client.send_goal_async(cell.goal()))
    third = get(client.send_goal_async(cell.goal()))

    def cancelled(request: Any) -> list[bytes]:
        return [identity(info) for info in get(service.call_async(request)).goals_canceling]

    request = CancelGoal.Request()
    # rclpy stamps a goal a little later than its answer says.
    until = Time.from_msg(first.stamp) + Duration(seconds=0.5)
    request.goal_info.stamp = until.to_msg()
    assert cancelled(request) == [identity(first)]
    # A time and an identity: until that time, and that one.
    request.goal_info.goal_id = third.goal_id
    assert cancelled(request) == [identity(third)]
    assert cancelled(CancelGoal.Request()) == [identity(second)]
    assert [handle.status for handle in cell.handles] == [CANCELING] * 3


def test_execution_is_put_off(cell: Cell) -> None:
    cell.serve(
        cell.count, handle_accepted_callback=cell.handles.append, cancel_callback=accept_cancel
    )
    client = cell.call()
    first, second = (get(client.send_goal_async(cell.goal())) for _ in range(2))
    assert wait_until(lambda: len(cell.handles) == 2)
    assert [handle.status for handle in cell.handles] == [ACCEPTED, ACCEPTED]
    # One is cancelled before it begins, the other one executed by another function.
    assert get(first.cancel_goal_async()).goals_canceling
    waiting = list(cell.handles)
    assert waiting[0].is_cancel_requested and waiting[0].is_active
    waiting[0].execute()
    assert get(first.get_result_async()).status == CANCELED

    def other(handle: Any) -> Any:
        assert handle.status == EXECUTING
        handle.succeed()
        return cell.action.Result(sequence=[9])

    waiting[1].execute(other)
    assert list(get(second.get_result_async()).result.sequence) == [9]


def test_callbacks_may_be_coroutines(ros: Any) -> None:
    """On one thread, which serves the wish to cancel while the goal waits."""
    from example_interfaces.action import Fibonacci
    from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.task import Future

    node = ros.create_node("alone")
    until: Any = Future()

    async def decide(_goal: Any) -> Any:
        return GoalResponse.ACCEPT

    async def agree(_handle: Any) -> Any:
        until.set_result(None)
        return CancelResponse.ACCEPT

    async def execute(handle: Any) -> Any:
        await until
        handle.canceled()
        return Fibonacci.Result(sequence=[4])

    async def accepted(handle: Any) -> None:
        handle.execute()

    ActionServer(
        node,
        Fibonacci,
        "count",
        execute,
        goal_callback=decide,
        cancel_callback=agree,
        handle_accepted_callback=accepted,
    )
    client = ActionClient(node, Fibonacci, "count")
    assert client.wait_for_server(timeout_sec=PATIENCE)

    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def finish(future: Any) -> Any:
        executor.spin_until_future_complete(future, timeout_sec=PATIENCE)
        assert future.done()
        return future.result()

    handle = finish(client.send_goal_async(Fibonacci.Goal(order=1)))
    assert handle.accepted
    result = handle.get_result_async()
    assert finish(handle.cancel_goal_async()).goals_canceling
    response = finish(result)
    assert response.status == CANCELED and list(response.result.sequence) == [4]
    node.destroy_node()
