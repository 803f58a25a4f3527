"""Reads bags: ours and those of ``ros2 bag record``. Checksums are always compared."""

import mmap
import tempfile
import time
from bisect import bisect_left
from collections.abc import Collection, Iterator, Set
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path

import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from stepdiag_ros.bags import layout
from stepdiag_ros.bags.bag import Bag, Order, Payloads, RecordedMessage
from stepdiag_ros.bags.errors import BagCorruptError, BagCutError, BagError
from stepdiag_ros.bags.header import Attachment
from stepdiag_ros.bags.tally import (
    PROMISING,
    BagTally,
    Flaw,
    Promise,
    key_of,
    recovery_flaws,
    tally_of,
)
from stepdiag_ros.text.intake import LARGEST_CHUNK, MOST_EXPANSION

COMPRESSED = b"\x28\xb5\x2f\xfd"
"""First bytes of what is compressed by zstd: ``ros2 bag record`` can do so with whole files."""
_PART = 2**20
"""Bytes that are decompressed at a time."""
_RECORDED_NOW = 60.0
"""Seconds since the last write within which a file that is not closed may still be recorded."""


def map_file(path: Path) -> mmap.mmap:
    """Map a file's bytes for reading; one that is compressed by zstd is decompressed.

    Raises:
        BagError: it is not there, cannot be read, is empty or is not an MCAP file.
    """
    try:
        with path.open("rb") as file:
            if file.seek(0, 2) == 0:
                raise BagCutError(f"{path} is empty; nothing was recorded into it", fault="too_few")
            file.seek(0)
            if file.read(len(COMPRESSED)) == COMPRESSED:
                data = _decompressed(path)
            else:
                data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except FileNotFoundError:
        raise BagError(f"there is no bag {path}", fault="not_found") from None
    except OSError as error:
        raise BagError(f"{path} cannot be read: {error.strerror}") from None
    if data[: len(layout.MAGIC)] != layout.MAGIC:
        data.close()
        raise BagError(
            f"{path} is not an MCAP file. Make a bag from a measurement in another format with:"
            " stepdiag import",
            fault="wrong_kind",
        )
    return data


def _decompressed(path: Path) -> mmap.mmap:
    """Map the content of a compressed file, from a file without a name."""
    with path.open("rb") as source, tempfile.TemporaryFile() as target:
        try:
            most = LARGEST_CHUNK + MOST_EXPANSION * path.stat().st_size
            with zstandard.ZstdDecompressor().stream_reader(source) as content:
                while part := content.read(_PART):
                    target.write(part)
                    if target.tell() > most:
                        raise BagCorruptError(
                            f"{path}: its content is more than {MOST_EXPANSION} times as large"
                        )
        except zstandard.ZstdError as error:
            raise BagCorruptError(
                f"{path} cannot be decompressed: {error}", fault="damaged"
            ) from None
        target.flush()
        if target.tell() == 0:
            raise BagCutError(f"{path} is cut off and contains nothing", fault="cut")
        return mmap.mmap(target.fileno(), 0, access=mmap.ACCESS_READ)


class BagReader(Bag):
    """A complete bag in one file.

    Args:
        path: the file.

    Raises:
        BagError: not there, or no MCAP file.
        BagCutError: the end is missing.
        BagCorruptError: a checksum is wrong; the text names the offset.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._data = map_file(self.path)
        try:
            self._open()
        except BaseException:
            self._data.close()
            raise

    def close(self) -> None:
        """Close the file; harmless when called again."""
        self._data.close()

    @property
    def size(self) -> int:
        """Return the size of the file in bytes."""
        return len(self._data)

    @property
    def has_data_checksum(self) -> bool:
        """Say whether a checksum covers all that stands before the summary (``ros2 bag``: none)."""
        return self._footer.data_crc != 0

    @property
    def chunk_count(self) -> int:
        """Return the number of chunks."""
        return len(self._chunks)

    @property
    def topics(self) -> dict[str, str]:
        """Return the full names of the topics and their types, in the order of first recording."""
        return {channel.topic: self._type_of(channel) for channel in self._channels.values()}

    @cached_property
    def start_time(self) -> int:
        """Return the first log time, ns; 0 without messages."""
        return min((self._times(chunk)[0] for chunk in self._chunks), default=0)

    @cached_property
    def end_time(self) -> int:
        """Return the last log time, ns; 0 without messages."""
        return max((self._times(chunk)[1] for chunk in self._chunks), default=0)

    def definitions(self) -> dict[str, str]:
        """Return type → text of its definition; see ``Bag``."""
        known = (schema for schema in self._schemas.values() if schema.encoding == "ros2msg")
        try:
            return {schema.name: schema.data.decode() for schema in known}
        except UnicodeDecodeError:
            raise BagError(f"{self.path}: a message definition is not text (UTF-8)") from None

    def records(
        self,
        order: Order = "file",
        topics: Collection[str] | None = None,
        start: int | None = None,
        end: int | None = None,
    ) -> Iterator[RecordedMessage]:
        """Go through the recorded messages; see ``Bag``."""
        wanted = {
            number: (channel.topic, self._type_of(channel))
            for number, channel in self._channels.items()
            if topics is None or channel.topic in topics
        }
        low = 0 if start is None else start
        high = 2**64 if end is None else end
        by_time = bool(self.tally.misplaced) or order == "time"
        in_order = self._in_time_order if by_time else self._in_file_order
        for message in self._each_once(in_order(wanted.keys(), low, high)):
            channel, sequence, log_time, publish_time, cdr = message
            if low <= log_time <= high:
                topic, type_name = wanted[channel]
                yield RecordedMessage(topic, type_name, log_time, publish_time, sequence, cdr)

    def payloads(self, topic: str) -> Iterator[Payloads]:
        """Go through the messages of one topic, those of a chunk at a time; see ``Bag``."""
        known = self._channels.items()
        wanted = {number: channel for number, channel in known if channel.topic == topic}
        types = {self._type_of(channel) for channel in wanted.values()}
        if self.tally.doubles or self.tally.misplaced or len(types) != 1:
            yield from super().payloads(topic)
            return
        (type_name,) = types
        for chunk in self._chunks_with(wanted.keys()):
            yield Payloads(type_name, *self._payloads_of(chunk, wanted.keys()))

    @cached_property
    def tally(self) -> BagTally:
        """Return what was counted in the file, compared with what it promises."""
        self._held: list[frozenset[int]] = []
        return tally_of(self._checked_heads(), self._all_messages, self._channels, self._promise)

    def flaws(self) -> tuple[Flaw, ...]:
        """Say what is wrong with the recording; see ``Bag``."""
        name = self.path.name
        return (*recovery_flaws(name, self.metadata), *self.tally.flaws(name))

    # -- opening --------------------------------------------------------------

    @property
    def _advice(self) -> str:
        return f"what is intact can be saved: stepdiag recover {self.path}"

    def _open(self) -> None:
        data = self._data
        if not layout.ends_properly(data):
            wait = ""
            if time.time() - self.path.stat().st_mtime < _RECORDED_NOW:
                wait = " It may still be recorded: wait until the recorder has closed it. If not:"
            raise BagCutError(
                f"{self.path} was not closed.{wait} 'stepdiag recover {self.path}' saves what it"
                " holds",
                fault="cut",
            )
        try:
            self._footer = layout.footer_of(data)
        except layout.Damaged as error:
            raise BagCorruptError(f"{self.path}: {error}; {self._advice}") from None
        self.metadata = {}
        self.attachments = []
        self._chunks: list[layout.RawRecord] = []
        self._spans: dict[int, tuple[int, int]] = {}
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._promise = Promise()
        self._expansion = 0
        intact = layout.data_section_is_intact(data, self._footer)
        if not layout.summary_is_intact(data, self._footer):
            raise BagCorruptError(f"{self.path}: the summary's checksum is wrong; {self._advice}")
        offset = len(layout.MAGIC)
        try:
            for record in layout.records(data):
                offset = record.offset
                self._take(record, check=not intact)
        except layout.Torn as torn:
            raise BagCorruptError(
                f"{self.path}: the frame is broken at byte {torn.offset}; {self._advice}",
                fault="damaged",
            ) from None
        except layout.Damaged as error:
            raise BagCorruptError(
                f"{self.path}: the record at byte {offset} is damaged ({error}); {self._advice}",
                fault="damaged",
            ) from None
        if not intact:
            raise BagCorruptError(
                f"{self.path}: the checksum over bytes 0 to {self._footer.data_end} is wrong, "
                f"though every chunk's own is right; {self._advice}"
            )
        if not self._channels:
            self._channels_from_chunks()

    def _take(self, record: layout.RawRecord, check: bool) -> None:
        opcode = record.opcode
        if opcode in PROMISING:
            self._promise.take(opcode, record.body(self._data))
        if opcode == Opcode.CHUNK:
            self._spans[record.offset] = layout.chunk_times(self._data, record)
            self._expansion += layout.chunk_size(self._data, record)
            if self._expansion > LARGEST_CHUNK + MOST_EXPANSION * len(self._data):
                raise layout.Damaged(
                    f"the content of the chunks is {MOST_EXPANSION} times as large as the file"
                )
            self._chunks.append(record)
            if check:
                layout.chunk_content(record.body(self._data))
        elif opcode == Opcode.MESSAGE:
            time = _lone_message(record, self._data).log_time
            self._spans[record.offset] = time, time
            self._chunks.append(record)
        elif opcode == Opcode.METADATA:
            metadata = layout.metadata_of(record.body(self._data))
            self.metadata[metadata.name] = metadata.metadata
        elif opcode == Opcode.ATTACHMENT:
            found = layout.attachment_of(record.body(self._data))
            self.attachments.append(Attachment(found.name, found.media_type, found.data))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            self._define(opcode, record.body(self._data))

    def _define(self, opcode: int, body: bytes) -> None:
        if opcode == Opcode.SCHEMA:
            schema = layout.schema_of(body)
            self._schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = layout.channel_of(body)
            self._channels[channel.id] = channel

    def _channels_from_chunks(self) -> None:
        """Collect the topics of a bag without a summary."""
        for chunk in self._chunks:
            if chunk.opcode == Opcode.CHUNK:
                with self._refusing_damage(chunk):
                    for definition in layout.chunk_definitions(self._content(chunk)):
                        self._define(*definition)

    def _type_of(self, channel: Channel) -> str:
        schema = self._schemas.get(channel.schema_id)
        return "" if schema is None else schema.name

    # -- going through --------------------------------------------------------

    @contextmanager
    def _refusing_damage(self, chunk: layout.RawRecord) -> Iterator[None]:
        try:
            yield
        except layout.Damaged as error:
            raise BagCorruptError(
                f"{self.path}: the chunk at byte {chunk.offset} is damaged ({error}); "
                f"{self._advice}",
                fault="damaged",
            ) from None

    def _content(self, chunk: layout.RawRecord) -> bytes:
        layout.let_go(self._data, chunk.offset, chunk.end)
        return layout.chunk_content(chunk.body(self._data))

    def _times(self, chunk: layout.RawRecord) -> tuple[int, int]:
        return self._spans[chunk.offset]

    def _chunks_with(self, wanted: Set[int]) -> list[layout.RawRecord]:
        """Return the chunks that hold messages of the wanted channels.

        Raises:
            BagCorruptError: a message belongs to no channel.
        """
        if not frozenset().union(*self._held) <= self._channels.keys():
            raise BagCorruptError(f"{self.path}: a message belongs to no topic; {self._advice}")
        chunks = zip(self._chunks, self._held, strict=True)
        return [chunk for chunk, held in chunks if held & wanted]

    def _messages_of(
        self, chunk: layout.RawRecord, wanted: Collection[int] | None = None
    ) -> list[layout.RawMessage]:
        if chunk.opcode == Opcode.CHUNK:
            with self._refusing_damage(chunk):
                return layout.chunk_messages(self._content(chunk), wanted)
        message = _lone_message(chunk, self._data)
        return [message] if wanted is None or message.channel in wanted else []

    def _payloads_of(
        self, chunk: layout.RawRecord, wanted: Collection[int]
    ) -> tuple[list[int], list[bytes]]:
        if chunk.opcode == Opcode.CHUNK:
            with self._refusing_damage(chunk):
                return layout.chunk_payloads(self._content(chunk), wanted)
        message = _lone_message(chunk, self._data)
        return [message.log_time], [message.cdr]

    def _all_messages(self) -> Iterator[layout.RawMessage]:
        for chunk in self._chunks:
            yield from self._messages_of(chunk)

    def _checked_heads(self) -> Iterator[layout.MessageHead]:
        """Go through the heads of all messages, and note which channels each chunk holds.

        The head of each chunk must state the times of its messages.
        """
        # Chunks hold few different sets of channels, so that each set is kept once.
        known: dict[frozenset[int], frozenset[int]] = {}
        for chunk in self._chunks:
            heads = self._heads_of(chunk)
            yield from heads
            held = frozenset(channel for channel, _, _, _ in heads)
            self._held.append(known.setdefault(held, held))
            times = [log_time for _, _, log_time, _ in heads]
            if times and (min(times), max(times)) != self._times(chunk):
                raise BagCorruptError(
                    f"{self.path}: the chunk at byte {chunk.offset} states times that differ from"
                    f" those of its messages; {self._advice}"
                )

    def _heads_of(self, chunk: layout.RawRecord) -> list[layout.MessageHead]:
        if chunk.opcode != Opcode.CHUNK:
            return [_lone_message(chunk, self._data)[:4]]
        with self._refusing_damage(chunk):
            return layout.chunk_heads(self._content(chunk))

    def _each_once(self, messages: Iterator[layout.RawMessage]) -> Iterator[layout.RawMessage]:
        """Leave out the copies of messages that are in the file more than once."""
        doubles = self.tally.doubles
        return self._without(doubles, messages) if doubles else messages

    @staticmethod
    def _without(
        doubles: Collection[bytes], messages: Iterator[layout.RawMessage]
    ) -> Iterator[layout.RawMessage]:
        seen: set[bytes] = set()
        for message in messages:
            key = key_of(message)
            if key in seen:
                continue
            if key in doubles:
                seen.add(key)
            yield message

    def _in_file_order(self, wanted: Set[int], low: int, high: int) -> Iterator[layout.RawMessage]:
        for chunk in self._chunks_with(wanted):
            first, last = self._times(chunk)
            if first <= high and last >= low:
                yield from self._messages_of(chunk, wanted)

    def _in_time_order(self, wanted: Set[int], low: int, high: int) -> Iterator[layout.RawMessage]:
        spans = [(*self._times(chunk), chunk) for chunk in self._chunks_with(wanted)]
        spans = sorted(span for span in spans if span[0] <= high and span[1] >= low)
        waiting: list[tuple[int, int, int, layout.RawMessage]] = []
        for first, _, chunk in spans:
            # Whatever is older than the first message of all chunks still to come can go.
            ready = bisect_left(waiting, (first,))
            for entry in waiting[:ready]:
                yield entry[3]
            del waiting[:ready]
            waiting.extend(
                (message.log_time, chunk.offset, place, message)
                for place, message in enumerate(self._messages_of(chunk, wanted))
            )
            waiting.sort()  # nearly sorted already, which costs next to nothing
        for entry in waiting:
            yield entry[3]


def _lone_message(record: layout.RawRecord, data: mmap.mmap) -> layout.RawMessage:
    """Return a message that stands outside of chunks; raises ``Damaged``."""
    return layout.message_of(record.body(data))
