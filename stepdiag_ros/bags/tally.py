"""Whether a recording holds what was recorded: each message once, none missing, in its order.

Checksums show damage. A bag that was changed by a program has the right ones, whatever
it lacks. Counts show what it lacks. Our writer numbers the messages of each topic and writes at the
end how many there were; the file's statistics count them as well.
"""

import re
import struct
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from hashlib import blake2b
from typing import Any, Literal, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel

from stepdiag_ros import topics
from stepdiag_ros.bags import layout
from stepdiag_ros.bags.layout import MessageHead, RawMessage

LIBRARY = "stepdiag_ros"
"""How our writer begins to name itself in a file's header."""
COUNTS_METADATA = "stepdiag_ros.counts"
"""Name of the metadata record that our writer ends with: full name of a topic → messages."""
RECOVERY_METADATA = "stepdiag_ros.recovery"
"""Name of the metadata record in which a recovered bag names its source and what is lost."""
NOTHING_LOST = "Nothing was lost."
_NEVER_TWICE = (
    topics.READING,
    topics.SAMPLES,
    topics.MACHINE_COMMAND,
    topics.COMMAND_STATUS,
    topics.STOP,
    topics.BLOCK,
)
"""Nobody publishes the same bytes on these topics twice, even where messages are not numbered."""
_MOST_TOPICS = 6
_COUNT = re.compile(r"[0-9]{1,18}")
_HEAD = struct.Struct("<HIQQ")

PROMISING = (Opcode.HEADER, Opcode.STATISTICS, Opcode.METADATA)
"""Records of a file that say what is in it."""

Kind = Literal["missing", "doubled", "out_of_order", "different", "begun_late", "recovered"]


class Flaw(NamedTuple):
    """One way in which a recording is not what was recorded.

    Attributes:
        kind: ``missing``: what was recorded is not there; ``doubled``: it is there more than once,
            and counted once; ``out_of_order``: it does not stand in the order of recording;
            ``different``: it does not follow from the readings; ``begun_late``: the recording began
            after the run; ``recovered``: it was made whole after damage, and lost something.
        sentence: in words, with what to do.
        messages: full name of a topic → how many messages; empty where that is not known.
    """

    kind: Kind
    sentence: str
    messages: Mapping[str, int] = {}

    def as_dict(self) -> dict[str, Any]:
        """Return the flaw as plain data for JSON."""
        return {"kind": self.kind, "sentence": self.sentence, "messages": dict(self.messages)}


def key_of(message: RawMessage) -> bytes:
    """Return what is the same for two messages of a bag only if one is a copy of the other."""
    head = _HEAD.pack(*message[:4])
    return blake2b(head + message.cdr, digest_size=16).digest()


@dataclass
class BagTally:
    """What was counted in a bag; every count by full name of the topic.

    Attributes:
        messages: each counted once.
        doubled: further copies of a message.
        missing: that were recorded and are not there.
        misplaced: that stand behind a message that was recorded later.
        doubles: keys of what is there more than once.
    """

    messages: Counter[str] = field(default_factory=Counter)
    doubled: Counter[str] = field(default_factory=Counter)
    missing: dict[str, int] = field(default_factory=dict)
    misplaced: Counter[str] = field(default_factory=Counter)
    doubles: set[bytes] = field(default_factory=set)

    def flaws(self, name: str) -> Iterator[Flaw]:
        """Say what is wrong with the recording, most serious first.

        Args:
            name: what the user calls the bag.
        """
        if self.missing:
            yield Flaw(
                "missing",
                f"{name} lacks messages that were recorded: {_listed(self.missing)}. What follows"
                " is made of the rest; use the original recording.",
                self.missing,
            )
        if self.misplaced:
            yield Flaw(
                "out_of_order",
                f"{name} was changed after it was recorded: messages do not stand in the order of"
                f" recording ({_listed(self.misplaced)}). They are read in the order of times.",
                self.misplaced,
            )
        if self.doubled:
            yield Flaw(
                "doubled",
                f"{name} was changed after it was recorded: messages are in it more than once"
                f" ({_listed(self.doubled)}). Each counts once.",
                self.doubled,
            )


@dataclass
class Promise:
    """What a bag itself says that it holds.

    Attributes:
        library: that made the file, with its version.
        by_channel: messages of each channel, by the file's statistics; None without them.
        by_topic: by our writer's last record; None if it was not closed by it.
    """

    library: str = ""
    by_channel: Mapping[int, int] | None = None
    by_topic: Mapping[str, int] | None = None

    @property
    def numbered(self) -> bool:
        """Say whether our writer made it, which numbers the messages of each topic from 1."""
        return self.library.split(" ")[0] == LIBRARY

    def take(self, opcode: int, body: bytes) -> None:
        """Take note of a record of the file, if it promises something; raises ``Damaged``."""
        if opcode == Opcode.HEADER:
            self.library = layout.header_of(body).library
        elif opcode == Opcode.STATISTICS:
            self.by_channel = layout.statistics_of(body).channel_message_counts
        elif opcode == Opcode.METADATA:
            metadata = layout.metadata_of(body)
            if metadata.name == COUNTS_METADATA:
                self.by_topic = {
                    topic: int(text)
                    for topic, text in metadata.metadata.items()
                    if _COUNT.fullmatch(text)
                }


def recovery_flaws(name: str, metadata: Mapping[str, Mapping[str, str]]) -> Iterator[Flaw]:
    """Say what was lost before a bag was recovered.

    Args:
        name: what the user calls the bag.
        metadata: of the bag: name → texts.
    """
    losses = metadata.get(RECOVERY_METADATA, {}).get("losses", NOTHING_LOST)
    if losses != NOTHING_LOST:
        yield Flaw("recovered", f"{name} was recovered from a damaged recording. {losses}")


def tally_of(
    heads: Iterable[MessageHead],
    messages: Callable[[], Iterator[RawMessage]],
    channels: Mapping[int, Channel],
    promise: Promise,
) -> BagTally:
    """Count the messages of a bag and compare with what it promises.

    Only messages that come neither later nor with a higher number than all before them are
    remembered, so that a bag that nobody has changed costs no memory.

    Args:
        heads: of all messages as they stand in the file.
        messages: goes through the same messages; only called where copies may be among them.
        channels: of the bag.
        promise: what it says of itself.
    """
    tally = BagTally()
    numbers, spots = _first_pass(heads)
    for number, seen in numbers.items():
        if number in channels:
            tally.messages[channels[number].topic] += seen.count
    if spots:
        _note_doubled(messages(), channels, spots, tally)
        if promise.numbered:
            _note_misplaced(messages(), channels, tally)
    _note_missing(tally, numbers, channels, promise)
    return tally


@dataclass
class _Numbers:
    """What was seen of a channel: messages, their highest number, their latest time."""

    count: int = 0
    high: int = 0
    latest: int = -1


def _first_pass(heads: Iterable[MessageHead]) -> tuple[dict[int, _Numbers], set[int]]:
    """Return what was seen of each channel, and hashes of where copies may be, or misplaced ones.

    A copy comes with the number and the time of a message before it.
    """
    found: defaultdict[int, _Numbers] = defaultdict(_Numbers)
    spots: set[int] = set()
    for channel, sequence, log_time, _ in heads:
        seen = found[channel]
        seen.count += 1
        if log_time > seen.latest:
            seen.latest = log_time
        elif sequence <= seen.high:
            spots.add(hash((channel, sequence, log_time)))
        if sequence > seen.high:
            seen.high = sequence
    return found, spots


def _note_doubled(
    messages: Iterator[RawMessage],
    channels: Mapping[int, Channel],
    spots: set[int],
    tally: BagTally,
) -> None:
    never_twice = {number for number, one in channels.items() if _never_twice(one.topic)}
    heard: set[bytes] = set()
    for message in messages:
        if hash(message[:3]) not in spots or message.channel not in channels:
            continue
        if not message.sequence and message.channel not in never_twice:
            continue
        key = key_of(message)
        if key in heard:
            topic = channels[message.channel].topic
            tally.doubled[topic] += 1
            tally.messages[topic] -= 1
            tally.doubles.add(key)
        heard.add(key)


def _never_twice(topic: str) -> bool:
    found = topics.topic_of(topic)
    return found is not None and found[0] in _NEVER_TWICE


def _note_misplaced(
    messages: Iterator[RawMessage], channels: Mapping[int, Channel], tally: BagTally
) -> None:
    """Count messages that come after one with a higher number, copies left out."""
    highest: defaultdict[int, int] = defaultdict(int)
    for message in messages:
        channel, sequence = message[:2]
        fallen = 0 < sequence < highest[channel] and channel in channels
        if fallen and key_of(message) not in tally.doubles:
            tally.misplaced[channels[channel].topic] += 1
        highest[channel] = max(highest[channel], sequence)


def _note_missing(
    tally: BagTally,
    numbers: Mapping[int, _Numbers],
    channels: Mapping[int, Channel],
    promise: Promise,
) -> None:
    promised: Counter[str] = Counter()
    uncounted: Counter[str] = Counter()
    for number, channel in channels.items():
        seen = numbers.get(number, _Numbers())
        if promise.numbered:
            # A topic is registered with its first message.
            promised[channel.topic] += seen.high if seen.count else 1
        # Statistics count every copy.
        counted = (promise.by_channel or {}).get(number, 0)
        uncounted[channel.topic] += max(counted - seen.count, 0)
    for topic, count in (promise.by_topic or {}).items():
        promised[topic] = max(promised[topic], count)
    for topic in (*promised, *uncounted):
        missing = max(promised[topic] - tally.messages[topic], uncounted[topic])
        if missing > 0:
            tally.missing[topic] = missing


def _listed(counts: Mapping[str, int]) -> str:
    named = sorted(counts.items(), key=lambda one: -one[1])
    words = ", ".join(f"{count} on {topic}" for topic, count in named[:_MOST_TOPICS])
    more = len(named) - _MOST_TOPICS
    return f"{words} and on {more} topics more" if more > 0 else words
