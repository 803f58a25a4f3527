"""Servo lag: the machine stands short of each stop along its path, whichever axes move."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops


class ServoLag(Effect):
    """Way along the path that is left when the reading is taken, the same for all axes."""

    name = "servo lag"
    sentence = (
        "All axes follow their commands alike, late, and are read before they have caught up."
    )
    source = "ISO 230-2:2014; a first-order lag leaves feed x time constant x exp(-dwell/constant)"
    sizes = (Size("short_by", "m", -20e-6, 20e-6, "distance still to go along the path"),)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield one setting if more than one axis moves; of one axis it is settling."""
        if np.count_nonzero(np.any(stops.moved, axis=0)) > 1:
            yield {}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:  # noqa: ARG002
        """Return -short_by along the direction of the move that led to the stop."""
        length = np.linalg.norm(stops.way, axis=1, keepdims=True)
        moves = length > 0.0
        translation = np.where(
            moves, -sizes["short_by"] * stops.way / np.where(moves, length, 1.0), 0.0
        )
        return Change(translation=translation)


EFFECT = ServoLag()
