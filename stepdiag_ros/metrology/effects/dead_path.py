"""Dead path: the beam before the zero changes its length with the temperature of the air."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops


class DeadPath(Effect):
    """Zero of the reading that follows the temperature of the air."""

    name = "dead path"
    sentence = (
        "Between the laser and the zero lies air whose temperature is not corrected for, "
        "or a mount that grows."
    )
    source = "Ciddor 1996; 1 m of dead path: -0.93 µm a kelvin, 2.7 nm a pascal"
    sizes = (Size("m_per_K", "m/K", -20e-6, 20e-6, "change of the zero"),)
    needs = ("air_temperature",)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield one setting if the temperature is known and changes."""
        if self.known(stops) and np.nanmax(stops.air_temperature) > np.nanmin(
            stops.air_temperature
        ):
            yield {}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:  # noqa: ARG002
        """Return m_per_K·(temperature - 20.0)."""
        return Change(reading=sizes["m_per_K"] * (stops.air_temperature - 20.0))


EFFECT = DeadPath()
