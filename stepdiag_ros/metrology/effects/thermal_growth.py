"""Thermal growth: an axis grows with the recorded temperature of its material."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES


class ThermalGrowth(Effect):
    """Expansion of an axis beyond what is taken into account, by the material temperature."""

    name = "thermal growth"
    sentence = "The scale or ball screw of an axis expands with the temperature of its material."
    source = "ISO 230-3:2020; ISO 230-2:2014 (reference temperature 20 degC by ISO 1)"
    keys = (Key("axis", AXES),)
    sizes = (Size("per_K", "1/K", -50e-6, 50e-6, "expansion coefficient that is not corrected"),)
    needs = ("material_temperature",)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each axis that moves, if the temperature is known and not 20 degC throughout."""
        if not self.known(stops) or not np.nanmax(np.abs(stops.material_temperature - 20.0)) > 0.0:
            return
        for letter in stops.moving_axes:
            yield {"axis": letter}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return per_K·position·(material temperature - 20 degC) along the axis."""
        axis = AXES.index(setting["axis"])
        return Change.along(
            setting["axis"],
            sizes["per_K"] * stops.position[:, axis] * (stops.material_temperature - 20.0),
        )


EFFECT = ThermalGrowth()
