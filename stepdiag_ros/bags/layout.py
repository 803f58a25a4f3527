"""How the bytes of an MCAP file are framed, and whether they are those that were written.

A record is one byte of opcode, eight bytes of length and a body (mcap.dev/spec). The MCAP library's
own readers neither report where a file is damaged nor go on behind the damage; recovery and exact
error messages need both, so the frame is walked here and only the bodies are left to the library.
"""

import mmap
import struct
import threading
import zlib
from collections.abc import Collection, Iterator
from dataclasses import replace
from io import BytesIO
from typing import Any, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Metadata, Schema, Statistics
from mcap.stream_reader import get_chunk_data_stream

from stepdiag_ros.text.intake import LARGEST_CHUNK

MAGIC = b"\x89MCAP0\r\n"
FRAME = 9
"""Bytes of opcode and length in front of a body."""
FOOTER_SIZE = FRAME + 20
DATA_END_SIZE = FRAME + 4
_KEPT = 2**22
"""Bytes of a mapped file, about, that stay in memory while it is gone through."""
_FRAME = struct.Struct("<BQ")
_LENGTH = struct.Struct("<Q")
_MESSAGE = struct.Struct("<HIQQ")
_FRAMED_MESSAGE = struct.Struct("<BQHIQQ")
"""Frame and head of a message; of other records, the frame and whatever stands behind it."""
_CHUNK_HEAD = struct.Struct("<QQQII")
_COMPRESSIONS = (b"", b"zstd", b"lz4")


class _Zstd(threading.local):
    """One decompressor for each thread: the library makes a new one for every chunk."""

    def __init__(self) -> None:
        self.decompressor = zstandard.ZstdDecompressor()


_zstd = _Zstd()


class RawRecord(NamedTuple):
    """One framed record: where it begins and ends in the file, and what kind it is."""

    offset: int
    opcode: int
    end: int

    def body(self, data: Any) -> bytes:
        """Return the record's body out of the file's bytes."""
        return bytes(data[self.offset + FRAME : self.end])


MessageHead = tuple[int, int, int, int]
"""Channel, sequence, log time and publish time of a message: the head of a ``RawMessage``."""


class RawMessage(NamedTuple):
    """One message of a chunk."""

    channel: int
    sequence: int
    log_time: int
    publish_time: int
    cdr: bytes


class Torn(Exception):
    """The frame is broken at ``offset``: what stands there is no whole record."""

    def __init__(self, offset: int) -> None:
        super().__init__(f"no whole record at byte {offset}")
        self.offset = offset


class Damaged(Exception):
    """A record's content is not what was written."""


def record_at(data: Any, offset: int) -> RawRecord:
    """Return the record that begins at an offset of the file's bytes.

    Raises:
        Torn: there is no record, or it ends behind the end of the file.
    """
    if offset + FRAME > len(data):
        raise Torn(offset)
    opcode = data[offset]
    end = offset + FRAME + _LENGTH.unpack_from(data, offset + 1)[0]
    if opcode == 0 or end > len(data):
        raise Torn(offset)
    return RawRecord(offset, opcode, end)


def records(data: Any, offset: int = len(MAGIC)) -> Iterator[RawRecord]:
    """Walk the frame from an offset to the footer.

    Raises:
        Torn: the frame breaks before the footer.
    """
    while True:
        record = record_at(data, offset)
        let_go(data, record.offset, record.end)
        yield record
        if record.opcode == Opcode.FOOTER:
            return
        offset = record.end


def ends_properly(data: Any) -> bool:
    """Say whether the file has a footer and closing magic where they belong."""
    if len(data) < 2 * len(MAGIC) + FOOTER_SIZE or bytes(data[-len(MAGIC) :]) != MAGIC:
        return False
    footer = len(data) - len(MAGIC) - FOOTER_SIZE
    length: int = _LENGTH.unpack_from(data, footer + 1)[0]
    return bool(data[footer] == Opcode.FOOTER and length == FOOTER_SIZE - FRAME)


class Footer(NamedTuple):
    """Where the data section and the summary end, with their checksums (0: none was written)."""

    data_end: int
    data_crc: int
    summary_start: int
    summary_crc: int
    offset: int


def footer_of(data: Any) -> Footer:
    """Return the footer of a file that ``ends_properly``.

    Raises:
        Damaged: footer and end of the data section do not fit together.
    """
    offset = len(data) - len(MAGIC) - FOOTER_SIZE
    summary_start, _, summary_crc = struct.unpack_from("<QQI", data, offset + FRAME)
    data_end = (summary_start or offset) - DATA_END_SIZE
    if not 0 <= data_end < offset or data[data_end] != Opcode.DATA_END:
        raise Damaged("the footer does not point at the end of the data")
    (data_crc,) = struct.unpack_from("<I", data, data_end + FRAME)
    return Footer(data_end, data_crc, summary_start, summary_crc, offset)


def data_section_is_intact(data: Any, footer: Footer) -> bool:
    """Compare the checksum of everything in front of the summary; true where none was written."""
    return footer.data_crc in (0, _crc(data, 0, footer.data_end))


def summary_is_intact(data: Any, footer: Footer) -> bool:
    """Compare the checksum of the summary and the footer; true where none was written."""
    start = footer.summary_start or footer.offset
    # The checksum stands last in the footer and covers all of it that stands before.
    return footer.summary_crc in (0, _crc(data, start, footer.offset + FOOTER_SIZE - 4))


def _crc(data: Any, start: int, end: int) -> int:
    crc = 0
    for begin in range(start, end, _KEPT):
        stop = min(begin + _KEPT, end)
        with memoryview(data) as view, view[begin:stop] as part:
            crc = zlib.crc32(part, crc)
        let_go(data, begin, stop)
    return crc


def let_go(data: Any, begin: int, end: int) -> None:
    """Give back the memory of a mapped file when what is read from begin to end passes a mark.

    The pages of a file that is gone through would otherwise all count as memory of the process;
    what is read again comes from the computer's cache.
    """
    if begin // _KEPT != end // _KEPT and hasattr(data, "madvise"):
        data.madvise(mmap.MADV_DONTNEED)


def _parsed(reader: Any, body: bytes) -> Any:
    try:
        return reader(ReadDataStream(BytesIO(body)))
    except (McapError, struct.error, UnicodeDecodeError, OverflowError, MemoryError) as error:
        raise Damaged(str(error) or type(error).__name__) from None


def header_of(body: bytes) -> Header:
    """Parse the file's header record; raises ``Damaged``."""
    parsed: Header = _parsed(Header.read, body)
    return parsed


def statistics_of(body: bytes) -> Statistics:
    """Parse the statistics record of the summary; raises ``Damaged``."""
    parsed: Statistics = _parsed(Statistics.read, body)
    return parsed


def schema_of(body: bytes) -> Schema:
    """Parse a schema record; raises ``Damaged``."""
    parsed: Schema = _parsed(Schema.read, body)
    return parsed


def channel_of(body: bytes) -> Channel:
    """Parse a channel record; raises ``Damaged``."""
    parsed: Channel = _parsed(Channel.read, body)
    return parsed


def metadata_of(body: bytes) -> Metadata:
    """Parse a metadata record; raises ``Damaged``."""
    parsed: Metadata = _parsed(Metadata.read, body)
    return parsed


def attachment_of(body: bytes) -> Attachment:
    """Parse an attachment record and compare its checksum; raises ``Damaged``."""
    # The library skips the checksum of attachments.
    written = struct.unpack_from("<I", body, len(body) - 4)[0] if len(body) >= 4 else 0
    if written not in (0, zlib.crc32(body[:-4])):
        raise Damaged("the checksum of an attachment is wrong")
    parsed: Attachment = _parsed(Attachment.read, body)
    return parsed


def chunk_times(data: Any, record: RawRecord) -> tuple[int, int]:
    """Return the first and the last log time of a chunk, ns, from its head; raises ``Damaged``."""
    if record.end - record.offset < FRAME + _CHUNK_HEAD.size:
        raise Damaged("a chunk lacks its header")
    first, last = struct.unpack_from("<QQ", data, record.offset + FRAME)
    return int(first), int(last)


def chunk_content(body: bytes) -> bytes:
    """Return the records of a chunk, decompressed, with its checksum compared.

    Raises:
        Damaged: the chunk cannot be decompressed or its checksum is wrong.
    """
    chunk: Chunk = _parsed(Chunk.read, body)
    _bound(chunk)
    try:
        if chunk.compression == "zstd":
            content = _zstd.decompressor.decompress(chunk.data, chunk.uncompressed_size)
            chunk = replace(chunk, compression="", data=content)
        stream, length = get_chunk_data_stream(chunk, validate_crc=True)
        content = stream.read(length)
    except (McapError, zstandard.ZstdError, ValueError, RuntimeError, MemoryError) as error:
        raise Damaged(str(error)) from None
    if len(content) != chunk.uncompressed_size:
        raise Damaged(f"a chunk of {chunk.uncompressed_size} bytes has {len(content)}")
    return content


def chunk_size(data: Any, record: RawRecord) -> int:
    """Return the size of a chunk's content by its head, bytes."""
    return int(_CHUNK_HEAD.unpack_from(data, record.offset + FRAME)[2])


def _bound(chunk: Chunk) -> None:
    """Refuse a chunk whose content is larger than any recorder makes it, before it is there."""
    sizes = [chunk.uncompressed_size]
    try:
        if chunk.compression == "zstd":
            sizes.append(zstandard.frame_content_size(chunk.data))
        elif chunk.compression == "lz4":
            # LZ4 expands at most 255 times.
            sizes.append(min(LARGEST_CHUNK, 255 * len(chunk.data)))
    except zstandard.ZstdError as error:
        raise Damaged(str(error)) from None
    if max(sizes) > LARGEST_CHUNK:
        raise Damaged(f"a chunk of {max(sizes)} bytes; at most {LARGEST_CHUNK} are accepted")


def chunk_definitions(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Go through what is not a message in a chunk: opcode and body of each; raises ``Damaged``."""
    position, size = 0, len(content)
    while position < size:
        if position + FRAME > size:
            raise Damaged("the records of a chunk do not fill it")
        opcode, length = _FRAME.unpack_from(content, position)
        start = position + FRAME
        position = start + length
        if position > size:
            raise Damaged("the records of a chunk do not fit into it")
        if opcode != Opcode.MESSAGE:
            yield opcode, content[start:position]


def chunk_heads(content: bytes) -> list[MessageHead]:
    """Return the heads of a chunk's messages, without their bytes; raises ``Damaged``."""
    return [head for head, _, _ in _messages(content)]


def chunk_messages(content: bytes, wanted: Collection[int] | None = None) -> list[RawMessage]:
    """Return the messages of a chunk.

    Args:
        content: of the chunk.
        wanted: numbers of the channels whose messages are returned; all if None.

    Raises:
        Damaged: the chunk's inner frame is broken, or a message is too short.
    """
    return [
        RawMessage(*head, content[start:end]) for head, start, end in _messages(content, wanted)
    ]


def chunk_payloads(content: bytes, wanted: Collection[int]) -> tuple[list[int], list[bytes]]:
    """Return log times and serialised content of a chunk's messages on some channels.

    Raises:
        Damaged: as ``chunk_messages``.
    """
    found = _messages(content, wanted)
    times = [head[2] for head, _, _ in found]
    return times, [content[start:end] for _, start, end in found]


def _messages(
    content: bytes, wanted: Collection[int] | None = None
) -> list[tuple[MessageHead, int, int]]:
    """Return head of each wanted message, and where its serialised content begins and ends.

    A run has hundreds of thousands of records, and this goes through them all: frame and head are
    unpacked together, so that each record costs one call.
    """
    found: list[tuple[MessageHead, int, int]] = []
    message, head_size = int(Opcode.MESSAGE), _MESSAGE.size
    framed_at, put = _FRAMED_MESSAGE.unpack_from, found.append
    # Behind a last record that is not a message there must be something to unpack as a head.
    padded = content + bytes(head_size)
    position, size = 0, len(content)
    try:
        while position < size:
            opcode, length, channel, sequence, logged, published = framed_at(padded, position)
            start = position + FRAME
            position = start + length
            if opcode != message:
                continue
            if length < head_size:
                raise Damaged("a message is too short")
            if wanted is None or channel in wanted:
                put(((channel, sequence, logged, published), start + head_size, position))
    except struct.error:
        raise Damaged("the records of a chunk do not fill it") from None
    if position > size:
        raise Damaged("the records of a chunk do not fit into it")
    return found


def message_of(content: bytes) -> RawMessage:
    """Parse a message record that stands outside of chunks; raises ``Damaged``."""
    if len(content) < _MESSAGE.size:
        raise Damaged("a message is too short")
    head: MessageHead = _MESSAGE.unpack_from(content)
    return RawMessage(*head, content[_MESSAGE.size :])


def next_chunk(data: Any, offset: int) -> RawRecord | None:
    """Look for the next place at or behind an offset where a chunk with the right checksum begins.

    Args:
        data: the file's bytes, with a ``find`` (an mmap).
        offset: where to begin.
    """
    mark = bytes([Opcode.CHUNK])
    while (offset := data.find(mark, offset)) >= 0:
        try:
            record = record_at(data, offset)
            if _looks_like_chunk(data, record):
                chunk_content(record.body(data))
                return record
        except (Torn, Damaged):
            pass
        offset += 1
    return None


def _looks_like_chunk(data: Any, record: RawRecord) -> bool:
    # Cheap and selective: only one byte in many millions gets as far as being decompressed.
    start = record.offset + FRAME
    if record.end - start < _CHUNK_HEAD.size:
        return False
    first, last, _, _, name = _CHUNK_HEAD.unpack_from(data, start)
    return (
        first <= last and name <= 4 and bytes(data[start + 32 : start + 32 + name]) in _COMPRESSIONS
    )


def indexed_messages(data: Any, record: RawRecord) -> int:
    """Return how many messages a message index record lists; 0 if it is too short."""
    if record.end - record.offset < FRAME + 6:
        return 0
    (size,) = struct.unpack_from("<I", data, record.offset + FRAME + 2)
    return int(size) // 16
