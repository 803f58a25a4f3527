"""Sequence of a run that is measured by hand, followed as the readings come.

Nobody here moves the machine. The operator sets laser and mirror up, stands at the first stop, says
so (``resume``) and starts the NC program; from then on every rest in the readings is matched to the
stops of the setup's lines (``metrology.rest_matching``), beginning with the first. Each stop that
is certain becomes a command and an arrival, as ``metrology.by_hand`` makes them of a recording.
A mismatch is reported at once; one that later readings cannot resolve stops the run
until the operator has begun the present line again.
"""

from collections.abc import Callable
from math import nan

from stepdiag_ros.metrology.expected_stop import ExpectedStops
from stepdiag_ros.metrology.hand_lines import window_in
from stepdiag_ros.metrology.measurement import Arrival, Reading, StopCommand
from stepdiag_ros.metrology.plan import Plan, moved_axes
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.rest_matching import (
    SURE,
    Match,
    StopPlace,
    Tolerance,
    match,
    places_of,
    same_level,
)
from stepdiag_ros.metrology.stillness import Criteria, Rest, StillnessDetector
from stepdiag_ros.run.refusing import in_wrong_state
from stepdiag_ros.run.sequence import Progress, State

MOST_READINGS = 200_000
"""Readings of a setup that are kept at least, if there are so many, to find windows in."""
MOST_MISFITS = 3
"""Rests in a row that fit no stop, after which the line has to be begun again."""
_UNKNOWN_PLACE = (nan, nan, nan)


class HandCourse:
    """Follows a plan by its readings alone.

    Args:
        plan: of the measurement.
        tell: is given the command and the arrival of each stop that was found.
    """

    def __init__(self, plan: Plan, tell: Callable[[StopCommand, Arrival], None]) -> None:
        self._plan = plan
        self._tell = tell
        self._criteria, self._tolerance = Criteria.of_plan(plan), Tolerance.of_plan(plan)
        self._needed = round((plan.sampling.settle + plan.sampling.window) * 1e9)
        self._counts = [len(line.stops(plan.volume)) for line in plan.lines]
        self.state = State.IDLE
        self.text = "nothing was started"
        self._line = 0
        self._stop = 0
        self._attempt = 1
        self._zeros: dict[str, int] = {}
        self._commands = 0
        self._places: list[StopPlace] = []
        self._first_line = 0
        self._seen_since: int | None = None
        self._forget()

    # What an operator does -------------------------------------------------------------------

    def start(self) -> None:
        """Begin with the first setup.

        Raises:
            ValueError: the run was started before.
        """
        if self.state is not State.IDLE:
            raise Refusal("this run was started before", fault="busy")
        self._wait_for_setup()

    def check_resumable(self) -> None:
        """Refuse unless the run can be resumed, whether or not all nodes are ready.

        Raises:
            Refusal: nothing is waited for.
        """
        if self.state not in (State.FAULT, State.WAITING_FOR_SETUP):
            raise in_wrong_state("resume", self.state)

    def resume(self) -> None:
        """Follow from now on: the machine stands at the first stop of the present line.

        Raises:
            ValueError: nothing is waited for.
        """
        self.check_resumable()
        if self.state is State.FAULT:
            self._attempt += 1
        setup = self._plan.setup_of(self._plan.lines[self._line])
        self._zeros[setup] = self._zeros.get(setup, 0) + 1
        lines = [self._line]
        while lines[-1] + 1 < len(self._plan.lines) and (
            self._plan.setup_of(self._plan.lines[lines[-1] + 1]) == setup
        ):
            lines.append(lines[-1] + 1)
        self._places = places_of(self._plan, lines)
        self._first_line = self._line
        self._stop = 0
        self._forget()
        self._enter(State.RUNNING, f"waits for the machine to leave {self._words(self._line, 0)}")

    def abort(self, text: str) -> None:
        """End the run for good.

        Raises:
            ValueError: the run has ended.
        """
        if self.state in (State.FINISHED, State.ABORTED):
            raise in_wrong_state("abort", self.state)
        self._enter(State.ABORTED, text)

    def fault(self, text: str) -> None:
        """Stop following because something is wrong; ``resume`` begins the present line again."""
        if self.state is State.RUNNING:
            again = f"go back to the first stop of {self._plan.lines[self._line]}, then resume"
            self._enter(State.FAULT, f"{text}; {again}")

    # What the instrument says ----------------------------------------------------------------

    def take(self, reading: Reading) -> None:
        """Take the next reading."""
        if self.state is not State.RUNNING:
            return
        self._readings.append(reading)
        if len(self._readings) > 2 * MOST_READINGS:
            del self._readings[:MOST_READINGS]
        ended = self._detector.add(reading)
        if ended:
            self._rests += ended
            self._seen_since = None
            self._look(self._rests)
            return
        since = self._detector.since
        if since is None or since == self._seen_since or reading.time - since < self._needed:
            return
        present = self._detector.present
        if present is not None and present.end - present.start >= self._needed:
            self._seen_since = since
            self._look([*self._rests, present])

    @property
    def line_index(self) -> int:
        """Return the line of the plan that is measured."""
        return self._line

    def progress(self) -> Progress:
        """Return where the run is."""
        ended = self._line == len(self._plan.lines)
        line = None if ended else self._plan.lines[self._line]
        done = sum(self._counts[: self._line]) + (0 if ended else self._stop)
        return Progress(
            state=self.state,
            line_index=self._line,
            line_count=len(self._plan.lines),
            line="" if line is None else str(line),
            setup="" if line is None else self._setup(self._line),
            block=0 if line is None else line.block_of(self._stop),
            block_count=0 if line is None else self._plan.volume.blocks,
            stop=self._stop,
            stop_count=0 if ended else self._counts[self._line],
            stops_done=done,
            stops_total=sum(self._counts),
            remaining_time=nan,
            text=self.text,
        )

    # What follows ----------------------------------------------------------------------------

    def _forget(self) -> None:
        self._detector = StillnessDetector(self._criteria)
        self._readings: list[Reading] = []
        self._rests: list[Rest] = []
        self._told: dict[tuple[int, int], int] = {}
        self._seen_since = None
        self._last_window = 0

    def _enter(self, state: State, text: str) -> None:
        self.state, self.text = state, text

    def _wait_for_setup(self) -> None:
        line = self._plan.lines[self._line]
        self._enter(
            State.WAITING_FOR_SETUP,
            f"by hand: align laser and mirror for {self._plan.setup_of(line)}, stand at the first "
            f"stop of {line}; then resume, and start the NC program",
        )

    def _setup(self, line: int) -> str:
        name = self._plan.setup_of(self._plan.lines[line])
        count = self._zeros.get(name, 1)
        return name if count == 1 else f"{name} #{count}"

    def _words(self, line: int, stop: int) -> str:
        return f"stop {stop} of {self._plan.lines[line]}"

    def _look(self, rests: list[Rest]) -> None:
        """Find out which stop the newest rest is, and pass on what is certain."""
        if rests[-1].zero != rests[0].zero:
            self.fault("the zero is lost: the beam was broken, or the reading jumped")
            return
        found = match(self._places, rests, self._tolerance, begins_here=True, goes_on=True)
        places = {one.rest: one for one in found}
        for (line, stop), rest in self._told.items():
            place = places.get(rest)
            if place is None or (line, stop) not in self._places[place.place].stops:
                self.fault(self._no_stops_after(line, stop))
                return
        for number, one in enumerate(found):
            if one.margin < SURE:
                self.text = f"not certain which stop this is, perhaps {self._name(one)}"
                return
            self._tell_stops(one, found[number - 1] if number else None, rests)
            if self.state is not State.RUNNING:
                return
        self._say_misfits(rests, places)

    def _tell_stops(self, one: Match, before: Match | None, rests: list[Rest]) -> None:
        rest = rests[one.rest]
        stops = self._places[one.place].stops
        for line, stop in stops:
            # The first stop of a line is read last, when the machine is about to leave it.
            going_on = one.rest >= len(self._rests)
            if (line, stop) in self._told or (stop == 0 and going_on):
                continue
            window = round(self._plan.sampling.window * 1e9)
            start = window_in(
                rest, self._readings, self._plan.sampling, stop == 0, self._last_window
            )
            if start is None:
                self.text = f"{self._words(line, stop)} stands for only {rest.duration:.3g} s"
                continue
            objection = self._elsewhere(line, stop, rest, rests)
            if objection:
                self.fault(objection)
                return
            left = rests[one.rest - 1].end if one.rest else rest.start
            self._told[(line, stop)] = one.rest
            self._command(line, stop, start, max(min(left, start), self._last_window))
            self._last_window = start + window
            missed = one.place - before.place - 1 if before is not None else 0
            lacking = f"; missed before it: {missed}" if missed > 0 else ""
            self._arrived(line, stop, lacking)

    def _elsewhere(self, line: int, stop: int, rest: Rest, rests: list[Rest]) -> str:
        """Say if a stop is not where the plan has it; empty if it is."""
        earlier = [(number, one) for (index, number), one in self._told.items() if index == line]
        if not earlier:
            return ""
        first, there = min(earlier)
        expected = ExpectedStops(self._plan, line, self._tolerance)
        went = rest.arrived - rests[there].left
        if abs(expected.departure(first, stop, went)) > self._tolerance.most:
            return self._no_stops_after(line, first)
        return expected.objection(first, stop, went)

    def _no_stops_after(self, line: int, stop: int) -> str:
        return (
            f"the rests after {self._words(line, stop)} are not stops of the plan, or that rest"
            " was not one: a wrong direction, or another program"
        )

    def _command(self, line: int, stop: int, start: int, left: int) -> None:
        self._commands += 1
        targets = self._plan.lines[line].stops(self._plan.volume)
        x, y, z = (float(value) for value in targets[stop])
        command = StopCommand(
            command_id=self._commands,
            line_index=line,
            attempt=self._attempt if line == self._first_line else 1,
            setup=self._setup(line),
            stop=stop,
            axis=moved_axes(targets[stop - 1], targets[stop]) if stop else "",
            target=(x, y, z),
            time=left,
        )
        settle = round(self._plan.sampling.settle * 1e9)
        self._tell(command, Arrival(self._commands, start - settle, _UNKNOWN_PLACE))

    def _arrived(self, line: int, stop: int, lacking: str) -> None:
        if line != self._line:
            self._attempt = 1
        self._line, self._stop = line, stop
        self.text = f"by hand: {self._words(line, stop)} found{lacking}"
        if stop < self._counts[line] - 1:
            return
        if line + 1 == len(self._plan.lines):
            self._line = line + 1
            self._enter(State.FINISHED, f"all lines are measured by hand{lacking}")
        elif (line, stop) == self._places[-1].stops[-1]:
            self._line, self._stop, self._attempt = line + 1, 0, 1
            self._wait_for_setup()

    def _say_misfits(self, rests: list[Rest], places: dict[int, Match]) -> None:
        misfits = 0
        while misfits < len(rests) and len(rests) - 1 - misfits not in places:
            misfits += 1
        if not misfits:
            return
        rest, last = rests[-1], rests[-1 - misfits] if misfits < len(rests) else rests[0]
        if same_level(last, rest, self._tolerance):
            self.text = f"doubled: stands again at {self._words(self._line, self._stop)}"
            return
        way = (rest.arrived - last.left) * 1e3
        where = f"{way:+.4f} mm after {self._words(self._line, self._stop)}"
        self.text = f"a rest that is not a stop, {where}"
        if misfits >= MOST_MISFITS:
            self.fault(f"the last {misfits} rests are not stops, the last {where}")

    def _name(self, one: Match) -> str:
        return self._words(*self._places[one.place].stops[0])
