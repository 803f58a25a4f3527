"""Abbe offset: the mirror of one setup stands elsewhere on the tool than in the others.

A constant offset o of the mirror adds (ε_i(q_i) × n)·o, a function of one axis's position: part of
that axis's curves where it is the same in all setups. Where one setup has another offset, it shows
there alone. Offset and rotation are known only as a product: the size is the length
that it adds up to at the end of the travel.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.passes import setup_index
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES


class AbbeOffset(Effect):
    """Rotation of an axis times another offset of the mirror in one setup."""

    name = "Abbe offset"
    sentence = (
        "The mirror of one line is mounted at another place, and an axis that turns carries it."
    )
    source = "ISO 230-1:2012 (Abbe principle); Ibaraki & Hata 2010, eq. 23 with a constant arm"
    keys = (Key("setup", str), Key("axis", AXES))
    sizes = (
        Size("linear", "m", -50e-6, 50e-6, "turn over the travel times offset"),
        Size("quadratic", "m", -50e-6, 50e-6, "the part that grows with the square of the way"),
    )

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each setup with each axis that moves in it, if there are several setups."""
        for index, setup in enumerate(stops.setups if len(stops.setups) > 1 else ()):
            for axis, letter in enumerate(AXES):
                if np.ptp(stops.position[stops.setup == index, axis]) > 0.0:
                    yield {"setup": setup, "axis": letter}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return linear·u + quadratic·u² on the setup, u = position / travel of the axis."""
        here = stops.setup == setup_index(setting, stops)
        share = stops.share[:, AXES.index(setting["axis"])]
        length = sizes["linear"] * share + sizes["quadratic"] * share**2
        return Change(reading=np.where(here, length, 0.0))

    def label(self, setting: Setting) -> str:
        """Say for example ``Abbe offset on ppp XYZ with turns of X``."""
        return f"{self.name} on {setting['setup']} with turns of {setting['axis']}"


EFFECT = AbbeOffset()
