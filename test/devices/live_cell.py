"""A whole run in one process: sequence, controller, interferometer, weather and assembler."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.cnc import CncState, PositionSample
from stepdiag_ros.metrology.assembly import Assembler
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.measurement import (
    Arrival,
    MeasuredLine,
    Measurement,
    SettledStop,
    latest_attempts,
)
from stepdiag_ros.metrology.plan import FORWARD
from stepdiag_ros.run.sequence import Answer, Purpose, Sequence, State

START = 1_700_000_000_000_000_000
MS = 1_000_000
MACHINE = Machine("m", "YXZ", (-0.1, -0.1, -0.1), (0.5, 0.4, 0.3), 0.5, 2.0)
ANSWERS = {
    CncState.MOVING: Answer.MOVING,
    CncState.READY: Answer.IN_POSITION,
    CncState.STOPPED: Answer.STOPPED,
    CncState.FAULT: Answer.FAULT,
}


class LiveCell:
    """Runs a plan on the simulated devices, as the nodes do, without the nodes.

    Args:
        plan: of the run.
        cell: the truth.
        tick: of the clock, ns.
        late: with this seed, commands and answers reach the interferometer up to 0.4 s late.
        rate: of the readings, Hz.
        before_run: how long the weather has gone on before the run, ns.
        position_rate: of the positions, Hz.
        seed: of the noise of the readings.
    """

    def __init__(
        self,
        plan,
        cell,
        tick=40 * MS,
        late=None,
        rate=100.0,
        before_run=3000 * MS,
        position_rate=50.0,
        seed=0,
    ):
        self.plan, self.tick = plan, tick
        self.random = None if late is None else np.random.default_rng(late)
        self.now, self.start = START, START + before_run
        around = Surroundings(MACHINE, cell)
        self.cnc = prepare("cnc", "simulated", {"position_rate_hz": position_rate}, around)(START)
        settings = {"rate_hz": rate, "hold_after_s": 3600.0, "weather_age_s": 3600.0, "seed": seed}
        self.laser = prepare("interferometer", "simulated", settings, around)(START)
        self.weather = prepare("weather", "simulated", {"rate_hz": 20.0}, around)(START)
        self.assembler = Assembler(plan, self.start)
        self.sequence = Sequence(plan, (0.0, 0.0, 0.0), self._send, lambda: None)
        self.post: list[tuple[int, Callable[[], None]]] = []
        self.due: dict[str, int] = {}
        self.setup, self.number, self.not_before = "", 0, 0
        self.position = (0.0, 0.0, 0.0)
        self.readings, self.stops, self.lines = [], [], []
        self.watchers: list[Callable[[SettledStop], None]] = [self.stops.append]

    def measure(self) -> Measurement:
        """Run to the end; return what was measured."""
        while self.now < self.start:
            self._go_on()
        self.laser.begin_run(self.plan, self.start)
        self._align()
        self.sequence.start(self.now, self.now * 1e-9)
        for _ in range(200_000):
            if self.sequence.state is State.FINISHED:
                break
            self._go_on()
            if self.sequence.state in (State.FAULT, State.WAITING_FOR_SETUP):
                self.resume()
            elif self.sequence.state is State.RUNNING:
                self._align()
                self.sequence.update(self.now, self.now * 1e-9)
        assert self.sequence.state is State.FINISHED, self.sequence.text
        return Measurement(self.plan.volume, latest_attempts(tuple(self.lines)), "YXZ")

    def resume(self):
        """Go on after a setup, or measure the present line again after a fault."""
        self.cnc.reset(self.now)
        self.sequence.resume(self.now, self.now * 1e-9, self.position)

    def _go_on(self):
        self.now += self.tick
        for time, environment in self.weather.poll(self.now):
            self.laser.update_environment(time, environment)
        for event in self.cnc.poll(self.now):
            self.position = event.position
            if isinstance(event, PositionSample):
                self.laser.update_position(event.time, event.position)
                self._take(self.assembler.add_position(event.time, event.position))
            elif self.number:
                self._answer(event)
        self._deliver()
        for reading in self.laser.poll(self.now):
            self.readings.append(reading)
            self._take(self.assembler.add_reading(reading))

    def _answer(self, event):
        answer, number = ANSWERS[event.state], self.number
        self.sequence.answered(number, answer, event.reason, self.now, self.now * 1e-9)
        if answer is Answer.MOVING:
            return
        in_position = answer is Answer.IN_POSITION
        self._tell("answer", lambda: self.laser.update_answer(number, event.time, in_position))
        if in_position:
            self._take(self.assembler.add_arrival(Arrival(number, event.time, event.position)))

    def _send(self, command):
        now = max(self.now, self.not_before)
        self.number = command.command_id
        stop = command.given_at(now)
        ends_at_stop = command.purpose is Purpose.STOP
        self._tell("command", lambda: self.laser.update_command(stop, ends_at_stop))
        if ends_at_stop:
            self._take(self.assembler.add_command(stop))
        self.cnc.start_move(self.now, command.target, command.feed, command.axis)

    def _align(self):
        setup = self.sequence.progress(self.now).setup
        if setup and setup != self.setup:
            line = self.plan.lines[self.sequence.progress(self.now).line_index]
            first = replace(line, direction=FORWARD).stops(self.plan.volume)[0]
            self.laser.align(self.now, setup, line.name, self.plan.volume.step, tuple(first))
            self.setup = setup
        self.sequence.beam_ready(setup)

    def _take(self, events):
        for event in events:
            if isinstance(event, SettledStop):
                self.not_before = event.window_end
                rejection = "" if event.settled else event.reason
                command = event.command
                self.sequence.settled(command.line_index, command.attempt, command.stop, rejection)
                self.sequence.stored(command.command_id)
                for watcher in self.watchers:
                    watcher(event)
            elif isinstance(event, MeasuredLine):
                self.lines.append(event)

    def _tell(self, topic, word):
        delay = 0 if self.random is None else int(self.random.integers(0, 400 * MS))
        # Each of the two topics keeps its order, but one may overtake the other.
        due = self.due[topic] = max(self.now + delay, self.due.get(topic, 0))
        if due == self.now:
            word()
        else:
            self.post.append((due, word))

    def _deliver(self):
        for one in sorted(self.post, key=lambda one: one[0]):
            if one[0] <= self.now:
                self.post.remove(one)
                one[1]()
