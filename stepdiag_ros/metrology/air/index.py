"""The refractive index of air by name of the equation; the modified Edlén equation is the default.

Which of the two is taken matters less than the sensors: from 0 to 40 degC they agree within 2e-8 at
633 nm (in saturated air of 50 degC and 120 kPa within 6e-8), while 0.02 K of air temperature are as
much.
"""

from collections.abc import Callable

from stepdiag_ros.metrology.air.ciddor import ciddor_index
from stepdiag_ros.metrology.air.edlen import edlen_index
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.refusal import Refusal

HELIUM_NEON_WAVELENGTH = 632.9908e-9
"""Vacuum wavelength of a red helium-neon laser, m (CIPM recommended value, unstabilised)."""

EQUATIONS: dict[str, Callable[[float | Vector, float | Vector, float | Vector, float], Vector]] = {
    "edlen": edlen_index,
    "ciddor": ciddor_index,
}
"""Name → refractive index from temperature, pressure, humidity and vacuum wavelength."""

DEFAULT_EQUATION = "edlen"


def refractive_index(
    temperature: float | Vector,
    pressure: float | Vector,
    relative_humidity: float | Vector,
    wavelength: float = HELIUM_NEON_WAVELENGTH,
    equation: str = DEFAULT_EQUATION,
) -> Vector:
    """Return the phase refractive index of air with 450 ppm of CO2; NaN where the air is not known.

    Args:
        temperature: of the air, degC, any shape; NaN if unknown.
        pressure: of the air, Pa, broadcast against the temperature; NaN if unknown.
        relative_humidity: 0..1, broadcast against the temperature; NaN if unknown.
        wavelength: in vacuum, m.
        equation: one of ``EQUATIONS``.

    Returns:
        n, of the broadcast shape.

    Raises:
        ValueError: no such equation, or a value lies outside the range in which it holds.
    """
    if equation not in EQUATIONS:
        raise Refusal(
            f"'{equation}' is not an equation for the refractive index; use {', '.join(EQUATIONS)}",
            fault="unknown",
        )
    return EQUATIONS[equation](temperature, pressure, relative_humidity, wavelength)


def index_of(
    environment: Environment,
    wavelength: float = HELIUM_NEON_WAVELENGTH,
    equation: str = DEFAULT_EQUATION,
) -> float:
    """Return the refractive index of an environment's air; NaN if the air is not known.

    Raises:
        ValueError: no such equation, or a value lies outside the range in which it holds.
    """
    return float(
        refractive_index(
            environment.air_temperature,
            environment.air_pressure,
            environment.relative_humidity,
            wavelength,
            equation,
        )
    )
