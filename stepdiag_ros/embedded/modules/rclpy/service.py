"""Services."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy._service_wire import ServerEnd
from rclpy._source import Source
from rclpy.callback_groups import CallbackGroup
from rclpy.qos import QoSProfile

if TYPE_CHECKING:
    from rclpy.node import Node


class Service(Source):
    """Answers requests with a function; made by ``Node.create_service``."""

    def __init__(
        self,
        node: Node,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        callback_group: CallbackGroup,
        qos_profile: QoSProfile,
    ) -> None:
        super().__init__(callback_group)
        self._node = node
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.callback = callback
        self.qos_profile = qos_profile
        self._end = ServerEnd(node, srv_type, srv_name, qos_profile)

    @property
    def service_name(self) -> str:
        """The service's full name."""
        return self.srv_name

    def send_response(self, response: Any, header: Any) -> None:
        """Send the response to a request.

        Raises:
            TypeError: It is another message than the service's response.
        """
        if not isinstance(response, self.srv_type.Response):
            raise TypeError(
                f"Expected {self.srv_type.Response}, got {type(response)}; the callback of the"
                f" service {self.srv_name} must return its response."
            )
        self._end.reply(header, response)

    def destroy(self) -> None:
        """End the service."""
        super().destroy()
        self._end.close()

    def __enter__(self) -> Service:
        return self

    def __exit__(self, *_: object) -> None:
        self._node.destroy_service(self)

    def _conditions(self) -> list[int]:
        return [self._end.condition]

    def _fetch(self) -> None:
        self._pending.extend(self._end.take())

    def _run(self, item: Any) -> Any:
        found = self._end.decode(item)
        if found is None:
            return None
        header, request = found
        response = self.callback(request, self.srv_type.Response())
        if inspect.iscoroutine(response):
            return self._finish(response, header)
        self.send_response(response, header)
        return None

    async def _finish(self, response: Any, header: Any) -> None:
        self.send_response(await response, header)
