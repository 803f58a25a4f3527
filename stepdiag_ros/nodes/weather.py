#!/usr/bin/env python3
"""Node: publishes what the weather sensors say, on topics of standard types."""

import sys
from collections.abc import Callable
from functools import partial
from math import isnan
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.configuration import load_cell
from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.weather import WeatherDevice
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.messages.types import new_message
from stepdiag_ros.metrology.frames import LASER, MACHINE
from stepdiag_ros.nodes.base import spin
from stepdiag_ros.nodes.managed import DeviceNode
from stepdiag_ros.run.accord import SIMULATED
from stepdiag_ros.run.device_health import Air
from stepdiag_ros.run.health import HealthFinding

SENSOR_FRAMES = {topics.MATERIAL_TEMPERATURE: MACHINE}
"""Of the sensors that do not stand at the beam."""
SETTINGS = {"rate": "rate_hz", "weather_begins": "weather_begins_ns"}
"""Parameter → setting of the simulated station."""


class WeatherNode(DeviceNode[WeatherDevice]):
    """Publishes temperature of air and material, pressure and humidity."""

    role = "weather"
    thing = "weather station"

    def __init__(self) -> None:
        super().__init__("weather")
        simulated = self.parameter("device") == SIMULATED
        self._cell = load_cell(self.parameter("cell"))[0] if simulated else None
        self.opener()
        self._outlets = {
            name: (self.stream(topic), topic, field)
            for name, (topic, field) in topics.WEATHER.items()
        }
        self._air = Air(self.parameter("value_timeout"))
        self.on_change("value_timeout", partial(setattr, self._air, "stale_after"))
        self.add_device_task("sensors", self._judge_sensors)
        self.follow_run()

    def opener(self, **changed: Any) -> Callable[[int], WeatherDevice]:
        """Return what opens the weather station (see ``DeviceNode.opener``)."""
        settings = self.device_settings(changed, SETTINGS)
        surroundings = Surroundings(cell=self._cell)
        with self.naming_file(changed):
            return prepare("weather", self.parameter("device"), settings, surroundings)

    def poll(self, device: WeatherDevice) -> None:
        """Publish what the sensors have said."""
        for time, environment in device.poll(self.now()):
            for name, (publisher, topic, field) in self._outlets.items():
                value = getattr(environment, name)
                if isnan(value):
                    # Nothing was said of it; it grows old with whoever needs it.
                    continue
                self._air.take(name, value, time, self.real_time())
                message = new_message(topic.type_name)
                set_header(message, time, SENSOR_FRAMES.get(topic, LASER))
                setattr(message, field, value)
                publisher.publish(message)

    def _judge_sensors(self) -> HealthFinding:
        return self._air.judge(self.now(), self.real_time())


def main() -> int:
    """Run the node."""
    return spin(WeatherNode)


if __name__ == "__main__":
    sys.exit(main())
