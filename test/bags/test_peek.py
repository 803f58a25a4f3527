"""The head of a message read from its bytes alone: the same as after decoding all of it."""

import struct
from array import array

import pytest

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros import topics
from stepdiag_ros.bags.peek import block_head_of, head_of, stamp_of


def serialized(type_name, frame, **fields):
    from rclpy.serialization import serialize_message

    from stepdiag_ros.messages.conversion import new_message
    from stepdiag_ros.messages.fields import set_header

    message = new_message(type_name)
    set_header(message, 1_700_000_000_123_456_789, frame)
    for name, value in fields.items():
        setattr(message, name, value)
    return serialize_message(message)


@pytest.mark.parametrize("length", range(18))
def test_a_reading_with_a_frame_of_any_length(length):
    sequence = 2**63 + length
    cdr = serialized(topics.READING.type_name, "f" * length, sequence=sequence)
    head = head_of(cdr)
    assert head == (1_700_000_000_123_456_789, sequence)
    assert stamp_of(cdr) == head.time


@pytest.mark.parametrize("length", range(9))
def test_a_block_of_samples_with_a_frame_of_any_length(length):
    values = array("d", range(length * 3))
    cdr = serialized(
        topics.SAMPLES.type_name, "f" * length, sequence=2**40 + length, raw_displacement=values
    )
    head = block_head_of(cdr)
    assert head == (1_700_000_000_123_456_789, 2**40 + length, length * 3)
    with pytest.raises(ValueError):
        block_head_of(cdr[:70])


def test_the_stamp_of_joint_states():
    cdr = serialized(topics.JOINT_STATES.type_name, "machine", position=[1.0, 2.0, 3.0])
    assert stamp_of(cdr) == 1_700_000_000_123_456_789


def test_the_other_byte_order():
    body = struct.pack(">iII4sQ", 5, 7, 4, b"abc\0", 9)
    assert head_of(b"\x00\x00\x00\x00" + body) == (5_000_000_007, 9)


@pytest.mark.parametrize("cut", [0, 3, 8, 20])
def test_what_is_no_message_is_refused(cut):
    cdr = serialized(topics.READING.type_name, "laser", sequence=1)
    with pytest.raises(ValueError):
        head_of(cdr[:cut])
