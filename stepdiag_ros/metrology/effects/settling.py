"""Settling: an axis that has just moved stands short of its target."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES


class Settling(Effect):
    """Way that is left of a move when the reading is taken."""

    name = "settling"
    sentence = "When it is read, an axis that has just moved has not quite reached its target."
    source = "ISO 230-2:2014 (dwell before a reading is recorded)"
    keys = (Key("axis", AXES),)
    sizes = (
        Size("short_by", "m", -20e-6, 20e-6, "distance still to go, in the sense of the move"),
    )

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each axis whose move leads to a stop."""
        for axis, letter in enumerate(AXES):
            if np.any(stops.moved[:, axis]):
                yield {"axis": letter}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return -short_by along the axis, in the sense of the move that led to the stop."""
        axis = AXES.index(setting["axis"])
        return Change.along(setting["axis"], -sizes["short_by"] * stops.moved[:, axis])


EFFECT = Settling()
