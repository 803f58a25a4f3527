"""Whether a run holds what its own messages promise: by numbers that the nodes gave them.

These hold for bags of every recorder. Readings count by one, commands too. A settled
stop names the readings that it was made from, a line its stops, and a stop the command that led to
it.
"""

from array import array
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stepdiag_ros import topics
from stepdiag_ros.bags.readings import ReadingBatch
from stepdiag_ros.bags.tally import Flaw, Kind
from stepdiag_ros.metrology.measurement import Arrival, BlockDisplacement, MeasuredLine, SettledStop
from stepdiag_ros.topics import Topic

_ENDED = (4, 5, 6)
"""``RunState``: FINISHED, ABORTED, FAULT."""


class ReadingNumbers:
    """Times (ns) and sequence numbers of the readings, in the order of the file.

    Only stretches are kept in which the numbers count by one and the times do not fall: one in a
    recording that lacks nothing, however long it is.
    """

    def __init__(self) -> None:
        self._times, self._first, self._last = array("q"), array("Q"), array("Q")
        self._latest = 0
        self._misplaced = 0

    def take(self, times: npt.NDArray[np.int64], sequences: npt.NDArray[np.uint64]) -> None:
        """Note the readings that come next.

        Args:
            times: ns, shape (n,).
            sequences: shape (n,).
        """
        if self._last:
            times = np.concatenate([[self._latest], times])
            sequences = np.concatenate([np.array(self._last[-1:], np.uint64), sequences])
        elif len(times):
            self._begin(times[0], sequences[0])
        fallen = times[1:] < times[:-1]
        self._misplaced += int(np.count_nonzero(fallen & (sequences[1:] < sequences[:-1])))
        # Unsigned numbers: the one after the highest is 0, which follows nothing.
        follows = (sequences[1:] - sequences[:-1] == 1) & (sequences[1:] > 0)
        for place in np.flatnonzero(fallen | ~follows).tolist():
            self._last[-1] = int(sequences[place])
            self._begin(times[place + 1], sequences[place + 1])
        if len(times):
            self._last[-1], self._latest = int(sequences[-1]), int(times[-1])

    def _begin(self, time: np.int64, sequence: np.uint64) -> None:
        self._times.append(int(time))
        self._first.append(int(sequence))
        self._last.append(int(sequence))

    def missing(self) -> tuple[int, int]:
        """Return how many readings are missing between others, and in how many gaps.

        A number that falls while time goes on is that of an instrument that was started again.
        """
        first, last = np.asarray(self._first), np.asarray(self._last)
        if self._misplaced:
            order = np.argsort(np.asarray(self._times), kind="stable")
            first, last = first[order], last[order]
        before, after = last[:-1], first[1:]
        # Unsigned numbers: what falls must not be subtracted.
        gaps = (after - before - 1)[after > before]
        return sum(map(int, gaps)), int(np.count_nonzero(gaps))

    def misplaced(self) -> int:
        """Return how many readings have both time and number before those of the one before."""
        return self._misplaced

    def lacking(self, stops: Sequence[SettledStop]) -> int:
        """Return how many of these stops were made of more readings than are there."""
        first, last = np.asarray(self._first), np.asarray(self._last)
        lacking = 0
        for stop in stops:
            if stop.readings == 0 or stop.last_sequence < stop.first_sequence:
                continue
            low = np.maximum(first, np.uint64(stop.first_sequence))
            high = np.minimum(last, np.uint64(stop.last_sequence))
            there = high >= low
            found = int(np.sum((high - low)[there])) + int(np.count_nonzero(there))
            lacking += found < stop.readings
        return lacking


def numbers_of_readings(batches: Iterable[ReadingBatch]) -> ReadingNumbers:
    """Return the numbers of a run's readings, which come in the order of the file."""
    numbers = ReadingNumbers()
    for batch in batches:
        numbers.take(batch.time, batch.sequence)
    return numbers


class Recorded(NamedTuple):
    """What a bag holds of a run, as far as one part of it promises another.

    Attributes:
        namespace: of the run's topics.
        command_ids: of all commands to the machine.
        arrivals: in position.
        stops: settled or rejected.
        blocks: of the stops.
        lines: every attempt.
        last_state: ``RunState.state`` as last published; None if it never was.
        readings: their numbers.
    """

    namespace: str
    command_ids: Collection[int]
    arrivals: Sequence[Arrival]
    stops: Sequence[SettledStop]
    blocks: Sequence[BlockDisplacement]
    lines: Sequence[MeasuredLine]
    last_state: int | None
    readings: ReadingNumbers

    @property
    def first_command(self) -> int:
        """Return the lowest number of a command; 0 without a command."""
        return min(self.command_ids, default=0)

    def flaws(self, known: Collection[str], stops_of_lines: Sequence[int]) -> Iterator[Flaw]:
        """Say what the run lacks.

        Args:
            known: full names of topics that are known to lack messages.
            stops_of_lines: number of stops of each line of the plan.
        """
        if self.first_command > 1:
            before = self.first_command - 1
            yield self._flaw(
                "begun_late",
                topics.MACHINE_COMMAND,
                before,
                "The recording began after the run did: the first"
                f" {before} commands of the run are not in it, nor what was measured then.",
            )
        for topic, missing, what in self._missing(stops_of_lines):
            if missing and topics.absolute(topic, self.namespace) not in known:
                yield self._flaw("missing", topic, missing, f"The recording lacks {what}.")
        misplaced = self.readings.misplaced()
        if misplaced:
            yield self._flaw(
                "out_of_order",
                topics.READING,
                misplaced,
                f"Readings do not stand in the order of their times, at {misplaced} places: the"
                " recording was changed after it was made.",
            )

    def _flaw(self, kind: Kind, topic: Topic, count: int, sentence: str) -> Flaw:
        return Flaw(kind, sentence, {topics.absolute(topic, self.namespace): count})

    def _missing(self, stops_of_lines: Sequence[int]) -> Iterator[tuple[Topic, int, str]]:
        """Yield topic, number and words of what others promise and is not there."""
        missing, gaps = self.readings.missing()
        lacking = self.readings.lacking(self.stops)
        told = [
            f"{missing} readings of the interferometer, in {gaps} gaps of their sequence",
            f"readings that {lacking} stops were made of",
        ]
        words = " and ".join(
            text for text, count in zip(told, (missing, lacking), strict=True) if count
        )
        yield topics.READING, max(missing, lacking), words
        # Of a run that was not recorded by the nodes nothing more is promised; of one whose
        # beginning is missing it is not known what was before.
        if not self.command_ids or self.first_command > 1:
            return
        commands = self._commands_missing()
        yield topics.MACHINE_COMMAND, commands, f"{commands} commands to the machine"
        # Whoever records chooses topics: one of which nothing is there was not recorded.
        if self.arrivals:
            arrived = {one.command_id for one in self.arrivals}
            ends = len({stop.command.command_id for stop in self.stops} - arrived)
            yield topics.COMMAND_STATUS, ends, f"the bridge's word that {ends} moves had ended"
        if self.stops:
            stops = self._stops_missing()
            yield topics.STOP, stops, f"{stops} stops of lines that it has"
        if self.blocks:
            blocks = self._blocks_missing()
            yield (
                topics.BLOCK,
                blocks,
                f"{blocks} of the block displacements between stops that it has",
            )
        if self.lines:
            lines = self._lines_missing(stops_of_lines)
            yield topics.LINE, lines, f"{lines} lines whose last stop it has"
        # Of a run that broke off it is said that lines are missing, and how it ended.
        all_there = {line.line_index for line in self.lines}.issuperset(range(len(stops_of_lines)))
        if all_there and self.last_state not in (None, *_ENDED):
            yield topics.RUN_STATE, 1, "the end of the run, although it has all lines of the plan"

    def _commands_missing(self) -> int:
        ended = {stop.command.command_id for stop in self.stops}
        arrived = {arrival.command_id for arrival in self.arrivals}
        promised = max({*self.command_ids, *ended, *arrived})
        return promised - len(set(self.command_ids))

    def _stops_missing(self) -> int:
        there = {_place(stop) for stop in self.stops}
        promised = {
            (line.line_index, line.attempt, int(number))
            for line in self.lines
            for number in np.flatnonzero(np.isfinite(line.time))
        }
        return len(promised - there)

    def _blocks_missing(self) -> int:
        there = {(block.line_index, block.attempt, block.to_stop) for block in self.blocks}
        settled: dict[tuple[int, int, int], bool] = {}
        promised = set()
        for stop in self.stops:
            line_index, attempt, number = _place(stop)
            settled[line_index, attempt, number] = stop.settled
            if stop.settled and settled.get((line_index, attempt, number - 1)):
                promised.add((line_index, attempt, number))
        return len(promised - there)

    def _lines_missing(self, stops_of_lines: Sequence[int]) -> int:
        there = {(line.line_index, line.attempt) for line in self.lines}
        promised = {
            _place(stop)[:2]
            for stop in self.stops
            if stop.command.line_index < len(stops_of_lines)
            and stop.command.stop == stops_of_lines[stop.command.line_index] - 1
        }
        return len(promised - there)


def _place(stop: SettledStop) -> tuple[int, int, int]:
    return stop.command.line_index, stop.command.attempt, stop.command.stop
