"""Sequence of a run: which command comes next, what it waits for, and what stops it."""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from enum import Enum, IntEnum

import numpy as np

from stepdiag_ros.metrology.assembly import repetition_helps
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.measurement import StopCommand
from stepdiag_ros.metrology.on_the_fly.flight import needs_corner_stops
from stepdiag_ros.metrology.plan import HOLD, Line, Plan, moved_axes
from stepdiag_ros.metrology.target import TargetStanding, TargetState
from stepdiag_ros.metrology.units import NANOSECONDS
from stepdiag_ros.run.refusing import in_wrong_state
from stepdiag_ros.run.route import MachineRoute
from stepdiag_ros.run.target_words import end_words
from stepdiag_ros.run.time_left import TimeLeft

ANSWER_LIMIT = 2.0
"""Real seconds within which the bridge must answer a command."""
BEAM_LIMIT = 10.0
"""Real seconds within which the interferometer must have a beam for a new setup."""
OVERDUE_LIMIT = 10.0
"""Real seconds that a move or a stop that is overdue in ROS time may take all the same."""
STORE_LIMIT = 10.0
"""Real seconds within which the recorder must have stored a stop."""
TARGET_LIMIT = 20.0
"""Real seconds that a run with a target waits for the solution of a line that may be its last."""
MOVE_ALLOWANCE = 5.0
"""ROS seconds that a move may take beyond twice its nominal time."""
MOVED = 1e-3
"""m: by more, an axis was moved in a pause; a corrected target and servo drift are less."""


class State(IntEnum):
    """State of a run; the numbers are those of RunState.msg."""

    IDLE = 0
    RUNNING = 1
    PAUSED = 2
    WAITING_FOR_SETUP = 3
    FINISHED = 4
    ABORTED = 5
    FAULT = 6


class Purpose(IntEnum):
    """Purpose of a command; the numbers are those of StepCommand.msg."""

    STOP = 0
    POSITION = 1


class Answer(IntEnum):
    """What became of a command; the numbers are those of CommandStatus.msg."""

    ACCEPTED = 0
    MOVING = 1
    IN_POSITION = 2
    REJECTED = 3
    STOPPED = 4
    FAULT = 5


@dataclass(frozen=True)
class Command:
    """One straight move (fields as in StepCommand.msg; m, m/s)."""

    command_id: int
    purpose: Purpose
    line_index: int
    attempt: int
    setup: str
    stop: int
    axis: str
    target: tuple[float, float, float]
    feed: float

    def given_at(self, time: int) -> StopCommand:
        """Return what the assembly keeps of the command, given at a time in ns."""
        return StopCommand(
            command_id=self.command_id,
            line_index=self.line_index,
            attempt=self.attempt,
            setup=self.setup,
            stop=self.stop,
            axis=self.axis,
            target=self.target,
            time=time,
        )


@dataclass(frozen=True)
class Progress:
    """Where a run is (fields as in RunState.msg and in the feedback of Measure.action; s)."""

    state: State
    line_index: int
    line_count: int
    line: str
    setup: str
    block: int
    block_count: int
    stop: int
    stop_count: int
    stops_done: int
    stops_total: int
    remaining_time: float
    text: str
    target: TargetStanding | None = None


class _Phase(Enum):
    """What a run that goes on waits for."""

    READY = "the beam of the setup"
    ANSWER = "the answer of the bridge to a command"
    MOTION = "the machine to be in position"
    CORNER = "the next move of a line that is measured on the fly"
    SETTLING = "the stop to settle"
    DWELL = "the stop to be stored"
    TARGET = "the solution of the line, by which the run may have reached its target"


class Sequence:
    """Executes a plan one move at a time (``MachineRoute``), each after the last stop has settled.

    Every method takes the ROS time in ns (``now``) and a clock that never steps in s (``real``):
    durations of the machine count in ROS time, silence of other nodes in real time.

    Args:
        plan: the test plan.
        position: actual position of the machine, m.
        send: is given each command to be executed.
        stop_motion: asks the machine to stop at once.
        patience: factor by which other nodes may take longer to answer.
        ends: numbers of lines after which the run may have reached its target; empty without one.
    """

    def __init__(
        self,
        plan: Plan,
        position: tuple[float, float, float],
        send: Callable[[Command], None],
        stop_motion: Callable[[], None],
        patience: float = 1.0,
        ends: Collection[int] = (),
    ) -> None:
        self._plan = plan
        self._ends = ends
        self._target_limit = TARGET_LIMIT * patience
        self.target: TargetStanding | None = None
        self._answer_limit = ANSWER_LIMIT * patience
        self._beam_limit = BEAM_LIMIT * patience
        self._overdue_limit = OVERDUE_LIMIT * patience
        self._store_limit = STORE_LIMIT * patience
        self._position = np.asarray(position, dtype=np.float64)
        self._send = send
        self._stop_motion = stop_motion
        self._stops = [line.stops(plan.volume) for line in plan.lines]
        self._total = plan.stop_count
        self.state = State.IDLE
        self.text = "waiting for all nodes to take up the run"
        self.unstopped = ""
        self.unready = ""
        self._line_index = 0
        self._attempt = 1
        self._stop = 0
        self._route = MachineRoute(plan)
        # How often this stop, and this line since an operator last saw to it, have been measured.
        self._stop_tries = 1
        self._line_tries = 1
        # What is wrong with the present stop; which stop of a line that was given up was first.
        self._rejection = ""
        self._given_up = ""
        self._phase = _Phase.READY
        self._command: Command | None = None
        self._command_count = 0
        self._setup_count: dict[str, int] = {}
        self._confirmed_setup = ""
        self._sent_real = 0.0
        self._deadline = 0
        self._arrived = 0
        self._time_left = TimeLeft()
        self._pause_wanted = False
        self._assembled = False
        # Whether lines are measured on the fly, as long as positions come often enough.
        self._flies = plan.on_the_fly
        self._stored = 0
        self._beam_setup = ""
        self._beam_wanted_since: float | None = None
        self._dwell = round(plan.sampling.dwell * NANOSECONDS)
        self.incomplete: list[str] = []

    # What an operator does -------------------------------------------------------------------

    def start(self, now: int, real: float) -> None:
        """Start at the first line.

        Raises:
            ValueError: the run was started before.
        """
        if self.state is not State.IDLE:
            raise ValueError("this run was started before")
        self._enter(State.RUNNING, "measuring")
        self.update(now, real)

    def pause(self) -> None:
        """Stand still after the present stop has been measured.

        Raises:
            ValueError: the run is not running.
        """
        if self.state is not State.RUNNING:
            raise in_wrong_state("pause", self.state)
        self._pause_wanted = True
        self.text = "pausing after this stop"

    def check_resumable(self) -> None:
        """Refuse unless the run can be resumed, whether or not all nodes are ready.

        Raises:
            Refusal: there is nothing to resume.
        """
        pausing = self.state is State.RUNNING and self._pause_wanted
        held = (State.WAITING_FOR_SETUP, State.FAULT, State.PAUSED)
        if not pausing and self.state not in held:
            raise in_wrong_state("resume", self.state)

    def resume(self, now: int, real: float, position: tuple[float, float, float]) -> None:
        """Go on after a pause or a setup; after a fault measure the present line again.

        A machine that was moved in a pause is a fault: it would come to the next stop another way.

        Raises:
            ValueError: there is nothing to resume.
        """
        self.check_resumable()
        if self.state is State.RUNNING:
            self._pause_wanted = False
            self.text = "measuring"
            return
        if self.state is State.WAITING_FOR_SETUP:
            self._confirmed_setup = self._setup()
        elif self.state is State.PAUSED and (moved := self._moved_to(position)):
            self.fault(f"{moved} in the pause: resume to measure the line again")
            return
        elif self.state is State.FAULT:
            # Whatever stopped the run may have moved the beam or lost the fringe count.
            self._position = np.asarray(position, dtype=np.float64)
            if self._line_index < len(self._stops):
                self._restart_line()
            self._line_tries = 1
        self._enter(State.RUNNING, "measuring")
        self.update(now, real)

    def abort(self, text: str) -> None:
        """Stop the machine and end the run for good.

        Raises:
            ValueError: the run has ended.
        """
        if self.state in (State.FINISHED, State.ABORTED):
            raise in_wrong_state("abort", self.state)
        if self.state is State.FAULT:
            text = f"{text}, after the fault: {self.text}"
        self._stop_motion()
        self._enter(State.ABORTED, text)

    def fault(self, text: str) -> None:
        """Stop the machine because something is wrong; ``resume`` restarts the present line."""
        if self.active:
            self._stop_motion()
            self._enter(State.FAULT, text)

    # What the other nodes say ----------------------------------------------------------------

    def not_stopped(self, why: str) -> bool:
        """Take note why the machine may not have stopped on command; empty if it has after all.

        Returns:
            whether that is news.
        """
        before, self.unstopped = self.unstopped, why
        return why != before

    def not_resumed(self, why: str) -> None:
        """Take note why a run that was resumed does not go on: the machine cannot be made ready."""
        self.unready = why

    def answered(
        self,
        command_id: int,
        answer: Answer,
        reason: str,
        now: int,
        real: float,
    ) -> None:
        """Take the bridge's answer to a command; answers to other commands are ignored."""
        command = self._command
        if command is None or command.command_id != command_id or not self.active:
            return
        if answer in (Answer.REJECTED, Answer.STOPPED, Answer.FAULT):
            self.fault(f"{answer.name.lower()} move of {command.axis or 'no axis'}: {reason}")
            return
        if answer in (Answer.ACCEPTED, Answer.MOVING):
            if self._phase is _Phase.ANSWER:
                self._phase = _Phase.MOTION
            return
        self._position = np.asarray(command.target)
        if command.purpose is Purpose.POSITION:
            self._phase = _Phase.READY
        elif self._passes_corner and self._phase in (_Phase.ANSWER, _Phase.MOTION):
            self._phase = _Phase.CORNER
            self._arrived = now
        elif self._phase in (_Phase.ANSWER, _Phase.MOTION):
            self._phase = _Phase.DWELL if self._assembled else _Phase.SETTLING
            self._arrived = now
            wait = self._plan.sampling.longest_wait + MOVE_ALLOWANCE
            self._deadline = now + round(wait * NANOSECONDS)
            self._sent_real = real
        self.update(now, real)

    def settled(self, line_index: int, attempt: int, stop: int, rejection: str) -> None:
        """Take the assembler's word on a stop; words on other stops are ignored.

        Args:
            line_index: of the stop's line.
            attempt: at that line.
            stop: which one.
            rejection: why the stop has no value; empty if it settled.
        """
        if (line_index, attempt) != (self._line_index, self._attempt):
            return
        if self._assembled or not self.active:
            return
        if self._flies:
            # All stops of a line on the fly are decided at its end; the first objection counts.
            rejection = self._rejection = self._rejection or rejection
            if stop < self._stop:
                self._time_left.stop_measured()
        if stop != self._stop:
            return
        # The bridge's and the assembler's messages travel apart and may overtake each other.
        self._assembled = True
        self._rejection = rejection
        self._time_left.stop_measured()
        if self._phase is _Phase.SETTLING:
            self._phase = _Phase.DWELL

    def beam_ready(self, setup: str) -> None:
        """Take the interferometer's word that it has a beam and a zero for a setup."""
        self._beam_setup = setup

    def stored(self, command_id: int) -> None:
        """Take the recorder's word that the stop of this command is on the disk."""
        self._stored = max(self._stored, command_id)

    def solved(self, standing: TargetStanding) -> None:
        """Take the solver's word on how far the run is from its target."""
        if self.state in (State.FINISHED, State.ABORTED):
            return
        self.target = standing
        if self.state in (State.PAUSED, State.WAITING_FOR_SETUP) and self._may_end_here:
            self._finish()

    # What follows ----------------------------------------------------------------------------

    def update(self, now: int, real: float) -> None:
        """Send the next command if it is due, or find that something has taken too long."""
        self._time_left.look(now, self.state is State.RUNNING)
        if self.state is not State.RUNNING:
            return
        if self._phase is _Phase.ANSWER and real - self._sent_real > self._answer_limit:
            limit = f"{self._answer_limit:g} s"
            self.fault(f"the CNC bridge has not answered a command for {limit}")
        elif self._phase in (_Phase.MOTION, _Phase.SETTLING) and now > self._deadline:
            # A stopped or hurried clock alone is not a fault of the machine.
            if real - self._sent_real > self._overdue_limit:
                moving = self._phase is _Phase.MOTION
                what = "move has not ended" if moving else "stop has not been assembled"
                self.fault(f"the {what} in the time it should take")
        elif self._phase is _Phase.DWELL:
            self._end_dwell(now, real)
        elif self._phase is _Phase.CORNER and now >= self._arrived + self._stay:
            self._advance(real)
        if self._phase is _Phase.TARGET and self._judged(real):
            self._go_on()
        if self._phase is _Phase.READY and self.state is State.RUNNING:
            self._command_next(now, real)

    def progress(self, now: int) -> Progress:
        """Return where the run is."""
        done = min(self._line_index, len(self._stops))
        stops_done = sum(len(stops) for stops in self._stops[:done]) + self._stop
        self._time_left.look(now, self.state is State.RUNNING)
        held = self.active or self.state is State.FAULT
        remaining = self._time_left.estimate(self._total - stops_done) if held else math.nan
        ended = done == len(self._stops)
        text = self.text
        if self.unready:
            text += f"; not resumed: {self.unready}"
        if self.unstopped:
            text += f"; the machine may still move: {self.unstopped}"
        return Progress(
            state=self.state,
            line_index=self._line_index,
            line_count=len(self._stops),
            line="" if ended else str(self._line),
            setup="" if ended else self._setup(),
            block=0 if ended else self._line.block_of(self._stop),
            block_count=0 if ended else self._plan.volume.blocks,
            stop=self._stop,
            stop_count=0 if ended else len(self._stops[done]),
            stops_done=stops_done,
            stops_total=self._total,
            remaining_time=remaining,
            text=text,
            target=self.target,
        )

    @property
    def active(self) -> bool:
        """Say whether the run has begun and not ended (a fault or pause may hold it)."""
        return self.state in (State.RUNNING, State.PAUSED, State.WAITING_FOR_SETUP)

    @property
    def wanted(self) -> int:
        """Return the command whose move is wanted now; 0 if none is."""
        moving = self._phase in (_Phase.ANSWER, _Phase.MOTION)
        if self.state is State.RUNNING and moving and self._command is not None:
            return self._command.command_id
        return 0

    @property
    def waits_for(self) -> str:
        """Return what has to happen before the run goes on; empty if it is not begun, or over."""
        if self.state is State.RUNNING:
            return self._phase.value
        return "~/resume" if self.active or self.state is State.FAULT else ""

    @property
    def _line(self) -> Line:
        return self._plan.lines[self._line_index]

    @property
    def _passes_corner(self) -> bool:
        """Say whether the present stop is not waited for, but measured with its line."""
        return self._flies and self._stop < len(self._stops[self._line_index]) - 1

    @property
    def _stay(self) -> int:
        """Return how long the machine stays at a corner, ns: at the first its zero is read."""
        return self._dwell if self._stop == 0 else 0

    def _setup(self) -> str:
        """Return the identity of alignment and zero; a new one after each restart of a line."""
        setup = self._plan.setup_of(self._line)
        count = self._setup_count.get(setup, 1)
        return setup + (f" #{count}" if count > 1 else "")

    def _enter(self, state: State, text: str) -> None:
        self.state = state
        self.text = text
        self._pause_wanted = False
        self.unready = ""
        if state is State.RUNNING:
            self.unstopped = ""

    def _moved_to(self, position: tuple[float, float, float]) -> str:
        """Name the axis that was moved most since the run has stopped it; empty if none was."""
        off = np.asarray(position) - self._position
        axis = int(np.argmax(np.abs(off)))
        if abs(off[axis]) <= MOVED:
            return ""
        return f"{AXES[axis]} was moved by {off[axis] * 1e3:.1f} mm"

    def _restart_line(self) -> None:
        self._attempt += 1
        self._line_tries += 1
        self._stop = 0
        self._stop_tries = 1
        self._rejection = self._given_up = ""
        self._route.restart_line()
        self._phase = _Phase.READY
        setup = self._plan.setup_of(self._line)
        self._setup_count[setup] = self._setup_count.get(setup, 1) + 1

    def _end_dwell(self, now: int, real: float) -> None:
        assert self._command is not None
        # The machine moves on only when what was measured cannot be lost any more.
        if self._stored < self._command.command_id:
            if real - self._sent_real > self._store_limit and now > self._deadline:
                self.fault(f"the recorder has not stored a stop within {self._store_limit:g} s")
        elif now >= self._arrived + self._dwell:
            self._advance(real)

    def _advance(self, real: float) -> None:
        self._phase = _Phase.READY
        if self._rejection and self._try_again():
            return
        self._stop += 1
        self._stop_tries = 1
        if self._stop == len(self._stops[self._line_index]):
            if self._given_up:
                self.incomplete.append(f"{self._line}: {self._given_up}")
            self._line_index += 1
            self._attempt = self._line_tries = 1
            self._stop = 0
            self._given_up = self._rejection = ""
            if self._line_index < len(self._stops):
                self._route.begin_line(self._line_index)
            if self._line_index in self._ends:
                self._phase, self._sent_real = _Phase.TARGET, real
                return
        self._go_on()

    def _judged(self, real: float) -> bool:
        """Say whether the solver has judged the lines so far, or was waited for long enough."""
        known = self.target is not None and self.target.lines >= self._line_index
        return known or real - self._sent_real > self._target_limit

    @property
    def _may_end_here(self) -> bool:
        """Say whether the target is reached and no line is begun and not ended."""
        reached = self.target is not None and self.target.state is TargetState.REACHED
        return reached and self._stop == 0 and self._line_index > 0

    def _go_on(self) -> None:
        """Go on after a stop or a line: end the run, pause it, or let the next command come."""
        self._phase = _Phase.READY
        if self._line_index == len(self._stops) or self._may_end_here:
            self._finish()
        elif self._pause_wanted:
            self._enter(State.PAUSED, "paused by the operator")

    def _finish(self) -> None:
        done, total = self._line_index, len(self._stops)
        said = ["all lines are measured" if done == total else f"{done} of {total} passes measured"]
        if self.incomplete:
            said.append(f"left incomplete: {'; '.join(self.incomplete)}")
        if self._ends:
            said.append(end_words(self.target, done))
        self._enter(State.FINISHED, "; ".join(said))

    def _try_again(self) -> bool:
        """Measure a rejected stop, or its line, again; hold the run when that was often enough.

        Returns:
            False if the run goes on without the stop.
        """
        what, sampling = f"stop {self._stop}: {self._rejection}", self._plan.sampling
        if self._given_up:
            return False
        if self._flies and needs_corner_stops(self._rejection):
            self._flies = False
            self.text = "measuring with stops at the corners: " + self._rejection
            self._line_tries -= 1
            self._restart_line()
        elif repetition_helps(self._rejection) and self._stop_tries < sampling.stop_attempts:
            self._stop_tries += 1
            self._route.repeat(self._line, self._stop)
        elif self._line_tries < sampling.line_attempts:
            self._restart_line()
        elif sampling.after_attempts == HOLD:
            times = f"measured {self._line_tries} times in vain"
            self.fault(f"line {self._line}, {times}, {what}; see to it, then resume")
            return True
        else:
            self._given_up = what
            return False
        if self._pause_wanted:
            self._enter(State.PAUSED, "paused by the operator")
        return True

    def _has_beam(self, setup: str, real: float) -> bool:
        if self._beam_setup == setup:
            self._beam_wanted_since = None
            return True
        if self._beam_wanted_since is None:
            self._beam_wanted_since = real
        elif real - self._beam_wanted_since > self._beam_limit:
            self._beam_wanted_since = None
            self.fault(f"the interferometer has no beam for setup '{setup}'")
        return False

    def _command_next(self, now: int, real: float) -> None:
        setup = self._setup()
        if self._plan.pause_for_setup and setup != self._confirmed_setup:
            self._enter(
                State.WAITING_FOR_SETUP,
                f"align laser and mirror for {self._plan.setup_of(self._line)}, then resume",
            )
            return
        if not self._has_beam(setup, real):
            return
        try:
            target, at_stop = self._route.next(self._line, self._stop, self._position)
        except ValueError as error:
            self.fault(f"line {self._line}, stop {self._stop}: {error}")
            return
        purpose = Purpose.STOP if at_stop else Purpose.POSITION
        self._command_count += 1
        self._command = Command(
            command_id=self._command_count,
            purpose=purpose,
            line_index=self._line_index,
            attempt=self._attempt,
            setup=setup,
            stop=self._stop if at_stop else 0,
            axis=moved_axes(self._position, target),
            target=(float(target[0]), float(target[1]), float(target[2])),
            feed=self._plan.feed,
        )
        distance = float(np.linalg.norm(target - self._position))
        allowed = 2.0 * distance / self._plan.feed + MOVE_ALLOWANCE
        self._deadline = now + round(allowed * NANOSECONDS)
        self._sent_real = real
        self._assembled = False
        self._phase = _Phase.ANSWER
        self._send(self._command)
