"""What was found of each line of a plan in a recording: its stops and their windows, or why not.

A line is taken if its first and last stop and at least ``LEAST_PART`` of its stops were found, no
zero was lost within it, no other matching comes near (``rest_matching.SURE``), each stop is where
the plan has it (``expected_stop``), and no rest is left unexplained that could be a stop of another
program (``hand_surplus``). Stops that are missing in it stay without a value. A remark
names everything else that was seen.
"""

from bisect import bisect_left
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from stepdiag_ros.metrology.expected_stop import ExpectedStops
from stepdiag_ros.metrology.hand_surplus import LEAST_PART, Surplus
from stepdiag_ros.metrology.measurement import Reading
from stepdiag_ros.metrology.plan import Plan, Sampling
from stepdiag_ros.metrology.rest_matching import (
    SURE,
    Match,
    StopPlace,
    Tolerance,
    match,
    same_level,
)
from stepdiag_ros.metrology.stillness import Criteria, Rest
from stepdiag_ros.metrology.window import examine

LONG = 1.7
"""Multiple of the usual time of a line's rests from which on a rest counts as long."""
UNIT_FACTORS = (25.4, 1e3, 1e6)
"""Between inches and millimetres, and between metres, millimetres and micrometres."""


@dataclass(frozen=True)
class TakenStop:
    """A stop that was found.

    Attributes:
        line_index: of the plan, from 0.
        stop: from 0.
        rest: of the mirror.
        window_start: of the readings that are averaged, ns.
        left_before: when the machine left the stop before, ns.
    """

    line_index: int
    stop: int
    rest: Rest
    window_start: int
    left_before: int


@dataclass(frozen=True)
class LineFound:
    """What a recording says of one line.

    Attributes:
        line_index: of the plan, from 0.
        refusal: why the line gives nothing; empty if it counts.
        remarks: what else was seen in it: stops missed, doubled, rests that are none.
        stops: that were found, in order.
        zero: of its rests; lines with the same number may share a zero.
    """

    line_index: int
    refusal: str
    remarks: tuple[str, ...]
    stops: tuple[TakenStop, ...]
    zero: int


def window_in(
    rest: Rest, readings: Sequence[Reading], sampling: Sampling, at_end: bool, after: int = 0
) -> int | None:
    """Return where in a rest the window of readings begins that is averaged, ns.

    The first window that settles is taken, from the beginning of the rest on (less the plan's
    settle time, as far as the rest is long enough for it), or from its end backwards.

    Args:
        rest: of the mirror.
        readings: at least those of the rest, in order.
        sampling: of the plan.
        at_end: look from the end of the rest backwards.
        after: ns; the window begins no earlier.

    Returns:
        None if the rest is shorter than the window.
    """
    window = round(sampling.window * 1e9)
    earliest, latest = max(rest.start, after), rest.end - window
    if at_end:
        # Not before the last dwell: there the place may have been come to from the other side.
        stay = max(sampling.dwell, sampling.settle + sampling.window)
        earliest = max(earliest, min(rest.end - round(stay * 1e9), latest))
    if latest < earliest:
        return None
    first = latest if at_end else min(max(rest.start + round(sampling.settle * 1e9), after), latest)
    tries = max(1, round(sampling.longest_wait / sampling.window))
    step = -window if at_end else window
    for start in range(first, first + step * tries, step):
        if not earliest <= start <= latest:
            break
        end = start + window
        low = bisect_left(readings, start, key=lambda reading: reading.time)
        high = bisect_left(readings, end, key=lambda reading: reading.time)
        if not examine(readings[low:high], start, end).objection(sampling):
            return start
    return first


class LineFinder:
    """Says what was found of each line.

    Args:
        plan: of the measurement.
        places: its stops that were looked for.
        rests: that were found.
        matches: of rests to places.
        tolerance: of a step.
        readings: of the recording.
    """

    def __init__(
        self,
        plan: Plan,
        places: Sequence[StopPlace],
        rests: Sequence[Rest],
        matches: Sequence[Match],
        tolerance: Tolerance,
        readings: Sequence[Reading],
    ) -> None:
        self._plan, self._places, self._rests = plan, places, rests
        self._matches, self._tolerance, self._readings = matches, tolerance, readings
        self._by_place = {one.place: one for one in matches}
        self._matched = {one.rest for one in matches}
        self._zeros = _zeros(places, rests, matches, tolerance)
        self._surplus = Surplus(plan, places, rests, matches, tolerance, readings[0].time)

    def line(self, index: int, doubt: str) -> LineFound:
        """Return what was found of a line of the plan (``doubt``: in the whole recording)."""
        own, found = self._own(index)
        remarks = self._remarks(index, own, found)
        refusal = self._refusal(index, own, found) or doubt or self._surplus.of_line(index, found)
        stops: tuple[TakenStop, ...] = ()
        if not refusal:
            stops, short = self._taken(index, found)
            remarks += short
            if not stops or stops[-1].stop != len(own) - 1:
                refusal = f"its last stop cannot be taken: {'; '.join(short)}"
            elif len(stops) < LEAST_PART * len(own):
                refusal = f"only {len(stops)} of {len(own)} stops can be taken: {short[0]}"
        zero = self._zeros[found[0].rest] if found else 0
        return LineFound(index, refusal, tuple(remarks), stops, zero)

    def _refusal(self, index: int, own: Sequence[int], found: Sequence[Match]) -> str:
        if not found:
            return "no rests in the recording fit its stops"
        unsure = [one for one in found if one.margin < SURE]
        if unsure:
            return self._why_unsure(index, own, unsure[0], len(found))
        zeros = [self._zeros[one.rest] for one in found]
        for before, after, one, other in zip(zeros, zeros[1:], found, found[1:], strict=False):
            if before != after:
                return (
                    f"the zero is lost between {self._stop(index, one)} and "
                    f"{self._stop(index, other)}: {self._step(one, other)}"
                )
        if len(found) < LEAST_PART * len(own):
            return f"only {len(found)} of its {len(own)} stops are in the recording"
        for end, one, words in ((own[0], found[0], "first"), (own[-1], found[-1], "last")):
            if one.place != end:
                return (
                    f"its {words} stop is not in the recording: the sequence is cut, or it was "
                    "made with another plan"
                )
        return ""

    def _own(self, index: int) -> tuple[list[int], list[Match]]:
        """Return the places of a line, and what was matched to them."""
        own = [n for n, place in enumerate(self._places) if index in dict(place.stops)]
        return own, [self._by_place[n] for n in own if n in self._by_place]

    def of_another_plan(self, lines: Sequence[int]) -> str:
        """Say which stop of a line found whole is not where the plan has it; empty if all are.

        Blocks and steps are those of all lines of a plan, so it counts against the whole recording,
        also where another line does not show it.
        """
        for index in lines:
            own, found = self._own(index)
            if not self._refusal(index, own, found):
                elsewhere = self._elsewhere(index, found)
                if elsewhere:
                    return elsewhere
        return ""

    def _elsewhere(self, index: int, found: Sequence[Match]) -> str:
        """Say which stop of a line is not where the plan has it; empty if all are."""
        expected = ExpectedStops(self._plan, index, self._tolerance)
        numbers = [dict(self._places[one.place].stops)[index] for one in found]
        first = self._rests[self._rest_for(found[0], numbers[0])]
        for one, stop in zip(found[1:], numbers[1:], strict=True):
            went = self._rests[one.rest].arrived - first.left
            objection = expected.objection(numbers[0], stop, went)
            if objection:
                return objection
        return ""

    def mirrored(self) -> str:
        """Say if the readings fit better with the other sign; empty if they do not."""
        enough = max(len(self._matches), LEAST_PART * len(self._places))
        if min(len(self._rests), len(self._places)) <= enough:
            return ""
        turned = [replace(rest, arrived=-rest.arrived, left=-rest.left) for rest in self._rests]
        fitting = len(match(self._places, turned, self._tolerance))
        if fitting <= enough:
            return ""
        return (
            "with the sign of the readings reversed they fit better: a reading must grow as the "
            "mirror moves away from the laser"
        )

    def _why_unsure(self, index: int, own: Sequence[int], one: Match, count: int) -> str:
        seen = f"{count} of its {len(own)} stops seem to be there, but which ones is not certain"
        rest = f"the rest at {self._at(self._rests[one.rest])}"
        if one.instead is None:
            return f"{seen}: {self._stop(index, one)} may as well be another rest than {rest}"
        other_line, other_stop = self._places[one.instead].stops[0]
        where = "" if other_line == index else f" of {self._plan.lines[other_line]}"
        return (
            f"{seen}: {rest} may be {self._stop(index, one)} or stop {other_stop}{where}; the "
            "recording is cut, stops are missing, or it was made with another plan"
        )

    def _remarks(self, index: int, own: Sequence[int], found: Sequence[Match]) -> list[str]:
        remarks = []
        there = {one.place for one in found}
        missing = [dict(self._places[n].stops)[index] for n in own if n not in there]
        if missing and found:
            stops = ", ".join(str(stop) for stop in missing)
            remarks.append(f"missed: no rest at stop{'s' if len(missing) > 1 else ''} {stops}")
        for one, other in pairwise(found):
            first = max(one.rest, self._rest_for(one, dict(self._places[one.place].stops)[index]))
            for number in range(first + 1, other.rest):
                remarks.append(self._extra(index, one, other, number))
        usual = float(np.median([self._rests[one.rest].duration for one in found] or [0.0]))
        for one in found[1:-1]:
            rest = self._rests[one.rest]
            if rest.duration > LONG * usual:
                remarks.append(
                    f"stands {rest.duration:.3g} s at {self._stop(index, one)}, elsewhere mostly "
                    f"{usual:.3g} s: held, or stopped there twice"
                )
        return remarks

    def _extra(self, index: int, before: Match, after: Match, number: int) -> str:
        rest, last = self._rests[number], self._rests[before.rest]
        lasts = f"for {rest.duration:.3g} s at {self._at(rest)}"
        for stop in (before, after):
            if same_level(self._rests[stop.rest], rest, self._tolerance):
                return f"doubled: stands twice at {self._stop(index, stop)}, once {lasts}"
        if last.zero != rest.zero:
            return f"extra rest after {self._stop(index, before)}, {lasts}, in another zero"
        way = (rest.arrived - last.left) * 1e3
        return f"extra rest {way:+.4f} mm after {self._stop(index, before)}, {lasts}; left out"

    def _taken(self, index: int, found: Sequence[Match]) -> tuple[tuple[TakenStop, ...], list[str]]:
        """Return the stops of a line with their windows, and in words which have none."""
        taken, short = [], []
        sampling = self._plan.sampling
        for one in found:
            stops = self._places[one.place].stops
            stop = dict(stops)[index]
            rest = self._rests[self._rest_for(one, stop)]
            # At the first stop the operator is at work until the machine leaves; where a line
            # ends, he begins to be as soon as he sees it.
            at_end = stop == 0
            after = 0
            if at_end and len(stops) > 1 and self._rest_for(one, -1) == self._rest_for(one, stop):
                ended = window_in(rest, self._readings, sampling, at_end=False)
                after = rest.end if ended is None else ended + round(sampling.window * 1e9)
            start = window_in(rest, self._readings, sampling, at_end, after)
            if start is None:
                both = ", for two stops," if len(stops) > 1 else ""
                short.append(
                    f"stop {stop} stands still for only {rest.duration:.3g} s{both} and the window "
                    f"is {sampling.window:g} s: dwell longer"
                )
                continue
            number = self._rest_for(one, stop)
            left = self._rests[number - 1].end if number else rest.start
            left = max(after, left) if after else min(left, start)
            taken.append(TakenStop(index, stop, rest, start, left))
        return tuple(taken), short

    def _rest_for(self, one: Match, stop: int) -> int:
        """Return the rest of a match in which a stop is read.

        Where a line begins, the machine may stand several times; the last time counts, for the
        operator is ready then. Where a line ends, the first time counts: after it the next line
        begins, or the operator is at work, and the next setup may have its zero at the same level.
        """
        stops = self._places[one.place].stops
        if stop > 0 and len(stops) == 1:
            index, _ = stops[0]
            if stop < len(self._plan.lines[index].stops(self._plan.volume)) - 1:
                return one.rest
        number, way = one.rest, 1 if stop == 0 else -1
        while (
            0 <= number + way < len(self._rests)
            and number + way not in self._matched
            and same_level(self._rests[one.rest], self._rests[number + way], self._tolerance)
        ):
            number += way
        return number

    def _stop(self, index: int, one: Match) -> str:
        return f"stop {dict(self._places[one.place].stops)[index]}"

    def _at(self, rest: Rest) -> str:
        return f"{(rest.start - self._readings[0].time) * 1e-9:.2f} s"

    def _step(self, one: Match, other: Match) -> str:
        before, after = self._rests[one.rest], self._rests[other.rest]
        if before.zero != after.zero:
            return "the beam was lost, or the reading jumped faster than the machine moves"
        went = (after.arrived - before.left) * 1e3
        nominal = self._places[other.place].displacement - self._places[one.place].displacement
        return f"the reading goes by {went:+.4f} mm instead of {nominal * 1e3:+.4f} mm"

    def hint(self) -> str:
        """Say what may be wrong when not a single line was found."""
        if not self._rests:
            band = Criteria.of_plan(self._plan)
            return (
                f"the readings never stay within {band.band * 1e3:.3g} mm for {band.shortest:.3g} "
                f"s: is it a recording of stops, and is its unit right?{self._unit()}"
            )
        return steps_seen(self._rests, self._places) + self._unit()

    def _unit(self) -> str:
        """Ask for the unit of the readings if their span says that it is another."""
        values = [reading.compensated_displacement for reading in self._readings]
        spans = float(np.ptp(values)), max(abs(place.displacement) for place in self._places)
        for factor in UNIT_FACTORS:
            for small, large, words in ((*spans, "smaller"), (*spans[::-1], "larger")):
                if factor / 2 < large / max(small, 1e-12) < factor * 2:
                    return (
                        f". The recording spans {spans[0]:.2g} m and the plan {spans[1]:.2g} m: "
                        f"about {factor:g} times {words}. Is the unit right?"
                    )
        return ""


def steps_seen(rests: Sequence[Rest], places: Sequence[StopPlace]) -> str:
    """Say which rests a recording shows, and which stops were looked for in it."""
    steps = [round((b.arrived - a.left) * 1e3, 1) for a, b in pairwise(rests) if a.zero == b.zero]
    seen = ", ".join(f"{step:+.1f} mm" for step, _ in Counter(steps).most_common(3))
    nominal = np.diff([place.displacement for place in places]) * 1e3
    wanted = Counter(np.round(nominal, 1).tolist()).most_common(3)
    expected = ", ".join(f"{step:+.1f} mm" for step, _ in wanted)
    shown = "1 rest" if len(rests) == 1 else f"{len(rests)} rests"
    steps_shown = f" with steps of mostly {seen}" if seen else " and no step"
    return (
        f"it shows {shown}{steps_shown}; the plan has {len(places)} stops with steps of mostly "
        f"{expected}"
    )


def _zeros(
    places: Sequence[StopPlace],
    rests: Sequence[Rest],
    matches: Sequence[Match],
    tolerance: Tolerance,
) -> Mapping[int, int]:
    """Return for each matched rest the number of its zero; it changes with each unchecked step."""
    zeros, count = {}, 0
    for number, one in enumerate(matches):
        if number:
            before = matches[number - 1]
            a, b = rests[before.rest], rests[one.rest]
            nominal = places[one.place].displacement - places[before.place].displacement
            off = abs(b.arrived - a.left - nominal)
            same_setup = places[one.place].setup == places[before.place].setup
            if not same_setup or a.zero != b.zero or off > float(tolerance.of(nominal)):
                count += 1
        zeros[one.rest] = count
    return zeros
