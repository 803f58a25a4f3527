"""Learned rotation: an axis that turns by a product of plain shapes, which has no name yet.

The factors are those of ``learned_shape``.
"""

from collections.abc import Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Key, Setting, Size
from stepdiag_ros.metrology.effects.learned_shape import EFFECT as SHAPE
from stepdiag_ros.metrology.effects.learned_shape import Learned
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import ROTATIONS, moving_axis


class LearnedRotation(Learned):
    """A rotation of an axis by a product of plain shapes."""

    name = "learned rotation"
    sentence = "An axis turns for no reason with a name; it was described by what that depends on."
    keys = (Key("acts_on", ROTATIONS), Key("shape", str))
    sizes = (Size("amplitude", "rad", -200e-6, 200e-6, "where the product of the shapes is 1"),)

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return the rotation of the axis, amplitude times the product of the factors.

        Raises:
            ValueError: a factor does not exist.
        """
        error = setting["acts_on"]
        rotation = np.zeros_like(stops.position)
        rotation[:, "ABC".index(error[2])] = self.amount(setting, sizes, stops)
        return Change(rotations={moving_axis(error): rotation})

    def label(self, setting: Setting) -> str:
        """Say for example ``learned rotation E_AZ: z^1 * material^1``."""
        return f"{self.name} {setting['acts_on']}: {setting['shape']}"


EFFECT = LearnedRotation()


def learned(acts_on: str) -> Learned:
    """Return the effect of what acts on a displacement, the reading or a rotation, see its key."""
    return EFFECT if acts_on in ROTATIONS else SHAPE
