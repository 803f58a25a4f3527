"""The document ``info``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from stepdiag_ros.schemas.lead import Flaw
from stepdiag_ros.schemas.parts import Count, Number, Text, Words, means
from stepdiag_ros.schemas.seal_check import Seal


@dataclass(frozen=True, kw_only=True)
class RunInBag:
    """One run of the bag."""

    run_id: str
    namespace: Annotated[str, means("That the run's topics are in.")]
    plan: Annotated[str, means("Name of the test plan; empty if that cannot be read.")]
    software_version: Annotated[str, means("Version of stepdiag_ros that made the run.")]
    start_time: Annotated[int, means("ns.")]
    end: Annotated[str, means("How the run ended; empty if the recording does not state it.")] = ""
    stops_done: Annotated[Count, means("Settled stops when it ended.")] = 0
    stops_total: Annotated[Count, means("Stops in its plan; 0 if they are not recorded.")] = 0


@dataclass(frozen=True, kw_only=True)
class Topic:
    """What was recorded on a topic."""

    name: str
    type: str
    messages: Count


@dataclass(frozen=True, kw_only=True)
class Gap:
    """Readings that are missing."""

    after: Annotated[Count, means("Sequence number before the gap.")]
    before: Annotated[Count, means("Sequence number behind it.")]
    time: Annotated[Count, means("ns.")]


@dataclass(frozen=True, kw_only=True)
class Samples:
    """What was recorded of one fast interferometer."""

    namespace: Annotated[str, means("That the samples are in.")]
    blocks: Annotated[Count, means("Messages with samples.")]
    samples: Annotated[Count, means("In all blocks.")]
    rate: Annotated[float, Meta(ge=0), means("Samples in a second, Hz.")]
    missing: Annotated[Count, means("Samples that are not there between two that are.")]
    readings_made_again: Annotated[
        Count, means("Recorded readings that the samples are there for.")
    ]
    readings_different: Annotated[
        Count, means("Of these, how many differ from the samples in any bit.")
    ]


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Offset between readings and positions."""

    offset: Annotated[
        Number, means("s; positive: readings are stamped later; null if it is not known.")
    ]
    standard_uncertainty: Annotated[Number, means("Of the offset, s; null if it is not known.")]
    expanded_uncertainty: Annotated[
        Number, means("Half-width of the 95 % interval, s; null if it is not known.")
    ]
    degrees_of_freedom: Annotated[Count, means("Of the uncertainty.")]
    moves: Annotated[Count, means("That the offset was found from.")]
    lines: Annotated[Count, means("That have a result.")]
    drift: Annotated[
        Number, means("By which the offset grows, s/s; null with fewer than three lines.")
    ]
    drift_uncertainty: Annotated[
        Number, means("Standard uncertainty of the drift, s/s; null if it is not known.")
    ]
    others: Annotated[Sequence[float], means("Other offsets that fit about as well, s.")]
    reason: Annotated[str, means("Why the offset is not known; empty if it is.")]


@dataclass(frozen=True, kw_only=True)
class Document:
    """What is in a bag.

    Printed by `stepdiag info --json`. Here times are integers in nanoseconds.
    """

    path: str
    size: Annotated[Count, means("Bytes.")]
    complete: Annotated[bool, means("The file has its end.")]
    intact: Annotated[bool | None, means("Every checksum is right; null if that is unknown.")]
    problem: Annotated[str, means("What is wrong and what to do; empty if nothing is.")]
    run: Annotated[
        Annotated[
            Mapping[str, str],
            means(
                "Identity of the run, as texts: run_id, plan_name, software_version, schema_version"
                " of its messages, middleware, start_time (ns), and further facts."
            ),
        ]
        | None,
        means("Null if the bag has none."),
    ]
    runs: Annotated[
        Sequence[RunInBag],
        means(
            "The runs in the bag in the order of their starts; a recording of ros2 bag record may"
            " hold several."
        ),
    ]
    attachments: Words
    start_time: Annotated[Count, means("First log time, ns.")]
    end_time: Annotated[Count, means("Last log time, ns.")]
    duration: Annotated[float, Meta(ge=0), means("s.")]
    messages: Count
    topics: Sequence[Topic]
    repetitions: Annotated[
        Count,
        means(
            "Messages that were published again for late subscribers; they count in `messages` and"
            " `topics`, and once elsewhere."
        ),
    ]
    lines: Annotated[Words, means("Finished lines, in words.")]
    diagnosis: Annotated[
        Text, means("Sentence of the last diagnosis beside the run; null without a diagnosis.")
    ]
    recording: Annotated[
        Sequence[Flaw],
        means(
            "What is wrong with the recording, most serious first: empty if it holds what was"
            " recorded, as far as its counts show."
        ),
    ]
    seal: Annotated[Seal | None, means("The seal beside the bag; null without a seal.")]
    gaps: Annotated[Sequence[Gap], means("In the sequence of the readings.")]
    missing_readings: Count
    samples: Annotated[
        Sequence[Samples],
        means("Samples of fast interferometers, of which the readings were made."),
    ]
    timing: Annotated[
        Timing | None,
        means(
            "How late the readings are stamped against the positions; null if the bag does not have"
            " both of one run."
        ),
    ]
    chunks: Count
    data_checksum: Annotated[bool, means("A checksum covers the whole file.")]
