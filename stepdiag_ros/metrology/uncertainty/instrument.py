"""What is known of how well the instrument, the air, the material and the setup are known.

Read from YAML (layout and meaning of every key: ``config/instruments/demo.yaml``). What is left out
or said to be ``unknown`` stays unknown, and so does its contribution.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.refusal import Refusal

NORMAL = "normal"
RECTANGULAR = "rectangular"
TRIANGULAR = "triangular"
ARCSINE = "arcsine"

DIVISORS = {RECTANGULAR: math.sqrt(3.0), TRIANGULAR: math.sqrt(6.0), ARCSINE: math.sqrt(2.0)}
"""Distribution within limits → half-width over standard uncertainty (JCGM 101, table 1)."""

_WAYS = ("standard_uncertainty", "half_width", "expanded")
_INFINITE = float("inf")
_UNKNOWN = float("nan")


_LAYOUT: dict[str, dict[str, tuple[str, float]]] = {
    "laser": {
        "wavelength_relative": ("wavelength", 1e-3),
        "resolution_m": ("resolution", 1e-3),
        "periodic_error_m": ("periodic_error", 1e-3),
    },
    "air": {
        "temperature_K": ("air_temperature", 50.0),
        "pressure_Pa": ("air_pressure", 5e4),
        "relative_humidity": ("relative_humidity", 1.0),
        "co2_fraction": ("co2", 1e-2),
        "index_equation_relative": ("index_equation", 1e-4),
        "gradient_K": ("air_gradient", 50.0),
        "turbulence_relative": ("turbulence", 1e-4),
    },
    "dead_path": {"uncertainty_m": ("dead_path_spread", 100.0)},
    "material": {
        "temperature_K": ("material_temperature", 100.0),
        "gradient_K": ("material_gradient", 100.0),
        "expansion_per_K": ("expansion", 1e-4),
    },
    "setup": {"alignment_rad": ("alignment", 0.1), "return_rad": ("return_angle", 0.1)},
    "machine": {"angular_errors_rad": ("angular_errors", 0.1)},
}
"""Section → key → attribute, and the largest value that is not a typing error."""


@dataclass(frozen=True)
class Spread:
    """What is known of one input quantity (type B).

    Attributes:
        standard_uncertainty: in the unit of the quantity; NaN if unknown.
        distribution: ``normal``, ``rectangular``, ``triangular`` or ``arcsine``.
        degrees_of_freedom: how well the standard uncertainty itself is known (GUM G.4.2).
    """

    standard_uncertainty: float = _UNKNOWN
    distribution: str = NORMAL
    degrees_of_freedom: float = _INFINITE

    @property
    def known(self) -> bool:
        """Say whether the standard uncertainty is known."""
        return math.isfinite(self.standard_uncertainty)


@dataclass(frozen=True)
class Instrument:
    """Standard uncertainties of everything that acts on a reading; unknown unless given.

    Attributes:
        name: in words.
        wavelength: of the laser in vacuum, relative.
        resolution: of the counter, m.
        periodic_error: nonlinearity within a fringe, m.
        air_temperature: sensor, K.
        air_pressure: sensor, Pa.
        relative_humidity: sensor, 0..1.
        co2: mole fraction of CO2, from the 450e-6 that the equation takes.
        index_equation: the equation for the refractive index, relative.
        air_gradient: air temperature on the beam from that at the sensor, K, different for each
            setup.
        turbulence: refractive index from reading to reading, relative.
        dead_path: from the laser's reference to the mirror at a setup's zero, m; NaN if unknown.
        dead_path_spread: of the dead path that the compensation assumed, m.
        material_temperature: sensor, K.
        material_gradient: temperature of what is measured from that at the sensor, K, different
            for each setup.
        expansion: coefficient of thermal expansion, 1/K.
        alignment: beam and mirror together from their line, rad, each of two angles of each setup.
        return_angle: mirror from square to the beam, rad, each of two angles of each setup.
        angular_errors: of the machine, rad at the end of the travel, each of nine; if unknown, the
            plausible size of the measurement is taken (``metrology.plausible``).
    """

    name: str = "nothing known"
    wavelength: Spread = field(default_factory=Spread)
    resolution: Spread = field(default_factory=Spread)
    periodic_error: Spread = field(default_factory=Spread)
    air_temperature: Spread = field(default_factory=Spread)
    air_pressure: Spread = field(default_factory=Spread)
    relative_humidity: Spread = field(default_factory=Spread)
    co2: Spread = field(default_factory=Spread)
    index_equation: Spread = field(default_factory=Spread)
    air_gradient: Spread = field(default_factory=Spread)
    turbulence: Spread = field(default_factory=Spread)
    dead_path: float = _UNKNOWN
    dead_path_spread: Spread = field(default_factory=Spread)
    material_temperature: Spread = field(default_factory=Spread)
    material_gradient: Spread = field(default_factory=Spread)
    expansion: Spread = field(default_factory=Spread)
    alignment: Spread = field(default_factory=Spread)
    return_angle: Spread = field(default_factory=Spread)
    angular_errors: Spread = field(default_factory=Spread)

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], source: str) -> "Instrument":
        """Make an instrument from the parsed YAML of an instrument file.

        Raises:
            ValueError: names the source, the key, what is wrong and what is expected.
        """
        section = Section(mapping, source)
        values: dict[str, Any] = {"name": section.text("name", default="unnamed")}
        for group, keys in _LAYOUT.items():
            part = section.section(group)
            for key, (name, largest) in keys.items():
                values[name] = _spread(part, key, largest, f"{source}: {group}")
            if group == "dead_path":
                values["dead_path"] = (
                    _UNKNOWN
                    if part.unknown("length_m")
                    else part.number("length_m", low=0.0, high=100.0)
                )
            part.finish()
        section.finish()
        return cls(**values)


def perfect() -> Instrument:
    """Return an instrument of which everything is known exactly: only the readings scatter."""
    exact = {
        entry.name: Spread(0.0)
        for entry in fields(Instrument)
        if entry.name not in ("name", "dead_path")
    }
    return Instrument(name="exactly known", dead_path=0.0, **exact)


def _spread(section: Section, key: str, largest: float, source: str) -> Spread:
    """Read one entry in any of the three ways in which certificates state an uncertainty."""
    if section.unknown(key):
        return Spread()
    entry = section.section(key)
    there = entry.keys()
    given = [way for way in _WAYS if way in there]
    if len(given) != 1:
        raise Refusal(
            f"{source}: {key}: expected one of standard_uncertainty, half_width (with"
            " distribution) and expanded (with coverage_factor), or the word unknown instead",
            fault="missing",
            aspect="size",
        )
    freedom = _INFINITE
    if "degrees_of_freedom" in there:
        freedom = entry.number("degrees_of_freedom", low=1.0, high=1e9)
    value = entry.number(given[0], low=0.0, high=largest)
    if given[0] == "half_width":
        shape = entry.names("distribution", tuple(DIVISORS), default=(RECTANGULAR,))[0]
        made = Spread(value / DIVISORS[shape], shape, freedom)
    elif given[0] == "expanded":
        factor = entry.number("coverage_factor", low=1.0, high=10.0)
        made = Spread(value / factor, NORMAL, freedom)
    else:
        made = Spread(value, NORMAL, freedom)
    entry.finish()
    return made
