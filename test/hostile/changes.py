"""Changes of a bag's structure and content, each drawn from a random generator.

``STRUCTURE`` leaves every message as it was and changes which of them are there, how often and in
which order, or what stands around them: a command must notice, or give the same numbers.
``CONTENT`` changes the messages and texts themselves: that may give other numbers, but no
traceback.
"""

import math
import random
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from forging import Anatomy, Frame, attachment_frame, metadata_frame
from mcap.opcode import Opcode
from mcap.records import Schema

from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.header import METADATA_NAME
from stepdiag_ros.bags.types import own_types

Change = Callable[[random.Random, Anatomy], None]

_LENGTHS = (0, 1, 2**31 - 1, 2**32, 2**63 - 1, 2**63, 2**64 - 10, 2**64 - 1)
_NUMBERS = (
    *(math.nan, math.inf, -math.inf, 0.0, -0.0, 1e308, -1e308, 5e-324, 1e-300, 1e18, -1.0),
    *(2.0**63, -(2.0**63), 1e9, 1e-9),
)
_DEEP = 1000
_TRIALS = 5
TEXTS = (
    "",
    "\0",
    "\x1b[2J\r\n$MA_MAX_AX_VELO[AX1]=1\u2028x\u202e",
    "[" * _DEEP + "]" * _DEEP,
    "[" * 100_000,
    "{a: " * _DEEP + "1" + "}" * _DEEP,
    "".join(f"{' ' * n}a:\n" for n in range(_DEEP)),
    "- " * _DEEP + "1",
    "name: x\nchain: {a: 1}\n",
    "name: x\nchain: 5\n",
    "name: x\nchain: [1, 2, 3]\n",
    "name: [x]\nchain: [[X], [Y], [Z]]\nplausible_rotations: [1]\n",
    "just text",
    "5",
    "a: " + "9" * 5000,
    "a: 1e999\nb: .nan\nc: 2026-99-99\n",
    "? [a]\n: b\n? {c: d}\n: e\n",
    "a: &a [x, x, x, x, x, x, x, x, x]\n"
    + "".join(f"{n}: &{n} [{', '.join([f'*{p}'] * 9)}]\n" for p, n in pairwise("abcdefghi")),
    "a: &a [*a]\n",
    "!!python/object/apply:os.system [exit]",
    "!!binary x",
    "x" * 300_000,
)
SCHEMAS = (
    "",
    "garbage ][",
    "float64",
    "builtin_interfaces/Time stamp\nfloat64[1000000000] a",
    "float64[99999999999999999999] a",
    "string<=5 a\nstring[<=3] b",
    "float64 sequence",
    "uint8 A=300\nuint8 B='x'\n",
    "\x00\x01\x02",
    "a/msg/B b\n" + "=" * 80 + "\nMSG: a/B\na/msg/B b\n",
    "".join(f"{'=' * 80}\nMSG: deep/D{n}\n" * (n > 0) + f"deep/D{n + 1} d\n" for n in range(_DEEP))
    + f"{'=' * 80}\nMSG: deep/D{_DEEP}\nfloat64 d\n",
    "".join(f"{'=' * 80}\nMSG: wide/D{n}\n" * (n > 0) + f"wide/D{n + 1}[9] d\n" for n in range(12))
    + f"{'=' * 80}\nMSG: wide/D12\nfloat64 d\n",
)


# -- structure ------------------------------------------------------------------------------------


def _chunk(chance: random.Random, bag: Anatomy) -> int:
    return chance.randrange(len(bag.chunks))


def double_a_chunk(chance: random.Random, bag: Anatomy) -> None:
    number = _chunk(chance, bag)
    bag.chunks.insert(chance.randint(0, len(bag.chunks)), list(bag.chunks[number]))


def double_all_chunks(chance: random.Random, bag: Anatomy) -> None:
    bag.chunks = bag.chunks * 2 if chance.random() < 0.5 else [c for c in bag.chunks for _ in "ab"]


def drop_a_chunk(chance: random.Random, bag: Anatomy) -> None:
    del bag.chunks[_chunk(chance, bag)]


def drop_the_end(chance: random.Random, bag: Anatomy) -> None:
    del bag.chunks[-chance.randint(1, max(len(bag.chunks) // 2, 1)) :]


def drop_the_beginning(chance: random.Random, bag: Anatomy) -> None:
    # The description stands in the first chunk: without it there is no run.
    del bag.chunks[0][1:]
    del bag.chunks[1 : chance.randint(1, max(len(bag.chunks) // 2, 1))]


def exchange_chunks(chance: random.Random, bag: Anatomy) -> None:
    a, b = _chunk(chance, bag), _chunk(chance, bag)
    bag.chunks[a], bag.chunks[b] = bag.chunks[b], bag.chunks[a]


def reverse_the_chunks(_: random.Random, bag: Anatomy) -> None:
    bag.chunks.reverse()


def shuffle_a_chunk(chance: random.Random, bag: Anatomy) -> None:
    chance.shuffle(bag.chunks[_chunk(chance, bag)])


def double_a_message(chance: random.Random, bag: Anatomy) -> None:
    chunk = bag.chunks[_chunk(chance, bag)]
    place = chance.randrange(len(chunk))
    bag.chunks[_chunk(chance, bag)].insert(0, chunk[place])


def drop_a_message(chance: random.Random, bag: Anatomy) -> None:
    number, place = chance.choice(bag.places(_topic(chance, bag)))
    del bag.chunks[number][place]


def drop_a_few_messages(chance: random.Random, bag: Anatomy) -> None:
    for _ in range(chance.randint(2, 30)):
        drop_a_message(chance, bag)


def drop_a_topic(chance: random.Random, bag: Anatomy) -> None:
    number = bag.channel_of(_topic(chance, bag))
    bag.chunks = [[m for m in chunk if m.channel_id != number] for chunk in bag.chunks]


def move_a_message(chance: random.Random, bag: Anatomy) -> None:
    number, place = chance.choice(bag.places(_topic(chance, bag)))
    message = bag.chunks[number].pop(place)
    bag.chunks[_chunk(chance, bag)].insert(0, message)


def empty_a_chunk(chance: random.Random, bag: Anatomy) -> None:
    bag.chunks[_chunk(chance, bag)] = []


def forge_the_summary(chance: random.Random, bag: Anatomy) -> None:
    bag.lies.summary = chance.choice(
        (
            b"",
            chance.randbytes(200),
            Frame(Opcode.STATISTICS, chance.randbytes(60)).encoded(),
            Frame(Opcode.CHUNK_INDEX, chance.randbytes(80)).encoded() * 3,
            Frame(Opcode.STATISTICS, b"", 2**63).encoded(),
        )
    )


def forge_the_counts(chance: random.Random, bag: Anatomy) -> None:
    told = bag.counted()
    counts = {number: chance.choice(_LENGTHS) for number in told.channel_message_counts}
    bag.lies.statistics = replace(
        told, channel_message_counts=counts, message_count=chance.choice(_LENGTHS)
    )


def forge_the_end(chance: random.Random, bag: Anatomy) -> None:
    bag.lies.summary_start = chance.choice((*_LENGTHS, 13, 100, 5000))


def forge_a_length(chance: random.Random, bag: Anatomy) -> None:
    bag.lies.record = (chance.randrange(100), chance.choice((*_LENGTHS, chance.randrange(9000))))


def forge_a_length_in_chunks(chance: random.Random, bag: Anatomy) -> None:
    bag.lies.inner = (chance.randrange(100), chance.choice((*_LENGTHS, chance.randrange(900))))


def forge_the_heads_of_chunks(chance: random.Random, bag: Anatomy) -> None:
    bag.lies.head = chance.choice(
        (
            {"uncompressed_size": chance.choice(_LENGTHS)},
            {"message_start_time": chance.choice(_LENGTHS)},
            {"message_end_time": chance.choice(_LENGTHS)},
            {"compression": chance.choice(("", "lz4", "zst", "\0", "x" * 5000))},
            {"data": chance.randbytes(chance.randrange(2000))},
            {"uncompressed_crc": 0},
        )
    )


def leave_out_checksums(chance: random.Random, bag: Anatomy) -> None:
    bag.lies.without_checksums = True
    chance.choice((drop_a_chunk, double_a_chunk, forge_a_length))(chance, bag)


# -- content --------------------------------------------------------------------------------------


def forge_times(chance: random.Random, bag: Anatomy) -> None:
    chunk = bag.chunks[_chunk(chance, bag)]
    for place in chance.sample(range(len(chunk)), min(len(chunk), chance.choice((1, 5, 5000)))):
        chunk[place] = replace(
            chunk[place], log_time=chance.choice(_LENGTHS), publish_time=chance.choice(_LENGTHS)
        )


def forge_channels(chance: random.Random, bag: Anatomy) -> None:
    number = chance.choice(list(bag.channels))
    channel, other = bag.channels[number], chance.choice(list(bag.channels.values()))
    bag.channels[number] = chance.choice(
        (
            replace(channel, topic=other.topic),
            replace(channel, topic=chance.choice(TEXTS)),
            replace(channel, schema_id=other.schema_id),
            replace(channel, schema_id=0),
            replace(channel, schema_id=60_000),
            replace(channel, message_encoding="json"),
        )
    )


def drop_a_channel(chance: random.Random, bag: Anatomy) -> None:
    del bag.channels[chance.choice(list(bag.channels))]


def forge_a_schema(chance: random.Random, bag: Anatomy) -> None:
    number = chance.choice(list(bag.schemas))
    schema = bag.schemas[number]
    text = schema.data.decode()
    lines = text.split("\n")
    place = chance.randrange(len(lines))
    bag.schemas[number] = chance.choice(
        (
            _told(schema, "\n".join(lines[:place] + lines[place + 1 :])),
            _told(schema, "\n".join([*lines[:place], f"{schema.name} itself", *lines[place:]])),
            _told(schema, "\n".join([*lines[:place], f"{schema.name}[] own", *lines[place:]])),
            _told(schema, text.replace("float64", chance.choice(("string", "int8", "float32")))),
            _told(schema, text.replace("string", "float64[]")),
            _told(schema, text.replace("[]", "[3]")),
            _told(schema, chance.choice(SCHEMAS)),
            replace(schema, data=chance.randbytes(300)),
            replace(schema, name=chance.choice((*TEXTS[:4], "a/msg/B", "stepdiag_ros/msg/None"))),
            replace(schema, encoding=chance.choice(("ros2idl", "jsonschema", ""))),
        )
    )


def _told(schema: Schema, text: str) -> Schema:
    return replace(schema, data=text.encode())


def forge_bytes(chance: random.Random, bag: Anatomy) -> None:
    for _ in range(chance.choice((1, 3, 20))):
        number, place = chance.choice(bag.places(_topic(chance, bag)))
        message = bag.chunks[number][place]
        data = bytearray(message.data)
        at = chance.randrange(len(data))
        width = chance.choice((1, 4, 8))
        with_what = chance.choice((b"\xff" * width, b"\0" * width, chance.randbytes(width)))
        data[at : at + width] = with_what
        if chance.random() < 0.2:
            del data[chance.randrange(len(data)) :]
        bag.chunks[number][place] = replace(message, data=bytes(data))


def forge_fields(chance: random.Random, bag: Anatomy) -> None:
    for _ in range(chance.choice((1, 1, 4, 40))):
        topic = _topic(chance, bag)
        number, place = chance.choice(bag.places(topic))
        _forge_message(chance, bag, number, place)


def forge_every_message_of_a_topic(chance: random.Random, bag: Anatomy) -> None:
    topic = _topic(chance, bag)
    seed = chance.random()
    for number, place in bag.places(topic):
        _forge_message(random.Random(seed), bag, number, place)


def forge_the_description(chance: random.Random, bag: Anatomy) -> None:
    number, place = bag.places("/run/description")[0]
    message = bag.chunks[number][place]
    name = _type_of(bag, message.channel_id)
    made = own_types().decode(name, message.data)
    field = chance.choice(("plan", "machine", "simulated_cell", "run_id", "software_version"))
    text = getattr(made, field)
    if field in ("plan", "machine") and chance.random() < 0.6:
        text = _one_value_changed(chance, text)
    else:
        text = chance.choice(TEXTS)
    object.__setattr__(made, field, text)
    bag.chunks[number][place] = replace(message, data=own_types().encode(name, made))


def _one_value_changed(chance: random.Random, text: str) -> str:
    lines = text.split("\n")
    places = [n for n, line in enumerate(lines) if ":" in line and line.lstrip()[:1] != "#"]
    place = chance.choice(places)
    key = lines[place].split(":")[0]
    value = chance.choice(
        (
            *("", "x", "-1", "0", "1e308", ".nan", ".inf", "9" * 5000, "[]", "{}", "null", "true"),
            *("[1, [2]]", "{a: {b: c}}", "1000000000", "1e-300", "'\\0'", "2026-01-01", "[x, 1]"),
            "[" * _DEEP + "]" * _DEEP,
        )
    )
    lines[place] = f"{key}: {value}"
    return "\n".join(lines)


def forge_the_identity(chance: random.Random, bag: Anatomy) -> None:
    """Change the metadata and attachments in front of the messages."""
    text = chance.choice(TEXTS)
    bag.front.append(
        chance.choice(
            (
                metadata_frame(METADATA_NAME, {"schema_version": text, "start_time": text}),
                metadata_frame(METADATA_NAME, {"run_id": text, "plan_name": text}),
                metadata_frame(METADATA_NAME, {"source_file": text, "remark 1": text, text: text}),
                metadata_frame(METADATA_NAME, {"source: simulated cell": text}),
                metadata_frame("stepdiag_ros.recovery", {"losses": text}),
                metadata_frame("stepdiag_ros.recovery", {}),
                attachment_frame(chance.choice(("plan.yaml", "machine.yaml")), b"\xff\xfe"),
                attachment_frame(text, b"x"),
                Frame(Opcode.METADATA, chance.randbytes(40)),
                Frame(Opcode.ATTACHMENT, chance.randbytes(40)),
                Frame(200, chance.randbytes(40)),
            )
        )
    )


def _topic(chance: random.Random, bag: Anatomy) -> str:
    here = {message.channel_id for chunk in bag.chunks for message in chunk}
    return chance.choice(sorted(bag.channels[number].topic for number in here))


def _type_of(bag: Anatomy, channel: int) -> str:
    return bag.schemas[bag.channels[channel].schema_id].name


def _forge_message(chance: random.Random, bag: Anatomy, number: int, place: int) -> None:
    message = bag.chunks[number][place]
    name = _type_of(bag, message.channel_id)
    for _ in range(_TRIALS):
        try:
            made = own_types().decode(name, message.data)
            _forge_field(chance, made)
            data = own_types().encode(name, made)
        except BagError:
            continue  # the value does not fit into the field, or this is no such message any more
        bag.chunks[number][place] = replace(message, data=data)
        return


def _forge_field(chance: random.Random, message: Any) -> None:
    fields = [name for name in vars(message) if not name.startswith("__")]
    field = chance.choice(fields)
    value = getattr(message, field)
    if isinstance(value, str):
        new: Any = chance.choice(TEXTS)
    elif isinstance(value, bool):
        new = not value
    elif isinstance(value, int | np.integer):
        new = chance.choice((0, 1, 2, 7, 255, *(2**n - 1 for n in (16, 31, 32, 63, 64))))
    elif isinstance(value, float | np.floating):
        new = chance.choice(_NUMBERS)
    elif isinstance(value, np.ndarray | list):
        new = _forged_values(chance, list(value))
    else:
        _forge_field(chance, value)
        return
    object.__setattr__(message, field, new)


def _forged_values(chance: random.Random, values: list[Any]) -> list[Any]:
    if values and isinstance(values[0], str):
        some: list[Any] = [chance.choice(TEXTS)]
    elif values and not isinstance(values[0], float | int | np.number):
        return [] if chance.random() < 0.5 else values * 3
    else:
        some = [chance.choice(_NUMBERS)]
    place = chance.randrange(len(values)) if values else 0
    return chance.choice(
        (
            [],
            values[:place],
            values + some,
            some * 100_000,
            [*values[:place], *some, *values[place + 1 :]],
            some * len(values),
        )
    )


STRUCTURE: tuple[Change, ...] = (
    *(double_a_chunk, double_all_chunks, drop_a_chunk, drop_the_end, drop_the_beginning),
    *(exchange_chunks, reverse_the_chunks, shuffle_a_chunk, double_a_message, drop_a_message),
    *(drop_a_few_messages, drop_a_topic, move_a_message, empty_a_chunk, forge_the_summary),
    *(forge_the_counts, forge_the_end, forge_a_length, forge_a_length_in_chunks),
    *(forge_the_heads_of_chunks, leave_out_checksums),
)
CONTENT: tuple[Change, ...] = (
    *(forge_times, forge_channels, drop_a_channel, forge_a_schema, forge_bytes, forge_fields),
    *(forge_every_message_of_a_topic, forge_the_description, forge_the_identity),
)
