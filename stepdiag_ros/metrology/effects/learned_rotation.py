"""Learned rotation: an axis that turns by a product of plain shapes, which has no name yet.

The factors are those of ``learned_shape``.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.learned_shape import product_of
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import ROTATIONS, moving_axis


class LearnedRotation(Effect):
    """A rotation of an axis by a product of plain shapes."""

    name = "learned rotation"
    sentence = "An axis turns for no reason with a name; it was described by what that depends on."
    source = "learned from runs of the machine (docs/diagnose.md)"
    keys = (Key("acts_on", ROTATIONS), Key("shape", str))
    sizes = (Size("amplitude", "rad", -200e-6, 200e-6, "where the product of the shapes is 1"),)
    learned = True

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield nothing: a learned rotation is described, not tried."""
        del stops
        return iter(())

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return the rotation of the axis, amplitude times the product of the factors.

        Raises:
            ValueError: a factor does not exist.
        """
        error = setting["acts_on"]
        rotation = np.zeros_like(stops.position)
        turn = sizes["amplitude"] * product_of(setting["shape"], stops)
        rotation[:, "ABC".index(error[2])] = turn
        return Change(rotations={moving_axis(error): rotation})

    def label(self, setting: Setting) -> str:
        """Say for example ``learned rotation E_AZ: z^1 * material^1``."""
        return f"{self.name} {setting['acts_on']}: {setting['shape']}"


EFFECT = LearnedRotation()
