"""Wrong wavelength: all readings are too long or too short in proportion."""

from collections.abc import Iterator, Mapping

from stepdiag_ros.metrology.effects.effect import Change, Effect, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops


class Wavelength(Effect):
    """Scale of all readings of the laser."""

    name = "wrong wavelength"
    sentence = (
        "The wavelength that the readings are made of is wrong, or one air correction for all."
    )
    source = "ISO 230-1:2012 (laser interferometer); the wavelength is the scale of every reading"
    sizes = (Size("scale", "1", -100e-6, 100e-6, "error over displacement"),)

    def settings(self, stops: Stops) -> Iterator[Setting]:  # noqa: ARG002
        """Yield one setting."""
        yield {}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:  # noqa: ARG002
        """Return scale·displacement."""
        return Change(reading=sizes["scale"] * stops.along)


EFFECT = Wavelength()
