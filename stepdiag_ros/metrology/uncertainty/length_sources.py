"""What laser, air, dead path and material do to the readings, each with its uncertainty.

The model of a reading, corrected for the air, the dead path and the expansion of the material:

    s = [N·λ - (n(t) - n(0))·D] / n(t) / (1 + α·(T - 20 degC))

with n the refractive index by temperature, pressure and humidity of the air, D the dead path, T and
α temperature and expansion coefficient of the material. Its derivatives by each input, at each
reading, are the slopes below; the derivatives of n are those of the equation itself.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.air import refractive_index
from stepdiag_ros.metrology.expansion import REFERENCE_TEMPERATURE
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.observations import Integers, Observations
from stepdiag_ros.metrology.uncertainty.instrument import Instrument, Spread
from stepdiag_ros.metrology.uncertainty.source import (
    AIR,
    DEAD_PATH,
    INSTRUMENT,
    MATERIAL,
    PER_PLACE,
    PRODUCT,
    Source,
    common,
    each_reading,
    each_setup,
)
from stepdiag_ros.metrology.units import IN_MICRO

REFERENCE_AIR = (20.0, 101325.0, 0.5)
"""degC, Pa, 0..1: where the derivatives of the index are taken if the air was not recorded."""
_AIR = {
    "air temperature": f"{REFERENCE_AIR[0]:g} degC",
    "air pressure": f"{REFERENCE_AIR[1] / 100.0:g} hPa",
    "humidity": f"{100.0 * REFERENCE_AIR[2]:g} %",
}
"""Quantities of the air, with ``REFERENCE_AIR`` in words."""
CO2_EFFECT = 1.44e-4
"""Change of n with the mole fraction of CO2: (n - 1)·0.534 (Ciddor 1996, eq. 2)."""

_UNKNOWN = float("nan")


@dataclass(frozen=True)
class Readings:
    """Readings with all that their uncertainty depends on; vectors have shape (n,).

    Attributes:
        measurement: as solved: corrected to 20 degC if a coefficient was given.
        observations: of it.
        coefficient: of thermal expansion that was corrected with, 1/K; NaN if nothing was.
        material: temperature of the material that was corrected with, degC; NaN if nothing was.
        air: temperature degC, pressure Pa, relative humidity, shape (n, 3); NaN if not recorded.
    """

    measurement: Measurement
    observations: Observations
    coefficient: float
    material: Vector
    air: Vector


def readings_of(
    measurement: Measurement,
    observations: Observations,
    coefficient: float = _UNKNOWN,
    temperature: float | None = None,
) -> Readings:
    """Gather what the uncertainty of the readings depends on; see ``Readings``.

    Args:
        measurement: as solved.
        observations: of it.
        coefficient: that it was corrected to 20 degC with, 1/K; NaN if it was not corrected.
        temperature: of the material that was taken instead of the recorded one, degC.
    """
    environment = np.array(
        [
            measurement.lines[line].environment[stop]
            for line, stop in zip(observations.passes, observations.stop, strict=True)
        ]
    )
    material = environment[:, 3] if temperature is None else np.full(len(environment), temperature)
    return Readings(
        measurement=measurement,
        observations=observations,
        coefficient=coefficient,
        material=material,
        air=environment[:, :3],
    )


def instrument_sources(readings: Readings, instrument: Instrument) -> list[Source]:
    """Return the sources of the laser and its counter."""
    seen = readings.observations
    scale = -seen.displacement
    each = np.ones_like(scale)
    return [
        common("laser wavelength", INSTRUMENT, instrument.wavelength, "relative", scale),
        _resolution(seen, instrument.resolution),
        each_reading(
            "periodic error of the fringe", INSTRUMENT, instrument.periodic_error, "m", each
        ),
    ]


def _resolution(seen: Observations, stated: Spread) -> Source:
    """Return the resolution that is stated, or the rounding that the readings themselves show."""
    name, each = "resolution of the counter", np.ones_like(seen.displacement)
    if not seen.rounding > 0.0 or stated.standard_uncertainty > seen.rounding:
        return each_reading(name, INSTRUMENT, stated, "m", each)
    note = f"the readings come in steps of {seen.step * IN_MICRO:g} µm; what repeats do not show"
    shown = each_reading(name, INSTRUMENT, Spread(seen.rounding), "m", each, note)
    place, _ = seen.groups()
    return replace(shown, correlation=PER_PLACE, member=place)


def _not_recorded(air: Vector) -> tuple[str, str]:
    """Return which quantities of the air, (n, 3), lack values, and what is taken; empty if none."""
    lacks = ~np.all(np.isfinite(air), axis=0)
    names = [name for name, here in zip(_AIR, lacks, strict=True) if here]
    return ", ".join(names), ", ".join(_AIR[name] for name in names)


def air_sources(readings: Readings, instrument: Instrument) -> list[Source]:
    """Return the sources of the compensation for the air, dead path included."""
    seen = readings.observations
    air = np.where(np.isfinite(readings.air), readings.air, REFERENCE_AIR)
    lacking, taken = _not_recorded(readings.air)
    note = f"{lacking} not recorded: there {taken} is taken" if lacking else ""
    zero = first_of_setup(seen)
    path = instrument.dead_path
    # Where the dead path is not known, its share in a sensor's common error is left out: it acts
    # through the change of the derivative since the zero, a thousandth of the rest.
    known_path = path if np.isfinite(path) else 0.0

    def slope(derivative: Vector) -> Vector:
        moved: Vector = -seen.displacement * derivative - known_path * (
            derivative - derivative[zero]
        )
        return moved

    by_temperature = _derivative(
        lambda x: refractive_index(x, air[:, 1], air[:, 2]), air[:, 0], 1.0
    )
    by_pressure = _derivative(lambda x: refractive_index(air[:, 0], x, air[:, 2]), air[:, 1], 100.0)
    # Vapour acts in proportion to the humidity, so that any two humidities give the derivative.
    by_humidity = refractive_index(air[:, 0], air[:, 1], 1.0) - refractive_index(
        air[:, 0], air[:, 1], 0.0
    )
    scale = -seen.displacement
    index = refractive_index(air[:, 0], air[:, 1], air[:, 2])
    change = index - index[zero] if not lacking else np.full(len(index), _UNKNOWN)
    return [
        common(
            "air temperature", AIR, instrument.air_temperature, "K", slope(by_temperature), note
        ),
        common("air pressure", AIR, instrument.air_pressure, "Pa", slope(by_pressure), note),
        common(
            "relative humidity", AIR, instrument.relative_humidity, "1", slope(by_humidity), note
        ),
        common("CO2 content", AIR, instrument.co2, "1", scale * CO2_EFFECT),
        common("equation for the index", AIR, instrument.index_equation, "relative", scale),
        each_setup(
            "air temperature on the beam",
            AIR,
            instrument.air_gradient,
            "K",
            [-seen.displacement * by_temperature],
            seen.setup,
            note,
        ),
        each_reading(
            "turbulence of the air",
            AIR,
            instrument.turbulence,
            "relative",
            -(seen.displacement + path),
            "" if np.isfinite(path) else "the dead path is not known",
        ),
        each_setup(
            "length of the dead path",
            DEAD_PATH,
            instrument.dead_path_spread,
            "m",
            [-change],
            seen.setup,
            f"{lacking} not recorded, so the change of the air is not known" if lacking else "",
        ),
    ]


def material_sources(readings: Readings, instrument: Instrument) -> list[Source]:
    """Return the sources of the correction to 20 degC; none if nothing was corrected."""
    seen = readings.observations
    coefficient = readings.coefficient
    if not np.isfinite(coefficient):
        return []
    above = readings.material - REFERENCE_TEMPERATURE
    scale = -seen.displacement / (1.0 + coefficient * above)
    both = Spread(
        instrument.expansion.standard_uncertainty
        * float(
            np.hypot(
                instrument.material_temperature.standard_uncertainty,
                instrument.material_gradient.standard_uncertainty,
            )
        ),
        PRODUCT,
    )
    return [
        common("expansion coefficient", MATERIAL, instrument.expansion, "1/K", scale * above),
        common(
            "material temperature",
            MATERIAL,
            instrument.material_temperature,
            "K",
            scale * coefficient,
        ),
        each_setup(
            "material temperature on the line",
            MATERIAL,
            instrument.material_gradient,
            "K",
            [scale * coefficient],
            seen.setup,
        ),
        # GUM 5.1.2, note: near 20 degC the first order vanishes and the product is what counts.
        common("coefficient × temperature", MATERIAL, both, "relative", scale),
    ]


def first_of_setup(seen: Observations) -> Integers:
    """Return for each reading the first of its setup, at which the counter was zeroed."""
    _, first = np.unique(seen.setup, return_index=True)
    return first.astype(np.int64)[seen.setup]


def _derivative(function: Callable[[Vector], Vector], at: Vector, change: float) -> Vector:
    slope: Vector = (function(at + change) - function(at - change)) / (2.0 * change)
    return slope
