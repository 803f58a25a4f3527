"""Dead path: the beam before the zero changes its length with the pressure of the air."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops


class DeadPathByPressure(Effect):
    """Zero of the reading that follows the pressure of the air."""

    name = "dead path by pressure"
    sentence = "Between the laser and the zero lies air whose pressure is not corrected for."
    source = "Ciddor 1996; 1 m of dead path: -0.93 µm a kelvin, 2.7 nm a pascal"
    sizes = (Size("m_per_Pa", "m/Pa", -1e-7, 1e-7, "change of the zero"),)
    needs = ("air_pressure",)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield one setting if the pressure is known and changes."""
        if self.known(stops) and np.nanmax(stops.air_pressure) > np.nanmin(stops.air_pressure):
            yield {}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:  # noqa: ARG002
        """Return m_per_Pa·(pressure - 101325.0)."""
        return Change(reading=sizes["m_per_Pa"] * (stops.air_pressure - 101325.0))


EFFECT = DeadPathByPressure()
