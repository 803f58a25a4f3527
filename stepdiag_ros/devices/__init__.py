"""Drivers of controllers, interferometers and weather stations: one driver a module.

A driver knows no ROS, holds no thread and no clock: time is given to it in whole nanoseconds, and
it is asked (``poll``) for what has happened since. ``create`` makes one by its name.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal, overload

from stepdiag_ros.devices.cnc import CncDevice
from stepdiag_ros.devices.interferometer import InterferometerDevice
from stepdiag_ros.devices.weather import WeatherDevice
from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.machine import Machine

Kind = Literal["cnc", "interferometer", "weather"]


@dataclass(frozen=True)
class Surroundings:
    """What a driver may need to know beside its own settings.

    Attributes:
        start: time at which the device is switched on, ns; its samples lie on a grid that begins
            here.
        machine: the machine under test; needed by controllers.
        cell: the simulated cell; needed by simulated devices only.
    """

    start: int
    machine: Machine | None = None
    cell: SimulatedCell | None = None


_DRIVERS: dict[tuple[Kind, str], str] = {
    ("cnc", "simulated"): "stepdiag_ros.devices.cnc.simulated:from_settings",
    ("interferometer", "simulated"): "stepdiag_ros.devices.interferometer.simulated:from_settings",
    ("weather", "simulated"): "stepdiag_ros.devices.weather.simulated:from_settings",
}
"""Kind and name of a driver → module and function; imported only when it is asked for."""


@overload
def create(
    kind: Literal["cnc"], name: str, settings: Mapping[str, Any], surroundings: Surroundings
) -> CncDevice: ...


@overload
def create(
    kind: Literal["interferometer"],
    name: str,
    settings: Mapping[str, Any],
    surroundings: Surroundings,
) -> InterferometerDevice: ...


@overload
def create(
    kind: Literal["weather"], name: str, settings: Mapping[str, Any], surroundings: Surroundings
) -> WeatherDevice: ...


def create(
    kind: Kind, name: str, settings: Mapping[str, Any], surroundings: Surroundings
) -> CncDevice | InterferometerDevice | WeatherDevice:
    """Return a device made by the driver of that name.

    Args:
        kind: ``cnc``, ``interferometer`` or ``weather``.
        name: of the driver; ``simulated`` is there for every kind.
        settings: of the driver; what it does not know is refused.
        surroundings: time, machine and cell.

    Raises:
        ValueError: there is no such driver, or a setting is wrong; the text says what is expected.
    """
    place = _DRIVERS.get((kind, name))
    if place is None:
        known = ", ".join(driver for other, driver in _DRIVERS if other == kind)
        raise ValueError(f"there is no {kind} driver '{name}'; known: {known}")
    module, function = place.split(":")
    make: Callable[[Mapping[str, Any], Surroundings], Any] = getattr(
        import_module(module), function
    )
    device: CncDevice | InterferometerDevice | WeatherDevice = make(settings, surroundings)
    return device
