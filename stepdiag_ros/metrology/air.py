"""Refractive index of air, and what it does to the count of a laser interferometer.

The index is the modified Edlén equation of the NIST Engineering Metrology Toolbox: Birch & Downs
1993 and 1994 for dry air, with the water vapour term of Stone & Zimmerman ("Index of refraction of
air", appendix A-IV), which agrees with Ciddor 1996 within 2e-8 from 0 to 50 degC at 633 nm.
Saturation pressure of water
vapour: IAPWS 1997 over water, Wexler over ice (the same document, appendix A-I).
"""

from typing import TypeVar

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Environment

Number = TypeVar("Number", float, Vector)

HELIUM_NEON_WAVELENGTH = 632.9908e-9
"""Vacuum wavelength of a red helium-neon laser, m (CIPM recommended value, unstabilised)."""

TEMPERATURE_RANGE = (-40.0, 100.0)
"""degC, where the equation holds."""
PRESSURE_RANGE = (10e3, 140e3)
"""Pa, where the equation holds."""
WAVELENGTH_RANGE = (300e-9, 1700e-9)
"""m, where the equation holds."""


def saturation_vapour_pressure(temperature: float | Vector) -> Vector:
    """Return the saturation pressure of water vapour, Pa: over ice below 0 degC, else over water.

    Args:
        temperature: degC, any shape.

    Source: Stone & Zimmerman, NIST, appendix A-I.
    """
    celsius = np.asarray(temperature, dtype=np.float64)
    kelvin = celsius + 273.15
    omega = kelvin - 0.238555575678 / (kelvin - 650.175348448)
    a = omega**2 + 1167.05214528 * omega - 724213.167032
    b = -17.0738469401 * omega**2 + 12020.8247025 * omega - 3232555.03223
    c = 14.9151086135 * omega**2 - 4823.26573616 * omega + 405113.405421
    water = 1e6 * (2.0 * c / (-b + np.sqrt(b**2 - 4.0 * a * c))) ** 4
    theta = kelvin / 273.16
    ice = 611.657 * np.exp(-13.928169 * (1.0 - theta**-1.5) + 34.7078238 * (1.0 - theta**-1.25))
    pressure: Vector = np.where(celsius < 0.0, ice, water)
    return pressure


def refractive_index(
    temperature: float | Vector,
    pressure: float | Vector,
    relative_humidity: float | Vector,
    wavelength: float = HELIUM_NEON_WAVELENGTH,
) -> Vector:
    """Return the phase refractive index of air with 450 ppm of CO2; NaN where the air is not known.

    Args:
        temperature: of the air, degC, any shape; NaN if unknown.
        pressure: of the air, Pa, broadcast against the temperature; NaN if unknown.
        relative_humidity: 0..1, broadcast likewise; NaN if unknown.
        wavelength: in vacuum, m.

    Returns:
        n, of the broadcast shape.

    Raises:
        ValueError: a value lies outside the range in which the equation holds.

    Source: Stone & Zimmerman, NIST, appendix A-IV.
    """
    celsius = _within("air temperature", temperature, *TEMPERATURE_RANGE, "degC")
    pascal = _within("air pressure", pressure, *PRESSURE_RANGE, "Pa")
    humidity = _within("relative humidity", relative_humidity, 0.0, 1.0, "(0 to 1, not per cent)")
    wavenumber = 1.0 / (_within("vacuum wavelength", wavelength, *WAVELENGTH_RANGE, "m") * 1e6) ** 2
    standard = 1e-8 * (8342.54 + 2406147.0 / (130.0 - wavenumber) + 15998.0 / (38.9 - wavenumber))
    density = (1.0 + 1e-8 * (0.601 - 0.00972 * celsius) * pascal) / (1.0 + 0.003661 * celsius)
    vapour = humidity * saturation_vapour_pressure(celsius)
    water_term = 1e-10 * (292.75 / (celsius + 273.15)) * (3.7345 - 0.0401 * wavenumber) * vapour
    index: Vector = 1.0 + pascal * standard * density / 96095.43 - water_term
    return index


def index_of(environment: Environment, wavelength: float = HELIUM_NEON_WAVELENGTH) -> float:
    """Return the refractive index of an environment's air; NaN if the air is not known.

    Raises:
        ValueError: a value lies outside the range in which the equation holds.
    """
    return float(
        refractive_index(
            environment.air_temperature,
            environment.air_pressure,
            environment.relative_humidity,
            wavelength,
        )
    )


def raw_displacement(
    displacement: Number, dead_path: float, index: Number, index_at_zero: float
) -> Number:
    """Return what the counter shows, in vacuum wavelengths expressed in m.

    The counter holds the change of the optical path since its zero: with D the path from the
    interferometer's reference to the mirror at the zero and s the displacement since,
    ``n(t)·(D + s) - n(0)·D``.

    Args:
        displacement: s, m.
        dead_path: D, m.
        index: n(t), refractive index of the air on the path.
        index_at_zero: n(0), the same when the counter was zeroed.
    """
    return index * displacement + (index - index_at_zero) * dead_path


def compensated_displacement(
    raw: Number, dead_path: float, index: Number, index_at_zero: float
) -> Number:
    """Return the displacement in m that a count means; the inverse of ``raw_displacement``.

    Args:
        raw: count since zero, m in vacuum wavelengths.
        dead_path: D, m; 0 leaves the dead path uncorrected.
        index: n(t) as known from the weather sensors; NaN if the air is not known.
        index_at_zero: n(0) as known when the counter was zeroed; NaN if the air was not known.

    Returns:
        Displacement since zero, m; NaN if an index is NaN.
    """
    return (raw - (index - index_at_zero) * dead_path) / index


def _within(name: str, value: float | Vector, low: float, high: float, unit: str) -> Vector:
    checked = np.asarray(value, dtype=np.float64)
    # Written so that NaN, which means "unknown", passes.
    outside = (checked < low) | (checked > high)
    if np.any(outside):
        wrong = float(checked[outside].flat[0]) if checked.ndim else float(checked)
        raise ValueError(f"{name} is {wrong:g}; expected {low:g} to {high:g} {unit}")
    return checked
