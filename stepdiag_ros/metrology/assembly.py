"""From commands, arrivals and readings to settled stops, block displacements and lines.

The assembler is a deterministic merge of three streams, each in order in itself: commands by their
id, arrivals by their id, readings by their time. A stop is decided from its arrival and from
readings only, and only when a reading at or after the end of the window in question has come;
nothing depends on which stream is ahead, or on any clock. A replay of a bag therefore gives the
live run's results bit for bit.

That also settles what may be used against a stop: only what was sent before its decision can be
known to every replay. A command that leaves a stop before its window has ended ("moved too early")
is therefore held against the stop that it leads to, and the stop that it left is void in the
finished line.
"""

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from math import isfinite, nan, sqrt

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import (
    Arrival,
    BlockDisplacement,
    Environment,
    MeasuredLine,
    Reading,
    SettledStop,
    StopCommand,
)
from stepdiag_ros.metrology.on_the_fly.flight import Flight, FlownLine, needs_corner_stops
from stepdiag_ros.metrology.on_the_fly.record import Moved
from stepdiag_ros.metrology.plan import Line, Plan, moved_axes
from stepdiag_ros.metrology.plan_commands import check_command
from stepdiag_ros.metrology.rising import Rising
from stepdiag_ros.metrology.window import STATUS_WORDS, Window, examine

Event = SettledStop | BlockDisplacement | MeasuredLine

FIRST_STATUS_THAT_LOSES_ZERO = 2
"""BEAM_LOST and all above it of InterferometerReading.msg; LOW_SIGNAL below still counts."""

_NOT_SETTLED = "not settled within"
_NEVER = 2**63
_MOST_LOSSES = 1000
_MOST_IN_FLIGHT = 500_000
"""Readings of a line on the fly that are kept, so that memory is bounded: 8 minutes at 1 kHz."""


def repetition_helps(reason: str) -> bool:
    """Say whether a rejected stop need only be measured again, and not its whole line.

    Args:
        reason: of the rejection, as a ``SettledStop`` has it.
    """
    return reason.startswith(_NOT_SETTLED)


@dataclass
class _Zero:
    """The zero of a setup: the first settled stop after the setup began or its zero was lost."""

    setup: str
    identity: str
    since: int
    displacement: float = nan


@dataclass
class _OpenLine:
    """An attempt at a line of which stops are being decided."""

    line: Line
    line_index: int
    attempt: int
    targets: Vector
    since: int
    zero: _Zero
    last: SettledStop | None = None
    stops: dict[int, SettledStop] = field(default_factory=dict)
    void: set[int] = field(default_factory=set)
    moved: Moved | None = None


@dataclass
class _OpenStop:
    """A stop that the machine has reached and that is not decided yet."""

    command: StopCommand
    arrival: Arrival
    window_start: int
    window_end: int
    last_end: int


class Assembler:
    """Makes settled stops, block displacements and lines of one run.

    Each ``add_`` method returns the events that have become certain, in an order that depends on
    the three streams alone. Together they are: a ``SettledStop`` for every stop that was reached,
    settled or rejected with a reason; after it the ``BlockDisplacement`` to it from the stop
    before, if both are settled; after the last stop of a line its ``MeasuredLine``.

    Args:
        plan: of the run.
        start: of the run, ns; times of finished lines count from it.
        buffer: how many readings are kept for an arrival that comes late. Between stops all
            readings since the last arrival are kept, up to this number; a stop whose readings are
            gone is rejected.
        on_pass: is given every line that was measured on the fly, with its delays and curves.
    """

    def __init__(
        self,
        plan: Plan,
        start: int,
        buffer: int = 50_000,
        on_pass: Callable[[FlownLine], object] | None = None,
    ) -> None:
        self._on_pass = on_pass
        self._plan = plan
        self._start = start
        self._buffer = buffer
        sampling = plan.sampling
        self._settle = round(sampling.settle * 1e9)
        self._window = round(sampling.window * 1e9)
        self._longest_wait = round(sampling.longest_wait * 1e9)
        # None where every stop is settled: by the plan, or because positions come too seldom.
        self._flight = Flight(sampling) if plan.on_the_fly else None

        self._commands: deque[StopCommand] = deque()
        self._arrivals: deque[Arrival] = deque()
        self._commands_taken, self._arrivals_taken = Rising("command"), Rising("arrival")
        # Readings that may still be needed, their times for bisection, and the newest time dropped.
        self._readings: list[Reading] = []
        self._times: list[int] = []
        self._dropped_until = -_NEVER
        self._latest = -_NEVER
        self._latest_sequence = -1
        # Spans [first, last, status] in which the zero was lost, in order of time.
        self._losses: list[tuple[int, int, int]] = []
        self._losing = False

        self._stop: _OpenStop | None = None
        self._decide_at = _NEVER
        self._decided_arrival = -_NEVER
        self._line: _OpenLine | None = None
        self._zero: _Zero | None = None
        self._zeros_of_setup: dict[str, int] = {}
        self._trigger = 0  # of the last settled stop

    def add_command(self, command: StopCommand) -> list[Event]:
        """Take the next command of the run.

        A command that comes again is ignored.

        Raises:
            ValueError: the command does not belong to the plan, or contradicts one before it.
        """
        check_command(command, self._plan)
        if not self._commands_taken.is_new(command.command_id, command):
            return []
        self._commands.append(command)
        return self._advance()

    def add_arrival(self, arrival: Arrival) -> list[Event]:
        """Take the next arrival; arrivals of commands that are not stops may be among them.

        Raises:
            ValueError: it contradicts one before it.
        """
        if not self._arrivals_taken.is_new(arrival.command_id, arrival):
            return []
        self._arrivals.append(arrival)
        return self._advance()

    def add_position(self, time: int, position: tuple[float, float, float]) -> list[Event]:
        """Take the actual position of the axes, m, at a time, ns; only lines on the fly need it."""
        if self._flight is None:
            return []
        self._flight.add_position(time, position)
        return self._advance()

    def add_reading(self, reading: Reading) -> list[Event]:
        """Take the next reading.

        A reading that is not later than the one before is left out (a repetition, or a clock that
        stepped back); the gap in the sequence then shows. A sequence number that falls although
        time goes on says that the instrument was started again: its zero is lost.
        """
        return self.add_readings((reading,))

    def add_readings(self, readings: Iterable[Reading], until: int = _NEVER) -> list[Event]:
        """Take the next readings, the first at or after a time as the last; see ``add_reading``.

        Args:
            readings: in order of their time; of an iterator, those that follow are left in it.
            until: time, ns.
        """
        events: list[Event] = []
        latest, latest_sequence = self._latest, self._latest_sequence
        times, keep_time, keep = self._times, self._times.append, self._readings.append
        soonest, most = self._decide_at, 2 * self._buffer
        for reading in readings:
            time, sequence, _, _, _, status, _, _ = reading
            if time > latest:
                if status >= FIRST_STATUS_THAT_LOSES_ZERO:
                    self._note_loss(time, status)
                elif sequence <= latest_sequence:
                    self._losing = False
                    self._note_loss(time, 0)
                    self._losing = False
                elif self._losing:
                    self._losing = False
                latest, latest_sequence = time, sequence
                keep(reading)
                keep_time(time)
                if time >= soonest:
                    self._latest, self._latest_sequence = time, sequence
                    events += self._advance()
                    soonest = self._decide_at
                elif len(times) > most:
                    self._drop(self._buffer)
            if time >= until:
                break
        self._latest, self._latest_sequence = latest, latest_sequence
        return events

    @property
    def latest(self) -> int:
        """Return the time of the latest reading, ns."""
        return self._latest

    def _note_loss(self, time: int, status: int) -> None:
        if self._losing:
            first, _, first_status = self._losses[-1]
            self._losses[-1] = (first, time, first_status)
        else:
            self._losses.append((time, time, status))
            self._losing = True
        if len(self._losses) > _MOST_LOSSES:
            # A beam that flickers for hours: the oldest spans become one, so that memory is
            # bounded.
            (first, _, first_status), (_, last, _) = self._losses[:2]
            self._losses[:2] = [(first, last, first_status)]

    def _drop(self, keep: int) -> None:
        """Keep so many of the latest readings, and those of a line on the fly that is open."""
        if self._flight is not None and self._line is not None and not self._line.stops:
            of_line = len(self._times) - bisect_left(self._times, self._line.since)
            keep = min(max(keep, of_line), _MOST_IN_FLIGHT)
        if keep >= len(self._times):
            return
        self._dropped_until = self._times[-keep - 1]
        del self._times[:-keep]
        del self._readings[:-keep]

    def _advance(self) -> list[Event]:
        events: list[Event] = []
        while True:
            if self._stop is None:
                self._stop = self._next_stop()
            if self._stop is not None and self._flight is not None:
                if not self._fly(self._stop, self._flight, events):
                    break
                continue
            if self._stop is None or self._latest < self._stop.window_end:
                break
            self._try_window(self._stop, events)
        self._decide_at = self._stop.window_end if self._stop else _NEVER
        return events

    def _next_stop(self) -> _OpenStop | None:
        """Join the streams of commands and arrivals by their rising ids."""
        while self._commands and self._arrivals:
            command, arrival = self._commands[0], self._arrivals[0]
            if arrival.command_id < command.command_id:
                self._arrivals.popleft()
            elif arrival.command_id > command.command_id:
                # The machine has reached a later command: this one was refused or stopped.
                self._commands.popleft()
            else:
                self._commands.popleft()
                self._arrivals.popleft()
                start = arrival.time + self._settle
                return _OpenStop(
                    command=command,
                    arrival=arrival,
                    window_start=start,
                    window_end=start + self._window,
                    last_end=arrival.time + self._longest_wait,
                )
        return None

    def _fly(self, stop: _OpenStop, flight: Flight, events: list[Event]) -> bool:
        """Pass a corner, or decide the line at its last stop; say whether that could be done."""
        if self._latest < stop.arrival.time:
            # Whether the zero was lost before is not known yet.
            return False
        line = self._line_of(stop)
        last = len(line.targets) - 1
        if stop.command.stop < last:
            flight.pass_corner(stop.command, stop.arrival)
            self._stop = None
            return True
        too_late = stop.window_end + self._longest_wait
        if self._latest < (stop.window_end if flight.knows_until(stop.window_end) else too_late):
            return False
        flight.pass_corner(stop.command, stop.arrival)
        first = bisect_left(self._times, line.since + self._settle)
        part = slice(first, bisect_left(self._times, stop.window_end))
        beam = self._plan.lines[line.line_index].beam(self._plan.volume)
        origin = np.zeros(3)
        direction = np.array([float(beam.between(origin, axis)) for axis in np.eye(3)])
        readings = [] if line.since <= self._dropped_until else self._readings[part]
        flown, stops = flight.land(line.line, line.targets, direction, readings, stop.window_end)
        line.moved = flown.found.moved
        if self._on_pass is not None:
            self._on_pass(flown)
        for decided in stops:
            self._take(decided, line, events)
        if stops and needs_corner_stops(stops[-1].reason):
            self._flight = None
        self._end_stop(stop)
        return True

    def _try_window(self, stop: _OpenStop, events: list[Event]) -> None:
        first = bisect_left(self._times, stop.window_start)
        last = bisect_left(self._times, stop.window_end)
        window = examine(self._readings[first:last], stop.window_start, stop.window_end)
        line = self._line_of(stop)
        hopeless = self._hopeless(stop, line, window)
        objection = hopeless or window.objection(self._plan.sampling, self._trigger)
        next_end = stop.window_end + self._window
        if objection and not hopeless and next_end <= stop.last_end:
            stop.window_start, stop.window_end = stop.window_end, next_end
            return
        if objection and not hopeless:
            waited = self._plan.sampling.longest_wait
            objection = f"{_NOT_SETTLED} {waited:g} s after in position: {objection}"
        if not objection:
            objection = self._implausible(stop, line, window)
        self._decide(stop, line, window, objection, events)

    def _line_of(self, stop: _OpenStop) -> _OpenLine:
        """Return the attempt at a line that the stop belongs to; the stop begins a new one."""
        command = stop.command
        line = self._line
        if (
            line is None
            or line.line_index != command.line_index
            or line.attempt != command.attempt
            or line.zero.setup != command.setup
        ):
            plan_line = self._plan.lines[command.line_index]
            line = self._line = _OpenLine(
                line=plan_line,
                line_index=command.line_index,
                attempt=command.attempt,
                targets=plan_line.stops(self._plan.volume),
                since=stop.arrival.time,
                zero=self._zero_for(command.setup, stop.arrival.time),
            )
        return line

    def _zero_for(self, setup: str, time: int) -> _Zero:
        """Return the zero of a line that starts at this time: the setup's, or a new one."""
        zero = self._zero
        if zero is not None and zero.setup == setup and not self._loss(zero.since, time):
            return zero
        count = self._zeros_of_setup[setup] = self._zeros_of_setup.get(setup, 0) + 1
        identity = setup if count == 1 else f"{setup} (zero {count})"
        self._zero = _Zero(setup=setup, identity=identity, since=time)
        return self._zero

    def _loss(self, after: int, until: int) -> tuple[int, int, int] | None:
        """Return the first span after one time, up to another, in which the zero was lost."""
        for span in self._losses:
            if span[0] <= until and span[1] > after:
                return span
        return None

    def _hopeless(self, stop: _OpenStop, line: _OpenLine, window: Window) -> str:
        """Say why no later window could be taken either; empty if waiting may help."""
        before = line.last
        if stop.arrival.time < self._decided_arrival:
            return "the clock of the machine stepped back: in position earlier than the stop before"
        if before is not None and stop.command.time < before.window_end:
            line.void.add(before.command.stop)
            early = (before.window_end - stop.command.time) * 1e-9
            return (
                f"moved too early: commanded {early:.3g} s before the readings of stop "
                f"{before.command.stop} were finished"
            )
        if stop.window_start <= self._dropped_until:
            return "in position became known too late: the readings of the stop are no longer kept"
        loss = self._loss(line.since, window.end)
        if loss is not None:
            what = STATUS_WORDS.get(loss[2], "the interferometer was started again")
            when = (loss[0] - self._start) * 1e-9
            return (
                f"the zero is lost: {what} {when:.2f} s after the start of the run; "
                "measure the line again"
            )
        return ""

    def _implausible(self, stop: _OpenStop, line: _OpenLine, window: Window) -> str:
        """Say if the reading is off by more than half a move; empty if it is not.

        No misalignment that still returns the beam does that: the machine stands elsewhere, or
        counts are lost.
        """
        settled = [number for number, other in line.stops.items() if other.settled]
        number = stop.command.stop
        if not settled or number == 0:
            return ""
        last = line.stops[settled[-1]]
        beam = self._plan.lines[line.line_index].beam(self._plan.volume)
        targets = line.targets
        nominal = float(beam.between(targets[last.command.stop], targets[number]))
        found = window.displacement - last.displacement
        if abs(found - nominal) <= 0.5 * beam.span(targets[number - 1], targets[number]):
            return ""
        return (
            f"the displacement since stop {last.command.stop} is {found * 1e3:.4f} mm instead of "
            f"{nominal * 1e3:.4f} mm: the machine stands elsewhere, the beam is not along the "
            "line, or counts are lost"
        )

    def _decide(
        self,
        stop: _OpenStop,
        line: _OpenLine,
        window: Window,
        reason: str,
        events: list[Event],
    ) -> None:
        decided = SettledStop(
            command=stop.command,
            line=line.line,
            position=stop.arrival.position,
            settled=not reason,
            reason=reason,
            time=window.time,
            displacement=window.displacement,
            raw_displacement=window.raw_displacement,
            standard_uncertainty=window.standard_uncertainty,
            standard_deviation=window.standard_deviation,
            readings=window.readings,
            first_sequence=window.first_sequence,
            last_sequence=window.last_sequence,
            in_position_time=stop.arrival.time,
            window_start=window.start,
            window_end=window.end,
            environment=window.environment,
        )
        if decided.settled:
            self._trigger = window.trigger
        self._take(decided, line, events)
        self._end_stop(stop)

    def _take(self, stop: SettledStop, line: _OpenLine, events: list[Event]) -> None:
        """Add a decided stop to its line, with the events that follow from it."""
        # The identity of the zero, not of the alignment alone, is what its numbers belong to.
        decided = replace(stop, command=stop.command._replace(setup=line.zero.identity))
        command = decided.command
        if decided.settled and not isfinite(line.zero.displacement):
            line.zero.displacement = decided.displacement
        before = line.stops.get(command.stop - 1)
        line.stops[command.stop] = line.last = decided
        events.append(decided)
        if decided.settled and before is not None and before.settled:
            events.append(_block(line, before, decided, self._plan))
        if command.stop == len(line.targets) - 1:
            overrun = self._plan.overrun_of(line.line)
            events.append(_finished(line, decided, self._start, overrun))

    def _end_stop(self, stop: _OpenStop) -> None:
        self._stop = None
        self._decided_arrival = max(self._decided_arrival, stop.arrival.time)
        # No later stop can be reached before this one was.
        unneeded = bisect_left(self._times, self._decided_arrival)
        del self._times[:unneeded]
        del self._readings[:unneeded]


def assemble(
    plan: Plan,
    start: int,
    commands: Iterable[StopCommand],
    arrivals: Iterable[Arrival],
    readings: Iterable[Reading],
    positions: Iterable[tuple[int, tuple[float, float, float]]] = (),
    on_pass: Callable[[FlownLine], object] | None = None,
) -> list[Event]:
    """Return the events of a recorded run, the same as those of the live run.

    Args:
        plan: of the run.
        start: of the run, ns.
        commands: in order of their id.
        arrivals: in order of their id.
        readings: in order of their time.
        positions: time (ns) and actual position (m) of the axes, in the order in which they came;
            only lines on the fly need them.
        on_pass: is given every line that was measured on the fly.

    Raises:
        ValueError: a command does not belong to the plan, or a command or an arrival contradicts
            one before it.
    """
    assembler = Assembler(plan, start, on_pass=on_pass)
    events: list[Event] = []
    pending_commands, pending_arrivals = deque(commands), deque(arrivals)
    coming, places = iter(readings), iter(positions)
    while (due := _earliest(pending_commands, pending_arrivals)) < _NEVER:
        # Fed roughly in order of time, so that few readings need to be kept.
        if due > assembler.latest:
            events += _up_to(due, places, assembler)
            events += assembler.add_readings(coming, due)
        if pending_commands and pending_commands[0].time == due:
            events += assembler.add_command(pending_commands.popleft())
        else:
            events += assembler.add_arrival(pending_arrivals.popleft())
    return events + _up_to(_NEVER, places, assembler) + assembler.add_readings(coming)


def _up_to(
    time: int,
    positions: Iterator[tuple[int, tuple[float, float, float]]],
    assembler: Assembler,
) -> list[Event]:
    """Feed positions, the first at or after a time as the last."""
    events: list[Event] = []
    for at, position in positions:
        events += assembler.add_position(at, position)
        if at >= time:
            break
    return events


def _earliest(commands: deque[StopCommand], arrivals: deque[Arrival]) -> int:
    return min(commands[0].time if commands else _NEVER, arrivals[0].time if arrivals else _NEVER)


def _block(
    line: _OpenLine, before: SettledStop, after: SettledStop, plan: Plan
) -> BlockDisplacement:
    start, end = line.targets[before.command.stop], line.targets[after.command.stop]
    beam = plan.lines[line.line_index].beam(plan.volume)
    moves_per_block = max(len(line.line.order), 1)
    return BlockDisplacement(
        line_index=line.line_index,
        attempt=line.attempt,
        line=line.line,
        time=after.time,
        block=before.command.stop // moves_per_block + 1,
        axis=moved_axes(start, end),
        from_stop=before.command.stop,
        to_stop=after.command.stop,
        nominal_displacement=float(beam.between(start, end)),
        displacement=after.displacement - before.displacement,
        standard_uncertainty=sqrt(before.standard_uncertainty**2 + after.standard_uncertainty**2),
    )


def _finished(line: _OpenLine, last: SettledStop, start: int, overrun: float) -> MeasuredLine:
    count = len(line.targets)
    time, displacement, uncertainty = (np.full(count, nan) for _ in range(3))
    environment = np.full((count, len(Environment._fields)), nan)
    for number, stop in line.stops.items():
        time[number] = (stop.time - start) * 1e-9
        environment[number] = stop.environment
        if stop.settled and number not in line.void:
            displacement[number] = stop.displacement - line.zero.displacement
            uncertainty[number] = stop.standard_uncertainty
    return MeasuredLine(
        line=line.line,
        line_index=line.line_index,
        attempt=line.attempt,
        setup=line.zero.identity,
        time=time,
        end_time=last.time,
        target=line.targets,
        displacement=displacement,
        standard_uncertainty=uncertainty,
        environment=environment,
        overrun=overrun,
        moved=line.moved,
    )
