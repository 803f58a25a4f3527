"""Settings and identities of DDS endpoints, to and from Cyclone's own objects."""

from __future__ import annotations

import ctypes
from ctypes import byref, c_int16, c_size_t, c_uint64, c_void_p
from dataclasses import dataclass
from typing import Any

from . import ddslib
from .ddslib import library

#: Nanoseconds that mean "no limit" in a :class:`Qos`.
UNLIMITED = ddslib.INFINITE


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
class EndpointInfo:
    """A writer or reader anywhere in the domain."""

    guid: bytes
    participant: bytes
    topic: str
    type_name: str
    user_data: str
    qos: Qos


def make_qos(qos: Qos, user_data: str) -> Any:
    """Return Cyclone's object for settings, which the caller deletes."""
    lib = library()
    made = lib.dds_create_qos()
    history = ddslib.KEEP_ALL if qos.keep_all else ddslib.KEEP_LAST
    depth = -1 if qos.keep_all else qos.depth
    lib.dds_qset_history(made, history, depth)
    lib.dds_qset_writer_data_lifecycle(made, False)
    # A packet goes when its writer says so: after every sample, or after a burst of them.
    lib.dds_qset_writer_batching(made, True)
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


def read_endpoint(found: ddslib.Endpoint) -> EndpointInfo:
    """Return what Cyclone reports about an endpoint."""
    return EndpointInfo(
        bytes(found.key.value),
        bytes(found.participant_key.value),
        (found.topic_name or b"").decode("utf-8", "replace"),
        (found.type_name or b"").decode("utf-8", "replace"),
        read_user_data(found.qos),
        read_qos(found.qos),
    )


def matched_peers(handle: int, readers: bool) -> list[EndpointInfo]:
    """Return the endpoints that match a writer (``readers``) or a reader."""
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
            found.append(read_endpoint(pointer.contents))
            lib.dds_builtintopic_free_endpoint(pointer)
    return found


def read_user_data(qos: Any) -> str:
    """Return the user data among Cyclone's settings."""
    lib = library()
    value, size = c_void_p(), c_size_t()
    if not qos or not lib.dds_qget_userdata(qos, byref(value), byref(size)) or not value:
        return ""
    try:
        return ctypes.string_at(value, size.value).decode("utf-8", "replace")
    finally:
        lib.dds_free(value)


def read_qos(qos: Any) -> Qos:
    """Return settings from Cyclone's object."""
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
