"""DDS entities: participant, writers, readers and wait sets that carry CDR bytes unseen.

One :class:`Participant` stands for a process's ROS context. Names and types are those of DDS; the
ROS naming rules are in :mod:`.naming`.
"""

from __future__ import annotations

import ctypes
import os
import threading
from ctypes import byref, c_bool, c_int16, c_size_t, c_uint64, c_void_p
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import quoteattr

from . import ddslib
from .ddslib import DdsError as DdsError
from .ddslib import library

#: Nanoseconds that mean "no limit" in a :class:`Qos`.
UNLIMITED = ddslib.INFINITE

#: Participants of one machine that find each other; each start sends as many small packets.
MAX_PARTICIPANTS = 100

_TAKE = 64


@dataclass(frozen=True)
class Qos:
    """Quality of service of a writer or reader; durations in nanoseconds."""

    reliable: bool = True
    transient_local: bool = False
    keep_all: bool = False
    depth: int = 10
    deadline: int = UNLIMITED
    lifespan: int = UNLIMITED
    manual_liveliness: bool = False
    lease: int = UNLIMITED


@dataclass(frozen=True)
class Sample:
    """One received sample: its CDR bytes, its writer's handle and the time it was written (ns)."""

    data: bytes
    writer: int
    source_timestamp: int


@dataclass(frozen=True)
class EndpointInfo:
    """A writer or reader anywhere in the domain."""

    guid: bytes
    participant: bytes
    topic: str
    type_name: str
    user_data: str
    qos: Qos


def discovery_config() -> str:
    """Return the Cyclone configuration for ``ROS_AUTOMATIC_DISCOVERY_RANGE`` and its peers.

    Raises:
        DdsError: The variable has a value which ROS 2 does not know.
    """
    wanted = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "") or "LOCALHOST"
    peers = [peer for peer in os.environ.get("ROS_STATIC_PEERS", "").split(";") if peer]
    parts: list[str] = []
    if wanted in ("LOCALHOST", "OFF"):
        parts.append("<General><AllowMulticast>false</AllowMulticast></General>")
    discovery = ""
    if wanted == "OFF":
        # A tag that no other process has keeps everybody out.
        discovery = f"<ParticipantIndex>none</ParticipantIndex><Tag>off_{os.getpid()}</Tag>"
    elif wanted in ("LOCALHOST", "SUBNET"):
        if wanted == "LOCALHOST":
            peers.insert(0, "localhost")
        discovery = (
            "<ParticipantIndex>auto</ParticipantIndex>"
            f"<MaxAutoParticipantIndex>{MAX_PARTICIPANTS}</MaxAutoParticipantIndex>"
        )
        listed = "".join(f"<Peer address={quoteattr(peer)}/>" for peer in peers)
        discovery += f"<Peers>{listed}</Peers>" if listed else ""
    elif wanted != "SYSTEM_DEFAULT":
        raise DdsError(
            f"ROS_AUTOMATIC_DISCOVERY_RANGE is '{wanted}'; set it to LOCALHOST, SUBNET, OFF or"
            " SYSTEM_DEFAULT."
        )
    if discovery:
        parts.append(f"<Discovery>{discovery}</Discovery>")
    own = f"<CycloneDDS><Domain>{''.join(parts)}</Domain></CycloneDDS>" if parts else ""
    return ",".join(part for part in (own, os.environ.get("CYCLONEDDS_URI", "")) if part)


class _Domains:
    """The domains this process takes part in, and how many participants use each."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._open: dict[int, tuple[int, int]] = {}

    def open(self, number: int) -> None:
        lib = library()
        with self._lock:
            handle, users = self._open.get(number, (0, 0))
            if not users:
                config = discovery_config()
                handle = lib.check(
                    lib.dds_create_domain(number, config.encode()), f"open domain {number}"
                )
            self._open[number] = (handle, users + 1)

    def close(self, number: int) -> None:
        with self._lock:
            handle, users = self._open[number]
            if users > 1:
                self._open[number] = (handle, users - 1)
            else:
                del self._open[number]
                library().dds_delete(handle)


_domains = _Domains()


class Participant:
    """This process in a DDS domain.

    Raises:
        DdsError: Cyclone is missing, or the domain cannot be joined.
    """

    def __init__(self, domain: int, user_data: str = "") -> None:
        if not 0 <= domain <= 232:
            raise DdsError(f"ROS_DOMAIN_ID is {domain}; it must be from 0 to 232.")
        self.domain = domain
        self._lib = library()
        self._builtin: dict[int, int] = {}
        self._lock = threading.Lock()
        _domains.open(domain)
        qos = self._lib.dds_create_qos()
        self._lib.dds_qset_userdata(qos, user_data.encode(), len(user_data.encode()))
        code = self._lib.dds_create_participant(domain, qos, None)
        self._lib.dds_delete_qos(qos)
        if code < 0:
            _domains.close(domain)
        self.handle = self._lib.check(
            code, f"join domain {domain} (are there more than {MAX_PARTICIPANTS} nodes?)"
        )

    @property
    def guid(self) -> bytes:
        """The participant's identity, 16 bytes."""
        return _guid(self.handle)

    def close(self) -> None:
        """Leave the domain with everything made here; peers are told at once."""
        with self._lock:
            handle, self.handle = self.handle, 0
        if handle:
            self._lib.dds_delete(handle)
            _domains.close(self.domain)

    def create_writer(self, topic: str, type_name: str, qos: Qos, user_data: str = "") -> Writer:
        """Return a new writer of a topic."""
        return Writer(self._create("writer", topic, type_name, qos, user_data))

    def create_reader(self, topic: str, type_name: str, qos: Qos, user_data: str = "") -> Reader:
        """Return a new reader of a topic."""
        return Reader(self._create("reader", topic, type_name, qos, user_data))

    def _create(self, kind: str, topic: str, type_name: str, qos: Qos, user_data: str) -> int:
        lib = self._lib
        if not self.handle:
            raise DdsError(f"The {kind} of {topic} cannot be made after shutdown.")
        descriptor = ddslib.opaque_descriptor(type_name)
        made = lib.check(
            lib.dds_create_topic(self.handle, byref(descriptor), topic.encode(), None, None),
            f"create the topic {topic}",
        )
        settings = _make_qos(qos, user_data)
        try:
            create = lib.dds_create_writer if kind == "writer" else lib.dds_create_reader
            return lib.check(
                create(self.handle, made, settings, None), f"create a {kind} of {topic}"
            )
        finally:
            lib.dds_delete_qos(settings)
            # The writer or reader keeps the topic alive.
            lib.dds_delete(made)

    def endpoints(self, writers: bool) -> list[EndpointInfo]:
        """Return all writers (or readers) in the domain, this process's own included."""
        lib = self._lib
        kind = ddslib.BUILTIN_PUBLICATIONS if writers else ddslib.BUILTIN_SUBSCRIPTIONS
        with self._lock:
            if not self.handle:
                return []
            if kind not in self._builtin:
                self._builtin[kind] = lib.check(
                    lib.dds_create_reader(self.handle, kind, None, None), "watch discovery"
                )
            reader = self._builtin[kind]
            size = 256
            while True:
                samples, infos = (c_void_p * size)(), (ddslib.SampleInfo * size)()
                count = lib.dds_read_mask(reader, samples, infos, size, size, ddslib.ALIVE_STATE)
                lib.check(count, "read what discovery found")
                found = [
                    _endpoint(ddslib.Endpoint.from_address(samples[i] or 0))
                    for i in range(count)
                    if infos[i].valid_data
                ]
                if count:
                    lib.dds_return_loan(reader, samples, count)
                if count < size:
                    return found
                size *= 4


class _Entity:
    """A DDS object that ends with :meth:`close`."""

    def __init__(self, handle: int) -> None:
        self.handle = handle
        self._lib = library()

    def close(self) -> None:
        """Delete the object; further use is an error."""
        handle, self.handle = self.handle, 0
        if handle:
            self._lib.dds_delete(handle)

    @property
    def guid(self) -> bytes:
        """The object's identity in the domain, 16 bytes."""
        return _guid(self.handle)

    @property
    def instance(self) -> int:
        """The object's instance handle."""
        value = c_uint64()
        self._lib.check(
            self._lib.dds_get_instance_handle(self.handle, byref(value)), "identify an endpoint"
        )
        return value.value


class Writer(_Entity):
    """Writes CDR bytes to a topic; may be used by several threads."""

    def __init__(self, handle: int) -> None:
        super().__init__(handle)
        sertype = c_void_p()
        self._lib.check(
            self._lib.dds_get_entity_sertype(handle, byref(sertype)), "look at a writer's type"
        )
        self._sertype = sertype
        self._lib.dds_set_status_mask(handle, ddslib.OFFERED_INCOMPATIBLE_QOS_STATUS)

    def write(self, data: bytes) -> None:
        """Send one sample: CDR with its four bytes of encapsulation header.

        Waits while a reader that keeps all is behind.

        Raises:
            DdsError: The bytes are not CDR, or the writer is closed.
        """
        lib = self._lib
        size = len(data)
        if size & 3:
            data += b"\0" * (-size & 3)
            size = len(data)
        piece = ddslib.Iovec(data, size)
        made = (
            lib.ddsi_serdata_from_ser_iov(self._sertype, ddslib.SDK_DATA, 1, byref(piece), size)
            if self.handle and size > 4
            else None
        )
        if not made:
            raise DdsError("The sample cannot be sent: it is not CDR, or the publisher is closed.")
        code = lib.dds_writecdr(self.handle, made)
        if code < 0:
            lib.check(code, "send a sample")

    def matched(self) -> int:
        """Return how many readers receive what is written."""
        status = ddslib.MatchedStatus()
        self._lib.dds_get_publication_matched_status(self.handle, byref(status))
        return int(status.current_count)

    def wait_for_acks(self, timeout_ns: int) -> bool:
        """Wait until all reliable readers have everything; return whether they do."""
        code = self._lib.dds_wait_for_acks(self.handle, timeout_ns)
        if code == ddslib.RETCODE_TIMEOUT:
            return False
        self._lib.check(code, "wait for acknowledgements")
        return True

    def incompatible(self) -> tuple[int, int]:
        """Return how many new readers did not match, and the number of the last policy."""
        status = ddslib.IncompatibleStatus()
        self._lib.dds_get_offered_incompatible_qos_status(self.handle, byref(status))
        return int(status.total_count_change), int(status.last_policy_id)

    def peers(self) -> list[EndpointInfo]:
        """Return the readers that receive what is written."""
        return _peers(self.handle, readers=True)


class Reader(_Entity):
    """Takes CDR bytes from a topic; one thread at a time."""

    def __init__(self, handle: int) -> None:
        super().__init__(handle)
        self._lib.dds_set_status_mask(handle, ddslib.REQUESTED_INCOMPATIBLE_QOS_STATUS)
        self.condition = self._lib.check(
            self._lib.dds_create_readcondition(handle, ddslib.ANY_STATE), "watch a reader"
        )
        self._samples = (c_void_p * _TAKE)()
        self._infos = (ddslib.SampleInfo * _TAKE)()
        self._buffer = ctypes.create_string_buffer(4096)
        self._address = ctypes.addressof(self._buffer)

    def take(self, limit: int = _TAKE) -> list[Sample]:
        """Return up to ``limit`` (at most 64) samples that have arrived, oldest first."""
        lib, samples, infos = self._lib, self._samples, self._infos
        if not self.handle:
            return []
        count = lib.dds_takecdr(self.handle, samples, min(limit, _TAKE), infos, ddslib.ANY_STATE)
        if count <= 0:
            if count < 0 and count != ddslib.RETCODE_ALREADY_DELETED:
                lib.check(count, "take samples")
            return []
        taken: list[Sample] = []
        copy, unref, get_size = (
            lib.ddsi_serdata_to_ser,
            lib.ddsi_serdata_unref,
            lib.ddsi_serdata_size,
        )
        for index in range(count):
            pointer, info = samples[index], infos[index]
            if info.valid_data:
                size = get_size(pointer)
                if size > len(self._buffer):
                    self._buffer = ctypes.create_string_buffer(2 * size)
                    self._address = ctypes.addressof(self._buffer)
                copy(pointer, 0, size, self._address)
                data = ctypes.string_at(self._address, size)
                taken.append(Sample(data, info.publication_handle, info.source_timestamp))
            unref(pointer)
        return taken

    def matched(self) -> int:
        """Return how many writers are received."""
        status = ddslib.MatchedStatus()
        self._lib.dds_get_subscription_matched_status(self.handle, byref(status))
        return int(status.current_count)

    def incompatible(self) -> tuple[int, int]:
        """Return how many new writers did not match, and the number of the last policy."""
        status = ddslib.IncompatibleStatus()
        self._lib.dds_get_requested_incompatible_qos_status(self.handle, byref(status))
        return int(status.total_count_change), int(status.last_policy_id)

    def peers(self) -> list[EndpointInfo]:
        """Return the writers that are received."""
        return _peers(self.handle, readers=False)

    def writer_user_data(self, writer: int) -> str:
        """Return the user data of a received writer, given by its instance handle."""
        pointer = self._lib.dds_get_matched_publication_data(self.handle, writer)
        if not pointer:
            return ""
        try:
            return _user_data(pointer.contents.qos)
        finally:
            self._lib.dds_builtintopic_free_endpoint(pointer)


class GuardCondition(_Entity):
    """Wakes a wait set from any thread."""

    def __init__(self, participant: Participant) -> None:
        lib = library()
        super().__init__(
            lib.check(lib.dds_create_guardcondition(participant.handle), "create a wake-up")
        )

    def trigger(self) -> None:
        """Wake the wait set now, or at its next wait."""
        self._lib.dds_set_guardcondition(self.handle, True)

    def reset(self) -> None:
        """Forget earlier triggers."""
        was = c_bool()
        self._lib.dds_take_guardcondition(self.handle, byref(was))


class WaitSet(_Entity):
    """Waits for any of its conditions; each is known by a number of the caller's."""

    def __init__(self, participant: Participant, size: int = 64) -> None:
        lib = library()
        super().__init__(lib.check(lib.dds_create_waitset(participant.handle), "create a wait set"))
        self._hits = (ctypes.c_ssize_t * size)()
        self._size = c_size_t(size)

    def attach(self, condition: int, key: int) -> None:
        """Wait for a condition (a handle of a reader's condition, an entity, a guard) too."""
        code = self._lib.dds_waitset_attach(self.handle, condition, key)
        if code != ddslib.RETCODE_PRECONDITION_NOT_MET:
            self._lib.check(code, "wait for an entity")

    def detach(self, condition: int) -> None:
        """Wait for a condition no longer; nothing happens if it is gone already."""
        self._lib.dds_waitset_detach(self.handle, condition)

    def wait(self, timeout_ns: int) -> list[int]:
        """Return the numbers of the conditions that hold, after at most ``timeout_ns``."""
        size: Any = self._size
        count = self._lib.dds_waitset_wait(self.handle, self._hits, size, timeout_ns)
        if count < 0:
            self._lib.check(count, "wait")
        return self._hits[: min(count, size.value)]


def self_test(participant: Participant) -> None:
    """Write one sample and read it back, to see that the library does what this module expects.

    Raises:
        DdsError: It does not; the message names the library.
    """
    sent = b"\0\1\0\0" + bytes(range(1, 12)) + b"\0"
    qos = Qos(depth=1)
    name = f"stepdiag_self_test_{os.getpid()}"
    reader = participant.create_reader(name, "stepdiag_self_test", qos)
    writer = participant.create_writer(name, "stepdiag_self_test", qos)
    try:
        writer.write(sent)
        received = [sample.data for sample in reader.take()]
    finally:
        writer.close()
        reader.close()
    if received != [sent]:
        raise DdsError(
            f"The Cyclone DDS library {ddslib.library_path()} does not work with this package;"
            " install the version it asks for: pip install 'cyclonedds>=11.0,<11.1'."
        )


def _guid(handle: int) -> bytes:
    lib, guid = library(), ddslib.Guid()
    lib.check(lib.dds_get_guid(handle, byref(guid)), "identify an entity")
    return bytes(guid.value)


def _make_qos(qos: Qos, user_data: str) -> Any:
    lib = library()
    made = lib.dds_create_qos()
    history = ddslib.KEEP_ALL if qos.keep_all else ddslib.KEEP_LAST
    depth = -1 if qos.keep_all else qos.depth
    lib.dds_qset_history(made, history, depth)
    lib.dds_qset_writer_data_lifecycle(made, False)
    if qos.reliable:
        lib.dds_qset_reliability(made, ddslib.RELIABLE, UNLIMITED)
    else:
        lib.dds_qset_reliability(made, ddslib.BEST_EFFORT, 0)
    if qos.transient_local:
        lib.dds_qset_durability(made, ddslib.TRANSIENT_LOCAL)
        lib.dds_qset_durability_service(made, 0, history, depth, -1, -1, -1)
    if qos.lifespan != UNLIMITED:
        lib.dds_qset_lifespan(made, qos.lifespan)
    if qos.deadline != UNLIMITED:
        lib.dds_qset_deadline(made, qos.deadline)
    if qos.manual_liveliness or qos.lease != UNLIMITED:
        kind = (
            ddslib.LIVELINESS_MANUAL_BY_TOPIC
            if qos.manual_liveliness
            else ddslib.LIVELINESS_AUTOMATIC
        )
        lib.dds_qset_liveliness(made, kind, qos.lease)
    representation = (c_int16 * 1)(ddslib.XCDR1)
    lib.dds_qset_data_representation(made, 1, representation)
    if user_data:
        lib.dds_qset_userdata(made, user_data.encode(), len(user_data.encode()))
    return made


def _endpoint(found: ddslib.Endpoint) -> EndpointInfo:
    return EndpointInfo(
        bytes(found.key.value),
        bytes(found.participant_key.value),
        (found.topic_name or b"").decode("utf-8", "replace"),
        (found.type_name or b"").decode("utf-8", "replace"),
        _user_data(found.qos),
        _read_qos(found.qos),
    )


def _peers(handle: int, readers: bool) -> list[EndpointInfo]:
    lib = library()
    list_all = lib.dds_get_matched_subscriptions if readers else lib.dds_get_matched_publications
    get = lib.dds_get_matched_subscription_data if readers else lib.dds_get_matched_publication_data
    size = 64
    while True:
        handles = (c_uint64 * size)()
        count = list_all(handle, handles, size)
        if count <= size:
            break
        size = count
    found: list[EndpointInfo] = []
    for number in handles[: max(count, 0)]:
        pointer = get(handle, number)
        if pointer:
            found.append(_endpoint(pointer.contents))
            lib.dds_builtintopic_free_endpoint(pointer)
    return found


def _user_data(qos: Any) -> str:
    lib = library()
    value, size = c_void_p(), c_size_t()
    if not qos or not lib.dds_qget_userdata(qos, byref(value), byref(size)) or not value:
        return ""
    try:
        return ctypes.string_at(value, size.value).decode("utf-8", "replace")
    finally:
        lib.dds_free(value)


def _read_qos(qos: Any) -> Qos:
    lib = library()
    reliability, durability, history = (ctypes.c_int32() for _ in range(3))
    liveliness, depth = ctypes.c_int32(), ctypes.c_int32(0)
    blocking, lease = ctypes.c_int64(), ctypes.c_int64(UNLIMITED)
    lifespan, deadline = ctypes.c_int64(UNLIMITED), ctypes.c_int64(UNLIMITED)
    lib.dds_qget_reliability(qos, byref(reliability), byref(blocking))
    lib.dds_qget_durability(qos, byref(durability))
    lib.dds_qget_history(qos, byref(history), byref(depth))
    lib.dds_qget_liveliness(qos, byref(liveliness), byref(lease))
    lib.dds_qget_lifespan(qos, byref(lifespan))
    lib.dds_qget_deadline(qos, byref(deadline))
    return Qos(
        reliable=reliability.value == ddslib.RELIABLE,
        transient_local=durability.value >= ddslib.TRANSIENT_LOCAL,
        keep_all=history.value == ddslib.KEEP_ALL,
        depth=depth.value,
        deadline=deadline.value,
        lifespan=lifespan.value,
        manual_liveliness=liveliness.value == ddslib.LIVELINESS_MANUAL_BY_TOPIC,
        lease=lease.value,
    )
