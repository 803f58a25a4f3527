"""Values of weather sensors that may be used: not too old, and not impossible.

A sensor that is set to another unit, or whose cable is loose, reports numbers all the same. 1 K of
air temperature is 1 µm in every metre, so an impossible value is not used: it is unknown,
with the reason in words.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isnan, nan

from stepdiag_ros.metrology.measurement import Environment


@dataclass(frozen=True)
class PlausibleAir:
    """What a sensor at a machine can mean.

    Attributes:
        words: the quantity in words.
        unit: of the values.
        low: smallest value.
        high: largest value.
        leap: by which it cannot change from one value to the next, unless it stays there.
        others: another unit that the sensor may be set to → conversion to ours.
    """

    words: str
    unit: str
    low: float
    high: float
    leap: float
    others: Mapping[str, Callable[[float], float]]


_TEMPERATURES: Mapping[str, Callable[[float], float]] = {
    "K": lambda value: value - 273.15,
    "degF": lambda value: (value - 32.0) / 1.8,
}

PLAUSIBLE: Mapping[str, PlausibleAir] = {
    "air_temperature": PlausibleAir("air temperature", "degC", -10.0, 50.0, 3.0, _TEMPERATURES),
    # From 5000 m above the sea to below it.
    "air_pressure": PlausibleAir(
        "air pressure",
        "Pa",
        50e3,
        115e3,
        1e3,
        {
            "hPa": lambda value: value * 100.0,
            "kPa": lambda value: value * 1000.0,
            "mmHg": lambda value: value * 133.3224,
            "inHg": lambda value: value * 3386.389,
            "psi": lambda value: value * 6894.757,
            "bar": lambda value: value * 1e5,
        },
    ),
    "relative_humidity": PlausibleAir(
        "relative humidity", "0..1", 0.0, 1.0, 0.3, {"per cent": lambda value: value / 100.0}
    ),
    "material_temperature": PlausibleAir(
        "material temperature", "degC", -10.0, 60.0, 3.0, _TEMPERATURES
    ),
}
"""Field of Environment → what can be meant."""

_NEVER = -(2**63)


def implausible(name: str, value: float) -> str:
    """Say why a value cannot be meant; empty if it can, or is unknown (NaN).

    Args:
        name: field of ``Environment``.
        value: in the unit of that field.
    """
    expected = PLAUSIBLE[name]
    # Written so that NaN passes.
    if not (value < expected.low or value > expected.high):
        return ""
    fitting = [
        unit
        for unit, convert in expected.others.items()
        if expected.low <= convert(value) <= expected.high
    ]
    hint = f": it would fit in {' or '.join(fitting)}" if fitting else ""
    return f"out of range{hint}"


@dataclass
class _Told:
    """The last value of one quantity, and the last that could be used."""

    time: int = _NEVER
    objection: str = ""
    used: float = nan
    used_time: int = _NEVER


class KnownAir:
    """The newest usable value of each quantity.

    A value that has leapt from the one before is not used until it has stayed for the longest age:
    sensors that fail leap, air does not.

    Args:
        longest_age: s after which a value is unknown.
    """

    def __init__(self, longest_age: float) -> None:
        self.longest_age = longest_age
        self._told = {name: _Told() for name in PLAUSIBLE}
        self._environment = Environment()

    def take(self, name: str, value: float, time: int) -> None:
        """Take a value (unit as in Environment, NaN if unknown) that was measured at a time, ns."""
        told = self._told[name]
        if time < told.time:
            return
        told.time = time
        told.objection = implausible(name, value)
        if isnan(value) or told.objection:
            told.used, told.used_time = nan, _NEVER
            return
        age = (time - told.used_time) * 1e-9
        if age <= self.longest_age and abs(value - told.used) > PLAUSIBLE[name].leap:
            told.objection = "changing by leaps: is the sensor sound?"
            return
        told.used, told.used_time = value, time

    def objection(self, name: str) -> str:
        """Say why the last value of a quantity is not used; empty if it is."""
        return self._told[name].objection

    def at(self, time: int) -> Environment:
        """Return what is known at a time (ns), not before that of the last value.

        It is the same object as long as the values are the same.
        """
        values = []
        for told in self._told.values():
            old = (time - told.used_time) * 1e-9 > self.longest_age
            values.append(nan if old or told.objection else told.used)
        environment = Environment(*values)
        if not _same(environment, self._environment):
            self._environment = environment
        return self._environment


def _same(first: Environment, second: Environment) -> bool:
    return all(a == b or (isnan(a) and isnan(b)) for a, b in zip(first, second, strict=True))
