#!/usr/bin/env python3
"""Node: publishes what the weather sensors say, on topics of standard types."""

import sys

from stepdiag_ros.configuration import load_cell
from stepdiag_ros.conversion import new_message, set_header
from stepdiag_ros.devices import Surroundings, create
from stepdiag_ros.devices.weather import WeatherDevice
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.nodes.interferometer import WEATHER, WEATHER_BEGINS

POLL_PERIOD = 0.01


class WeatherNode(StepdiagNode):
    """Publishes temperature of air and material, pressure and humidity."""

    role = "weather"

    def __init__(self) -> None:
        super().__init__("weather")
        self._driver = self.parameter("device", "simulated", "driver of the weather station")
        cell = self.parameter("cell", "demo", "simulated cell: YAML file or name, config/cells")
        rate = self.parameter("rate", 1.0, "values in a second", 0.001, 1000.0)
        self._cell = load_cell(cell)[0] if self._driver == "simulated" else None
        begins = self.parameter(*WEATHER_BEGINS)
        self._settings = {"rate_hz": rate, "weather_begins_ns": begins}
        self._device: WeatherDevice
        self._outlets = {
            name: (self.announce(topic), topic, field) for name, (topic, field) in WEATHER.items()
        }
        self.follow_run()
        self.await_clock(self._open)

    def _open(self) -> None:
        surroundings = Surroundings(self.now(), cell=self._cell)
        self._device = create("weather", self._driver, self._settings, surroundings)
        self.every(POLL_PERIOD, self._poll, real=True)

    def _poll(self) -> None:
        for time, environment in self._device.poll(self.now()):
            for name, (publisher, topic, field) in self._outlets.items():
                message = new_message(topic.type_name)
                set_header(message, time, "weather")
                setattr(message, field, getattr(environment, name))
                publisher.publish(message)


def main() -> int:
    """Run the node."""
    return spin(WeatherNode)


if __name__ == "__main__":
    sys.exit(main())
