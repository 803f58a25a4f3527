"""Scale of an axis: its positions are too long or too short in proportion."""

from collections.abc import Iterator, Mapping

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES


class AxisScale(Effect):
    """Positioning error of an axis in proportion to its position."""

    name = "scale"
    sentence = "The scale or ball screw of an axis is longer or shorter than its control believes."
    source = "ISO 230-1:2012 (mean slope of E_XX, E_YY, E_ZZ)"
    keys = (Key("axis", AXES),)
    sizes = (Size("scale", "1", -500e-6, 500e-6, "error over position"),)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each axis that moves."""
        for letter in stops.moving_axes:
            yield {"axis": letter}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return scale·position along the axis."""
        axis = AXES.index(setting["axis"])
        return Change.along(setting["axis"], sizes["scale"] * stops.position[:, axis])


EFFECT = AxisScale()
