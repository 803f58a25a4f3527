"""Message classes, CDR and type hashes, held against rosbags as an independent implementation."""

from __future__ import annotations

import array
import copy
import math
import random
import string
import tracemalloc
from typing import Any

import numpy as np
import pytest
from refused import refused
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from stepdiag_ros.embedded import cdr, classes, definitions, registry
from stepdiag_ros.embedded.packages import is_served

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = sorted(
    name
    for name in STORE.fielddefs
    if is_served(name.split("/")[0]) and not name.endswith(("_Request", "_Response", "_Event"))
)

#: Hashes as ROS 2 Jazzy announces them.
JAZZY_HASHES = {
    "std_msgs/msg/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "rmw_dds_common/msg/ParticipantEntitiesInfo": (
        "91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e"
    ),
}


def make(fields: str, name: str = "test_msgs/msg/Sample") -> type:
    """Return the class of a message written down in a test."""
    definition = definitions.parse_message(name, fields)
    return classes.make_class(definition, registry.message_class, "test_msgs.msg", "Sample")


def roundtrip(message: Any) -> Any:
    definition = type(message)._DEFINITION
    write = cdr.make_serializer(definition, registry.definition)

    def find(name: str) -> type:
        return type(message) if name == definition.name else registry.message_class(name)

    read = cdr.make_deserializer(definition, registry.definition, find)
    return read(write(message))


def random_value(kind: definitions.FieldType, rng: random.Random) -> Any:
    if kind.name == "string":
        return "".join(rng.choices(string.ascii_letters + "äµ€", k=rng.randrange(9)))
    if kind.name == "byte":
        # rosbags takes a byte for signed and refuses the upper half.
        return bytes([rng.randrange(128)])
    if kind.name == "bool":
        return rng.random() < 0.5
    if kind.name == "float64":
        return rng.uniform(-1e6, 1e6)
    if kind.name == "float32":
        return float(np.float32(rng.uniform(-1e3, 1e3)))
    if kind.is_message:
        return random_message(registry.message_class(kind.name), rng)
    bits = 8 * definitions.PRIMITIVES[kind.name][1]
    signed = kind.name.startswith("int")
    return rng.randrange(-(2 ** (bits - 1)), 2 ** (bits - 1)) if signed else rng.getrandbits(bits)


def random_message(cls: type, rng: random.Random) -> Any:
    message = cls()
    for field in cls._DEFINITION.fields:  # type: ignore[attr-defined]
        kind = field.type
        if not kind.array:
            value = random_value(kind, rng)
        else:
            most = kind.size if kind.array == "bounded" else 4
            count = kind.size if kind.array == "fixed" else rng.randrange(most + 1)
            single = definitions.FieldType(kind.name, text_bound=kind.text_bound)
            value = [random_value(single, rng) for _ in range(count)]
        setattr(message, field.name, value)
    return message


def to_rosbags(message: Any, store: Typestore) -> Any:
    """Return the same message as an object of rosbags."""
    definition = type(message)._DEFINITION
    values = []
    for field in definition.wire_fields:
        value = getattr(message, field.name, 0)
        kind = field.type
        if kind.is_message:
            nested = [to_rosbags(item, store) for item in (value if kind.array else [value])]
            value = nested if kind.array else nested[0]
        elif kind.is_primitive and kind.array:
            flat = [item[0] if isinstance(item, bytes) else item for item in value]
            code = "?" if kind.name == "bool" else definitions.PRIMITIVES[kind.name][0]
            value = np.array(flat, dtype=code)
        elif kind.name == "byte":
            value = value[0]
        values.append(value)
    return store.types[definition.name](*values)


@pytest.mark.parametrize("package", sorted({name.split("/")[0] for name in TYPES}))
def test_cdr_equals_rosbags(package: str) -> None:
    rng = random.Random(package)
    for name in (name for name in TYPES if name.startswith(f"{package}/")):
        cls = registry.message_class(name)
        for _ in range(5):
            message = random_message(cls, rng)
            expected = bytes(STORE.serialize_cdr(to_rosbags(message, STORE), name))
            data = registry.serializer(cls)(message)
            assert data == expected, name
            assert registry.deserializer(cls)(data) == message, name


@pytest.mark.parametrize(
    "name", ["sensor_msgs/msg/Imu", "diagnostic_msgs/msg/DiagnosticArray", "sensor_msgs/msg/Joy"]
)
def test_big_endian_is_read(name: str) -> None:
    cls = registry.message_class(name)
    message = random_message(cls, random.Random(3))
    data = bytes(STORE.serialize_cdr(to_rosbags(message, STORE), name, little_endian=False))
    assert registry.deserializer(cls)(data) == message


def test_hashes_equal_rosbags(monkeypatch: pytest.MonkeyPatch) -> None:
    # rosbags counts a char as a type of its own; ROS 2 counts it as uint8.
    monkeypatch.setitem(Typestore.hash_rihs01.__globals__["TIDMAP"], "char", 3)
    assert len(TYPES) > 120
    for name in TYPES:
        assert registry.hash_of(registry.message_class(name)) == STORE.hash_rihs01(name), name


@pytest.mark.parametrize("name", JAZZY_HASHES)
def test_hashes_of_jazzy(name: str) -> None:
    assert registry.hash_of(registry.message_class(name)) == f"RIHS01_{JAZZY_HASHES[name]}"


def test_shipped_texts_equal_rosbags_definitions() -> None:
    from stepdiag_ros.embedded.packages import TEXTS

    for path in TEXTS.glob("*/msg/*.msg"):
        name = f"{path.parent.parent.name}/msg/{path.stem}"
        if name not in STORE.fielddefs:
            continue
        constants = {entry[0] for entry in STORE.fielddefs[name][0]}
        fields = [entry[0] for entry in STORE.fielddefs[name][1]]
        found = registry.definition(name)
        assert [field.name for field in found.wire_fields] == fields, name
        assert set(found.constants) == constants, name


def test_defaults_and_constants() -> None:
    cls = make(
        'int32 a\nfloat64 b 1.5\nstring c "x # y"\nbool d true\nbyte e\nfloat64[] f\n'
        "float64[3] g\nstring[] h\nstd_msgs/Header header\nstd_msgs/Header[2] two\n"
        "uint8 STATUS_OK=3\nstring NAME='n'\nint32[] i [1, 2]"
    )
    message: Any = cls()
    assert (message.a, message.b, message.c, message.d, message.e) == (0, 1.5, "x # y", True, b"\0")
    assert message.f == array.array("d") and message.h == []
    assert message.g.tolist() == [0, 0, 0]
    assert message.header.frame_id == "" and len(message.two) == 2
    assert message.i.tolist() == [1, 2]
    assert (cls.STATUS_OK, message.STATUS_OK, cls.NAME) == (3, 3, "n")  # type: ignore[attr-defined]
    other: Any = cls()
    other.f.append(1.0)
    other.header.frame_id = "changed"
    assert cls().f == array.array("d") and cls().header.frame_id == ""  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("fields", "value"),
    [
        ("float64 x", 1),
        ("float64 x", "1"),
        ("int32 x", 1.0),
        ("int8 x", 128),
        ("uint8 x", -1),
        ("uint64 x", 2**64),
        ("string x", b"a"),
        ("string<=2 x", "abc"),
        ("bool x", 1),
        ("byte x", b"ab"),
        ("float32 x", 1e39),
        ("std_msgs/Header x", 1),
        ("float64[] x", [1, 2]),
        ("float64[] x", array.array("f", [1.0])),
        ("float64[] x", np.array([1, 2])),
        ("float64[] x", np.zeros((2, 2))),
        ("float64[] x", 1.0),
        ("int32[] x", [1.0]),
        ("uint8[] x", np.array([300])),
        ("string[] x", "abc"),
        ("float64[3] x", [1.0]),
        ("float64[<=2] x", [1.0, 2.0, 3.0]),
        ("std_msgs/Header[] x", [1]),
    ],
)
def test_wrong_values_are_refused_by_name(fields: str, value: Any) -> None:
    cls = make(fields)
    message: Any = cls()
    with refused(AssertionError, None, "'x'"):
        message.x = value
    with refused(AssertionError, None, "'x'"):
        cls(x=value)


def test_unknown_keyword_is_refused() -> None:
    with refused(AssertionError, None, "Sample", "wrong"):
        make("int32 x")(wrong=1)
    with pytest.raises(TypeError):
        make("int32 x")(1)
    with pytest.raises(AttributeError):
        make("int32 x")().wrong = 1  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "value",
    [
        [1.0, 2.0],
        (1.0, 2.0),
        array.array("d", [1.0, 2.0]),
        np.array([1.0, 2.0]),
        np.array([1.0, 2.0], dtype=np.float32),
        np.array([0.0, 1.0, 2.0, 3.0])[1:3],
        np.array([2.0, 1.0])[::-1],
    ],
)
@pytest.mark.parametrize("fields", ["float64[] x", "float64[2] x", "float64[<=2] x"])
def test_floats_are_taken_from_all_their_forms(fields: str, value: Any) -> None:
    message = roundtrip(make(fields)(x=value))
    assert np.asarray(message.x).dtype == np.float64
    assert np.asarray(message.x).tolist() == [1.0, 2.0]


def test_received_arrays_can_be_changed() -> None:
    message = roundtrip(make("float64[] x\nfloat64[2] y")(x=[1.0], y=[1.0, 2.0]))
    message.x.append(2.0)
    message.y[0] = 5.0
    assert message.x.tolist() == [1.0, 2.0] and message.y.tolist() == [5.0, 2.0]


def test_special_numbers_survive() -> None:
    message = roundtrip(make("float64[] x\nfloat32 y")(x=[math.inf, math.nan], y=-math.inf))
    assert message.x[0] == math.inf and math.isnan(message.x[1]) and message.y == -math.inf


def test_empty_message() -> None:
    cls = registry.message_class("std_msgs/msg/Empty")
    assert registry.serializer(cls)(cls()) == b"\0\1\0\0\0"
    assert registry.deserializer(cls)(b"\0\1\0\0\0\0\0\0") == cls()
    assert cls.get_fields_and_field_types() == {}  # type: ignore[attr-defined]


def test_equality_copy_and_repr() -> None:
    cls = make("float64[] x\nfloat64[2] y\nstd_msgs/Header h")
    one, two = cls(x=[1.0]), cls(x=[1.0])
    assert one == two and one != cls() and one != 3
    copied: Any = copy.deepcopy(one)
    assert copied == one
    copied.h.frame_id = "other"
    assert copied != one
    assert repr(registry.message_class("std_msgs/msg/String")(data="a")) == (
        "std_msgs.msg.String(data='a')"
    )
    assert cls.get_fields_and_field_types() == {  # type: ignore[attr-defined]
        "x": "sequence<double>",
        "y": "double[2]",
        "h": "std_msgs/Header",
    }


BROKEN = registry.message_class("diagnostic_msgs/msg/DiagnosticArray")


def test_broken_bytes_raise_decode_error_only() -> None:
    rng = random.Random(5)
    read = registry.deserializer(BROKEN)
    message = random_message(BROKEN, rng)
    message.status = [
        random_message(registry.message_class("diagnostic_msgs/msg/DiagnosticStatus"), rng)
    ]
    good = registry.serializer(BROKEN)(message)
    refused = 0
    for _ in range(3000):
        data = bytearray(good)
        for _ in range(rng.randrange(1, 4)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        cut = bytes(data[: rng.randrange(len(data) + 1)])
        try:
            read(cut)
        except cdr.DecodeError:
            refused += 1
    assert refused > 1000
    for data in (b"", b"\0", b"\0\1\0\0", good[:-4], b"\0\3" + good[2:], b"\xff" * 400):
        with pytest.raises(cdr.DecodeError):
            read(data)


@pytest.mark.parametrize("tail", [1, 3, 8, 160])
def test_a_tail_of_fast_dds_means_nothing(tail: int) -> None:
    message = random_message(BROKEN, random.Random(6))
    good = registry.serializer(BROKEN)(message)
    read = registry.deserializer(BROKEN)
    assert read(good + b"\xff" * tail) == message


def test_a_huge_count_takes_no_memory() -> None:
    cls = make("float64[] x\nstring[] y")
    definition = cls._DEFINITION  # type: ignore[attr-defined]
    read = cdr.make_deserializer(definition, registry.definition, lambda _: cls)
    tracemalloc.start()
    try:
        for count in (b"\xff\xff\xff\x7f", b"\xff\xff\xff\xff"):
            with pytest.raises(cdr.DecodeError):
                read(b"\0\1\0\0" + count)
            with pytest.raises(cdr.DecodeError):
                read(b"\0\1\0\0" + b"\0\0\0\0" + count)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 1_000_000


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("float64", "'float64'"),
        ("float64 X", "'float64 X'"),
        ("wstring x", "wstring"),
        ("int32 x abc", "'int32 x abc'"),
        ("int32[] x 3", "'int32[] x 3'"),
        ("int32 x\nint32 x", "test_msgs/msg/Sample"),
        ("float64[a] x", "'float64[a] x'"),
    ],
)
def test_wrong_definitions_are_explained(text: str, named: str) -> None:
    with pytest.raises(definitions.DefinitionError) as caught:
        definitions.parse_message("test_msgs/msg/Sample", text)
    assert named in str(caught.value)


def test_service_definition_needs_one_separator() -> None:
    with refused(definitions.DefinitionError, None, "test_msgs/srv/Do", "---"):
        definitions.parse_service("test_msgs/srv/Do", "int32 x")


def test_unknown_message_is_an_import_error() -> None:
    with refused(ImportError, None, "Nothing"):
        from std_msgs.msg import Nothing  # noqa: F401
    with pytest.raises(ImportError):
        import no_such_msgs.msg  # noqa: F401


def test_modules_list_their_classes() -> None:
    import std_msgs.msg
    import std_srvs.srv

    assert {"Header", "String"} <= set(dir(std_msgs.msg))
    assert "Trigger" in std_srvs.srv.__all__
    assert std_msgs.msg.String is std_msgs.msg.String
    from sensor_msgs.msg import Imu, Temperature

    assert Temperature().header.frame_id == "" and Imu().orientation.x == 0.0
