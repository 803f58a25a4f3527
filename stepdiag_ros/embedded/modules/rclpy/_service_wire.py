"""The two ends of a service on the wire, which services, clients and actions are made of."""

from __future__ import annotations

import dataclasses
import itertools
import os
import struct
import threading
import time
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy._endpoint import Decoder, type_user_data
from rclpy.exceptions import InvalidHandle, RCLError
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


class RequestId(NamedTuple):
    """Which request a reply answers: the client's identity, the number, and the client's writer."""

    client: int
    number: int
    writer: int


class _End:
    """The writer and reader of one end."""

    def __init__(
        self, node: Node, srv_type: Any, name: str, qos_profile: QoSProfile, is_server: bool
    ) -> None:
        self._node = node
        self.name = name
        participant, _ = node.context._require()
        # History is each side's own affair, and no request or reply of a burst shall be lost.
        qos = dataclasses.replace(qos_profile._to_dds(), keep_all=True)
        key = f"{'serviceid' if is_server else 'clientid'}={_unique_id()};"

        def arguments(cls: type, topic: str) -> tuple[str, str, dds.Qos, str]:
            kind = naming.dds_type(registry.type_name(cls))
            return topic, kind, qos, key + type_user_data(cls)

        request = arguments(srv_type.Request, naming.dds_request(name))
        reply = arguments(srv_type.Response, naming.dds_reply(name))
        self._writer = participant.create_writer(*(reply if is_server else request))
        self._reader = participant.create_reader(*(request if is_server else reply))
        #: Identities of the reader and of the writer, for the graph.
        self.guids = [self._reader.guid], [self._writer.guid]

    @property
    def condition(self) -> int:
        """The DDS condition that holds when something has arrived."""
        return self._reader.condition

    def close(self) -> None:
        """End writer and reader."""
        self._writer.close()
        self._reader.close()


class ServerEnd(_End):
    """Takes requests and sends replies."""

    def __init__(self, node: Node, srv_type: Any, name: str, qos_profile: QoSProfile) -> None:
        super().__init__(node, srv_type, name, qos_profile, True)
        self._decode = Decoder(node, srv_type.Request, f"service {name}")
        self._encode = registry.serializer(srv_type.Response)
        self._known_writers: set[int] = set()
        self._lock = threading.Lock()

    def take(self) -> list[dds.Sample]:
        """Return the requests that have arrived, for :meth:`decode`."""
        return self._reader.take()

    def decode(self, sample: dds.Sample) -> tuple[RequestId, Any] | None:
        """Return which request it is and its message, ``None`` if the bytes are none."""
        parts = _split(sample.data)
        request = self._decode(parts[2] if parts else sample.data)
        if parts is None or request is None:
            return None
        return RequestId(parts[0], parts[1], sample.writer), request

    def reply(self, request_id: RequestId, response: Any) -> None:
        """Send the response to a request; nothing happens after shutdown."""
        self._wait_for_client(request_id.writer)
        if self._writer.handle and self._node.context.ok():
            data = self._encode(response)
            self._writer.write(_join(request_id.client, request_id.number, data))

    def _wait_for_client(self, writer: int) -> None:
        """Wait until the client's reader is known, or the reply to its first request gets lost."""
        with self._lock:
            if writer in self._known_writers:
                return
        user_data = self._reader.writer_user_data(writer)
        key = next((part for part in user_data.split(";") if part.startswith("clientid=")), None)
        end = time.monotonic() + _CLIENT_PATIENCE
        while key is not None:
            if any(key in peer.user_data.split(";") for peer in self._writer.peers()):
                with self._lock:
                    self._known_writers.add(writer)
                return
            if time.monotonic() > end:
                return
            time.sleep(0.001)


class ClientEnd(_End):
    """Sends requests and takes replies."""

    def __init__(self, node: Node, srv_type: Any, name: str, qos_profile: QoSProfile) -> None:
        super().__init__(node, srv_type, name, qos_profile, False)
        #: Gives the response of a reply's bytes, ``None`` if they are none.
        self.decode = Decoder(node, srv_type.Response, f"service {name}")
        self._encode = registry.serializer(srv_type.Request)
        self._identity = self._writer.instance
        self._numbers = itertools.count(1)

    def next_number(self) -> int:
        """Return the number of the next request, which is to be noted before it is sent."""
        return next(self._numbers)

    def check(self) -> None:
        """Raise an error if requests cannot be sent.

        Raises:
            rclpy.exceptions.InvalidHandle: The client is destroyed.
            rclpy.exceptions.RCLError: The context is shut down.
        """
        if not self._writer.handle:
            raise InvalidHandle("Cannot use Destroyable because destruction was requested")
        if not self._node.context.ok():
            raise RCLError(f"Failed to call {self.name}: client's context is invalid")

    def encode(self, request: Any) -> bytes:
        """Return the bytes of a request, for :meth:`send`."""
        return self._encode(request)

    def send(self, number: int, data: bytes) -> None:
        """Send a request's bytes."""
        self._writer.write(_join(self._identity, number, data))

    def take(self) -> list[tuple[int, bytes]]:
        """Return the replies that have arrived: the requests' numbers and the bytes."""
        found: list[tuple[int, bytes]] = []
        for sample in self._reader.take():
            parts = _split(sample.data)
            # Replies to the service's other clients arrive here too.
            if parts is not None and parts[0] == self._identity:
                found.append(parts[1:])
        return found

    def is_ready(self) -> bool:
        """Return whether a service is there that can be called.

        Raises:
            rclpy.exceptions.InvalidHandle: The client is destroyed.
        """
        if not self._writer.handle:
            raise InvalidHandle("Cannot use Destroyable because destruction was requested")
        return self._writer.matched() > 0 and self._reader.matched() > 0


def _join(client: int, number: int, data: bytes) -> bytes:
    """Return the bytes of a request or reply from its header and its CDR."""
    return _CDR_HEADER + _HEADER.pack(client, number) + data[_CDR_SIZE:]


def _split(data: bytes) -> tuple[int, int, bytes] | None:
    """Return client, number and CDR of a request's or reply's bytes; ``None`` if they are none."""
    start = _CDR_SIZE + _HEADER.size
    if len(data) < start or data[:2] != _CDR_HEADER[:2]:
        return None
    client, number = _HEADER.unpack_from(data, _CDR_SIZE)
    return client, number, data[:_CDR_SIZE] + data[start:]


def _unique_id() -> str:
    """Return a text, as ``rmw_cyclonedds`` writes it, by which the two ends of one are matched."""
    parts = os.urandom(12) + struct.pack(">I", next(_ids) & 0xFFFFFFFF)
    return ".".join(f"{value:02x}" for value in parts)
