"""Cosine error: the beam of one setup is not along the line, so its readings are short."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.passes import setup_index
from stepdiag_ros.metrology.effects.stops import Stops


class CosineError(Effect):
    """Scale of the readings of one setup."""

    name = "cosine error"
    sentence = (
        "The beam of one line is out of line with the motion, or its mirror returns it askew."
    )
    source = "ISO 230-1:2012 (alignment of laser beams); second order of the tilts: |b|²/2 - b·m"
    keys = (Key("setup", str),)
    sizes = (Size("scale", "1", -50e-6, 50e-6, "error over displacement; negative: reads short"),)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each setup."""
        for setup in stops.setups:
            yield {"setup": setup}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return scale·displacement on the setup."""
        here = stops.setup == setup_index(setting, stops)
        return Change(reading=np.where(here, sizes["scale"] * stops.along, 0.0))


EFFECT = CosineError()
