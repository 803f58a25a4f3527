"""Backlash: an axis stops short of its target by half the reversal error."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES


class Backlash(Effect):
    """Reversal error of an axis between its two senses of travel."""

    name = "backlash"
    sentence = "When an axis turns round, its drive moves before the carriage does."
    source = "ISO 230-1:2012; ISO 230-2:2014 (reversal error B)"
    keys = (Key("axis", AXES),)
    depends_on_sense = True
    sizes = (Size("lost_motion", "m", -50e-6, 50e-6, "travel lost at a reversal"),)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each axis that comes to a place in both senses."""
        for axis, letter in enumerate(AXES):
            if {-1.0, 1.0} <= set(np.unique(stops.last_sense[:, axis])):
                yield {"axis": letter}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return -lost_motion/2 along the axis, in the sense of its last move."""
        axis = AXES.index(setting["axis"])
        return Change.along(
            setting["axis"], -0.5 * sizes["lost_motion"] * stops.last_sense[:, axis]
        )


EFFECT = Backlash()
