"""Services between nodes and processes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import pytest
from patience import PATIENCE
from ros_processes import Peer, spin_until, wait_until

Start = Callable[..., Peer]

SERVE = """
from std_srvs.srv import SetBool
rclpy.init()
node = rclpy.create_node('server')
def answer(request, response):
    response.success = request.data
    response.message = 'on' if request.data else 'off'
    return response
node.create_service(SetBool, 'switch', answer)
# Some rclpys see a signal only when something else wakes them.
node.create_timer(0.1, lambda: None)
print('ready', flush=True)
rclpy.spin(node)
"""


def trigger(_request: Any, response: Any) -> Any:
    response.success, response.message = True, "done"
    return response


def test_service_in_one_process(ros: Any, node: Any) -> None:
    from std_srvs.srv import Trigger

    node.create_service(Trigger, "~/go", trigger)
    client = node.create_client(Trigger, "/tester/go")
    assert client.wait_for_service(timeout_sec=PATIENCE)
    future = client.call_async(Trigger.Request())
    ros.spin_until_future_complete(node, future, timeout_sec=PATIENCE)
    assert future.done() and future.result().message == "done"


def test_service_across_processes(ros: Any, node: Any, peer: Start) -> None:
    from std_srvs.srv import SetBool

    client = node.create_client(SetBool, "switch")
    assert not client.service_is_ready()
    assert not client.wait_for_service(timeout_sec=0.05)
    peer(SERVE)
    assert client.wait_for_service(timeout_sec=PATIENCE)
    for number in range(200):
        future = client.call_async(SetBool.Request(data=number % 2 == 0))
        ros.spin_until_future_complete(node, future, timeout_sec=PATIENCE)
        assert future.result().message == ("on" if number % 2 == 0 else "off")


def test_first_call_is_not_lost(ros: Any, node: Any, peer: Start) -> None:
    from std_srvs.srv import SetBool

    peer(SERVE).wait_for_line("ready")
    for _ in range(10):
        client = node.create_client(SetBool, "switch")
        assert client.wait_for_service(timeout_sec=PATIENCE)
        future = client.call_async(SetBool.Request(data=True))
        ros.spin_until_future_complete(node, future, timeout_sec=PATIENCE)
        assert future.done()
        node.destroy_client(client)


def test_two_clients_get_their_own_answers(node: Any, peer: Start) -> None:
    from std_srvs.srv import SetBool

    peer(SERVE)
    clients = [node.create_client(SetBool, "switch") for _ in range(2)]
    assert all(client.wait_for_service(timeout_sec=PATIENCE) for client in clients)
    futures = [
        (number % 2 == 0, clients[number % 2].call_async(SetBool.Request(data=number % 2 == 0)))
        # No more than the services' own quality of service keeps.
        for number in range(8)
    ]
    assert spin_until(node, lambda: all(future.done() for _, future in futures))
    assert all(future.result().success is wanted for wanted, future in futures)


def test_a_request_of_a_destroyed_client_is_never_answered(ros: Any, node: Any) -> None:
    from std_srvs.srv import Trigger

    node.create_service(Trigger, "go", trigger)
    client = node.create_client(Trigger, "go")
    assert client.wait_for_service(timeout_sec=PATIENCE)
    future = client.call_async(Trigger.Request())
    called: list[Any] = []
    future.add_done_callback(called.append)
    node.destroy_client(client)
    ros.spin_until_future_complete(node, future, timeout_sec=0.2)
    assert not future.done() and not future.cancelled() and called == []


def test_blocking_call_from_another_thread(ros: Any, node: Any) -> None:
    from std_srvs.srv import Trigger

    node.create_service(Trigger, "go", trigger)
    client = node.create_client(Trigger, "go")
    assert client.wait_for_service(timeout_sec=PATIENCE)
    executor = ros.executors.SingleThreadedExecutor()
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    assert client.call(Trigger.Request()).success
    executor.shutdown()
    thread.join(PATIENCE)
    assert not thread.is_alive()


def test_call_from_a_callback_on_several_threads(ros: Any, node: Any) -> None:
    from rclpy.callback_groups import ReentrantCallbackGroup
    from std_srvs.srv import Trigger

    group = ReentrantCallbackGroup()
    node.create_service(Trigger, "inner", trigger, callback_group=group)
    client = node.create_client(Trigger, "inner", callback_group=group)
    assert client.wait_for_service(timeout_sec=PATIENCE)

    def outer(_request: Any, response: Any) -> Any:
        response.success = client.call(Trigger.Request()).success
        return response

    node.create_service(Trigger, "outer", outer, callback_group=group)
    outer_client = node.create_client(Trigger, "outer", callback_group=group)
    assert outer_client.wait_for_service(timeout_sec=PATIENCE)
    executor = ros.executors.MultiThreadedExecutor(num_threads=3)
    executor.add_node(node)
    future = outer_client.call_async(Trigger.Request())
    executor.spin_until_future_complete(future, timeout_sec=PATIENCE)
    assert future.done() and future.result().success
    executor.shutdown()


def test_coroutine_callback_awaits_another_service(ros: Any, node: Any) -> None:
    from rclpy.callback_groups import ReentrantCallbackGroup
    from std_srvs.srv import Trigger

    group = ReentrantCallbackGroup()
    node.create_service(Trigger, "inner", trigger, callback_group=group)
    client = node.create_client(Trigger, "inner", callback_group=group)
    assert client.wait_for_service(timeout_sec=PATIENCE)

    async def outer(_request: Any, response: Any) -> Any:
        inner = await client.call_async(Trigger.Request())
        response.message = inner.message + " twice"
        return response

    node.create_service(Trigger, "outer", outer, callback_group=group)
    outer_client = node.create_client(Trigger, "outer", callback_group=group)
    assert outer_client.wait_for_service(timeout_sec=PATIENCE)
    future = outer_client.call_async(Trigger.Request())
    ros.spin_until_future_complete(node, future, timeout_sec=PATIENCE)
    assert future.done() and future.result().message == "done twice"


def test_wrong_request_is_refused(node: Any) -> None:
    from std_srvs.srv import SetBool, Trigger

    client = node.create_client(Trigger, "go")
    with pytest.raises(TypeError):
        client.call_async(SetBool.Request())


def test_exception_in_a_callback_ends_spinning(node: Any) -> None:
    wanted = ValueError("on purpose")

    def fail() -> None:
        raise wanted

    node.create_timer(0.01, fail)
    with pytest.raises(ValueError) as caught:
        spin_until(node, lambda: False)
    assert caught.value is wanted


def test_service_goes_away(node: Any, peer: Start) -> None:
    from std_srvs.srv import SetBool

    other = peer(SERVE)
    client = node.create_client(SetBool, "switch")
    assert client.wait_for_service(timeout_sec=PATIENCE)
    other.process.terminate()
    other.finish()
    assert wait_until(lambda: not client.service_is_ready())
