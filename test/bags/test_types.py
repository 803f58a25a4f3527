"""Definitions, hashes and CDR of bags, compared with the embedded client's independent ones."""

import numpy as np
import pytest
from refused import refused

from stepdiag_ros import topics
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.types import own_types, types_from_schemas
from stepdiag_ros.embedded import registry

TYPES = sorted({topic.type_name for topic in topics.TOPICS})


@pytest.mark.parametrize("type_name", TYPES)
def test_bytes_and_hash_are_those_of_the_embedded_client(type_name):
    types = own_types()
    cls = registry.message_class(type_name)
    message = cls()
    for field, kind in cls.get_fields_and_field_types().items():
        if kind == "double":
            setattr(message, field, 0.1)
        elif kind == "string":
            setattr(message, field, f"{field} µ")
        elif kind == "sequence<double>":
            setattr(message, field, [1.5, float("nan"), -2.0])
        elif kind == "sequence<string>":
            setattr(message, field, ["", "a", "bcd"])
        elif kind == "double[3]":
            setattr(message, field, [1.0, 2.0, 3.0])
        elif kind.startswith("uint"):
            setattr(message, field, 7)
    written = types.encode(type_name, message)
    assert written == registry.serializer(cls)(message)
    assert types.type_hash(type_name) == registry.hash_of(cls)
    assert types.encode(type_name, types.decode(type_name, written)) == written


@pytest.mark.parametrize("type_name", TYPES)
def test_a_schema_alone_is_enough_to_decode(type_name):
    own = own_types()
    text = own.schema(type_name)
    read = types_from_schemas({type_name: text + "\n"})  # not our text: parsed anew
    assert read is not own
    assert read.type_hash(type_name) == own.type_hash(type_name)
    empty = own.encode(type_name, own.new(type_name))
    assert read.encode(type_name, read.decode(type_name, empty)) == empty


def test_the_schema_keeps_the_comments_of_the_definition():
    text = own_types().schema("stepdiag_ros/msg/MeasuredLine")
    assert "zero at the first settled stop of the setup" in text
    assert text.count("=" * 80 + "\nMSG: ") == 2
    assert "MSG: std_msgs/Header\n" in text
    assert "MSG: builtin_interfaces/Time\n" in text


def test_gaps_between_fields_mean_nothing_and_values_do():
    types, type_name = own_types(), "stepdiag_ros/msg/RunState"
    message = types.new(type_name)
    message.run_id, message.line, message.remaining_time = "run", "ppp", 1.5
    written = types.encode(type_name, message)
    gaps = 0
    for position in range(4, len(written)):
        altered = bytearray(written)
        altered[position] ^= 0x01
        try:
            same = types.decode(type_name, bytes(altered)) == types.decode(type_name, written)
            normal = types.normal(type_name, bytes(altered))
        except BagError:
            continue
        assert (normal == written) is same, position
        gaps += same
    # Behind texts, before the next number.
    assert gaps > 0
    assert types.normal(type_name, written + b"\xff" * 160) == written


@pytest.mark.parametrize("missing", [1, 8, 40])
def test_a_message_without_its_end_is_refused(missing):
    types, type_name = own_types(), "stepdiag_ros/msg/RunState"
    message = types.new(type_name)
    message.text = "x" * 40
    with refused(BagError, "malformed", "stepdiag_ros/msg/RunState"):
        types.decode(type_name, types.encode(type_name, message)[:-missing])


def test_whole_numbers_in_a_list_become_doubles():
    types = own_types()
    name = "stepdiag_ros/msg/MeasuredLine"
    message = types.new(name)
    message.time = np.array([1, 2, 3])
    assert types.decode(name, types.encode(name, message)).time.tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("target", [1.0, 2.0]),
        ("run_id", 3),
        ("command_id", -1),
        ("command_id", 2**64),
        ("status", 256),
        ("status", 1.5),
        ("position", ["a", "b", "c"]),
    ],
)
def test_a_value_that_does_not_fit_is_refused_by_name(field, value):
    types = own_types()
    name = "stepdiag_ros/msg/CommandStatus"
    message = types.new(name)
    setattr(message, field, value)
    with refused(BagError, "malformed", field):
        types.encode(name, message)


def test_a_missing_field_is_named():
    types = own_types()
    message = types.new("stepdiag_ros/msg/RunState")
    del message.text
    with refused(BagError, "unknown", "text"):
        types.encode("stepdiag_ros/msg/RunState", message)


def test_constants_are_found():
    assert own_types().constant("stepdiag_ros/msg/RunDescription", "SCHEMA_VERSION") == 1
    with refused(BagError, "unknown", "NOTHING"):
        own_types().constant("stepdiag_ros/msg/RunDescription", "NOTHING")


def test_bytes_of_another_type_are_refused():
    types = own_types()
    state = types.encode("stepdiag_ros/msg/RunState", types.new("stepdiag_ros/msg/RunState"))
    with refused(BagError, "malformed", "stepdiag_ros/msg/MeasuredLine"):
        types.decode("stepdiag_ros/msg/MeasuredLine", state)


@pytest.mark.parametrize(
    "name, field, empty",
    [
        ("SettledStop", "float64[3] mirror_offset", [0.0, 0.0, 0.0]),
        ("RunState", "TargetStanding[] standing", []),
    ],
)
def test_a_message_of_an_earlier_definition_becomes_one_of_today_and_back(name, field, empty):
    own, kind = own_types(), f"stepdiag_ros/msg/{name}"
    lines = own.schema(kind).split("\n")
    earlier = types_from_schemas(
        {kind: "\n".join(line for line in lines if not line.startswith(field))}
    )
    assert earlier.differs(kind) and not own.differs(kind)
    message = earlier.new(kind)
    message.run_id, message.header.stamp.sec = "a run", 7
    recorded = earlier.encode(kind, message)
    today = own.converted(kind, recorded, earlier)
    found = own.decode(kind, today)
    assert (found.run_id, found.header.stamp.sec) == ("a run", 7)
    assert list(getattr(found, field.split()[-1])) == empty
    assert earlier.converted(kind, today, own) == recorded
