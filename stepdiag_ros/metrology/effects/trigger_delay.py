"""Delay of the position trigger: the reading belongs to a moment after the target."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector


class TriggerDelay(Effect):
    """Time between reaching a position and the reading that is recorded for it."""

    name = "position-trigger delay"
    sentence = "The trigger that records a reading as the machine passes a position comes too late."
    source = "Renishaw, laser diagonal testing (data capture); v·t for a mean velocity v"
    sizes = (Size("delay", "s", -0.1, 0.1, "of the reading behind the position"),)
    needs = ("time",)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield one setting if the times between stops are known."""
        if self.known(stops) and np.any(_velocity(stops)):
            yield {}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:  # noqa: ARG002
        """Return delay times the mean velocity along the beam on the way to the stop."""
        return Change(reading=sizes["delay"] * _velocity(stops))


def _velocity(stops: Stops) -> Vector:
    interval = np.diff(stops.time, prepend=stops.time[:1])
    timed = (stops.number > 0) & (interval > 0.0)
    way = np.sum(stops.direction * stops.way, axis=1)
    velocity: Vector = np.where(timed, way / np.where(timed, interval, 1.0), 0.0)
    return velocity


EFFECT = TriggerDelay()
