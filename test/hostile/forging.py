"""A bag taken apart into records, and put together again with every checksum right.

Whoever changes a bag on purpose makes its checksums anew. What is changed here is therefore never
found by a checksum: only the content can tell.
"""

import copy
import struct
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Footer, Message, Metadata, Schema, Statistics

from stepdiag_ros.bags import layout
from stepdiag_ros.bags.tally import COUNTS_METADATA

MAGIC = layout.MAGIC


@dataclass
class Frame:
    """A record as it stands in the file; ``length`` is what is written if it shall be a lie."""

    opcode: int
    body: bytes
    length: int | None = None

    def encoded(self) -> bytes:
        length = len(self.body) if self.length is None else self.length
        return struct.pack("<BQ", self.opcode, length) + self.body


@dataclass
class Lies:
    """What the frame says of the content that is not so; None: the truth.

    Attributes:
        head: replaces fields of every chunk's head: start, end, size, compression.
        inner: (place, length): the record of each chunk at that place tells this length.
        record: (place, length): the record of the file at that place tells this length.
        statistics: the counts of the whole bag stay in the summary, whatever is in it now.
        summary: bytes between the end of the data and the footer, instead of a summary.
        summary_start: that the footer tells.
        without_checksums: write checksums of zero, which means none.
    """

    head: dict[str, object] = field(default_factory=dict)
    inner: tuple[int, int] | None = None
    record: tuple[int, int] | None = None
    statistics: Statistics | None = None
    summary: bytes | None = None
    summary_start: int | None = None
    without_checksums: bool = False


@dataclass
class Anatomy:
    """A bag in parts: what stands before the messages, its types, and messages chunk by chunk."""

    front: list[Frame]
    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    chunks: list[list[Message]]
    statistics: Statistics
    lies: Lies = field(default_factory=Lies)

    def channel_of(self, topic: str) -> int:
        return next(number for number, one in self.channels.items() if one.topic == topic)

    def places(self, topic: str) -> list[tuple[int, int]]:
        """Where the messages of a topic stand: chunk and place in it."""
        wanted = self.channel_of(topic)
        return [
            (number, place)
            for number, chunk in enumerate(self.chunks)
            for place, message in enumerate(chunk)
            if message.channel_id == wanted
        ]

    def encoded(self) -> bytes:
        """Return the bag's bytes, all checksums right."""
        frames = [*self.front, *(self._chunk(messages) for messages in self.chunks)]
        if self.lies.record is not None:
            place, length = self.lies.record
            frames[place % len(frames)].length = length
        data = MAGIC + b"".join(frame.encoded() for frame in frames)
        crc = 0 if self.lies.without_checksums else zlib.crc32(data)
        data += Frame(Opcode.DATA_END, struct.pack("<I", crc)).encoded()
        summary = self._summary() if self.lies.summary is None else self.lies.summary
        start = len(data) if self.lies.summary_start is None else self.lies.summary_start
        head = summary + _record(Footer(start, 0, 0))[:-4]
        crc = 0 if self.lies.without_checksums else zlib.crc32(head)
        return data + head + struct.pack("<I", crc) + MAGIC

    def _chunk(self, messages: list[Message]) -> Frame:
        known: set[int] = set()
        frames: list[Frame] = []
        for message in messages:
            channel = self.channels.get(message.channel_id)
            if channel is not None and channel.id not in known:
                known.add(channel.id)
                if channel.schema_id in self.schemas:
                    frames.append(_frame(self.schemas[channel.schema_id]))
                frames.append(_frame(channel))
            frames.append(_frame(message))
        if self.lies.inner is not None and frames:
            place, length = self.lies.inner
            frames[place % len(frames)].length = length
        content = b"".join(frame.encoded() for frame in frames)
        times = [message.log_time for message in messages] or [0]
        chunk = Chunk(
            "zstd", zstandard.ZstdCompressor().compress(content), max(times), min(times),
            zlib.crc32(content), len(content),
        )  # fmt: skip
        return _frame(replace(chunk, **self.lies.head))

    def _summary(self) -> bytes:
        parts = [_record(schema) for schema in self.schemas.values()]
        parts += [_record(channel) for channel in self.channels.values()]
        parts.append(_record(self.lies.statistics or self.counted()))
        return b"".join(parts)

    def counted(self) -> Statistics:
        """Return the statistics of what is in the bag now."""
        messages = [message for chunk in self.chunks for message in chunk]
        counts: dict[int, int] = {}
        for message in messages:
            counts[message.channel_id] = counts.get(message.channel_id, 0) + 1
        times = [message.log_time for message in messages] or [0]
        return replace(
            self.statistics, channel_message_counts=counts, chunk_count=len(self.chunks),
            message_count=len(messages), message_start_time=min(times), message_end_time=max(times),
            channel_count=len(self.channels), schema_count=len(self.schemas),
        )  # fmt: skip


def taken_apart(path: Path) -> Anatomy:
    """Take a bag apart whose messages are all in chunks."""
    data = path.read_bytes()
    made = Anatomy([], {}, {}, [], Statistics(0, 0, {}, 0, 0, 0, 0, 0, 0))
    for record in layout.records(data):
        body = record.body(data)
        if record.opcode == Opcode.CHUNK:
            made.chunks.append(_messages(layout.chunk_content(body)))
        elif record.opcode in (Opcode.HEADER, Opcode.METADATA, Opcode.ATTACHMENT):
            made.front.append(Frame(record.opcode, body))
        elif record.opcode == Opcode.SCHEMA:
            schema = layout.schema_of(body)
            made.schemas[schema.id] = schema
        elif record.opcode == Opcode.CHANNEL:
            channel = layout.channel_of(body)
            made.channels[channel.id] = channel
    made.statistics = made.counted()
    return made


def as_our_writer_counts(bag: Anatomy) -> Anatomy:
    """Return the bag with messages that are numbered and counted, as ``BagWriter`` does now."""
    made, counts = copy.deepcopy(bag), dict.fromkeys(bag.channels, 0)
    for chunk in made.chunks:
        for place, message in enumerate(chunk):
            counts[message.channel_id] += 1
            chunk[place] = replace(message, sequence=counts[message.channel_id])
    told = {made.channels[number].topic: str(count) for number, count in counts.items()}
    made.front.append(metadata_frame(COUNTS_METADATA, told))
    return made


def as_older_recorders_wrote(bag: Anatomy) -> Anatomy:
    """Return the bag with messages that are not numbered, and without our writer's own counts."""
    made = copy.deepcopy(bag)
    made.front = [frame for frame in made.front if COUNTS_METADATA.encode() not in frame.body]
    made.chunks = [[replace(one, sequence=0) for one in chunk] for chunk in made.chunks]
    return made


def attachment_frame(name: str, data: bytes) -> Frame:
    return _frame(Attachment(0, 0, name, "application/yaml", data))


def metadata_frame(name: str, told: dict[str, str]) -> Frame:
    return _frame(Metadata(metadata=told, name=name))


def _messages(content: bytes) -> list[Message]:
    return [
        Message(one.channel, one.log_time, one.cdr, one.publish_time, one.sequence)
        for one in layout.chunk_messages(content)
    ]


def _record(record) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def _frame(record) -> Frame:
    encoded = _record(record)
    return Frame(encoded[0], encoded[layout.FRAME :])
