"""DDS entities: participant, writers, readers and wait sets that carry CDR bytes unseen.

One :class:`Participant` stands for a process's ROS context. Names and types are those of DDS; the
ROS naming rules are in :mod:`.naming`.
"""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Mapping
from ctypes import byref, c_bool, c_size_t, c_uint64, c_void_p
from dataclasses import dataclass
from typing import Any

from . import ddslib
from .ddsdomain import MAX_PARTICIPANTS, domains
from .ddsendpoint import UNLIMITED as UNLIMITED
from .ddsendpoint import EndpointInfo as EndpointInfo
from .ddsendpoint import Qos as Qos
from .ddsendpoint import make_qos, matched_peers, read_endpoint, read_user_data
from .ddslib import DdsError as DdsError
from .ddslib import library

_TAKE = 64


@dataclass(frozen=True)
class Sample:
    """One received sample: its CDR bytes, its writer's handle and the time it was written (ns)."""

    data: bytes
    writer: int
    source_timestamp: int


class Participant:
    """This process in a DDS domain.

    Args:
        domain: Number of the domain.
        user_data: What peers read of this participant.
        properties: Its DDS properties; those of DDS Security are in :mod:`.security`.

    Raises:
        DdsError: Cyclone is missing, or the domain cannot be joined.
    """

    def __init__(
        self, domain: int, user_data: str = "", properties: Mapping[str, str] | None = None
    ) -> None:
        if not 0 <= domain <= 232:
            raise DdsError(f"ROS_DOMAIN_ID is {domain}; it must be from 0 to 232.")
        self.domain = domain
        #: Whether DDS Security is on: then permissions say which topics there may be.
        self.protected = bool(properties)
        self._lib = library()
        self._builtin: dict[int, int] = {}
        self._known: dict[int, dict[int, EndpointInfo]] = {}
        self._news: dict[int, int] = {}
        self._lock = threading.Lock()
        domains.open(domain)
        qos = self._lib.dds_create_qos()
        self._lib.dds_qset_userdata(qos, user_data.encode(), len(user_data.encode()))
        for name, value in (properties or {}).items():
            self._lib.dds_qset_prop(qos, name.encode(), value.encode())
        code = self._lib.dds_create_participant(domain, qos, None)
        self._lib.dds_delete_qos(qos)
        if code < 0:
            domains.close(domain)
        hint = (
            "do the certificates and permissions of the enclave hold for it?"
            if properties
            else f"are there more than {MAX_PARTICIPANTS} nodes?"
        )
        self.handle = self._lib.check(code, f"join domain {domain} ({hint})")

    @property
    def guid(self) -> bytes:
        """The participant's identity, 16 bytes."""
        return _guid(self.handle)

    def close(self) -> None:
        """Leave the domain with everything made here; peers are notified at once."""
        with self._lock:
            handle, self.handle = self.handle, 0
        if handle:
            self._lib.dds_delete(handle)
            domains.close(self.domain)

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
        made = _allowed(
            lib.dds_create_topic(self.handle, byref(descriptor), topic.encode(), None, None),
            f"create the topic {topic}",
        )
        settings = make_qos(qos, user_data)
        try:
            create = lib.dds_create_writer if kind == "writer" else lib.dds_create_reader
            return _allowed(
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
                self._news[kind] = lib.check(
                    lib.dds_create_readcondition(self._builtin[kind], ddslib.ANY_NEWS),
                    "watch discovery",
                )
            reader = self._builtin[kind]
            if kind in self._known and not lib.dds_triggered(self._news[kind]):
                return list(self._known[kind].values())
            # Before the others: who goes from now on is news for the next look.
            self._note_gone(reader)
            size = 256
            while True:
                samples, infos = (c_void_p * size)(), (ddslib.SampleInfo * size)()
                count = lib.dds_read_mask(reader, samples, infos, size, size, ddslib.ALIVE_STATE)
                lib.check(count, "read what discovery found")
                # Most have been read before, and reading one takes far longer than looking it up.
                known, found = self._known.get(kind, {}), {}
                for info, sample in zip(infos[:count], samples[:count], strict=True):
                    if not info.valid_data:
                        continue
                    number = info.instance_handle
                    entry = None if info.sample_state == ddslib.NOT_READ else known.get(number)
                    found[number] = entry or read_endpoint(
                        ddslib.Endpoint.from_address(sample or 0)
                    )
                if count:
                    lib.dds_return_loan(reader, samples, count)
                if count < size:
                    self._known[kind] = found
                    return list(found.values())
                size *= 4

    def _note_gone(self, reader: int) -> None:
        """Mark what discovery has said of endpoints that are gone as read."""
        lib, size = self._lib, 256
        while size == 256:
            samples, infos = (c_void_p * size)(), (ddslib.SampleInfo * size)()
            count = lib.dds_read_mask(reader, samples, infos, size, size, ddslib.GONE_NEWS)
            lib.check(count, "read what discovery found")
            if count:
                lib.dds_return_loan(reader, samples, count)
            size = count


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

    def write(self, data: bytes, more: bool = False) -> None:
        """Send one sample: CDR with its four bytes of encapsulation header.

        Waits while a reader that keeps all is behind.

        Args:
            data: What is sent.
            more: More follows at once: let it share packets, until :meth:`flush`.

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
        if not more:
            self.flush()

    def flush(self) -> None:
        """Send what was written and still waits for more."""
        self._lib.check(self._lib.dds_write_flush(self.handle), "send samples")

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

    def incompatible(self) -> tuple[int, int, int]:
        """Return how many readers did not match, how many of them are new, and the last policy."""
        status = ddslib.IncompatibleStatus()
        self._lib.dds_get_offered_incompatible_qos_status(self.handle, byref(status))
        return int(status.total_count), int(status.total_count_change), int(status.last_policy_id)

    def peers(self) -> list[EndpointInfo]:
        """Return the readers that receive what is written."""
        return matched_peers(self.handle, readers=True)


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

    def incompatible(self) -> tuple[int, int, int]:
        """Return how many writers did not match, how many of them are new, and the last policy."""
        status = ddslib.IncompatibleStatus()
        self._lib.dds_get_requested_incompatible_qos_status(self.handle, byref(status))
        return int(status.total_count), int(status.total_count_change), int(status.last_policy_id)

    def peers(self) -> list[EndpointInfo]:
        """Return the writers that are received."""
        return matched_peers(self.handle, readers=False)

    def writer_user_data(self, writer: int) -> str:
        """Return the user data of a received writer, given by its instance handle."""
        pointer = self._lib.dds_get_matched_publication_data(self.handle, writer)
        if not pointer:
            return ""
        try:
            return read_user_data(pointer.contents.qos)
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
    # Real ROS 2 nodes warn of topics that tell no type hash.
    user_data = f"typehash=RIHS01_{'0' * 64};"
    reader = participant.create_reader(name, "stepdiag_self_test", qos, user_data)
    writer = participant.create_writer(name, "stepdiag_self_test", qos, user_data)
    try:
        writer.write(sent)
        received = [sample.data for sample in reader.take()]
    finally:
        writer.close()
        reader.close()
    if received != [sent]:
        raise DdsError(
            f"The Cyclone DDS library {ddslib.library_path()} does not work with this package;"
            f" install the version it asks for: {ddslib.INSTALL}."
        )


def _allowed(code: int, action: str) -> int:
    """Return ``code``; raise :class:`DdsError` if it says that something could not be made."""
    if code == ddslib.RETCODE_NOT_ALLOWED_BY_SECURITY:
        raise DdsError(
            f"The permissions of this process's security enclave do not allow to {action} (as it is"
            " named on the wire); choose another enclave, or change its permissions with"
            " 'ros2 security create_permission'."
        )
    return library().check(code, action)


def _guid(handle: int) -> bytes:
    lib, guid = library(), ddslib.Guid()
    lib.check(lib.dds_get_guid(handle, byref(guid)), "identify an entity")
    return bytes(guid.value)
