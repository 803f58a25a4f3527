"""Warm-up drift: tool and workpiece, or laser and its reference, move towards new places."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.drift import BEAM
from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.effects.time_constants import time_constants, warmed
from stepdiag_ros.metrology.geometry import AXES


class WarmUpDrift(Effect):
    """Motion of the structure along an axis, or of the reading, that comes near a limit."""

    name = "warm-up drift"
    sentence = (
        "The structure or the laser warms up after it is switched on and comes to rest slowly."
    )
    source = "ISO 230-3:2020 (thermal distortion, time constants)"
    keys = (Key("along", (*AXES, BEAM)), Key("time_constant_s", float))
    sizes = (Size("final", "m", -100e-6, 100e-6, "way in the end"),)
    needs = ("time",)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each axis that a beam can see, and the reading, with each time constant."""
        for along in (*AXES, BEAM):
            if along == BEAM or np.any(stops.direction[:, AXES.index(along)]):
                for constant in time_constants(stops):
                    yield {"along": along, "time_constant_s": constant}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return final·(1 - exp(-time / time constant))."""
        change = sizes["final"] * warmed(stops, setting["time_constant_s"])
        if setting["along"] == BEAM:
            return Change(reading=change)
        return Change.along(setting["along"], change)

    def label(self, setting: Setting) -> str:
        """Say for example ``warm-up drift along X, time constant 600 s``."""
        along = setting["along"]
        where = "of the reading" if along == BEAM else f"along {along}"
        return f"{self.name} {where}, time constant {setting['time_constant_s']:g} s"


EFFECT = WarmUpDrift()
