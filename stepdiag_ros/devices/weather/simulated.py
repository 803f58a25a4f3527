"""A simulated weather station: the cell's weather with the errors of its sensors."""

from collections.abc import Callable, Mapping
from typing import Any

from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.grid import SampleGrid
from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.refusal import Refusal


class SimulatedWeather:
    """A weather station in a simulated cell (protocol: ``WeatherDevice``).

    Args:
        cell: the true errors.
        start: ns; the grid begins here.
        rate: of the samples, Hz.
        weather_begins: ns, the zero of the cell's weather; ``start`` if None.
        sensor_errors: added to each true value: K, Pa, 1 (humidity 0..1), K.
    """

    def __init__(
        self,
        cell: SimulatedCell,
        start: int,
        rate: float = 1.0,
        sensor_errors: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
        weather_begins: int | None = None,
    ) -> None:
        self._cell = cell
        self._weather_begins = start if weather_begins is None else weather_begins
        self._grid = SampleGrid(start, rate)
        self._errors = sensor_errors
        self._silent_from: int | None = None

    def inject_silence(self, time_ns: int) -> None:
        """Let the station fall silent from a time on, for tests."""
        self._silent_from = time_ns

    def poll(self, time_ns: int) -> list[tuple[int, Environment]]:
        """Return the samples since the last poll with their times (ns), in order."""
        return [
            (time, self._sample(time))
            for time in self._grid.take(time_ns)
            if self._silent_from is None or time < self._silent_from
        ]

    def close(self) -> None:
        """Let the station go."""

    def _sample(self, time: int) -> Environment:
        true = self._cell.environment((time - self._weather_begins) * 1e-9)
        told = [value + error for value, error in zip(true, self._errors, strict=True)]
        # A humidity sensor shows no less than 0 and no more than 1.
        told[2] = min(max(told[2], 0.0), 1.0)
        return Environment(*told)


def from_settings(
    settings: Mapping[str, Any], surroundings: Surroundings
) -> Callable[[int], SimulatedWeather]:
    """Return what switches a simulated weather station on at a time, ns.

    Settings: ``rate_hz`` (default 1), ``weather_begins_ns`` (the same for all devices of a cell;
    default 0: when this one is switched on) and the errors of the sensors, each 0 by default:
    ``air_temperature_error_K``, ``air_pressure_error_Pa``, ``relative_humidity_error`` (of 0..1),
    ``material_temperature_error_K``.

    Raises:
        ValueError: a setting is wrong, or there is no cell.
    """
    cell = surroundings.cell
    if cell is None:
        raise Refusal("the simulated weather station needs a simulated cell", fault="missing")
    section = Section(settings, "settings of the simulated weather station")
    rate = section.number("rate_hz", low=1e-3, high=1000.0, default=1.0)
    errors = (
        section.number("air_temperature_error_K", low=-50.0, high=50.0, default=0.0),
        section.number("air_pressure_error_Pa", low=-5e4, high=5e4, default=0.0),
        section.number("relative_humidity_error", low=-1.0, high=1.0, default=0.0),
        section.number("material_temperature_error_K", low=-50.0, high=50.0, default=0.0),
    )
    begins = section.integer("weather_begins_ns", low=0, high=2**63 - 1, default=0)
    section.finish()
    return lambda start: SimulatedWeather(cell, start, rate, errors, begins or start)
