"""The readings of a run out of its bag, many at a time."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice, repeat, starmap

import numpy as np
import numpy.typing as npt

from stepdiag_ros import topics
from stepdiag_ros.bags.bag import Bag, Payloads, RecordedMessage
from stepdiag_ros.bags.columns import columns_of
from stepdiag_ros.bags.runs import FoundRun, records_of
from stepdiag_ros.messages import conversion
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.metrology.units import NANOSECONDS

_AT_ONCE = 4096
"""Readings in a batch: enough that a batch costs little, few enough that memory does not count."""
_MOST_KEPT = 250_000
"""Readings of a run that stay in memory once they were read, 86 bytes each."""


@dataclass(frozen=True)
class ReadingBatch:
    """Readings that follow each other in the bag, as columns; iteration makes each a ``Reading``.

    Attributes:
        time: of measurement, ns, shape (n,).
        sequence: number of each, shape (n,).
        values: raw displacement, compensated displacement (m) and signal strength, shape (3, n).
        status: shape (n,).
        environment: in the order of ``Environment``, shape (n, 4).
        trigger: shape (n,).
    """

    time: npt.NDArray[np.int64]
    sequence: npt.NDArray[np.uint64]
    values: npt.NDArray[np.float64]
    status: npt.NDArray[np.uint8]
    environment: npt.NDArray[np.float64]
    trigger: npt.NDArray[np.uint64]

    @classmethod
    def of(cls, readings: Sequence[Reading]) -> "ReadingBatch":
        """Return readings as a batch."""
        return cls(
            time=np.array([one.time for one in readings], np.int64),
            sequence=np.array([one.sequence for one in readings], np.uint64),
            values=np.array([one[2:5] for one in readings], np.float64).reshape(-1, 3).T,
            status=np.array([one.status for one in readings], np.uint8),
            environment=np.array([one.environment for one in readings], np.float64),
            trigger=np.array([one.trigger for one in readings], np.uint64),
        )

    def __iter__(self) -> Iterator[Reading]:
        return starmap(
            Reading,
            zip(
                self.time.tolist(),
                self.sequence.tolist(),
                *self.values.tolist(),
                self.status.tolist(),
                self._environments(),
                self.trigger.tolist(),
                strict=True,
            ),
        )

    def _environments(self) -> Iterator[Environment]:
        """Go through the environments; readings of the same weather share theirs."""
        bits = np.ascontiguousarray(self.environment).view(np.uint64)
        new = np.flatnonzero((bits[1:] != bits[:-1]).any(axis=1)) + 1
        begins = [0, *new.tolist()] if len(bits) else []
        counts = np.diff([*begins, len(bits)]).tolist()
        shared = starmap(Environment, self.environment[begins].tolist())
        return chain.from_iterable(map(repeat, shared, counts))


class RunReadings:
    """The readings of a run, for who goes through them more than once.

    Those of a short run stay in memory; those of a long one are read from the bag each time.

    Args:
        bag: open as long as the readings are in use.
        run: which in it.
    """

    def __init__(self, bag: Bag, run: FoundRun) -> None:
        self._bag, self._run = bag, run
        self._kept: tuple[ReadingBatch, ...] | None = None

    def batches(self) -> Iterator[ReadingBatch]:
        """Go through the readings as ``reading_batches`` does."""
        if self._kept is not None:
            yield from self._kept
            return
        kept: list[ReadingBatch] = []
        count = 0
        for batch in reading_batches(self._bag, self._run):
            count += len(batch.time)
            if count <= _MOST_KEPT:
                kept.append(batch)
            else:
                kept.clear()
            yield batch
        if count <= _MOST_KEPT:
            self._kept = tuple(kept)


def reading_batches(bag: Bag, run: FoundRun) -> Iterator[ReadingBatch]:
    """Go through the readings of a run in the order in which they were recorded.

    Raises:
        BagError: a message is not a reading; the text names topic and time.
    """
    name = topics.absolute(topics.READING, run.namespace)
    if run.alone:
        yield from (_batch_of(bag, name, some) for some in _gathered(bag.payloads(name)))
        return
    found = (
        bag.converted(record, conversion.to_reading, message)
        for record, message in records_of(bag, run, (name,))
    )
    while batch := list(islice(found, _AT_ONCE)):
        yield ReadingBatch.of(batch)


def _gathered(parts: Iterable[Payloads]) -> Iterator[Payloads]:
    """Put what is of one type together until it is enough for a batch."""
    type_name, times, data = "", list[int](), list[bytes]()
    for part in parts:
        if data and (part.type_name != type_name or len(data) >= _AT_ONCE):
            yield Payloads(type_name, times, data)
            times, data = [], []
        type_name = part.type_name
        times += part.times
        data += part.data
    if data:
        yield Payloads(type_name, times, data)


def _batch_of(bag: Bag, topic: str, some: Payloads) -> ReadingBatch:
    messages = zip(some.times, some.data, strict=True)
    records = (RecordedMessage(topic, some.type_name, time, time, 0, cdr) for time, cdr in messages)
    first = next(records)
    bag.decode(first)  # says what is wrong with the topic or its definition
    found = columns_of(bag.types, some.type_name, some.data)
    if found is None:
        every = chain((first,), records)
        return ReadingBatch.of([bag.converted(record, conversion.to_reading) for record in every])
    seconds = found["header.stamp.sec"].astype(np.int64)
    lengths = ("raw_displacement", "compensated_displacement", "signal_strength")
    return ReadingBatch(
        time=seconds * NANOSECONDS + found["header.stamp.nanosec"],
        sequence=found["sequence"].copy(),  # not a view, which would keep all the messages
        values=np.stack([found[name] for name in lengths]),
        status=found["status"].copy(),
        environment=np.column_stack([found[name] for name in Environment._fields]),
        # Bags from before this was recorded do not tell it.
        trigger=found.get("trigger", np.zeros(len(some.data), np.uint64)).copy(),
    )
