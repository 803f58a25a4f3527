"""Wavy angular error: an axis turns along a smooth curve with two waves over its travel."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES, ROTATIONS, moving_axis


class SmoothAngularError(Effect):
    """One of the nine rotations of the axes, a slope and two waves over the travel."""

    name = "wavy angular error"
    sentence = (
        "A carriage turns to and fro as it moves, as on a guideway that is bolted down at points."
    )
    source = "ISO 230-1:2012; two waves as the straightness of rails between their bolts has them"
    keys = (Key("error", ROTATIONS),)
    sizes = (
        Size("slope", "rad", -200e-6, 200e-6, "turn over the travel"),
        Size("sine_1", "rad", -100e-6, 100e-6, "amplitude of one sine wave over the travel"),
        Size("cosine_1", "rad", -100e-6, 100e-6, "amplitude of one cosine wave"),
        Size("sine_2", "rad", -100e-6, 100e-6, "amplitude of two sine waves over the travel"),
        Size("cosine_2", "rad", -100e-6, 100e-6, "amplitude of two cosine waves"),
    )

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each rotation of an axis that moves; none if the chain is not known."""
        for error in ROTATIONS if stops.chain else ():
            if AXES[moving_axis(error)] in stops.moving_axes:
                yield {"error": error}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return the rotation slope·u + Σ sine_w·sin(2πwu) + cosine_w·(cos(2πwu) - 1)."""
        axis = moving_axis(setting["error"])
        share = stops.share[:, axis]
        angle = sizes["slope"] * share
        for wave in (1, 2):
            phase = 2.0 * np.pi * wave * share
            angle = angle + sizes[f"sine_{wave}"] * np.sin(phase)
            angle = angle + sizes[f"cosine_{wave}"] * (np.cos(phase) - 1.0)
        rotation = np.zeros_like(stops.position)
        rotation[:, "ABC".index(setting["error"][2])] = angle
        return Change(rotations={axis: rotation})

    def label(self, setting: Setting) -> str:
        """Say for example ``wavy angular error E_CZ``."""
        return f"{self.name} {setting['error']}"


EFFECT = SmoothAngularError()
