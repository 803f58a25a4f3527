"""Refractive index of air by Ciddor 1996 (Applied Optics 35, 1566), which the IAG recommends.

Dry air and water vapour each refract in proportion to their density; the densities are those of the
BIPM 1981/91 equation (Davis, Metrologia 29 (1992) 67), with the compressibility of moist air and
the enhancement factor of water vapour in air. Only ratios of densities of the same gas are needed,
in which the gas constant and the molar masses cancel (that of air with its CO2 too, so that CO2
acts through the refractivity of the dry air alone), so densities are counted in mol/m³ times R.

The humidity comes from the relative one by the saturation pressure of IAPWS 1997, as Stone &
Zimmerman do it (NIST, appendix A-II); Ciddor's own appendix takes that of Giacomo 1982, which is
within 0.07 % of it at 20 degC: less than 1e-9 in n.
"""

import numpy as np

from stepdiag_ros.metrology.air.humidity import (
    checked_air,
    saturation_vapour_pressure,
    squared_wavenumber,
    within,
)
from stepdiag_ros.metrology.geometry import Vector

STANDARD_CO2 = 450e-6
"""Mole fraction of CO2 that laboratory air usually has, and that the Edlén equation takes."""

_STANDARD_VAPOUR = (1333.0, 293.15)
"""Pa and K: pure water vapour whose refractivity is known (Ciddor 1996, eq. 3)."""
_STANDARD_AIR = (101325.0, 288.15)
"""Pa and K: dry air whose refractivity is known (Ciddor 1996, eq. 1)."""


def ciddor_index(
    temperature: float | Vector,
    pressure: float | Vector,
    relative_humidity: float | Vector,
    wavelength: float,
    co2: float = STANDARD_CO2,
) -> Vector:
    """Return the phase refractive index of air; NaN where the air is not known.

    Args:
        temperature: of the air, degC, any shape; NaN if unknown.
        pressure: of the air, Pa, broadcast against the temperature; NaN if unknown.
        relative_humidity: 0..1, broadcast against the temperature; NaN if unknown.
        wavelength: in vacuum, m.
        co2: mole fraction of CO2, for example 450e-6.

    Returns:
        n, of the broadcast shape.

    Raises:
        ValueError: a value lies outside the range in which the equation holds.

    Source: Ciddor 1996, appendix B, steps 1-10; humidity by Stone & Zimmerman, appendix A-II.
    """
    celsius, pascal, humidity = checked_air(temperature, pressure, relative_humidity)
    carbon = float(within("mole fraction of CO2", co2, 0.0, 2e-3, "(450e-6 is usual)"))
    wavenumber = squared_wavenumber(wavelength)
    enhancement = 1.00062 + 3.14e-8 * pascal + 5.60e-7 * celsius**2
    vapour = humidity * enhancement * saturation_vapour_pressure(celsius) / pascal

    # Refractivities of dry standard air, with its CO2, and of standard vapour: eqs. 1-3.
    air = 1e-8 * (5792105.0 / (238.0185 - wavenumber) + 167917.0 / (57.362 - wavenumber))
    air = air * (1.0 + 0.534e-6 * (carbon * 1e6 - 450.0))
    steam = 1.022e-8 * (
        295.235 + 2.6422 * wavenumber - 0.032380 * wavenumber**2 + 0.004028 * wavenumber**3
    )

    total = _density(pascal, celsius + 273.15, vapour)
    dry = (1.0 - vapour) * total / _density(*_STANDARD_AIR, 0.0)
    wet = vapour * total / _density(*_STANDARD_VAPOUR, 1.0)
    index: Vector = 1.0 + dry * air + wet * steam
    return index


def compressibility(pressure: Vector, kelvin: Vector, vapour: Vector) -> Vector:
    """Return the compressibility Z of moist air (Ciddor 1996, eq. 12; Davis 1992).

    Args:
        pressure: Pa.
        kelvin: temperature, K.
        vapour: mole fraction of water vapour.
    """
    celsius = kelvin - 273.15
    ratio = pressure / kelvin
    first = (
        1.58123e-6
        - 2.9331e-8 * celsius
        + 1.1043e-10 * celsius**2
        + (5.707e-6 - 2.051e-8 * celsius) * vapour
        + (1.9898e-4 - 2.376e-6 * celsius) * vapour**2
    )
    factor: Vector = 1.0 - ratio * first + ratio**2 * (1.83e-11 - 0.765e-8 * vapour**2)
    return factor


def _density(pressure: float | Vector, kelvin: float | Vector, vapour: float | Vector) -> Vector:
    """Return p/(Z·T) of moist air, Pa/K: the amount of gas in a volume, times R (eq. 4)."""
    pascal = np.asarray(pressure, dtype=np.float64)
    temperature = np.asarray(kelvin, dtype=np.float64)
    fraction = np.asarray(vapour, dtype=np.float64)
    dense: Vector = pascal / (compressibility(pascal, temperature, fraction) * temperature)
    return dense
