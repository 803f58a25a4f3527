"""Beam walk: the beam wanders over a mirror that is not flat."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops


class BeamWalk(Effect):
    """Curvature of the mirror, seen where the mirror moves sideways under the beam."""

    name = "beam walk on the mirror"
    sentence = "The mirror moves sideways through the beam in each block, and it is not flat."
    source = (
        "Ibaraki & Hata 2010, section 2 (flat mirror); sagitta of a sphere, w²/2 over its radius"
    )
    sizes = (Size("curvature", "1/m", -0.1, 0.1, "1 / radius; positive: the middle stands back"),)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield one setting if the mirror moves sideways at all."""
        if np.any(np.abs(stops.sideways) > 1e-9):
            yield {}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:  # noqa: ARG002
        """Return curvature·w²/2, w the way of the beam on the mirror from its centre."""
        square = np.sum(stops.sideways**2, axis=1)
        return Change(reading=0.5 * sizes["curvature"] * square)


EFFECT = BeamWalk()
