"""Sag: the structure bends by the places of two axes together."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES

_PAIRS = ("XY", "XZ", "YZ")


class Sag(Effect):
    """Displacement of the tool along an axis in proportion to the product of two positions."""

    name = "sag"
    sentence = "The weight of a carriage bends what carries it, the more the farther out it stands."
    source = "ISO 230-1:2012 (non-rigid behaviour); a beam with a moving load"
    keys = (Key("error", AXES), Key("over", _PAIRS))
    sizes = (Size("corner", "m", -100e-6, 100e-6, "at the ends of both travels"),)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each direction that a beam can see with each pair of axes that move."""
        moves = np.ptp(stops.position, axis=0) > 0.0
        for error, letter in enumerate(AXES):
            for pair in _PAIRS:
                if np.any(stops.direction[:, error]) and all(
                    moves[AXES.index(one)] for one in pair
                ):
                    yield {"error": letter, "over": pair}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return corner·u·v along the axis, u and v the positions over the travels."""
        one, two = (AXES.index(letter) for letter in setting["over"])
        return Change.along(
            setting["error"], sizes["corner"] * stops.share[:, one] * stops.share[:, two]
        )

    def label(self, setting: Setting) -> str:
        """Say for example ``sag along Z over X and Y``."""
        one, two = setting["over"]
        return f"{self.name} along {setting['error']} over {one} and {two}"


EFFECT = Sag()
