"""What is in a bag, at a glance, and whether it is whole. Works on cut and damaged bags too."""

from collections import defaultdict
from dataclasses import dataclass, field
from math import nan
from pathlib import Path
from typing import Any, NamedTuple

from stepdiag_ros import topics
from stepdiag_ros.bags.bag import Bag, RecordedMessage
from stepdiag_ros.bags.errors import BagCorruptError, BagCutError, BagError
from stepdiag_ros.bags.folder import open_bag
from stepdiag_ros.bags.header import RunHeader
from stepdiag_ros.bags.passes import end_words
from stepdiag_ros.bags.repetitions import Repetitions
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.bags.runs import full_names, runs_in
from stepdiag_ros.bags.sample_check import SampleCheck
from stepdiag_ros.bags.seal import Seal, read_seal
from stepdiag_ros.bags.tally import Flaw
from stepdiag_ros.bags.timing import timing_of
from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.diagnosis import to_diagnosis
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.metrology.time_alignment import RunTiming
from stepdiag_ros.schemas import info as parts
from stepdiag_ros.schemas import lead, seal_check
from stepdiag_ros.schemas.parts import part_of

_AT_THE_END = 60 * 10**9
"""ns before the end of a bag, in which the last state of its run is looked for."""


@dataclass(frozen=True)
class SequenceGap:
    """A jump in the sequence of the readings: between which numbers, at which time (ns)."""

    after: int
    before: int
    time: int

    @property
    def missing(self) -> int:
        """Return how many readings are missing for certain; 0 if the count went back.

        The count goes back when the instrument starts again or readings are doubled. How many are
        missing there is unknown.
        """
        return max(self.before - self.after - 1, 0)


class RunInBag(NamedTuple):
    """One run in a bag.

    Attributes:
        run_id: its identity.
        namespace: that its topics are in.
        plan: name of its plan; empty if that cannot be read.
        software_version: of stepdiag_ros that made it.
        start_time: ns.
        end: how it ended, in words; empty if the recording does not state it.
        stops_done: settled stops when it ended.
        stops_total: stops in its plan; 0 if the recording does not state them.
    """

    run_id: str
    namespace: str
    plan: str
    software_version: str
    start_time: int
    end: str = ""
    stops_done: int = 0
    stops_total: int = 0


@dataclass
class BagInfo:
    """Summary of a bag.

    Attributes:
        path: of the file.
        size: bytes.
        complete: the file has its end.
        intact: every checksum is right; None if unknown because the file has no end.
        problem: what is wrong, and what to do; empty if nothing is.
        header: identity of the run; None if the bag has none.
        runs: what is known of each run in the bag, in the order of their starts.
        start_time: first log time, ns.
        end_time: last log time, ns.
        topics: full name → type and number of messages.
        repetitions: messages that were published again for late subscribers and count once
            elsewhere.
        lines: finished lines, in words, in the order of measurement.
        diagnosis: what the last diagnosis beside the run says, in words; empty without a diagnosis.
        flaws: what is wrong with the recording: missing, doubled, out of order.
        seal: beside the bag; None without a seal.
        gaps: in the sequence of the readings.
        samples: namespace → what is there of the samples of its interferometer, where it has sent
            any.
        timing: how late the readings of the run are stamped; None where that cannot be asked.
        settle: s from in position to the begin of a stop's window; NaN without ``timing``.
        chunks: number of chunks.
        data_checksum: a checksum covers the whole file, not only each chunk.
    """

    path: Path
    size: int = 0
    complete: bool = False
    intact: bool | None = None
    problem: str = ""
    header: RunHeader | None = None
    runs: list[RunInBag] = field(default_factory=list)
    start_time: int = 0
    end_time: int = 0
    topics: dict[str, tuple[str, int]] = field(default_factory=dict)
    repetitions: int = 0
    lines: list[str] = field(default_factory=list)
    diagnosis: str = ""
    flaws: tuple[Flaw, ...] = ()
    seal: Seal | None = None
    gaps: list[SequenceGap] = field(default_factory=list)
    samples: dict[str, SampleCheck] = field(default_factory=dict)
    timing: RunTiming | None = None
    settle: float = nan
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

    def document(self) -> parts.Document:
        """Return the summary as a document; times in ns, duration in s, size in bytes."""
        header = self.header
        return part_of(
            parts.Document,
            self,
            path=str(self.path),
            run=None if header is None else header.metadata(),
            runs=[parts.RunInBag(**run._asdict()) for run in self.runs],
            attachments=[]
            if header is None
            else [attachment.name for attachment in header.attachments()],
            topics=[
                parts.Topic(name=name, type=type_name, messages=count)
                for name, (type_name, count) in self.topics.items()
            ],
            diagnosis=self.diagnosis or None,
            recording=[lead.Flaw(**flaw.as_dict()) for flaw in self.flaws],
            seal=None if self.seal is None else seal_check.Seal(**self.seal.as_dict()),
            gaps=[
                parts.Gap(after=gap.after, before=gap.before, time=gap.time) for gap in self.gaps
            ],
            missing_readings=sum(gap.missing for gap in self.gaps),
            samples=[
                part_of(
                    parts.Samples,
                    check,
                    namespace=namespace,
                    readings_made_again=check.made,
                    readings_different=check.different,
                )
                for namespace, check in self.samples.items()
            ],
            timing=_timing(self.timing),
        )


def bag_info(path: str | Path, run_id: str | None = None) -> BagInfo:
    """Summarise a bag; a cut or damaged one is summarised as far as ``problem`` states.

    Args:
        path: the bag.
        run_id: list lines and diagnosis of this run only; of all if None.

    Raises:
        BagError: the file is not there or no MCAP file, or it does not hold that run.
    """
    info = BagInfo(Path(path))
    files = info.path.iterdir() if info.path.is_dir() else (info.path,)
    info.size = sum(file.stat().st_size for file in files if file.is_file())
    info.seal = read_seal(info.path)
    try:
        with open_bag(path) as bag:
            info.complete = True
            _summarise(bag, info, run_id)
            info.intact = True
        _add_timing(info, run_id)
    except BagCutError as error:
        info.problem = str(error)
    except BagCorruptError as error:
        info.complete, info.intact, info.problem = True, False, str(error)
    if info.seal is not None and not info.seal.right and not info.problem:
        info.problem = f"the seal of {info.path} is wrong: {info.seal.problem}"
    return info


def _summarise(bag: Bag, info: BagInfo, run_id: str | None) -> None:
    info.chunks = bag.chunk_count
    info.data_checksum = bag.has_data_checksum
    info.start_time, info.end_time = bag.start_time, bag.end_time
    info.flaws = bag.flaws()
    try:
        info.header = bag.header
    except BagError:
        info.header = None  # recorded by something else, which is not a fault
    info.runs = _runs_of(bag)
    if run_id is not None and run_id not in [run.run_id for run in info.runs]:
        raise BagError(
            f"{bag.path} holds no run '{run_id}', but"
            f" {', '.join(run.run_id for run in info.runs) or 'none'}"
        )
    counts = dict.fromkeys(bag.topics, 0)
    sequences: dict[str, int] = {}
    repetitions = Repetitions()
    sampled = topics.SAMPLES.type_name in bag.topics.values()
    checks: defaultdict[str, SampleCheck] = defaultdict(SampleCheck)
    states: dict[str, Any] = {}
    for record in bag.records():
        counts[record.topic] += 1
        known = topics.topic_of(record.topic)
        if known is None:
            continue
        if not repetitions.is_news(record):
            info.repetitions += 1
        elif known[0] is topics.READING:
            message = bag.decode(record)
            _follow(message, record.topic, sequences, info)
            if sampled:
                checks[known[1]].take_reading(message)
        elif known[0] is topics.RUN_STATE:
            message = bag.decode(record)
            states[message.run_id] = message
        elif known[0] is topics.SAMPLES:
            _check_samples(bag, record, checks[known[1]])
        elif known[0] in (topics.LINE, topics.DIAGNOSIS):
            message = bag.decode(record)
            if run_id in (None, message.run_id):
                _conclude(bag, record, message, info)
    info.runs = [_ended(run, states.get(run.run_id)) for run in info.runs]
    info.topics = {name: (type_name, counts[name]) for name, type_name in bag.topics.items()}
    info.samples = {where: check for where, check in checks.items() if check.blocks}


def _check_samples(bag: Bag, record: RecordedMessage, check: SampleCheck) -> None:
    bag.converted(record, check.take_samples)


def _add_timing(info: BagInfo, run_id: str | None) -> None:
    """Add how readings and positions fit in time, if the bag has both of one run."""
    types = [type_name for type_name, count in info.topics.values() if count]
    needed = (topics.READING, topics.JOINT_STATES, topics.STOP)
    if not all(topic.type_name in types for topic in needed):
        return
    if run_id is None and len(info.runs) != 1:
        return
    try:
        run = load_run(info.path, run_id)
    except BagError:
        return  # of a newer version, for example, which is not a fault
    info.timing, info.settle = timing_of(run), run.plan.sampling.settle


def _timing(timing: RunTiming | None) -> parts.Timing | None:
    if timing is None:
        return None
    offset = timing.offset
    return part_of(
        parts.Timing,
        offset,
        lines=len(timing.lines),
        drift=timing.drift,
        drift_uncertainty=timing.drift_uncertainty,
    )


def _runs_of(bag: Bag) -> list[RunInBag]:
    found = []
    for run in runs_in(bag).values():
        try:
            plan = plan_from_text(run.description.plan, "plan").name
        except ValueError:
            plan = ""
        version = str(run.description.software_version)
        found.append(RunInBag(run.run_id, run.namespace, plan, version, run.start_time))
    return found


def end_of(path: Path) -> str:
    """Return how the run in a bag ended, in words; empty where the bag does not state it.

    Raises:
        BagError: the bag cannot be read.
    """
    with open_bag(path) as bag:
        names = full_names(bag, topics.RUN_STATE)
        last = list(bag.records(topics=names, start=bag.end_time - _AT_THE_END))[-1:]
        states = [bag.decode(record) for record in last]
    return "".join(end_words(int(state.state), str(state.text)) for state in states)


def _ended(run: RunInBag, state: Any) -> RunInBag:
    """Return the run with its end, by its last RunState; None if none was recorded."""
    if state is None:
        return run
    end = end_words(int(state.state), str(state.text))
    done, total = int(state.stops_done), int(state.stops_total)
    return run._replace(end=end, stops_done=done, stops_total=total)


def _conclude(bag: Bag, record: RecordedMessage, message: Any, info: BagInfo) -> None:
    if record.type_name == topics.LINE.type_name:
        info.lines.append(str(bag.converted(record, conversion.to_measured_line, message).line))
    else:
        info.diagnosis = bag.converted(record, to_diagnosis, message).words


def _follow(message: Any, topic: str, sequences: dict[str, int], info: BagInfo) -> None:
    sequence = int(message.sequence)
    last = sequences.get(topic)
    if last is not None and sequence != last + 1:
        time = to_nanoseconds(message.header.stamp)
        info.gaps.append(SequenceGap(last, sequence, time))
    sequences[topic] = sequence
