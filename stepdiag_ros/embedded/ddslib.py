"""The Cyclone DDS C library: find it, load it and declare the functions that are used.

The library is the one under ``CYCLONEDDS_HOME`` if that is set (as Cyclone's own Python binding has
it), else the one inside the ``cyclonedds`` wheel (its Python package is never imported, which saves
0.2 s), else the system's ``libddsc``. Constants carry the names of Cyclone's headers.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import importlib.util
import os
import sys
from ctypes import POINTER, c_bool, c_char_p, c_int32, c_int64, c_size_t, c_uint32, c_uint64
from functools import lru_cache
from pathlib import Path
from typing import Any

SERIES = "11.0"
"""Versions of Cyclone that this package is made for."""
INSTALL = "pip install 'cyclonedds>=11.0,<11.1'"
"""The command that brings one."""

ANY_STATE = 127
ALIVE_STATE = 3 | 12 | 16
NOT_READ = 2
ANY_NEWS = NOT_READ | 12 | 112
GONE_NEWS = NOT_READ | 12 | 96
INFINITE = 2**63 - 1
SDK_DATA = 2

KEEP_LAST, KEEP_ALL = 0, 1
BEST_EFFORT, RELIABLE = 0, 1
VOLATILE, TRANSIENT_LOCAL = 0, 1
LIVELINESS_AUTOMATIC, LIVELINESS_MANUAL_BY_TOPIC = 0, 2
XCDR1 = 0

OFFERED_INCOMPATIBLE_QOS_STATUS = 1 << 3
REQUESTED_INCOMPATIBLE_QOS_STATUS = 1 << 4

BUILTIN_PUBLICATIONS = 0x7FFF0003
BUILTIN_SUBSCRIPTIONS = 0x7FFF0004

RETCODE_ERROR = -1
RETCODE_BAD_PARAMETER = -3
RETCODE_PRECONDITION_NOT_MET = -4
RETCODE_ALREADY_DELETED = -9
RETCODE_TIMEOUT = -10
RETCODE_NOT_ALLOWED_BY_SECURITY = -13


class Iovec(ctypes.Structure):
    """Piece of memory."""

    _fields_ = [("base", c_char_p), ("length", c_size_t)]


class SampleInfo(ctypes.Structure):
    """What Cyclone reports about a sample beside its bytes."""

    _fields_ = [
        ("sample_state", c_int32),
        ("view_state", c_int32),
        ("instance_state", c_int32),
        ("valid_data", c_bool),
        ("source_timestamp", c_int64),
        ("instance_handle", c_uint64),
        ("publication_handle", c_uint64),
        ("disposed_generation_count", c_uint32),
        ("no_writers_generation_count", c_uint32),
        ("sample_rank", c_uint32),
        ("generation_rank", c_uint32),
        ("absolute_generation_rank", c_uint32),
    ]


class Guid(ctypes.Structure):
    """Identity of a DDS entity, 16 bytes."""

    _fields_ = [("value", ctypes.c_ubyte * 16)]


class Endpoint(ctypes.Structure):
    """Writer or reader anywhere in the domain, as discovery found it."""

    _fields_ = [
        ("key", Guid),
        ("participant_key", Guid),
        ("participant_instance_handle", c_uint64),
        ("topic_name", c_char_p),
        ("type_name", c_char_p),
        ("qos", ctypes.c_void_p),
    ]


class MatchedStatus(ctypes.Structure):
    """How many peers an endpoint has."""

    _fields_ = [
        ("total_count", c_uint32),
        ("total_count_change", c_int32),
        ("current_count", c_uint32),
        ("current_count_change", c_int32),
        ("last_handle", c_uint64),
    ]


class IncompatibleStatus(ctypes.Structure):
    """How many peers did not match because of their quality of service, and which policy."""

    _fields_ = [
        ("total_count", c_uint32),
        ("total_count_change", c_int32),
        ("last_policy_id", c_uint32),
    ]


class _TypeMeta(ctypes.Structure):
    _fields_ = [("data", ctypes.c_void_p), ("size", c_uint32)]


class TopicDescriptor(ctypes.Structure):
    """Type of a topic, as Cyclone's IDL compiler would write it."""

    _fields_ = [
        ("size", c_uint32),
        ("align", c_uint32),
        ("flagset", c_uint32),
        ("nkeys", c_uint32),
        ("typename", c_char_p),
        ("keys", ctypes.c_void_p),
        ("nops", c_uint32),
        ("ops", POINTER(c_uint32)),
        ("meta", c_char_p),
        ("type_information", _TypeMeta),
        ("type_mapping", _TypeMeta),
        ("restrict_data_representation", c_uint32),
    ]


_OP_ADR = 0x01 << 24
_OP_TYPE_1BY = 0x01 << 16
_FLAG_RESTRICT_DATA_REPRESENTATION = 1 << 7
_OPS = (c_uint32 * 3)(_OP_ADR | _OP_TYPE_1BY, 0, 0)


def opaque_descriptor(type_name: str) -> TopicDescriptor:
    """Return the descriptor of a type whose content Cyclone does not look into.

    It says one octet, which every sample has, and no XTypes information: peers then match by type
    name alone, as with ROS 2's own Cyclone layer.
    """
    return TopicDescriptor(
        size=1,
        align=1,
        flagset=_FLAG_RESTRICT_DATA_REPRESENTATION,
        typename=type_name.encode(),
        nops=2,
        ops=ctypes.cast(_OPS, POINTER(c_uint32)),
        meta=b"",
        restrict_data_representation=1 << XCDR1,
    )


_ENTITY = c_int32
_POINTER = ctypes.c_void_p

#: Functions that may wait or take locks for long: Python's global lock is released around them.
_SLOW: dict[str, tuple[Any, list[Any]]] = {
    "dds_create_domain": (_ENTITY, [c_uint32, c_char_p]),
    "dds_create_participant": (_ENTITY, [c_uint32, _POINTER, _POINTER]),
    "dds_create_topic": (
        _ENTITY,
        [_ENTITY, POINTER(TopicDescriptor), c_char_p, _POINTER, _POINTER],
    ),
    "dds_create_reader": (_ENTITY, [_ENTITY, _ENTITY, _POINTER, _POINTER]),
    "dds_create_writer": (_ENTITY, [_ENTITY, _ENTITY, _POINTER, _POINTER]),
    "dds_create_waitset": (_ENTITY, [_ENTITY]),
    "dds_create_guardcondition": (_ENTITY, [_ENTITY]),
    "dds_create_readcondition": (_ENTITY, [_ENTITY, c_uint32]),
    "dds_delete": (c_int32, [_ENTITY]),
    "dds_set_status_mask": (c_int32, [_ENTITY, c_uint32]),
    "dds_writecdr": (c_int32, [_ENTITY, _POINTER]),
    "dds_write_flush": (c_int32, [_ENTITY]),
    "dds_takecdr": (
        c_int32,
        [_ENTITY, POINTER(_POINTER), c_uint32, POINTER(SampleInfo), c_uint32],
    ),
    "dds_waitset_attach": (c_int32, [_ENTITY, _ENTITY, ctypes.c_ssize_t]),
    "dds_waitset_detach": (c_int32, [_ENTITY, _ENTITY]),
    "dds_waitset_wait": (
        c_int32,
        [_ENTITY, POINTER(ctypes.c_ssize_t), c_size_t, c_int64],
    ),
    "dds_set_guardcondition": (c_int32, [_ENTITY, c_bool]),
    "dds_take_guardcondition": (c_int32, [_ENTITY, POINTER(c_bool)]),
    "dds_wait_for_acks": (c_int32, [_ENTITY, c_int64]),
    "dds_get_guid": (c_int32, [_ENTITY, POINTER(Guid)]),
    "dds_get_instance_handle": (c_int32, [_ENTITY, POINTER(c_uint64)]),
    "dds_get_publication_matched_status": (c_int32, [_ENTITY, POINTER(MatchedStatus)]),
    "dds_get_subscription_matched_status": (c_int32, [_ENTITY, POINTER(MatchedStatus)]),
    "dds_get_offered_incompatible_qos_status": (c_int32, [_ENTITY, POINTER(IncompatibleStatus)]),
    "dds_get_requested_incompatible_qos_status": (c_int32, [_ENTITY, POINTER(IncompatibleStatus)]),
    "dds_get_matched_subscriptions": (c_int32, [_ENTITY, POINTER(c_uint64), c_size_t]),
    "dds_get_matched_publications": (c_int32, [_ENTITY, POINTER(c_uint64), c_size_t]),
    "dds_get_matched_subscription_data": (POINTER(Endpoint), [_ENTITY, c_uint64]),
    "dds_get_matched_publication_data": (POINTER(Endpoint), [_ENTITY, c_uint64]),
    "dds_builtintopic_free_endpoint": (None, [POINTER(Endpoint)]),
    "dds_get_entity_sertype": (c_int32, [_ENTITY, POINTER(_POINTER)]),
    "dds_read_mask": (
        c_int32,
        [_ENTITY, POINTER(_POINTER), POINTER(SampleInfo), c_size_t, c_uint32, c_uint32],
    ),
    "dds_triggered": (c_int32, [_ENTITY]),
    "dds_return_loan": (c_int32, [_ENTITY, POINTER(_POINTER), c_int32]),
    "dds_strretcode": (c_char_p, [c_int32]),
    "dds_create_qos": (_POINTER, []),
    "dds_delete_qos": (None, [_POINTER]),
    "dds_qset_prop": (None, [_POINTER, c_char_p, c_char_p]),
    "dds_qset_userdata": (None, [_POINTER, c_char_p, c_size_t]),
    "dds_qget_userdata": (c_bool, [_POINTER, POINTER(_POINTER), POINTER(c_size_t)]),
    "dds_qset_durability": (None, [_POINTER, c_int32]),
    "dds_qget_durability": (c_bool, [_POINTER, POINTER(c_int32)]),
    "dds_qset_history": (None, [_POINTER, c_int32, c_int32]),
    "dds_qget_history": (c_bool, [_POINTER, POINTER(c_int32), POINTER(c_int32)]),
    "dds_qset_reliability": (None, [_POINTER, c_int32, c_int64]),
    "dds_qget_reliability": (c_bool, [_POINTER, POINTER(c_int32), POINTER(c_int64)]),
    "dds_qset_durability_service": (
        None,
        [_POINTER, c_int64, c_int32, c_int32, c_int32, c_int32, c_int32],
    ),
    "dds_qset_lifespan": (None, [_POINTER, c_int64]),
    "dds_qget_lifespan": (c_bool, [_POINTER, POINTER(c_int64)]),
    "dds_qset_deadline": (None, [_POINTER, c_int64]),
    "dds_qget_deadline": (c_bool, [_POINTER, POINTER(c_int64)]),
    "dds_qset_liveliness": (None, [_POINTER, c_int32, c_int64]),
    "dds_qget_liveliness": (c_bool, [_POINTER, POINTER(c_int32), POINTER(c_int64)]),
    "dds_qset_writer_data_lifecycle": (None, [_POINTER, c_bool]),
    "dds_qset_writer_batching": (None, [_POINTER, c_bool]),
    "dds_qset_data_representation": (None, [_POINTER, c_uint32, POINTER(ctypes.c_int16)]),
    "dds_qset_ignorelocal": (None, [_POINTER, c_int32]),
    "dds_free": (None, [_POINTER]),
}

#: Functions of well under a microsecond, called for every sample: the global lock is kept.
_QUICK: dict[str, tuple[Any, list[Any]]] = {
    "ddsi_serdata_from_ser_iov": (
        _POINTER,
        [_POINTER, c_int32, c_size_t, POINTER(Iovec), c_size_t],
    ),
    "ddsi_serdata_size": (c_uint32, [_POINTER]),
    "ddsi_serdata_to_ser": (None, [_POINTER, c_size_t, c_size_t, _POINTER]),
    "ddsi_serdata_unref": (None, [_POINTER]),
}


class DdsError(RuntimeError):
    """Cyclone DDS refused or failed; the message says what was asked of it."""


class Library:
    """Cyclone's functions as attributes, by their C names."""

    def __init__(self, path: str) -> None:
        if sys.byteorder != "little":
            raise DdsError("The embedded ROS 2 client needs a little-endian machine.")
        try:
            slow, quick = ctypes.CDLL(path), ctypes.PyDLL(path)
        except OSError as error:
            raise DdsError(f"The Cyclone DDS library {path} cannot be loaded: {error}.") from error
        for source, functions in ((slow, _SLOW), (quick, _QUICK)):
            for name, (result, arguments) in functions.items():
                try:
                    function = getattr(source, name)
                except AttributeError:
                    raise DdsError(
                        f"The Cyclone DDS library {path} has no {name};"
                        f" install the version this package asks for: {INSTALL}."
                    ) from None
                function.restype, function.argtypes = result, arguments
                setattr(self, name, function)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"Cyclone's function {name} is not declared in ddslib")

    def check(self, code: int, action: str) -> int:
        """Return ``code``; raise :class:`DdsError` if it is a failure of ``action``."""
        if code < 0:
            reason = (self.dds_strretcode(code) or b"unknown").decode()
            raise DdsError(f"Cyclone DDS could not {action}: {reason}.")
        return code


def library_path() -> str:
    """Return the path of Cyclone's C library.

    Raises:
        DdsError: ``CYCLONEDDS_HOME`` has none, or neither the wheel nor the system has one.
    """
    home = os.environ.get("CYCLONEDDS_HOME", "")
    if home:
        path = Path(home).absolute() / "lib" / "libddsc.so"
        if not path.is_file():
            raise DdsError(f"CYCLONEDDS_HOME is '{home}', but there is no {path}.")
        return str(path)
    spec = importlib.util.find_spec("cyclonedds")
    for location in (spec.submodule_search_locations or []) if spec else []:
        folder = Path(location)
        for pattern in ("cyclonedds.libs/libddsc*.so*", "cyclonedds/.libs/libddsc*"):
            found = sorted(folder.parent.glob(pattern))
            if found:
                return str(found[0])
    system = ctypes.util.find_library("ddsc")
    if system:
        return system
    raise DdsError(f"No Cyclone DDS library was found; install it with: {INSTALL}.")


@lru_cache(maxsize=1)
def library() -> Library:
    """Return Cyclone's functions, loaded once.

    Raises:
        DdsError: The library is missing or does not fit.
    """
    return Library(library_path())
