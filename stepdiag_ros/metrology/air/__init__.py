"""Refractive index of air, and what it does to the count of a laser interferometer."""

from stepdiag_ros.metrology.air.ciddor import ciddor_index
from stepdiag_ros.metrology.air.compensation import compensated_displacement, raw_displacement
from stepdiag_ros.metrology.air.edlen import edlen_index
from stepdiag_ros.metrology.air.humidity import saturation_vapour_pressure
from stepdiag_ros.metrology.air.index import (
    DEFAULT_EQUATION,
    EQUATIONS,
    HELIUM_NEON_WAVELENGTH,
    index_of,
    refractive_index,
)

__all__ = [
    "DEFAULT_EQUATION",
    "EQUATIONS",
    "HELIUM_NEON_WAVELENGTH",
    "ciddor_index",
    "compensated_displacement",
    "edlen_index",
    "index_of",
    "raw_displacement",
    "refractive_index",
    "saturation_vapour_pressure",
]
