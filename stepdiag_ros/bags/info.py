"""What is in a bag, at a glance, and whether it is whole. Works on cut and damaged bags too."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stepdiag_ros import conversion, topics
from stepdiag_ros.bags.errors import BagCorruptError, BagCutError, BagError
from stepdiag_ros.bags.header import RunHeader
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.diagnosis_conversion import to_diagnosis


@dataclass(frozen=True)
class SequenceGap:
    """Readings that are missing: between these two sequence numbers, at this time (ns)."""

    after: int
    before: int
    time: int

    @property
    def missing(self) -> int:
        """Return how many readings are missing; negative if the count went back."""
        return self.before - self.after - 1


@dataclass
class BagInfo:
    """Summary of a bag.

    Attributes:
        path: of the file.
        size: bytes.
        complete: the file has its end.
        intact: every checksum is right; None if that cannot be said of a file without its end.
        problem: what is wrong, and what to do; empty if nothing is.
        header: identity of the run; None if the bag has none.
        start_time: first log time, ns.
        end_time: last log time, ns.
        topics: full name → type and number of messages.
        lines: finished lines, in words, in the order of measurement.
        diagnosis: what the last diagnosis beside the run says, in words; empty if there is none.
        gaps: in the sequence of the readings.
        chunks: number of chunks.
        data_checksum: a checksum covers the whole file, not only each chunk.
    """

    path: Path
    size: int = 0
    complete: bool = False
    intact: bool | None = None
    problem: str = ""
    header: RunHeader | None = None
    start_time: int = 0
    end_time: int = 0
    topics: dict[str, tuple[str, int]] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)
    diagnosis: str = ""
    gaps: list[SequenceGap] = field(default_factory=list)
    chunks: int = 0
    data_checksum: bool = False

    @property
    def duration(self) -> float:
        """Return the time from the first message to the last, s."""
        return (self.end_time - self.start_time) / 1e9

    @property
    def messages(self) -> int:
        """Return the number of messages."""
        return sum(count for _, count in self.topics.values())

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as plain data for JSON; times in ns, duration in s, size in bytes."""
        header = self.header
        return {
            "path": str(self.path),
            "size": self.size,
            "complete": self.complete,
            "intact": self.intact,
            "problem": self.problem,
            "run": None if header is None else header.metadata(),
            "attachments": []
            if header is None
            else [attachment.name for attachment in header.attachments()],
            "start_time": self.start_time,
            "end_time": self.end_time,
            "duration": self.duration,
            "messages": self.messages,
            "topics": [
                {"name": name, "type": type_name, "messages": count}
                for name, (type_name, count) in self.topics.items()
            ],
            "lines": list(self.lines),
            "diagnosis": self.diagnosis or None,
            "gaps": [
                {"after": gap.after, "before": gap.before, "time": gap.time} for gap in self.gaps
            ],
            "missing_readings": sum(gap.missing for gap in self.gaps),
            "chunks": self.chunks,
            "data_checksum": self.data_checksum,
        }


def bag_info(path: str | Path) -> BagInfo:
    """Summarise a bag; a cut or damaged one is summarised as far as that is said in ``problem``.

    Raises:
        BagError: the file is not there or no MCAP file.
    """
    info = BagInfo(Path(path))
    if info.path.is_file():
        info.size = info.path.stat().st_size
    try:
        with BagReader(path) as bag:
            info.complete = True
            _summarise(bag, info)
            info.intact = True
    except BagCutError as error:
        info.problem = str(error)
    except BagCorruptError as error:
        info.complete, info.intact, info.problem = True, False, str(error)
    return info


def _summarise(bag: BagReader, info: BagInfo) -> None:
    info.chunks = bag.chunk_count
    info.data_checksum = bag.has_data_checksum
    info.start_time, info.end_time = bag.start_time, bag.end_time
    try:
        info.header = bag.header
    except BagError:
        info.header = None  # recorded by something else, which is no fault
    counts = dict.fromkeys(bag.topics, 0)
    sequences: dict[str, int] = {}
    for record in bag.records():
        counts[record.topic] += 1
        known = topics.topic_of(record.topic)
        if known is None:
            continue
        if known[0] is topics.READING:
            _follow(bag.decode(record), record.topic, sequences, info)
        elif known[0] is topics.LINE:
            info.lines.append(str(conversion.to_measured_line(bag.decode(record)).line))
        elif known[0] is topics.DIAGNOSIS:
            info.diagnosis = to_diagnosis(bag.decode(record)).words
    info.topics = {name: (type_name, counts[name]) for name, type_name in bag.topics.items()}


def _follow(message: Any, topic: str, sequences: dict[str, int], info: BagInfo) -> None:
    sequence = int(message.sequence)
    last = sequences.get(topic)
    if last is not None and sequence != last + 1:
        time = conversion.to_nanoseconds(message.header.stamp)
        info.gaps.append(SequenceGap(last, sequence, time))
    sequences[topic] = sequence
