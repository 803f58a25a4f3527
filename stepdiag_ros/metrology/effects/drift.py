"""Drift: tool and workpiece, or laser and its reference, move apart steadily."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES

BEAM = "beam"
"""Along the beam of each line: the interferometer itself."""


class Drift(Effect):
    """Steady motion of the structure along an axis, or of the reading itself."""

    name = "drift"
    sentence = "The structure bends, or the interferometer wanders, steadily while the run goes on."
    source = "ISO 230-3:2020 (environmental temperature variation error)"
    keys = (Key("along", (*AXES, BEAM)),)
    sizes = (Size("m_per_s", "m/s", -1e-7, 1e-7, "speed of the drift"),)
    needs = ("time",)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each axis that a beam can see, and the reading itself."""
        if not self.known(stops) or not stops.duration > 0.0:
            return
        for axis, letter in enumerate(AXES):
            if np.any(stops.direction[:, axis]):
                yield {"along": letter}
        yield {"along": BEAM}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return m_per_s·time."""
        change = sizes["m_per_s"] * stops.time
        if setting["along"] == BEAM:
            return Change(reading=change)
        return Change.along(setting["along"], change)

    def label(self, setting: Setting) -> str:
        """Say for example ``drift along X`` or ``drift of the reading``."""
        where = "of the reading" if setting["along"] == BEAM else f"along {setting['along']}"
        return f"{self.name} {where}"


EFFECT = Drift()
