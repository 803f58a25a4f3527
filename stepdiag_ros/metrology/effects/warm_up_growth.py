"""Warm-up growth: an axis grows towards a limit as it is moved."""

from collections.abc import Iterator, Mapping

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.effects.time_constants import time_constants, warmed
from stepdiag_ros.metrology.geometry import AXES


class WarmUpGrowth(Effect):
    """Expansion of an axis that comes near its limit exponentially."""

    name = "warm-up growth"
    sentence = "Friction warms the ball screw of an axis until as much heat leaves it as comes in."
    source = "ISO 230-3:2020 (thermal distortion caused by moving axes, time constants)"
    keys = (Key("axis", AXES), Key("time_constant_s", float))
    sizes = (Size("final", "1", -500e-6, 500e-6, "relative growth in the end"),)
    needs = ("time",)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each axis that moves with each time constant that the run can determine."""
        for letter in stops.moving_axes:
            for constant in time_constants(stops):
                yield {"axis": letter, "time_constant_s": constant}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return final·position·(1 - exp(-time / time constant)) along the axis."""
        warm = warmed(stops, setting["time_constant_s"])
        axis = AXES.index(setting["axis"])
        return Change.along(setting["axis"], sizes["final"] * stops.position[:, axis] * warm)


EFFECT = WarmUpGrowth()
