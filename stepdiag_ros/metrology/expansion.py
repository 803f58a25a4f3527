"""Displacements at 20 degC, the reference temperature of ISO 1, from those at another temperature.

A laser measures what the machine does at the temperature that it has. A length of a material with
the expansion coefficient α that is L at 20 degC is L·(1 + α·(T - 20)) at T; so a displacement s
that was measured at T stands for s / (1 + α·(T - 20)) at 20 degC. The correction is one scale for
all directions: it changes positioning, but neither squareness nor straightness, as long as T is the
same everywhere. It acts on the displacement since the zero of a setup; how the zero itself moves as
the machine grows between laser and first stop cannot be known from the temperature alone.
"""

from dataclasses import replace
from typing import TypeVar

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Environment, MeasuredLine, Measurement
from stepdiag_ros.metrology.refusal import Refusal

REFERENCE_TEMPERATURE = 20.0
"""degC (ISO 1)."""
LARGEST_COEFFICIENT = 100e-6
"""1/K: no material that machines are built of expands more."""

Number = TypeVar("Number", float, Vector)

_MATERIAL = Environment._fields.index("material_temperature")


def at_reference_temperature(
    displacement: Number, coefficient: float, temperature: Number
) -> Number:
    """Return what a displacement measured at a material temperature is at 20 degC, m.

    Args:
        displacement: m, measured, any shape; corrected for the air already.
        coefficient: of linear thermal expansion, 1/K.
        temperature: of the material, degC, of the same shape.
    """
    return displacement / (1.0 + coefficient * (temperature - REFERENCE_TEMPERATURE))


def to_reference_temperature(
    measurement: Measurement, coefficient: float, temperature: float | None = None
) -> Measurement:
    """Correct every displacement of a measurement to a material temperature of 20 degC.

    The measurement that is given stays as it is: it holds the uncorrected values. Standard
    uncertainties are scaled with their displacements; those of the coefficient and of the
    temperature are common to many readings and belong in a budget (``uncertainty.sources``).

    Args:
        measurement: as measured.
        coefficient: of linear thermal expansion of what the readings are to stand for (the scales
            or the workpiece), 1/K, for example 11.5e-6 for steel.
        temperature: of the material, degC, instead of what was recorded; None takes the recorded.

    Raises:
        ValueError: the coefficient is not that of a machine's material, or the temperature of the
            material is not known at a stop that has a reading.
    """
    if not 0.0 <= coefficient <= LARGEST_COEFFICIENT:
        raise Refusal(
            f"the expansion coefficient is {coefficient:g}; expected 0 to {LARGEST_COEFFICIENT:g}"
            " per K, for example 11.5e-6 for steel",
            fault="out_of_range",
        )
    return replace(
        measurement,
        lines=tuple(_corrected(line, coefficient, temperature) for line in measurement.lines),
    )


def _corrected(line: MeasuredLine, coefficient: float, temperature: float | None) -> MeasuredLine:
    recorded = line.environment[:, _MATERIAL]
    material = recorded if temperature is None else np.full(len(recorded), temperature)
    unknown = np.flatnonzero(np.isfinite(line.displacement) & ~np.isfinite(material))
    if len(unknown):
        raise Refusal(
            f"line {line.line}: the material temperature at stop {unknown[0]} is not known, so"
            " nothing can be corrected to 20 degC; give the temperature, or leave the correction"
            " out",
            fault="undetermined",
        )
    scale = at_reference_temperature(np.ones(len(material)), coefficient, material)
    return replace(
        line,
        displacement=line.displacement * scale,
        standard_uncertainty=line.standard_uncertainty * scale,
    )


def expansion_remark(
    measurement: Measurement, coefficient: float, temperature: float | None = None
) -> str:
    """Say in words what ``to_reference_temperature`` does to a measurement."""
    corrected = to_reference_temperature(measurement, coefficient, temperature)
    changes = [
        after.displacement - before.displacement
        for before, after in zip(measurement.lines, corrected.lines, strict=True)
    ]
    sizes = np.abs(np.concatenate(changes)) if changes else np.zeros(0)
    known = sizes[np.isfinite(sizes)]
    largest = float(np.max(known)) if known.size else 0.0
    if temperature is None:
        recorded = np.concatenate([line.environment[:, _MATERIAL] for line in measurement.lines])
        recorded = recorded[np.isfinite(recorded)]
        where = f"{np.min(recorded):.2f} to {np.max(recorded):.2f} degC as recorded"
    else:
        where = f"{temperature:.2f} degC as given"
    return (
        f"displacements corrected to 20 degC (ISO 1) with {coefficient * 1e6:.4g} µm/(m K) and the"
        f" material at {where}: by {largest * 1e6:.3g} µm at most; the bag keeps the uncorrected"
        " readings"
    )
