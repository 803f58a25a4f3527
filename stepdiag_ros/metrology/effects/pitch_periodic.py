"""Pitch-periodic error: the position of an axis swings once a turn of its ball screw."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES

_LEADS = (2e-3, 4e-3, 5e-3, 6e-3, 8e-3, 10e-3, 12e-3, 16e-3, 20e-3, 25e-3, 32e-3, 40e-3)
"""Of ball screws for machine tools, m."""


class PitchPeriodicError(Effect):
    """Positioning error of an axis with the period of its ball screw."""

    name = "pitch-periodic error"
    sentence = "The ball screw, its bearing or its encoder runs out of true once a turn."
    source = "ISO 230-2:2014 (periodic positioning error); leads by ISO 3408-2"
    keys = (Key("axis", AXES), Key("period_m", float))
    sizes = (
        Size("sine", "m", -20e-6, 20e-6, "amplitude of the sine from the first node"),
        Size("cosine", "m", -20e-6, 20e-6, "amplitude of the cosine from the first node"),
    )

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each axis with each lead that its travel holds at least twice."""
        for axis, letter in enumerate(AXES):
            for period in _LEADS:
                if np.ptp(stops.position[:, axis]) >= 2.0 * period:
                    yield {"axis": letter, "period_m": period}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return sine·sin + cosine·(cos - 1) of 2π·position/period along the axis."""
        axis = AXES.index(setting["axis"])
        phase = 2.0 * np.pi * stops.position[:, axis] / setting["period_m"]
        return Change.along(
            setting["axis"], sizes["sine"] * np.sin(phase) + sizes["cosine"] * (np.cos(phase) - 1.0)
        )

    def label(self, setting: Setting) -> str:
        """Say for example ``pitch-periodic error of X, period 10 mm``."""
        return f"{self.name} of {setting['axis']}, period {setting['period_m'] * 1e3:g} mm"


EFFECT = PitchPeriodicError()
