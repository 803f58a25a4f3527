"""Which runs a bag holds, and what in it belongs to which.

A recorder of ours makes a bag for each run. ``ros2 bag record`` goes on from one run to the next,
records several cells at once, or begins in the middle.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.bags.bag import Bag, RecordedMessage
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.repetitions import without_repetitions
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.topics import Topic

_ALWAYS = 2**63


@dataclass(frozen=True)
class FoundRun:
    """One run in a bag.

    Attributes:
        namespace: that its topics are in.
        description: its RunDescription.
        begin: ns; what was measured before belongs to the run before.
        end: ns; what was measured from then on belongs to the run after.
        alone: it is the only one in the bag.
    """

    namespace: str
    description: Any
    begin: int
    end: int
    alone: bool

    @property
    def run_id(self) -> str:
        """Return its identity."""
        return str(self.description.run_id)

    @property
    def start_time(self) -> int:
        """Return when it was started, ns."""
        return to_nanoseconds(self.description.header.stamp)


def runs_in(bag: Bag) -> dict[str, FoundRun]:
    """Return the runs of a bag by their identity, in the order of their starts.

    Raises:
        BagError: a RunDescription cannot be decoded.
    """
    names = full_names(bag, topics.RUN_DESCRIPTION)
    told: dict[str, tuple[int, str, Any]] = {}
    for record, message in bag.messages(topics=names):
        start = to_nanoseconds(message.header.stamp)
        told.setdefault(message.run_id, (start, names[record.topic], message))
    found = {}
    for run_id, (start, namespace, message) in sorted(told.items(), key=lambda run: run[1][0]):
        beside = [other for other, where, _ in told.values() if where == namespace]
        found[run_id] = FoundRun(
            namespace,
            message,
            begin=start if any(other < start for other in beside) else -_ALWAYS,
            end=min((other for other in beside if other > start), default=_ALWAYS),
            alone=len(told) == 1,
        )
    return found


def choose_run(bag: Bag, run_id: str | None = None) -> FoundRun:
    """Return the run that is asked for.

    Args:
        bag: where to look.
        run_id: its identity; None for the only one.

    Raises:
        BagError: it is not in the bag, or the bag holds none, or several and none is named.
    """
    found = runs_in(bag)
    if not found:
        raise BagError(
            f"{bag.path} holds no run: there is no RunDescription in it", fault="missing"
        )
    if run_id is None and len(found) > 1:
        raise BagError(
            f"{bag.path} holds several runs; say which by --run: {', '.join(found)}",
            fault="ambiguous",
            aspect="run",
        )
    if run_id is not None and run_id not in found:
        raise BagError(
            f"{bag.path} holds no run '{run_id}', but {', '.join(found)}", fault="not_found"
        )
    return next(iter(found.values())) if run_id is None else found[run_id]


def records_of(
    bag: Bag, run: FoundRun, names: Collection[str] | None = None
) -> Iterator[tuple[RecordedMessage, Any]]:
    """Go through what belongs to a run, each message once, in the order of recording.

    Args:
        bag: that holds the run.
        run: which.
        names: full names of the wanted topics; all if None.

    Yields:
        record, and the decoded message where finding its run has needed it; None elsewhere.

    Raises:
        BagError: a message cannot be decoded.
    """
    for record in without_repetitions(bag.records(topics=names)):
        if run.alone:
            yield record, None
            continue
        message = bag.decode(record)
        if _belongs(message, record, run):
            yield record, message


def messages_of(
    bag: Bag, run: FoundRun, names: Collection[str] | None = None
) -> Iterator[tuple[RecordedMessage, Any]]:
    """Go through what belongs to a run and decode it; see ``records_of``."""
    for record, message in records_of(bag, run, names):
        yield record, bag.decode(record) if message is None else message


def full_names(bag: Bag, wanted: Topic) -> dict[str, str]:
    """Return the full names under which a topic is in a bag, and their namespaces."""
    found = {}
    for name in bag.topics:
        known = topics.topic_of(name)
        if known is not None and known[0] is wanted:
            found[name] = known[1]
    return found


def _belongs(message: Any, record: RecordedMessage, run: FoundRun) -> bool:
    named = getattr(message, "run_id", "")
    if named:
        return bool(named == run.run_id)
    known = topics.topic_of(record.topic)
    if known is not None and known[1] != run.namespace and not known[0].name.startswith("/"):
        return False
    header = getattr(message, "header", None)
    time = record.log_time if header is None else to_nanoseconds(header.stamp)
    return run.begin <= time < run.end
