"""The records of a chunk: found wherever they stand, refused where they do not fit."""

import struct

import pytest
from mcap.opcode import Opcode

from stepdiag_ros.bags.layout import (
    Damaged,
    RawMessage,
    chunk_definitions,
    chunk_heads,
    chunk_messages,
    chunk_payloads,
)

MESSAGES = [
    RawMessage(1, 1, 100, 90, b"abc"),
    RawMessage(2, 1, 110, 95, b""),
    RawMessage(1, 2, 120, 99, b"a longer one"),
]


def record(opcode, body):
    return struct.pack("<BQ", opcode, len(body)) + body


def framed(message):
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", *message[:4]) + message.cdr)


PARTS = [
    framed(MESSAGES[0]),
    record(Opcode.CHANNEL, b"c"),
    *map(framed, MESSAGES[1:]),
    # The last record is shorter than the head of a message.
    record(Opcode.SCHEMA, b""),
]
CONTENT = b"".join(PARTS)
ENDS = {len(b"".join(PARTS[:count])) for count in range(len(PARTS) + 1)}


def test_messages_are_found_between_and_before_other_records():
    assert chunk_messages(CONTENT) == MESSAGES
    assert chunk_messages(CONTENT, {2}) == [MESSAGES[1]]
    assert chunk_heads(CONTENT) == [message[:4] for message in MESSAGES]
    assert chunk_payloads(CONTENT, {1}) == ([100, 120], [b"abc", b"a longer one"])
    assert list(chunk_definitions(CONTENT)) == [(Opcode.CHANNEL, b"c"), (Opcode.SCHEMA, b"")]


@pytest.mark.parametrize(
    "read", [chunk_heads, chunk_messages, lambda c: list(chunk_definitions(c))]
)
@pytest.mark.parametrize("length", sorted(set(range(len(CONTENT))) - ENDS))
def test_a_chunk_that_ends_within_a_record_is_damaged(read, length):
    with pytest.raises(Damaged):
        read(CONTENT[:length])


@pytest.mark.parametrize("behind", [b"", framed(MESSAGES[0])])
def test_a_message_without_a_whole_head_is_damaged(behind):
    with pytest.raises(Damaged):
        chunk_messages(record(Opcode.MESSAGE, bytes(21)) + behind)
