"""Makes a clean bag from one that is cut off or damaged. The original is only read."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from stepdiag_ros.bags import layout
from stepdiag_ros.bags.errors import BagError, BagWriteError
from stepdiag_ros.bags.reader import map_file
from stepdiag_ros.bags.tally import (
    NOTHING_LOST,
    PROMISING,
    RECOVERY_METADATA,
    BagTally,
    Promise,
    key_of,
    tally_of,
)
from stepdiag_ros.bags.writer import CHUNK_SIZE, PROFILE, UnbufferedFile, mcap_writer


@dataclass
class RecoveryReport:
    """What was saved and what was lost.

    Attributes:
        source: the damaged bag.
        target: the clean bag.
        was_closed: the source has its end; it was not cut off.
        chunks: saved.
        messages: saved.
        damaged_chunks: with a wrong checksum, left out.
        messages_lost: that are known to have been in them; if ``lost_is_known`` is false, at least.
        lost_is_known: nothing is missing beyond ``messages_lost`` and what was never written.
        unreadable_bytes: that belong to no whole record, at the end or in between.
        attachments: saved.
        topics: full name → messages saved.
        start_time: log time of the first saved message, ns; None without messages.
        end_time: of the last.
        losses: what was lost, one sentence each; empty if nothing was.
    """

    source: Path
    target: Path
    was_closed: bool = False
    chunks: int = 0
    messages: int = 0
    damaged_chunks: int = 0
    messages_lost: int = 0
    lost_is_known: bool = True
    unreadable_bytes: int = 0
    attachments: int = 0
    topics: dict[str, int] = field(default_factory=dict)
    start_time: int | None = None
    end_time: int | None = None
    losses: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        """Say in words what was saved and what was lost."""
        duration = (
            ""
            if self.start_time is None or self.end_time is None
            else f" over {(self.end_time - self.start_time) / 1e9:.1f} s"
        )
        saved = f"{self.messages} messages{duration} in {len(self.topics)} topics were saved"
        return f"{saved} to {self.target}. " + (" ".join(self.losses) or NOTHING_LOST)


@dataclass
class _Found:
    """The whole records of a damaged file."""

    chunks: list[layout.RawRecord] = field(default_factory=list)
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    attachments: list[Any] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    promise: Promise = field(default_factory=Promise)


def recover(source: str | Path, target: str | Path) -> RecoveryReport:
    """Stream everything whole out of a cut or damaged bag into a new, closed one.

    Args:
        source: the bag; only read.
        target: the new bag.

    Returns:
        What was saved and what was lost.

    Raises:
        BagError: the source is not there or no MCAP file, nothing in it can be saved, or the target
            exists.
        BagWriteError: the target cannot be written.
    """
    source, target = Path(source), Path(target)
    if target.exists():
        raise BagError(f"{target} exists already; a bag is never overwritten", fault="exists")
    if not target.parent.is_dir():
        raise BagError(f"{target}: the folder {target.parent} does not exist")
    report = RecoveryReport(source, target)
    data = map_file(source)
    try:
        found = _search(data, report)
        if not (found.chunks or found.metadata or found.attachments):
            raise BagError(
                f"{source}: nothing can be recovered, because no record is complete",
                fault="damaged",
            )
        _write(data, found, report)
    finally:
        data.close()
    return report


def default_target(source: str | Path) -> Path:
    """Return the name that a recovered bag gets if none is given: ``NAME_recovered.mcap``."""
    source = Path(source)
    return source.parent / f"{source.stem}_recovered{source.suffix or '.mcap'}"


def _search(data: Any, report: RecoveryReport) -> _Found:
    found = _Found()
    report.was_closed = layout.ends_properly(data)
    damaged_chunk = False
    offset = len(layout.MAGIC)
    while offset < len(data):
        try:
            record = layout.record_at(data, offset)
        except layout.Torn:
            offset = _skip(data, offset, report)
            damaged_chunk = False
            continue
        offset = record.end
        if record.opcode == Opcode.FOOTER:
            break
        if record.opcode == Opcode.MESSAGE_INDEX and damaged_chunk:
            report.messages_lost += layout.indexed_messages(data, record)
            continue
        try:
            damaged_chunk = False
            _take(data, record, found)
        except layout.Damaged:
            damaged_chunk = record.opcode == Opcode.CHUNK
            if damaged_chunk:
                # Its length may be what is wrong; the frame behind it tells.
                offset = _behind(data, record, report)
            else:
                report.losses.append(
                    f"The record at byte {record.offset} is damaged and was left out."
                )
    if not report.was_closed:
        report.losses.append(
            "The bag was not closed: what had not been written when the recording stopped is lost."
        )
    elif not (report.losses or report.damaged_chunks) and not _whole_is_intact(data):
        report.losses.append(
            "Every chunk is right, but bytes outside of them are not those that were written: "
            "check the run's identity, plan and models."
        )
    if report.damaged_chunks:
        count = f"{report.messages_lost} messages" + ("" if report.lost_is_known else " or more")
        chunks = "chunk is" if report.damaged_chunks == 1 else "chunks are"
        report.losses.append(f"{report.damaged_chunks} {chunks} damaged; {count} in them are lost.")
    return found


def _whole_is_intact(data: Any) -> bool:
    try:
        return layout.data_section_is_intact(data, layout.footer_of(data))
    except layout.Damaged:
        return False


def _behind(data: Any, record: layout.RawRecord, report: RecoveryReport) -> int:
    """Return where to go on behind a damaged chunk."""
    report.damaged_chunks += 1
    try:
        following = layout.record_at(data, record.end).opcode
    except layout.Torn:
        following = 0
    if following in (Opcode.MESSAGE_INDEX, Opcode.CHUNK, Opcode.DATA_END):
        report.lost_is_known = report.lost_is_known and following == Opcode.MESSAGE_INDEX
        return record.end
    report.lost_is_known = False
    return _skip(data, record.offset + 1, report)


def _skip(data: Any, offset: int, report: RecoveryReport) -> int:
    """Go to the next whole chunk behind a broken frame; to the end of the file without one."""
    following = layout.next_chunk(data, offset)
    end = len(data) if following is None else following.offset
    report.unreadable_bytes += end - offset
    if following is not None:
        report.lost_is_known = False
        report.losses.append(f"Bytes {offset} to {end} are unreadable; what they held is lost.")
    elif end > offset:
        report.losses.append(
            f"The last {end - offset} bytes are not a complete record and were left out."
        )
    return end


def _take(data: Any, record: layout.RawRecord, found: _Found) -> None:
    body = record.body(data)
    if record.opcode in PROMISING:
        found.promise.take(record.opcode, body)
    if record.opcode == Opcode.CHUNK:
        content = layout.chunk_content(body)
        layout.chunk_heads(content)  # raises where a message of it is damaged
        for opcode, definition in layout.chunk_definitions(content):
            _define(opcode, definition, found)
        found.chunks.append(record)
    elif record.opcode == Opcode.MESSAGE:
        layout.message_of(body)
        found.chunks.append(record)
    elif record.opcode == Opcode.METADATA:
        metadata = layout.metadata_of(body)
        found.metadata.append((metadata.name, metadata.metadata))
    elif record.opcode == Opcode.ATTACHMENT:
        found.attachments.append(layout.attachment_of(body))
    else:
        _define(record.opcode, body, found)


def _define(opcode: int, body: bytes, found: _Found) -> None:
    if opcode == Opcode.SCHEMA:
        schema = layout.schema_of(body)
        found.schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        channel = layout.channel_of(body)
        found.channels[channel.id] = channel


def _write(data: Any, found: _Found, report: RecoveryReport) -> None:
    # Written beside the target and renamed when whole, so that a target that exists is a good bag.
    partial = report.target.with_name(f".{report.target.name}.partial")
    partial.unlink(missing_ok=True)
    try:
        file = UnbufferedFile(partial)
        try:
            _copy(data, found, report, file)
            file.sync()
        finally:
            file.close()
        partial.rename(report.target)
    except OSError as error:
        raise BagWriteError(f"{report.target} cannot be written: {error.strerror}") from error
    finally:
        partial.unlink(missing_ok=True)


def _copy(data: Any, found: _Found, report: RecoveryReport, file: UnbufferedFile) -> None:
    writer = mcap_writer(file, CHUNK_SIZE, compress=True)
    writer.start(profile=PROFILE, library=found.promise.library)
    for name, metadata in found.metadata:
        writer.add_metadata(name, metadata)
    for attachment in found.attachments:
        writer.add_attachment(
            attachment.create_time,
            attachment.log_time,
            attachment.name,
            attachment.media_type,
            attachment.data,
        )
    report.attachments = len(found.attachments)
    schemas = {
        number: writer.register_schema(schema.name, schema.encoding, schema.data)
        for number, schema in found.schemas.items()
    }
    channels = {
        number: writer.register_channel(
            channel.topic,
            channel.message_encoding,
            schemas.get(channel.schema_id, 0),
            channel.metadata,
        )
        for number, channel in found.channels.items()
    }
    homeless = 0
    tally = _tally(data, found, report)
    copied: set[bytes] = set()
    for record in found.chunks:
        report.chunks += record.opcode == Opcode.CHUNK
        for message in _messages(data, record):
            if message.channel not in channels:
                homeless += 1
                continue
            if tally.doubles and (key := key_of(message)) in tally.doubles:
                if key in copied:
                    continue
                copied.add(key)
            writer.add_message(
                channels[message.channel],
                message.log_time,
                message.cdr,
                message.publish_time,
                message.sequence,
            )
            _count(report, found.channels[message.channel].topic, message.log_time)
    if homeless:
        report.messages_lost += homeless
        report.losses.append(
            f"{homeless} messages are lost because the definition of their topic is damaged."
        )
    writer.add_metadata(
        RECOVERY_METADATA,
        {"source": report.source.name, "losses": " ".join(report.losses) or NOTHING_LOST},
    )
    writer.finish()  # type: ignore[no-untyped-call]


def _tally(data: Any, found: _Found, report: RecoveryReport) -> BagTally:
    """Count what is to be copied, and say what the recording promised beyond that."""

    def messages() -> Iterator[layout.RawMessage]:
        return (message for record in found.chunks for message in _messages(data, record))

    tally = tally_of(
        (message[:4] for message in messages()),
        messages,
        found.channels,
        found.promise,
    )
    lost = sum(tally.missing.values())
    if report.losses and lost <= report.messages_lost:
        tally.missing = {}  # has been said
    report.messages_lost = max(report.messages_lost, lost)
    report.losses += [flaw.sentence for flaw in tally.flaws(report.source.name)]
    return tally


def _messages(data: Any, record: layout.RawRecord) -> list[layout.RawMessage]:
    body = record.body(data)
    if record.opcode == Opcode.MESSAGE:
        return [layout.message_of(body)]
    return layout.chunk_messages(layout.chunk_content(body))


def _count(report: RecoveryReport, topic: str, time: int) -> None:
    report.messages += 1
    report.topics[topic] = report.topics.get(topic, 0) + 1
    report.start_time = time if report.start_time is None else min(report.start_time, time)
    report.end_time = time if report.end_time is None else max(report.end_time, time)
