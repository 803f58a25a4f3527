#!/usr/bin/env python3
"""Node: streams the readings of a laser interferometer."""

import sys
from dataclasses import replace
from functools import partial
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.configuration import load_cell, plan_from_text
from stepdiag_ros.conversion import (
    PURPOSE_STOP,
    from_reading,
    new_message,
    to_command,
    to_nanoseconds,
)
from stepdiag_ros.devices import Surroundings, create
from stepdiag_ros.devices.interferometer import STATUS_OK, FollowsRun, InterferometerDevice
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.plan import FORWARD, Plan
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.run.sequence import Answer
from stepdiag_ros.run.supervision import fact_of_run

POLL_PERIOD = 0.002
WEATHER_BEGINS = (
    "weather_begins",
    0,
    "ROS time in ns at which the weather of the simulated cell begins, the same for all its nodes; "
    "0: when this node starts",
    0,
    2**62,
)
"""Declaration of a parameter of the simulated cell that two nodes share."""
WEATHER = {
    "air_temperature": (topics.AIR_TEMPERATURE, "temperature"),
    "air_pressure": (topics.AIR_PRESSURE, "fluid_pressure"),
    "relative_humidity": (topics.RELATIVE_HUMIDITY, "relative_humidity"),
    "material_temperature": (topics.MATERIAL_TEMPERATURE, "temperature"),
}
"""Field of Environment → topic and field of its message."""


class InterferometerNode(StepdiagNode):
    """Publishes every reading, compensated for the weather that the weather topics tell."""

    role = "interferometer"

    def __init__(self) -> None:
        super().__init__("interferometer")
        self._driver = self.parameter("device", "simulated", "driver of the instrument")
        cell = self.parameter("cell", "demo", "simulated cell: YAML file or name, config/cells")
        rate = self.parameter("rate", 0.0, "readings in a second; 0: the cell's own", 0.0, 1e5)
        seed = self.parameter("seed", 0, "of the noise of the simulated readings", 0, 2**31)
        hold = self.parameter(
            "hold_after",
            1.0,
            "s without axis positions after which the last one holds",
            0.0,
            3600.0,
        )
        age = self.parameter(
            "weather_age", 10.0, "s after which the weather counts as unknown", 0.1, 86400.0
        )
        equation = self.parameter(
            "index_equation", "edlen", "refractive index of air by edlen (modified) or ciddor"
        )
        begins = self.parameter(*WEATHER_BEGINS)
        self._cell = load_cell(cell)[0] if self._driver == "simulated" else None
        self._settings: dict[str, Any] = {
            "seed": seed,
            "hold_after_s": hold,
            "weather_age_s": age,
            "index_equation": equation,
            "weather_begins_ns": begins,
        }
        if rate:
            self._settings["rate_hz"] = rate
        self._plan: Plan | None = None
        self._setup = ""
        # Since when a good reading of the present setup is waited for, ns; 0 if it has come.
        self._aligned = 0
        self._environment = Environment()
        self._weather_time = 0
        self._device: InterferometerDevice
        self._readings = self.announce(topics.READING)
        self._message = new_message(topics.READING.type_name)
        self.await_clock(self._open)

    def _open(self) -> None:
        surroundings = Surroundings(self.now(), cell=self._cell)
        self._device = create("interferometer", self._driver, self._settings, surroundings)
        if isinstance(self._device, FollowsRun):
            self.listen(topics.MACHINE_COMMAND, partial(self._on_command, self._device))
            self.listen(topics.COMMAND_STATUS, partial(self._on_answer, self._device))
        self.follow_run()
        self.listen(topics.JOINT_STATES, self._on_joints, keep_all=True)
        for name, (topic, field) in WEATHER.items():
            self.listen(topic, partial(self._on_weather, name, field))
        self.every(POLL_PERIOD, self._poll, real=True)

    def on_run(self, description: Any) -> None:
        """Take the plan, which says where the beam of each line is to go."""
        self._plan = plan_from_text(description.plan, "plan of the run")
        self._setup = ""
        if isinstance(self._device, FollowsRun):
            self._device.begin_run(self._plan, to_nanoseconds(description.header.stamp))

    def on_run_state(self, state: Any) -> None:
        """Set beam and zero up for the line that is to be measured."""
        if self._plan is None or state.run_id != self.run_id:
            return
        if not state.setup or state.setup == self._setup:
            return
        line, volume = self._plan.lines[state.line_index], self._plan.volume
        # The laser stands before the first stop of the forward pass, whichever pass comes first.
        x, y, z = (float(value) for value in replace(line, direction=FORWARD).stops(volume)[0])
        self._setup, self._aligned = state.setup, self.now()
        self._device.align(self._aligned, state.setup, line.name, volume.step, (x, y, z))

    def _on_command(self, device: FollowsRun, message: Any) -> None:
        if message.run_id == self.run_id:
            device.update_command(to_command(message), int(message.purpose) == PURPOSE_STOP)

    def _on_answer(self, device: FollowsRun, message: Any) -> None:
        if message.run_id == self.run_id and message.status not in (Answer.ACCEPTED, Answer.MOVING):
            in_position = message.status == Answer.IN_POSITION
            time = to_nanoseconds(message.header.stamp)
            device.update_answer(int(message.command_id), time, in_position)

    def _on_joints(self, message: Any) -> None:
        x, y, z = message.position
        self._device.update_position(to_nanoseconds(message.header.stamp), (x, y, z))

    def _on_weather(self, name: str, field: str, message: Any) -> None:
        self._environment = self._environment._replace(**{name: float(getattr(message, field))})
        # The four sensors speak one after another with the same stamp; each word counts.
        stamp = to_nanoseconds(message.header.stamp)
        self._weather_time = max(stamp, self._weather_time + 1)
        self._device.update_environment(self._weather_time, self._environment)

    def _poll(self) -> None:
        for reading in self._device.poll(self.now()):
            message = from_reading(reading, "interferometer", message=self._message)
            self._readings.publish(message)
            if self._aligned and reading.time > self._aligned and reading.status == STATUS_OK:
                self._aligned = 0
                self.facts["beam"] = fact_of_run(self.run_id, self._setup)
                self.beat()


def main() -> int:
    """Run the node."""
    return spin(InterferometerNode)


if __name__ == "__main__":
    sys.exit(main())
