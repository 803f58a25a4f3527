"""Refractive index of air by the modified Edlén equation.

That of the NIST Engineering Metrology Toolbox: Birch & Downs 1993 and 1994 for dry air, with the
water vapour term of Stone & Zimmerman ("Index of refraction of air", appendix A-IV), which agrees
with Ciddor 1996 within 2e-8 from 0 to 40 degC at 633 nm.
"""

from stepdiag_ros.metrology.air.humidity import (
    checked_air,
    saturation_vapour_pressure,
    squared_wavenumber,
)
from stepdiag_ros.metrology.geometry import Vector


def edlen_index(
    temperature: float | Vector,
    pressure: float | Vector,
    relative_humidity: float | Vector,
    wavelength: float,
) -> Vector:
    """Return the phase refractive index of air with 450 ppm of CO2; NaN where the air is not known.

    Args:
        temperature: of the air, degC, any shape; NaN if unknown.
        pressure: of the air, Pa, broadcast against the temperature; NaN if unknown.
        relative_humidity: 0..1, broadcast against the temperature; NaN if unknown.
        wavelength: in vacuum, m.

    Returns:
        n, of the broadcast shape.

    Raises:
        ValueError: a value lies outside the range in which the equation holds.

    Source: Stone & Zimmerman, NIST, appendix A-IV.
    """
    celsius, pascal, humidity = checked_air(temperature, pressure, relative_humidity)
    wavenumber = squared_wavenumber(wavelength)
    standard = 1e-8 * (8342.54 + 2406147.0 / (130.0 - wavenumber) + 15998.0 / (38.9 - wavenumber))
    density = (1.0 + 1e-8 * (0.601 - 0.00972 * celsius) * pascal) / (1.0 + 0.003661 * celsius)
    vapour = humidity * saturation_vapour_pressure(celsius)
    water_term = 1e-10 * (292.75 / (celsius + 273.15)) * (3.7345 - 0.0401 * wavenumber) * vapour
    index: Vector = 1.0 + pascal * standard * density / 96095.43 - water_term
    return index
