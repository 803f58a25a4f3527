"""Drivers of controllers, interferometers and weather stations: one driver a module.

A driver does not import ROS and does not have a clock: the node passes the time in whole
nanoseconds, and calls ``poll`` for the events since the last call. It does not start a thread
unless its library needs one. ``prepare`` finds a driver by its name, checks its settings, and
returns a function that opens the device; a device object is open until its ``close``.

A driver of this package is a module of ``cnc``, ``interferometer`` or ``weather`` that has a
function ``from_settings``; the name of the module is that of the driver. Drivers of other packages
are found by entry points: group ``stepdiag_ros.cnc``, ``stepdiag_ros.interferometer`` or
``stepdiag_ros.weather``, name of the driver, such a function.

No call takes long: the node is silent while it opens or polls a device, and after 2 s the other
nodes treat it as lost. Opening a device, and any of its methods, may raise OSError (the device does
not answer) or ValueError (the driver cannot interpret the answer, or the device refuses). The
caller then closes the device, and opens it again.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from pkgutil import iter_modules
from typing import Any, Literal, overload

from stepdiag_ros.devices.cnc import CncDevice
from stepdiag_ros.devices.cnc.joint_controller import ControllerNames, JointController
from stepdiag_ros.devices.interferometer import InterferometerDevice
from stepdiag_ros.devices.weather import WeatherDevice
from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.spelling import nearest, suggestion

NO_DRIVER = "driver"
"""``aspect`` of a refusal where the driver itself is at fault, not a setting of it."""
Kind = Literal["cnc", "interferometer", "weather"]
Device = CncDevice | InterferometerDevice | WeatherDevice
_Driver = Callable[..., Callable[[int], Device]]


@dataclass(frozen=True)
class Surroundings:
    """What a driver may need to know beside its own settings.

    Attributes:
        machine: the machine under test; needed by controllers.
        cell: the simulated cell; needed by simulated devices only.
        joint_controller: returns the ROS side of a joint trajectory controller, of the node that
            opens the device; needed by the driver ``ros2_control`` only.
    """

    machine: Machine | None = None
    cell: SimulatedCell | None = None
    joint_controller: Callable[[ControllerNames], JointController] | None = None

    def machine_for(self, driver: str) -> Machine:
        """Return the machine for a driver that needs one; ``Refusal`` if none was given."""
        if self.machine is None:
            raise Refusal(f"the {driver} needs a machine", fault="missing", about="machine")
        return self.machine


def known_drivers(kind: Kind) -> list[str]:
    """Return the names of all drivers of a kind, those of other packages last."""
    own = [name for name in _modules(kind) if _own_driver(kind, name) is not None]
    return own + sorted(entry.name for entry in entry_points(group=_group(kind)))


@overload
def prepare(
    kind: Literal["cnc"], name: str, settings: Mapping[str, Any], surroundings: Surroundings
) -> Callable[[int], CncDevice]: ...


@overload
def prepare(
    kind: Literal["interferometer"],
    name: str,
    settings: Mapping[str, Any],
    surroundings: Surroundings,
) -> Callable[[int], InterferometerDevice]: ...


@overload
def prepare(
    kind: Literal["weather"], name: str, settings: Mapping[str, Any], surroundings: Surroundings
) -> Callable[[int], WeatherDevice]: ...


def prepare(
    kind: Kind, name: str, settings: Mapping[str, Any], surroundings: Surroundings
) -> Callable[[int], Device]:
    """Return what opens a device of the driver of that name; nothing is opened yet.

    It takes the time of the opening, ns, on which the grid of the device's samples begins, and may
    be called again after the device was closed.

    Args:
        kind: ``cnc``, ``interferometer`` or ``weather``.
        name: of the driver; ``simulated`` is there for every kind.
        settings: of the driver; what it does not know is refused.
        surroundings: machine and cell.

    Raises:
        ValueError: there is no such driver, or a setting is wrong; the text says what is expected.
    """
    return _driver(kind, name)(settings, surroundings)


def _modules(kind: Kind) -> list[str]:
    folder = import_module(f"{__name__}.{kind}")
    return sorted(one.name for one in iter_modules(folder.__path__))


def _own_driver(kind: Kind, module: str) -> _Driver | None:
    """Import a module of a kind; return its driver, or None where it is only a part of one."""
    driver: _Driver | None = getattr(
        import_module(f"{__name__}.{kind}.{module}"), "from_settings", None
    )
    return driver


def _driver(kind: Kind, name: str) -> _Driver:
    found: list[_Driver] = []
    if name in _modules(kind) and (own := _own_driver(kind, name)) is not None:
        found.append(own)
    for entry in entry_points(group=_group(kind), name=name):
        try:
            found.append(entry.load())
        except (ImportError, AttributeError) as error:
            place = f"the {kind} driver '{name}' ({entry.value})"
            raise Refusal(
                f"{place} cannot be loaded: {error}", fault="failed", aspect=NO_DRIVER
            ) from error
    if not found:
        known = known_drivers(kind)
        near = nearest(name, known)
        hint = f"{suggestion(near)} K" if near else "k"
        raise Refusal(
            f"there is no {kind} driver '{name}'; {hint}nown: {', '.join(known)}",
            fault="unknown",
            aspect=NO_DRIVER,
        )
    if len(found) > 1:
        raise Refusal(
            f"there are {len(found)} {kind} drivers '{name}': remove a package that brings one",
            fault="ambiguous",
            aspect=NO_DRIVER,
        )
    return found[0]


def _group(kind: Kind) -> str:
    return f"stepdiag_ros.{kind}"
