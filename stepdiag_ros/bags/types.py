"""Message definitions of bags: schemas, type hashes, CDR to objects and back, without a ROS client.

Our own definitions come from ``msg/``, the standard ones from the texts that ship with the package.
A bag is decoded with the definitions that it carries, so that bags of older schemas stay readable.
"""

import struct
from collections.abc import Collection, Mapping, Sequence
from functools import cached_property, lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.serde.cdr import generate_deserialize_cdr, generate_getsize_cdr, generate_serialize_cdr
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.base import TypesysError, normalize_fieldname
from rosbags.typesys.store import Typestore
from rosbags.typesys.stores import empty, ros2_jazzy

from stepdiag_ros import resources
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.embedded.packages import OWN, TEXTS
from stepdiag_ros.messages.conversion import ADDED_LATER
from stepdiag_ros.topics import RECORDED

CDR_HEADER = 4
"""Bytes of CDR's encapsulation."""
_PLAIN = (b"\0\0", b"\0\1")
"""How plain CDR begins, big-endian and little-endian."""
_UNDECODABLE = (
    *(SerdeError, TypesysError, ValueError, struct.error, AssertionError, LookupError),
    *(TypeError, AttributeError, ArithmeticError, MemoryError, RecursionError, SyntaxError),
)
"""What decoders made of somebody else's definitions may raise."""
_LONGEST_PROBLEM = 200
_MOST_NESTED = 10
"""Levels of messages in one another; ours have four."""
_SEPARATOR = "=" * 80
_DUMMY = "structure_needs_at_least_one_member"
_WHOLE = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "byte", "char")
DTYPES = {"bool": "bool", "byte": "uint8", "char": "uint8", "float32": "float32"}
"""Kinds of numbers whose arrays have another name than the kind."""


class _Codec:
    """Functions that read and write messages of a type, each made when it is first needed.

    Args:
        store: holds the type and those in it.
        name: of the type.
    """

    def __init__(self, store: Typestore, name: str) -> None:
        self._store = store
        self.cls = store.types[name]
        self.fields = [(normalize_fieldname(one), kind) for one, kind in store.fielddefs[name][1]]

    @cached_property
    def deserialize_cdr_le(self) -> Any:
        return generate_deserialize_cdr(self.fields, self._store, "le")

    @cached_property
    def deserialize_cdr_be(self) -> Any:
        return generate_deserialize_cdr(self.fields, self._store, "be")

    @cached_property
    def serialize_cdr_le(self) -> Any:
        return generate_serialize_cdr(self.fields, self._store, "le")

    @cached_property
    def _sizes(self) -> tuple[Any, int]:
        return generate_getsize_cdr(self.fields, self._store)

    @property
    def getsize_cdr(self) -> Any:
        return self._sizes[0]

    @property
    def size_cdr(self) -> int:
        return self._sizes[1]


class _Store(Typestore):
    """Makes of a type what is needed of it, where rosbags makes a dozen functions at once.

    That takes as long as to decode all messages of a run.
    """

    def get_msgdef(self, typename: str) -> Any:
        if typename not in self.cache:
            made: Any = _Codec(self, typename)
            self.cache[typename] = made
        return self.cache[typename]


class MessageTypes:
    """A set of message definitions, with what can be done with them.

    Args:
        store: the rosbags type store that holds them.
        texts: ``ros2msg`` schema text of each type whose original text is known, by full type name.
    """

    def __init__(self, store: Typestore, texts: Mapping[str, str]) -> None:
        self._store = store
        self._texts = dict(texts)

    def __contains__(self, type_name: str) -> bool:
        return type_name in self._store.fielddefs

    def schema(self, type_name: str) -> str:
        """Return the ``ros2msg`` schema of a type: its text and those of all types in it.

        Raises:
            BagError: the type is not known.
        """
        self._require(type_name)
        parts = [self._text(type_name)]
        parts += [
            f"{_SEPARATOR}\nMSG: {name.replace('/msg/', '/')}\n{self._text(name)}"
            for name in self.nested(type_name)
        ]
        return "\n".join(part.rstrip("\n") for part in parts) + "\n"

    def type_hash(self, type_name: str) -> str:
        """Return the RIHS01 hash by which ROS 2 compares types.

        Raises:
            BagError: the type is not known.
        """
        self._require(type_name)
        return str(self._store.hash_rihs01(type_name))

    def decode(self, type_name: str, cdr: bytes) -> Any:
        """Return a message as an object with the message's attributes; its arrays are read-only.

        Args:
            type_name: full type name.
            cdr: serialised message with its four bytes of encapsulation.

        Raises:
            BagError: the type is not known, or these bytes are not a message of this type.
        """
        self._require(type_name)
        try:
            if bytes(cdr[:2]) not in _PLAIN:
                raise ValueError("no plain CDR")
            made = self._store.get_msgdef(type_name)
            read = made.deserialize_cdr_le if cdr[1] else made.deserialize_cdr_be
            message, end = read(cdr[CDR_HEADER:], 0, made.cls, self._store)
            # What stands behind the last field is not looked at: Fast DDS leaves a tail there of
            # what rclpy has serialised.
            if end > len(cdr) - CDR_HEADER:
                raise ValueError("the end is missing")
        except _UNDECODABLE as error:
            raise BagError(
                f"these {len(cdr)} bytes are not a {type_name} ({error})", fault="malformed"
            ) from None
        return message

    def encode(self, type_name: str, message: Any) -> bytes:
        """Return any object with the message's attributes as CDR, little-endian.

        Raises:
            BagError: an attribute is missing or its value does not fit the field's type.
        """
        self._require(type_name)
        return bytes(
            self._store.serialize_cdr(
                self._filled(type_name, message), type_name, little_endian=True
            )
        )

    def normal(self, type_name: str, cdr: bytes) -> bytes:
        """Return the same message in the bytes that every message of that content has.

        CDR aligns numbers and leaves gaps for that. Fast DDS leaves in the gaps, and in a tail,
        whatever was in memory, so that its bytes of one message differ from each other.

        Raises:
            BagError: the bytes are not such a message.
        """
        return self.encode(type_name, self.decode(type_name, cdr))

    def differs(self, type_name: str) -> bool:
        """Say whether the present definition of the type differs, for example by added fields."""
        own = own_types()
        known = type_name in self and type_name in own
        return known and self.type_hash(type_name) != own.type_hash(type_name)

    def converted(self, type_name: str, cdr: bytes, other: "MessageTypes") -> bytes:
        """Return a message of another set of definitions as a message of this set.

        Fields that this set lacks are left out; those that only this set has are zero or empty.

        Raises:
            BagError: the bytes are not such a message.
        """
        message = self._filled(type_name, other.decode(type_name, cdr), complete=False)
        return bytes(self._store.serialize_cdr(message, type_name, little_endian=True))

    def new(self, type_name: str) -> Any:
        """Return an object with the message's attributes, all zero or empty, to be filled."""
        self._require(type_name)
        fields = self._store.fielddefs[type_name][1]
        return SimpleNamespace(
            **{name: self._empty(kind) for name, kind in fields if name != _DUMMY}
        )

    def constant(self, type_name: str, name: str) -> Any:
        """Return the value of a constant of a message.

        Raises:
            BagError: the type is not known, or has no such constant.
        """
        self._require(type_name)
        for constant, _, value in self._store.fielddefs[type_name][0]:
            if constant == name:
                return value
        raise BagError(f"{type_name} has no constant {name}", fault="unknown")

    def _require(self, type_name: str) -> None:
        if type_name not in self._store.fielddefs:
            raise BagError(f"message type {type_name} is not known here", fault="unknown")

    def fields(self, type_name: str) -> Sequence[tuple[str, Any]]:
        """Return the fields of a type: name and kind, as rosbags has it."""
        return list(self._store.fielddefs[type_name][1])

    def nested(self, type_name: str, but: Collection[str] = ()) -> list[str]:
        """Return the names of all messages that are in a message of this type.

        Args:
            type_name: of the message.
            but: names of fields that are not looked into.
        """
        found: list[str] = []

        def visit(name: str) -> None:
            for field, kind in self._store.fielddefs[name][1]:
                if field in but:
                    continue
                node: Any = kind[0]
                content: Any = kind[1]
                if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
                    node, content = content[0]
                if node == Nodetype.NAME and content not in found:
                    found.append(str(content))
                    visit(str(content))

        visit(type_name)
        return found

    def _text(self, type_name: str) -> str:
        known = self._texts.get(type_name)
        if known is not None:
            return known
        text, _ = self._store.generate_msgdef(type_name, ros_version=2)
        return text.split(_SEPARATOR)[0]

    def _empty(self, kind: Any) -> Any:
        node, content = kind
        if node == Nodetype.NAME:
            return self.new(content)
        if node == Nodetype.BASE:
            name = content[0]
            return (
                ""
                if name == "string"
                else False
                if name == "bool"
                else 0
                if name in _WHOLE
                else 0.0
            )
        if node == Nodetype.ARRAY:
            return [self._empty(content[0]) for _ in range(content[1])]
        return []

    def _filled(self, type_name: str, message: Any, complete: bool = True) -> Any:
        """Return a message to write; where it need not be complete, missing fields are empty."""
        values = {}
        for name, kind in self._store.fielddefs[type_name][1]:
            if name == _DUMMY:
                values[name] = 0
                continue
            if not complete and not hasattr(message, name):
                values[name] = self._value(kind, self._empty(kind))
                continue
            try:
                values[name] = self._value(kind, getattr(message, name), complete)
            except AttributeError:
                raise BagError(
                    f"{type_name}: the message has no field '{name}'", fault="unknown"
                ) from None
            except (TypeError, ValueError, OverflowError) as error:
                raise BagError(
                    f"{type_name}: field '{name}' cannot be written ({error})", fault="malformed"
                ) from None
        return self._store.types[type_name](**values)

    def _value(self, kind: Any, value: Any, complete: bool = True) -> Any:
        node, content = kind
        if node == Nodetype.NAME:
            return self._filled(content, value, complete)
        if node == Nodetype.BASE:
            return _primitive(content[0], value)
        (inner_node, inner), size = content
        if node == Nodetype.ARRAY and len(value) != size:
            raise ValueError(f"{len(value)} values instead of {size}")
        if inner_node == Nodetype.NAME or inner[0] == "string":
            return [self._value((inner_node, inner), item, complete) for item in value]
        # rosbags writes an array's bytes as they lie in memory, whatever their type: convert here.
        given = np.asarray(value)
        array = given.astype(DTYPES.get(inner[0], inner[0]))
        if inner[0] in _WHOLE and not np.array_equal(array, given):
            raise ValueError(f"values that are not {inner[0]}")
        return array


def _primitive(name: str, value: Any) -> Any:
    if name == "string":
        if not isinstance(value, str):
            raise TypeError(f"{value!r} is not text")
        return value
    if name == "bool":
        return bool(value)
    if name in _WHOLE:
        whole = int(value)
        if whole != value:
            raise ValueError(f"{value!r} is not a whole number")
        limits = np.iinfo(DTYPES.get(name, name))
        if not limits.min <= whole <= limits.max:
            raise ValueError(f"{value!r} is outside {limits.min} to {limits.max}")
        return whole
    return float(value)


@lru_cache(maxsize=1)
def own_types() -> MessageTypes:
    """Return the definitions of this software: its own messages and those of ROS 2 Jazzy."""
    store = _Store(ros2_jazzy)
    texts = {
        f"{OWN}/msg/{path.stem}": path.read_text(encoding="utf-8")
        for path in sorted(resources.directory("msg").glob("*.msg"))
    }
    parsed: dict[str, Any] = {}
    for name, text in texts.items():
        parsed.update(get_types_from_msg(text, name))
    store.register(parsed)
    for path in sorted(TEXTS.glob("*/msg/*.msg")):
        texts.setdefault(_standard_name(path), path.read_text(encoding="utf-8"))
    return MessageTypes(store, texts)


def _standard_name(path: Path) -> str:
    return f"{path.parent.parent.name}/msg/{path.stem}"


def types_from_schemas(schemas: Mapping[str, str]) -> MessageTypes:
    """Return the definitions that a bag carries.

    Args:
        schemas: ``ros2msg`` text of each type of the bag, by full type name.

    Raises:
        BagError: a text is not a message definition, or two define one type differently.
    """
    own = own_types()
    if all(name in own and own.schema(name) == text for name, text in schemas.items()):
        return own
    store = _Store(empty)
    for name, text in schemas.items():
        try:
            store.register(get_types_from_msg(text, name))
            _bound_nesting(store, name)
        except _UNDECODABLE as error:
            problem = " ".join(str(error).split())[:_LONGEST_PROBLEM]
            raise BagError(
                f"the definition of {name} in the bag cannot be used ({problem})",
                fault="malformed",
            ) from None
    _compare(store, own)
    return MessageTypes(store, {})


def _bound_nesting(store: Typestore, name: str) -> None:
    """Refuse a type that contains itself, or others too deep in one another; raises ValueError."""
    level = {name}
    for _ in range(_MOST_NESTED):
        level = {inner for one in level for inner in _inner(store, one)}
    if level:
        raise ValueError(f"messages in it are nested more than {_MOST_NESTED} deep")


def _inner(store: Typestore, name: str) -> set[str]:
    """Return the types of a type's fields that are messages themselves."""
    found = set()
    for _, (node, content) in store.fielddefs[name][1]:
        kind: Any = content[0] if node in (Nodetype.ARRAY, Nodetype.SEQUENCE) else (node, content)
        if kind[0] == Nodetype.NAME:
            found.add(str(kind[1]))
    return found


def _compare(store: Typestore, own: MessageTypes) -> None:
    """Refuse definitions of the suite's messages that lack what is read, or have it otherwise.

    Raises:
        BagError: names type and field.
    """
    wanted = [topic.type_name for topic in RECORDED if topic.type_name in store.fielddefs]
    # What only a field that was added later contains, an older bag does not define.
    needed = {inner for one in wanted for inner in own.nested(one, ADDED_LATER)}
    further = {inner for one in wanted for inner in own.nested(one) if inner in store.fielddefs}
    for name in {*wanted, *needed, *further}:
        if name not in store.fielddefs:
            raise BagError(f"the bag does not define {name}, which its messages contain")
        fields = dict(store.fielddefs[name][1])
        for field, kind in own.fields(name):
            if field in fields and fields[field] != kind:
                raise BagError(f"in the bag's definition of {name}, '{field}' is of another type")
            if field not in fields and field not in ADDED_LATER:
                raise BagError(
                    f"the bag's definition of {name} lacks the field '{field}'", fault="mismatch"
                )
