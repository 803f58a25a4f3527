"""Several angular errors at once: all axes turn a little, as on every real machine."""

from collections.abc import Iterator, Mapping

from stepdiag_ros.metrology.effects.effect import Change, Effect, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops


class SeveralAngularErrors(Effect):
    """All nine rotations of the axes, each a random function of one typical size."""

    name = "several angular errors"
    sentence = "The carriages rotate about X, Y and Z as they move, several of them at once."
    source = "ISO 230-1:2012 (E_AX to E_CZ); Ibaraki & Hata 2010, section 4.2"
    sizes = (
        Size("size", "rad", 0.0, 200e-6, "standard deviation of a turn over the measured travel"),
    )
    typical = True

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield one setting; none if the chain is not known."""
        if stops.chain:
            yield {}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return no change: which way each axis turns, the size does not say."""
        del setting, sizes, stops
        return Change()


EFFECT = SeveralAngularErrors()
