#!/usr/bin/env python3
"""Node: streams the readings of a laser interferometer."""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import nan
from typing import Any

import numpy as np

from stepdiag_ros import topics
from stepdiag_ros.configuration import load_cell, plan_from_text
from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.interferometer import STATUS_OK, FollowsRun, InterferometerDevice
from stepdiag_ros.messages.conversion import (
    PURPOSE_STOP,
    axis_positions,
    from_reading,
    motor_positions,
    to_command,
)
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.messages.samples import from_sample_block
from stepdiag_ros.messages.types import new_message
from stepdiag_ros.metrology.air.compensator import Compensator
from stepdiag_ros.metrology.beam import BeamPath, FixedBeam
from stepdiag_ros.metrology.frames import LASER
from stepdiag_ros.metrology.fringe_count import CountCheck
from stepdiag_ros.metrology.measurement import Reading
from stepdiag_ros.metrology.plan import FORWARD, Plan
from stepdiag_ros.nodes.base import spin
from stepdiag_ros.nodes.managed import DeviceNode
from stepdiag_ros.run.accord import SIMULATED
from stepdiag_ros.run.device_health import Air, Beam, Compensation
from stepdiag_ros.run.health import Gaps, HealthFinding, StampRate
from stepdiag_ros.run.reading_source import ReadingSource
from stepdiag_ros.run.sequence import Answer, State
from stepdiag_ros.run.supervision import fact_of_run

SETTINGS = {
    "rate": "rate_hz",
    "seed": "seed",
    "hold_after": "hold_after_s",
    "weather_age": "weather_age_s",
    "index_equation": "index_equation",
    "weather_begins": "weather_begins_ns",
}
"""Parameter → setting of the simulated instrument."""


class InterferometerNode(DeviceNode[InterferometerDevice]):
    """Publishes every reading, compensated for the weather on the weather topics."""

    role = "interferometer"
    thing = "interferometer"
    poll_period = 0.002

    def __init__(self) -> None:
        super().__init__("interferometer")
        simulated = self.parameter("device") == SIMULATED
        self._cell = load_cell(self.parameter("cell"))[0] if simulated else None
        self.opener()
        self._beam = Beam(self.parameter("reading_timeout"), self.parameter("dim_signal"))
        self.on_change("reading_timeout", partial(setattr, self._beam, "stale_after"))
        self.on_change("dim_signal", partial(setattr, self._beam, "dim_below"))
        self.on_change("rate_tolerance", lambda new: setattr(self._rate, "tolerance", new))
        self._gaps = Gaps()
        self._judge_anew()
        for task in (
            self._judge_beam,
            self._judge_rate,
            self._judge_sequence,
            self._judge_weather,
            self._judge_compensation,
        ):
            self.add_device_task(task.__name__.removeprefix("_judge_"), task)
        self._plan: Plan | None = None
        self._run_begins = 0
        self._setup = ""
        self._count_check = CountCheck()
        self._line_beam: BeamPath = FixedBeam(np.zeros(3))
        # Since when a good reading of the present setup is waited for, ns; 0 if it has come.
        self._aligned = 0
        self._weather_time = 0
        self._position_time = 0
        self._readings = self.stream(topics.READING)
        self._samples = self.stream(topics.SAMPLES)
        self._message = new_message(topics.READING.type_name)
        self._listens = False

    def opener(self, **changed: Any) -> Callable[[int], InterferometerDevice]:
        """Return what opens the instrument (see ``DeviceNode.opener``)."""
        settings = self.device_settings(changed, SETTINGS)
        if not settings.get("rate_hz"):
            settings.pop("rate_hz", None)
        surroundings = Surroundings(cell=self._cell)
        with self.naming_file(changed):
            return prepare("interferometer", self.parameter("device"), settings, surroundings)

    def open_device(self) -> InterferometerDevice:
        """Open the instrument; what it is asked for may have changed since it was closed."""
        self._judge_anew()
        return super().open_device()

    def _judge_anew(self) -> None:
        """Begin with what the parameters say now."""
        asked = self.parameter("rate") or (self._cell.reading_rate if self._cell else nan)
        self._rate = StampRate(asked, self.parameter("rate_tolerance"))
        self._air = Air(self.parameter("weather_age"))
        self._compensation = Compensation(self.parameter("compensation"))
        how = ("compensation", "dead_path", "wavelength", "index_equation")
        self._compensator = Compensator(*map(self.parameter, how))

    def on_open(self, device: InterferometerDevice) -> None:
        """Feed the instrument from now on; pass on a run that is already in progress."""
        highest, late = self.parameter("reading_rate_limit"), self.parameter("stamps_late")
        self._source = ReadingSource(device, highest, late, self._compensator)
        if self._source.factor:
            self._rate = StampRate(self._source.rate, self.parameter("rate_tolerance"))
        if self._plan is not None and not self.run_over and isinstance(device, FollowsRun):
            device.begin_run(self._plan, self._run_begins)
        if self._listens:
            return
        self._listens = True
        if isinstance(device, FollowsRun):
            self.listen(topics.MACHINE_COMMAND, self._on_command)
            self.listen(topics.COMMAND_STATUS, self._on_answer)
        self.follow_run()
        self.listen(topics.JOINT_STATES, self._on_joints, keep_all=True)
        for name, (topic, field) in topics.WEATHER.items():
            self.listen(topic, partial(self._on_weather, name, field))

    def on_begin(self, device: InterferometerDevice) -> None:  # noqa: ARG002
        """Expect readings from now on."""
        self._beam.begin(self.real_time())
        # What was read and dropped before is not missed.
        self._gaps = Gaps()

    def on_end(self, device: InterferometerDevice, reason: str) -> None:  # noqa: ARG002
        """Forget beam and zero: they must be set up again before the next use."""
        self._setup, self._aligned = "", 0
        self._count_check.end()
        if self.facts.pop("beam", ""):
            self.beat()

    def on_run(self, description: Any) -> None:
        """Take the plan, which says where the beam of each line is to go."""
        self._plan = plan_from_text(description.plan, "plan of the run")
        self._run_begins = to_nanoseconds(description.header.stamp)
        self._setup = ""
        self._gaps.begin()
        self._beam.expect_setup()
        if isinstance(self.device, FollowsRun):
            self.device.begin_run(self._plan, self._run_begins)

    def on_run_state(self, state: Any) -> None:
        """Set beam and zero up for the line that is to be measured."""
        if self.device is None or not self.active:
            return
        if self._plan is None or state.run_id != self.run_id:
            return
        if state.state == State.WAITING_FOR_SETUP:
            # An operator is at the beam: what is set up now does not stand yet.
            self._setup, self._aligned = "", 0
            self._count_check.end()
            return
        if not state.setup or state.setup == self._setup:
            return
        line, volume = self._plan.lines[state.line_index], self._plan.volume
        # The laser stands before the first stop of the forward pass, whichever pass comes first.
        x, y, z = (float(value) for value in replace(line, direction=FORWARD).stops(volume)[0])
        self._setup, self._aligned = state.setup, self.now()
        self._beam.set_up(self._aligned + self._source.mixing)
        self._line_beam = line.beam(volume)
        self._count_check.end()
        self._compensator.align(self._aligned, self._line_beam, np.array((x, y, z)))
        with self.failing(f"align the interferometer for {state.setup}"):
            self.device.align(self._aligned, state.setup, line.name, volume.step, (x, y, z))

    def _on_command(self, message: Any) -> None:
        if message.run_id == self.run_id and isinstance(self.device, FollowsRun):
            at_stop = int(message.purpose) == PURPOSE_STOP
            self.device.update_command(to_command(message), at_stop)

    def _on_answer(self, message: Any) -> None:
        if message.run_id != self.run_id or not isinstance(self.device, FollowsRun):
            return
        if message.status not in (Answer.ACCEPTED, Answer.MOVING):
            in_position = message.status == Answer.IN_POSITION
            time = to_nanoseconds(message.header.stamp)
            self.device.update_answer(int(message.command_id), time, in_position)
            self._look_when_simulated()

    def _on_joints(self, message: Any) -> None:
        position = motor_positions(message) or axis_positions(message)
        if self.device is not None and position is not None:
            self._compensator.move(position)
            time = to_nanoseconds(message.header.stamp)
            self._count_check.add_position(time, position)
            spacing, self._position_time = time - self._position_time, time
            with self.failing("pass the position to the interferometer"):
                self.device.update_position(time, position)
            if time + spacing > self.now():
                # The last of those that came at once: none is due any more.
                self._look_when_simulated()

    def _look_when_simulated(self) -> None:
        """Read a simulated device as soon as it has what its readings depend on."""
        if self._is_simulated():
            self.look_at_device()

    def _on_weather(self, name: str, field: str, message: Any) -> None:
        # The four sensors speak one after another with the same stamp; each word counts.
        stamp = to_nanoseconds(message.header.stamp)
        self._weather_time = max(stamp, self._weather_time + 1)
        self._air.take(name, float(getattr(message, field)), stamp, self.real_time())
        if self.device is not None:
            with self.failing("pass the weather to the interferometer"):
                known = self._air.known.at(self._weather_time)
                self.device.update_environment(self._weather_time, known)

    def poll(self, device: InterferometerDevice) -> None:  # noqa: ARG002
        """Publish the readings; while the node is not active they are read and dropped."""
        now = self.now()
        blocks, readings = self._source.poll(now, self.real_time(), self._air.known.at(now))
        for block in blocks:
            self._samples.publish(from_sample_block(block, LASER, self._source.factor))
        before, readings = self._count_check.trouble, self._count_check.judged(readings)
        if self._count_check.trouble != before:
            self.get_logger().error(f"the count is wrong: {self._count_check.trouble}")
        self._readings.publish_all(
            from_reading(reading, LASER, message=self._message) for reading in readings
        )
        self._note_zero(readings)
        if readings and self.active:
            self._look_at(readings)

    def _note_zero(self, readings: list[Reading]) -> None:
        """Say that the beam stands, once a good reading of its setup has come."""
        if not self._aligned:
            return
        for reading in readings:
            if reading.time > self._aligned and reading.status == STATUS_OK:
                self._aligned = 0
                self._count_check.begin(self._line_beam, reading.time)
                self.facts["beam"] = fact_of_run(self.run_id, self._setup)
                self.beat()
                return

    def _look_at(self, readings: list[Reading]) -> None:
        real = self.real_time()
        self._gaps.take_all(readings, real)
        self._rate.take(len(readings), readings[-1].time)
        self._compensation.take(readings)
        if self._beam.take(readings, real):
            self.health.look()

    def _judge_beam(self) -> HealthFinding:
        return self._beam.judge(self.now(), self.real_time(), in_run=not self.run_over)

    def _judge_rate(self) -> HealthFinding:
        return self._rate.judge(self.real_time())

    def _judge_sequence(self) -> HealthFinding:
        return self._gaps.judge(not self.run_over, self.real_time())

    def _judge_compensation(self) -> HealthFinding:
        return self._compensation.judge(self._judge_weather())

    def _judge_weather(self) -> HealthFinding:
        return self._air.judge(self.now(), self.real_time())


def main() -> int:
    """Run the node."""
    return spin(InterferometerNode)


if __name__ == "__main__":
    sys.exit(main())
