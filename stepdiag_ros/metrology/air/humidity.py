"""Water vapour in air, and the check of what any equation for air is given."""

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal

TEMPERATURE_RANGE = (-40.0, 100.0)
"""degC, where both equations hold."""
PRESSURE_RANGE = (10e3, 140e3)
"""Pa, where both equations hold."""
WAVELENGTH_RANGE = (300e-9, 1700e-9)
"""m, where both equations hold."""


def saturation_vapour_pressure(temperature: float | Vector) -> Vector:
    """Return the saturation pressure of water vapour, Pa: over ice below 0 degC, else over water.

    Args:
        temperature: degC, any shape.

    Source: IAPWS 1997 over water, Wexler over ice; Stone & Zimmerman, NIST, appendix A-I.
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


def checked_air(
    temperature: float | Vector, pressure: float | Vector, relative_humidity: float | Vector
) -> tuple[Vector, Vector, Vector]:
    """Return temperature (degC), pressure (Pa) and relative humidity (0..1) as arrays; NaN passes.

    Raises:
        ValueError: a value lies outside the range in which the equations hold.
    """
    return (
        within("air temperature", temperature, *TEMPERATURE_RANGE, "degC"),
        within("air pressure", pressure, *PRESSURE_RANGE, "Pa"),
        within("relative humidity", relative_humidity, 0.0, 1.0, "(0 to 1, not per cent)"),
    )


def squared_wavenumber(wavelength: float) -> Vector:
    """Return 1/λ² of a vacuum wavelength in m, µm⁻².

    Raises:
        ValueError: the wavelength lies outside the range in which the equations hold.
    """
    checked = within("vacuum wavelength", wavelength, *WAVELENGTH_RANGE, "m")
    squared: Vector = 1.0 / (checked * 1e6) ** 2
    return squared


def within(name: str, value: float | Vector, low: float, high: float, unit: str) -> Vector:
    """Return a value as an array; NaN, which means "unknown", passes.

    Raises:
        ValueError: it lies outside [low, high]; names it.
    """
    checked = np.asarray(value, dtype=np.float64)
    # Written so that NaN passes.
    outside = (checked < low) | (checked > high)
    if np.any(outside):
        wrong = float(checked[outside].flat[0]) if checked.ndim else float(checked)
        raise Refusal(
            f"{name} is {wrong:g}; expected {low:g} to {high:g} {unit}", fault="out_of_range"
        )
    return checked
