"""Mirror tilt: the mirror of a setup turns on its mount while the line is measured."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.passes import setup_index
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.forward import perpendiculars


class MirrorTilt(Effect):
    """Turn of the mirror in proportion to the way along one line, seen by its sideways moves."""

    name = "mirror tilt under travel"
    sentence = "The mirror of one line creeps or sags on its mount as the machine travels."
    source = "Ibaraki & Hata 2010, eq. 5: constant tilts drop out of a block, changing ones do not"
    keys = (Key("setup", str),)
    sizes = (
        Size("first", "rad", -500e-6, 500e-6, "of the normal towards the first perpendicular"),
        Size("second", "rad", -500e-6, 500e-6, "of the normal towards the second perpendicular"),
    )

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each setup in which the mirror moves sideways."""
        walks = np.any(np.abs(stops.sideways) > 1e-9, axis=1)
        for index, setup in enumerate(stops.setups):
            if np.any(walks[stops.setup == index]):
                yield {"setup": setup}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return the tilt, grown in proportion along the line, times the way sideways."""
        here = stops.setup == setup_index(setting, stops)
        first, second = perpendiculars(stops.direction[here][0])
        tilt = sizes["first"] * first + sizes["second"] * second
        share = stops.along / np.max(np.abs(stops.along[here]))
        return Change(reading=np.where(here, share * (stops.sideways @ tilt), 0.0))

    def label(self, setting: Setting) -> str:
        """Say for example ``mirror tilt under travel on ppp XYZ``."""
        return f"{self.name} on {setting['setup']}"


EFFECT = MirrorTilt()
