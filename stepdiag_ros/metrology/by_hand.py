"""From a recording that nobody commanded to commands and arrivals, as a controlled run has them.

The rests in the readings (``stillness``) are matched to the stops of the plan (``rest_matching``).
Each stop that was found becomes a command and an arrival with the times at which the machine must
have left and stood still; from there on everything is as in a run that was commanded
(``assembly``). A line of which it is not certain which rest is which stop gives nothing, and says
why; it is never shifted.

``hand_lines`` selects the lines and writes the remarks on them.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import nan

import numpy as np

from stepdiag_ros.metrology.hand_lines import LineFinder, LineFound
from stepdiag_ros.metrology.measurement import Arrival, Reading, StopCommand
from stepdiag_ros.metrology.plan import STOPS, Plan, moved_axes
from stepdiag_ros.metrology.rest_matching import Match, StopPlace, Tolerance, match, places_of
from stepdiag_ros.metrology.stillness import Criteria, Rest, StillnessDetector
from stepdiag_ros.metrology.window import FEWEST_READINGS

_NOT_BY_CHANCE = 0.5
"""Part of a line's stops from which on it is not by chance that they are there."""
_ROUNDS = 4
_SILENCE = 10.0
"""Multiple of the usual time between two readings from which on readings are missing."""
_MOST_SILENCES = 5
_UNKNOWN_PLACE = (nan, nan, nan)


@dataclass(frozen=True)
class Found:
    """What a recording says of all the lines it was to hold.

    Attributes:
        lines: in order of the plan.
        rests: all that were found.
        matches: of rests to places.
        places: the stops that were looked for.
        hint: what may be wrong with the whole recording; empty if nothing is.
    """

    lines: tuple[LineFound, ...]
    rests: tuple[Rest, ...]
    matches: tuple[Match, ...]
    places: tuple[StopPlace, ...]
    hint: str


@dataclass
class Numbering:
    """Counts commands and zeros over all recordings of a run."""

    commands: int = 0
    zeros: dict[str, list[tuple[int, int]]] = field(default_factory=dict)

    def setup(self, name: str, zero: tuple[int, int]) -> str:
        """Return the identity of a setup with a zero, named as the sequencer does."""
        known = self.zeros.setdefault(name, [])
        if zero not in known:
            known.append(zero)
        count = known.index(zero) + 1
        return name if count == 1 else f"{name} #{count}"


def plan_by_hand(plan: Plan) -> Plan:
    """Return a plan as it is measured by hand: the machine does not wait for a stop to settle.

    Without the positions of the axes nothing is measured on the fly.
    """
    sampling = plan.sampling
    once = replace(sampling, longest_wait=sampling.settle + sampling.window)
    return replace(plan, sampling=once, measurement=STOPS)


def require_standing_beam(plan: Plan, source: str) -> None:
    """Refuse a plan with a tracker: rests are recognised along a beam that stands still.

    Args:
        plan: that is to be measured by hand.
        source: what the user calls it.

    Raises:
        ValueError: the plan has a tracker.
    """
    if plan.tracker is not None:
        raise ValueError(
            f"{source} is a plan with a tracker; stops are found by hand along a standing beam"
            " only: read a table of the tracker's lengths with 'stepdiag import'"
        )


def objection_to(plan: Plan, readings: Sequence[Reading]) -> str:
    """Say why a recording cannot be evaluated with a plan at all; empty if it can."""
    if len(readings) < FEWEST_READINGS:
        return f"it holds only {len(readings)} readings"
    times = np.array([reading.time for reading in readings], dtype=np.int64)
    between = float(np.median(np.diff(times))) * 1e-9
    window = plan.sampling.window
    if window < FEWEST_READINGS * between:
        return (
            f"it has a reading every {between:.3g} s, so the plan's window_s of {window:g} s holds "
            f"fewer than {FEWEST_READINGS}: give the plan a window_s of at least "
            f"{FEWEST_READINGS * between + 0.5 * between:.2g} s, and dwells that hold it"
        )
    return ""


def silences(readings: Sequence[Reading]) -> list[str]:
    """Say when a recording has no readings for much longer than from one to the next."""
    times = np.array([reading.time for reading in readings], dtype=np.int64)
    between = np.diff(times)
    found = np.nonzero(between > _SILENCE * np.median(between))[0]
    seconds = (times - times[0]) * 1e-9
    said = [
        f"no readings between {seconds[at]:.1f} s and {seconds[at + 1]:.1f} s"
        for at in found[:_MOST_SILENCES]
    ]
    more = len(found) - len(said)
    return [*said, f"{more} further silences"] if more > 0 else said


def find_stops(plan: Plan, lines: Sequence[int], readings: Sequence[Reading]) -> Found:
    """Find the stops of some lines of a plan in a recording.

    Args:
        plan: the plan.
        lines: indices of the lines that the recording is to hold, rising.
        readings: in order of time.

    Raises:
        ValueError: there are too many rests and stops for one recording.
    """
    detector = StillnessDetector(Criteria.of_plan(plan))
    rests: list[Rest] = []
    for reading in readings:
        rests += detector.add(reading)
    rests += detector.finish()
    places = places_of(plan, lines)
    tolerance = Tolerance.of_plan(plan)
    matches = without_strays(places, rests, tolerance)
    finder = LineFinder(plan, places, rests, matches, tolerance, readings)
    doubt = finder.mirrored() or finder.of_another_plan(lines)
    found = tuple(finder.line(index, doubt) for index in lines)
    hint = doubt
    if not hint and all(line.refusal for line in found):
        hint = finder.hint()
    return Found(found, tuple(rests), tuple(matches), tuple(places), hint)


def without_strays(
    places: Sequence[StopPlace], rests: Sequence[Rest], tolerance: Tolerance
) -> list[Match]:
    """Match rests to places, but let none count that only happen to fit.

    Here and there a rest of the operator's work is where a stop of a line could be of which nothing
    else is there. Such a stray must not tip the scales between two places where a whole line could
    be, so it is taken out and everything is matched again.

    Raises:
        ValueError: there are too many rests and stops for one recording.
    """
    stops = Counter(line for place in places for line, _ in place.stops)
    left = list(range(len(rests)))
    found: list[Match] = []
    for _ in range(_ROUNDS):
        found = match(places, [rests[number] for number in left], tolerance)
        seen = Counter(line for one in found for line, _ in places[one.place].stops)
        lines = {line for line, count in seen.items() if count >= _NOT_BY_CHANCE * stops[line]}
        strays = {
            left[one.rest]
            for one in found
            if lines.isdisjoint(line for line, _ in places[one.place].stops)
        }
        found = [replace(one, rest=left[one.rest]) for one in found if left[one.rest] not in strays]
        if not strays:
            break
        left = [number for number in left if number not in strays]
    return found


def as_commanded(
    plan: Plan, found: Found, recording: int, numbering: Numbering
) -> tuple[list[StopCommand], list[Arrival]]:
    """Return the commands and arrivals that a controlled run with these stops would have had.

    Args:
        plan: of the run.
        found: in one recording.
        recording: its number; another recording has another zero.
        numbering: of the run; it goes on with these.
    """
    commands, arrivals = [], []
    settle = round(plan.sampling.settle * 1e9)
    for line in found.lines:
        if line.refusal:
            continue
        plan_line = plan.lines[line.line_index]
        targets = plan_line.stops(plan.volume)
        setup = numbering.setup(plan.setup_of(plan_line), (recording, line.zero))
        for taken in line.stops:
            numbering.commands += 1
            x, y, z = (float(value) for value in targets[taken.stop])
            axis = ""
            if taken.stop:
                axis = moved_axes(targets[taken.stop - 1], targets[taken.stop])
            commands.append(
                StopCommand(
                    command_id=numbering.commands,
                    line_index=line.line_index,
                    attempt=1,
                    setup=setup,
                    stop=taken.stop,
                    axis=axis,
                    target=(x, y, z),
                    time=taken.left_before,
                )
            )
            arrivals.append(
                Arrival(numbering.commands, taken.window_start - settle, _UNKNOWN_PLACE)
            )
    return commands, arrivals
