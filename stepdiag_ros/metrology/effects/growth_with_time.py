"""Growth with time: an axis grows steadily, with or without a sensor for the cause."""

from collections.abc import Iterator, Mapping

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES


class GrowthWithTime(Effect):
    """Expansion of an axis in proportion to the time since the start of the run."""

    name = "growth with time"
    sentence = "The scale or ball screw of an axis warms up steadily where no sensor is."
    source = "ISO 230-3:2020 (thermal distortion caused by moving axes)"
    keys = (Key("axis", AXES),)
    sizes = (Size("per_s", "1/s", -1e-6, 1e-6, "speed of the relative growth"),)
    needs = ("time",)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each axis that moves."""
        if not self.known(stops) or not stops.duration > 0.0:
            return
        for letter in stops.moving_axes:
            yield {"axis": letter}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return per_s·position·time along the axis."""
        axis = AXES.index(setting["axis"])
        return Change.along(setting["axis"], sizes["per_s"] * stops.position[:, axis] * stops.time)


EFFECT = GrowthWithTime()
