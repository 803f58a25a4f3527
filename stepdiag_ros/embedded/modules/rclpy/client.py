"""Clients of services."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

from rclpy._service_wire import ClientEnd
from rclpy._source import Source
from rclpy.callback_groups import CallbackGroup
from rclpy.qos import QoSProfile
from rclpy.task import Future

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.node import Node


class _RequestFuture(Future):
    """Future of a response, which the client forgets when it is cancelled."""

    def __init__(self, client: Client, executor: Executor | None) -> None:
        super().__init__(executor=executor)
        self._client = client

    def cancel(self) -> None:
        """Cancel the request; its response will be ignored."""
        self._client.remove_pending_request(self)
        super().cancel()


class Client(Source):
    """Sends requests to a service; made by ``Node.create_client``."""

    def __init__(
        self,
        node: Node,
        srv_type: Any,
        srv_name: str,
        callback_group: CallbackGroup,
        qos_profile: QoSProfile,
    ) -> None:
        super().__init__(callback_group)
        self._node = node
        self.context = node.context
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.qos_profile = qos_profile
        self._end = ClientEnd(node, srv_type, srv_name, qos_profile)
        self._requests: dict[int, Future] = {}
        self._lock = threading.Lock()

    @property
    def service_name(self) -> str:
        """The service's full name."""
        return self.srv_name

    def call(self, request: Any, timeout_sec: float | None = None) -> Any:
        """Send a request and wait for its response; another thread must spin the node.

        Raises:
            TypeError: It is another message than the service's request.
            TimeoutError: The response did not come in time.
        """
        event = threading.Event()
        future = self.call_async(request)
        future._set_executor(None)
        future.add_done_callback(lambda _: event.set())
        if not event.wait(timeout_sec):
            self.remove_pending_request(future)
            raise TimeoutError(f"The service {self.srv_name} did not answer in {timeout_sec} s.")
        return future.result()

    def call_async(self, request: Any) -> Future:
        """Send a request and return the future of its response.

        Raises:
            TypeError: It is another message than the service's request.
            rclpy.exceptions.InvalidHandle: The client is destroyed.
            rclpy.exceptions.RCLError: The context is shut down.
        """
        if not isinstance(request, self.srv_type.Request):
            raise TypeError(f"Expected {self.srv_type.Request}, got {type(request)}")
        self._end.check()
        future = _RequestFuture(self, self._executor() or self._node.executor)
        data = self._end.encode(request)
        with self._lock:
            number = self._end.next_number()
            self._requests[number] = future
        self._end.send(number, data)
        return future

    def get_pending_request(self, sequence_number: int) -> Future:
        """Return the future of a request by its number.

        Raises:
            KeyError: The request is unknown.
        """
        return self._requests[sequence_number]

    def remove_pending_request(self, future: Future) -> None:
        """Forget a request; its response will be ignored."""
        with self._lock:
            for number, known in list(self._requests.items()):
                if known is future:
                    del self._requests[number]

    def service_is_ready(self) -> bool:
        """Return whether a service is there that can be called."""
        return self._end.is_ready()

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        """Wait until the service is there; return whether it is, after the given time at most."""
        end = None if timeout_sec is None or timeout_sec < 0 else time.monotonic() + timeout_sec
        while self.context.ok():
            if self.service_is_ready():
                return True
            if end is not None and time.monotonic() >= end:
                return False
            left = 0.005 if end is None else min(0.005, max(end - time.monotonic(), 0))
            time.sleep(left)
        return False

    def destroy(self) -> None:
        """End the client; the futures of requests without a response are never done."""
        super().destroy()
        self._end.close()
        with self._lock:
            self._requests.clear()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self._node.destroy_client(self)

    def _conditions(self) -> list[int]:
        return [self._end.condition]

    def _fetch(self) -> None:
        self._pending.extend(self._end.take())

    def _run(self, item: Any) -> Any:
        number, data = item
        with self._lock:
            future = self._requests.pop(number, None)
        response = self._end.decode(data)
        if future is not None and response is not None:
            future.set_result(response)
