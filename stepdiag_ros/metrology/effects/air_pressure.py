"""Uncompensated air pressure: the pressure changes the wavelength, and no sensor measures it."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops


class AirPressure(Effect):
    """Reading in proportion to its length and to the pressure of the air."""

    name = "uncompensated air pressure"
    sentence = "The reading is not, or wrongly, corrected for the pressure of the air in the beam."
    source = "Ciddor 1996: the index of air rises by 2.68e-9 a pascal"
    sizes = (Size("per_Pa", "1/Pa", -2e-8, 2e-8, "relative change of the reading"),)
    needs = ("air_pressure",)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield one setting if the pressure is known and not the standard one throughout."""
        if self.known(stops) and np.nanmax(np.abs(stops.air_pressure - 101325.0)) > 0.0:
            yield {}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:  # noqa: ARG002
        """Return per_Pa·displacement·(pressure - 101325.0 Pa)."""
        return Change(reading=sizes["per_Pa"] * stops.along * (stops.air_pressure - 101325.0))


EFFECT = AirPressure()
