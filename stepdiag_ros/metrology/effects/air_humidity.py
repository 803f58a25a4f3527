"""Uncompensated air humidity: the humidity changes the wavelength, and no sensor measures it."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops


class AirHumidity(Effect):
    """Reading in proportion to its length and to the humidity of the air."""

    name = "uncompensated air humidity"
    sentence = "The reading is not, or wrongly, corrected for the humidity of the air in the beam."
    source = "Ciddor 1996: the index of air falls by 0.85e-6 from dry to saturated air"
    sizes = (Size("per_unit", "1", -5e-6, 5e-6, "relative change of the reading"),)
    needs = ("relative_humidity",)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield one setting if the humidity is known and not the standard one throughout."""
        if self.known(stops) and np.nanmax(np.abs(stops.relative_humidity - 0.5)) > 0.0:
            yield {}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:  # noqa: ARG002
        """Return per_unit·displacement·(humidity - 0.5)."""
        return Change(reading=sizes["per_unit"] * stops.along * (stops.relative_humidity - 0.5))


EFFECT = AirHumidity()
