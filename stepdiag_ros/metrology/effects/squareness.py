"""Squareness: the straight line of one axis is not at a right angle to that of another."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES
from stepdiag_ros.metrology.geometry import AXES, SQUARENESS


class SquarenessEffect(Effect):
    """Deviation of two axes from the right angle, by right-handed rotation of the second."""

    name = "squareness"
    sentence = "Two axes are not set at a right angle to each other."
    source = "ISO 230-1:2012 (C0Y, B0Z, A0Z)"
    keys = (Key("angle", SQUARENESS),)
    sizes = (Size("turn", "rad", -500e-6, 500e-6, "right-handed rotation of the axis's line"),)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each pair of axes that both move."""
        for name in SQUARENESS:
            one, two = (AXES.index(letter) for letter in SQUARENESS_SLOPES[name][1][0][2:])
            if np.ptp(stops.position[:, one]) > 0.0 and np.ptp(stops.position[:, two]) > 0.0:
                yield {"angle": name}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return the slope of the curve of the later axis: E_XY, E_XZ or E_YZ."""
        factor, (first, second) = SQUARENESS_SLOPES[setting["angle"]]
        curve = first if first[3] == setting["angle"][2] else second
        error, axis = (AXES.index(letter) for letter in curve[2:])
        translation = np.zeros_like(stops.position)
        translation[:, error] = factor * sizes["turn"] * stops.position[:, axis]
        return Change(translation=translation)

    def label(self, setting: Setting) -> str:
        """Say for example ``squareness C0Y``."""
        return f"{self.name} {setting['angle']}"


EFFECT = SquarenessEffect()
