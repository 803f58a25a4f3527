"""Uncompensated air: readings are made of wavelengths in standard air, whatever the air is."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.air import refractive_index
from stepdiag_ros.metrology.effects.effect import Change, Effect, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector


class UncompensatedAir(Effect):
    """Share of the correction for temperature, pressure and humidity that is missing."""

    name = "uncompensated air"
    sentence = "The reading is not corrected for the air: its weather sensors are off, or far away."
    source = "Ciddor 1996; a length d counts d·n wavelengths and is shown as d·n/n0"
    sizes = (Size("missing", "1", -2.0, 2.0, "1: not corrected at all; -1: corrected twice"),)
    needs = ("air_temperature",)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield one setting if more of the air changes than its temperature alone.

        Otherwise it cannot be distinguished from an uncompensated temperature.
        """
        further = (stops.air_pressure, stops.relative_humidity)
        changes = any(
            np.any(np.isfinite(column)) and np.nanmax(column) > np.nanmin(column)
            for column in further
        )
        if self.known(stops) and changes:
            yield {}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:  # noqa: ARG002
        """Return missing·displacement·(n/n0 - 1), n0 that of air of 20 degC, 101325 Pa, 50 %."""
        return Change(reading=sizes["missing"] * stops.along * _excess(stops))


def _excess(stops: Stops) -> Vector:
    """Return n/n0 - 1, shape (n,); pressure and humidity that are not known are standard ones."""
    pressure, humidity = stops.air_pressure, stops.relative_humidity
    index = refractive_index(
        stops.air_temperature,
        np.where(np.isfinite(pressure), pressure, 101325.0),
        np.where(np.isfinite(humidity), humidity, 0.5),
    )
    excess: Vector = index / refractive_index(20.0, 101325.0, 0.5) - 1.0
    return excess


EFFECT = UncompensatedAir()
