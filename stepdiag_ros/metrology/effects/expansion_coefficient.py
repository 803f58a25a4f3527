"""Wrong expansion coefficient: readings are brought to 20 degC with a wrong figure."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops


class ExpansionCoefficient(Effect):
    """Error of the coefficient by which all readings are corrected to 20 degC."""

    name = "wrong expansion coefficient"
    sentence = "The correction of the readings to 20 degC takes a wrong expansion coefficient."
    source = "ISO 230-2:2014 (expansion coefficient in the correction to 20 degC, ISO 1)"
    sizes = (Size("per_K", "1/K", -50e-6, 50e-6, "true less used coefficient"),)
    needs = ("material_temperature",)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield one setting if the temperature is known and not 20 degC throughout."""
        if self.known(stops) and np.nanmax(np.abs(stops.material_temperature - 20.0)) > 0.0:
            yield {}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:  # noqa: ARG002
        """Return per_K·displacement·(material temperature - 20 degC)."""
        return Change(reading=sizes["per_K"] * stops.along * (stops.material_temperature - 20.0))


EFFECT = ExpansionCoefficient()
