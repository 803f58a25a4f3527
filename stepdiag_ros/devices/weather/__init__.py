"""Weather stations: air and material temperature, pressure, humidity."""

from typing import Protocol

from stepdiag_ros.metrology.measurement import Environment


class WeatherDevice(Protocol):
    """A station that samples the air and the material."""

    def poll(self, time_ns: int) -> list[tuple[int, Environment]]:
        """Return the samples since the last poll with their times (ns), in order."""
        ...

    def close(self) -> None:
        """Let the station go."""
        ...
