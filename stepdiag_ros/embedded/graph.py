"""ROS graph: announce the nodes of this process to the peers, and learn theirs.

Each process writes the list of its nodes, with their readers and writers, to the topic
``ros_discovery_info``, whole at each change. The message ``rmw_dds_common/msg/
ParticipantEntitiesInfo`` is simple and is coded here by hand, which spares numpy at start.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from . import dds, naming

_TOPIC = "ros_discovery_info"
_TYPE = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"
_GID_SIZE = 16
_TYPE_HASH = "RIHS01_91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e"


@dataclass(frozen=True)
class NodeEntry:
    """A node somewhere in the domain."""

    name: str
    namespace: str
    readers: tuple[bytes, ...]
    writers: tuple[bytes, ...]


@dataclass
class _OwnNode:
    name: str
    namespace: str
    readers: list[bytes] = field(default_factory=list)
    writers: list[bytes] = field(default_factory=list)


class Graph:
    """The nodes of this process and of its peers."""

    def __init__(self, participant: dds.Participant) -> None:
        self._participant = participant
        self._gid = participant.guid
        self._lock = threading.RLock()
        self._own: list[_OwnNode] = []
        self._others: dict[bytes, list[NodeEntry]] = {}
        self._held = 0
        user_data = f"typehash={_TYPE_HASH};"
        self._writer = participant.create_writer(
            _TOPIC, _TYPE, dds.Qos(transient_local=True, depth=1), user_data
        )
        self._reader = participant.create_reader(
            _TOPIC, _TYPE, dds.Qos(transient_local=True, depth=1000), user_data
        )

    @contextmanager
    def together(self) -> Iterator[None]:
        """Announce the changes made inside the ``with`` block once, at its end."""
        with self._lock:
            self._held += 1
        try:
            yield
        finally:
            with self._lock:
                self._held -= 1
            self._announce()

    def add_node(self, name: str, namespace: str) -> int:
        """Add a node of this process and return its number for the other calls."""
        with self._lock:
            self._own.append(_OwnNode(name, namespace))
            number = id(self._own[-1])
        self._announce()
        return number

    def remove_node(self, number: int) -> None:
        """Remove a node of this process."""
        with self._lock:
            self._own = [node for node in self._own if id(node) != number]
        self._announce()

    def add_endpoints(self, number: int, readers: list[bytes], writers: list[bytes]) -> None:
        """Add readers and writers, by their GUIDs, to a node of this process."""
        with self._lock:
            for node in self._own:
                if id(node) == number:
                    node.readers += readers
                    node.writers += writers
        self._announce()

    def remove_endpoints(self, number: int, guids: list[bytes]) -> None:
        """Remove readers and writers from a node of this process."""
        gone = set(guids)
        with self._lock:
            for node in self._own:
                if id(node) == number:
                    node.readers = [guid for guid in node.readers if guid not in gone]
                    node.writers = [guid for guid in node.writers if guid not in gone]
        self._announce()

    def nodes(self) -> list[NodeEntry]:
        """Return all nodes in the domain, this process's own first."""
        with self._lock:
            own = [
                NodeEntry(node.name, node.namespace, tuple(node.readers), tuple(node.writers))
                for node in self._own
            ]
            while samples := self._reader.take():
                for sample in samples:
                    try:
                        gid, entries = _decode(sample.data)
                    except (struct.error, ValueError):
                        # A foreign sample must not hide the other nodes.
                        continue
                    if gid != self._gid:
                        self._others[gid] = entries
            alive = {found.participant for found in self._participant.endpoints(writers=True)}
            self._others = {gid: e for gid, e in self._others.items() if gid in alive}
            return own + [entry for entries in self._others.values() for entry in entries]

    def topics(self, endpoints: list[dds.EndpointInfo]) -> dict[str, set[str]]:
        """Return the ROS topics of some endpoints, and the types of each."""
        found: dict[str, set[str]] = {}
        for endpoint in endpoints:
            topic, kind = naming.ros_topic(endpoint.topic), naming.ros_type(endpoint.type_name)
            if topic and kind:
                found.setdefault(topic, set()).add(kind)
        return found

    def services(self, endpoints: list[dds.EndpointInfo]) -> dict[str, set[str]]:
        """Return the ROS services of some endpoints, and the types of each."""
        found: dict[str, set[str]] = {}
        for endpoint in endpoints:
            service, kind = naming.ros_service(endpoint.topic), naming.ros_type(endpoint.type_name)
            if service and kind:
                short = kind.removesuffix("_Request").removesuffix("_Response")
                found.setdefault(service, set()).add(short)
        return found

    def endpoints(self) -> list[dds.EndpointInfo]:
        """Return all writers and readers in the domain."""
        return self._participant.endpoints(True) + self._participant.endpoints(False)

    def endpoints_of(self, writers: bool) -> list[dds.EndpointInfo]:
        """Return all writers, or all readers, in the domain."""
        return self._participant.endpoints(writers)

    def _announce(self) -> None:
        with self._lock:
            if not self._held and self._participant.handle:
                self._writer.write(_encode(self._gid, self._own))


def _encode(gid: bytes, nodes: list[_OwnNode]) -> bytes:
    body = bytearray(gid + struct.pack("<I", len(nodes)))
    for node in nodes:
        for text in (node.namespace, node.name):
            body += b"\0" * (-len(body) & 3)
            data = text.encode() + b"\0"
            body += struct.pack("<I", len(data)) + data
        for guids in (node.readers, node.writers):
            body += b"\0" * (-len(body) & 3)
            body += struct.pack("<I", len(guids)) + b"".join(guids)
    return b"\0\1\0\0" + bytes(body)


def _decode(data: bytes) -> tuple[bytes, list[NodeEntry]]:
    body, position = data[4:], _GID_SIZE

    def number() -> int:
        nonlocal position
        position += -position & 3
        (value,) = struct.unpack_from("<I", body, position)
        position += 4
        return int(value)

    def piece(size: int) -> bytes:
        nonlocal position
        if position + size > len(body):
            raise ValueError("the list of nodes is cut off")
        position += size
        return body[position - size : position]

    def text() -> str:
        return piece(number())[:-1].decode("utf-8", "replace")

    def guids() -> tuple[bytes, ...]:
        return tuple(piece(_GID_SIZE) for _ in range(number()))

    entries: list[NodeEntry] = []
    for _ in range(number()):
        namespace, name = text(), text()
        entries.append(NodeEntry(name, namespace, guids(), guids()))
    return body[:_GID_SIZE], entries
