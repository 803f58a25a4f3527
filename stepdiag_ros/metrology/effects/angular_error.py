"""Angular error: an axis turns as it moves, which shows wherever there is a lever arm."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES, ROTATIONS, moving_axis


class AngularError(Effect):
    """One of the nine rotations of the axes, a straight line and a parabola over the travel."""

    name = "angular error"
    sentence = "A carriage rotates about X, Y or Z as it moves along its bent or twisted guideway."
    source = "ISO 230-1:2012 (E_AX to E_CZ); Ibaraki & Hata 2010, eq. 23"
    keys = (Key("error", ROTATIONS),)
    sizes = (
        Size("linear", "rad", -200e-6, 200e-6, "turn over the travel"),
        Size(
            "quadratic", "rad", -200e-6, 200e-6, "turn over the travel that grows with its square"
        ),
    )

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each rotation of an axis that moves; none if the chain is not known."""
        for error in ROTATIONS if stops.chain else ():
            if AXES[moving_axis(error)] in stops.moving_axes:
                yield {"error": error}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return the rotation linear·u + quadratic·u², u = position / travel of the axis."""
        axis = moving_axis(setting["error"])
        share = stops.share[:, axis]
        rotation = np.zeros_like(stops.position)
        rotation[:, "ABC".index(setting["error"][2])] = (
            sizes["linear"] * share + sizes["quadratic"] * share**2
        )
        return Change(rotations={axis: rotation})

    def label(self, setting: Setting) -> str:
        """Say for example ``angular error E_CZ``."""
        return f"{self.name} {setting['error']}"


EFFECT = AngularError()
