"""Services."""

from __future__ import annotations

import dataclasses
import inspect
import itertools
import os
import struct
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy._endpoint import Decoder, type_user_data
from rclpy._source import Source
from rclpy.callback_groups import CallbackGroup
from rclpy.qos import QoSProfile
from stepdiag_ros.embedded import dds, naming, registry

if TYPE_CHECKING:
    from rclpy.node import Node

#: After the encapsulation header, each request and reply carries the client's identity (its
#: writer's instance handle) and the request's number.
_HEADER = struct.Struct("<Qq")
_CDR_HEADER = b"\0\1\0\0"
_CDR_SIZE = 4
#: How long a reply waits for its client to be discovered, in seconds.
_CLIENT_PATIENCE = 0.1
_ids = itertools.count(1)


def join(client: int, number: int, data: bytes) -> bytes:
    """Return the bytes of a request or reply from its header and its CDR."""
    return _CDR_HEADER + _HEADER.pack(client, number) + data[_CDR_SIZE:]


def split(data: bytes) -> tuple[int, int, bytes] | None:
    """Return client, number and CDR of a request's or reply's bytes; ``None`` if they are none."""
    start = _CDR_SIZE + _HEADER.size
    if len(data) < start or data[:2] != _CDR_HEADER[:2]:
        return None
    client, number = _HEADER.unpack_from(data, _CDR_SIZE)
    return client, number, data[:_CDR_SIZE] + data[start:]


def unique_id() -> str:
    """Return a text, as ``rmw_cyclonedds`` writes it, by which the two ends of one are matched."""
    parts = os.urandom(12) + struct.pack(">I", next(_ids) & 0xFFFFFFFF)
    return ".".join(f"{value:02x}" for value in parts)


class Endpoints:
    """The writer and reader of a service or client."""

    def __init__(
        self, node: Node, srv_type: Any, name: str, qos_profile: QoSProfile, is_service: bool
    ) -> None:
        participant, self._graph = node.context._require()
        # History is each side's own affair, and no request or reply of a burst shall be lost.
        qos = dataclasses.replace(qos_profile._to_dds(), keep_all=True)
        key = f"{'serviceid' if is_service else 'clientid'}={unique_id()};"

        def arguments(cls: type, topic: str) -> tuple[str, str, dds.Qos, str]:
            kind = naming.dds_type(registry.type_name(cls))
            return topic, kind, qos, key + type_user_data(cls)

        request = arguments(srv_type.Request, naming.dds_request(name))
        reply = arguments(srv_type.Response, naming.dds_reply(name))
        self.writer = participant.create_writer(*(reply if is_service else request))
        self.reader = participant.create_reader(*(request if is_service else reply))
        self.guids = [self.reader.guid], [self.writer.guid]

    def close(self) -> None:
        """End both."""
        self.writer.close()
        self.reader.close()


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
        self._decode = Decoder(node, srv_type.Request, f"service {srv_name}")
        self._encode = registry.serializer(srv_type.Response)
        self._endpoints = Endpoints(node, srv_type, srv_name, qos_profile, True)
        self._known_writers: set[int] = set()
        self._lock = threading.Lock()

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
        client, number, writer = header
        self._wait_for_client(writer)
        if self._endpoints.writer.handle and self._node.context.ok():
            self._endpoints.writer.write(join(client, number, self._encode(response)))

    def destroy(self) -> None:
        """End the service."""
        super().destroy()
        self._endpoints.close()

    def __enter__(self) -> Service:
        return self

    def __exit__(self, *_: object) -> None:
        self._node.destroy_service(self)

    def _conditions(self) -> list[int]:
        return [self._endpoints.reader.condition]

    def _fetch(self) -> None:
        self._pending.extend(self._endpoints.reader.take())

    def _run(self, item: Any) -> Any:
        parts = split(item.data)
        request = self._decode(parts[2] if parts else item.data)
        if parts is None or request is None:
            return None
        header = (parts[0], parts[1], item.writer)
        response = self.callback(request, self.srv_type.Response())
        if inspect.iscoroutine(response):
            return self._finish(response, header)
        self.send_response(response, header)
        return None

    async def _finish(self, response: Any, header: Any) -> None:
        self.send_response(await response, header)

    def _wait_for_client(self, writer: int) -> None:
        """Wait until the client's reader is known, or the reply to its first request gets lost."""
        with self._lock:
            if writer in self._known_writers:
                return
        user_data = self._endpoints.reader.writer_user_data(writer)
        key = next((part for part in user_data.split(";") if part.startswith("clientid=")), None)
        end = time.monotonic() + _CLIENT_PATIENCE
        while key is not None:
            if any(key in peer.user_data.split(";") for peer in self._endpoints.writer.peers()):
                with self._lock:
                    self._known_writers.add(writer)
                return
            if time.monotonic() > end:
                return
            time.sleep(0.001)
