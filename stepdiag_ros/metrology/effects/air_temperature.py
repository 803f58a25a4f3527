"""Uncompensated air temperature: the temperature changes the wavelength, unmeasured."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops


class AirTemperature(Effect):
    """Reading in proportion to its length and to the temperature of the air."""

    name = "uncompensated air temperature"
    sentence = (
        "The reading is not, or wrongly, corrected for the temperature of the air in the beam."
    )
    source = "Ciddor 1996: the index of air falls by 0.93e-6 a kelvin"
    sizes = (Size("per_K", "1/K", -5e-6, 5e-6, "relative change of the reading"),)
    needs = ("air_temperature",)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield one setting if the temperature is known and not the standard one throughout."""
        if self.known(stops) and np.nanmax(np.abs(stops.air_temperature - 20.0)) > 0.0:
            yield {}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:  # noqa: ARG002
        """Return per_K·displacement·(temperature - 20.0 degC)."""
        return Change(reading=sizes["per_K"] * stops.along * (stops.air_temperature - 20.0))


EFFECT = AirTemperature()
