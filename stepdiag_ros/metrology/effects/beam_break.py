"""Beam break: the beam is lost and taken up again with a wrong count, to the end of the pass."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Setting, Size
from stepdiag_ros.metrology.effects.passes import PASS_KEYS, pass_rows, pass_setting, pass_words
from stepdiag_ros.metrology.effects.stops import Stops


class BeamBreak(Effect):
    """Step of the reading that ends with its pass."""

    name = "beam-break jump"
    sentence = "The beam was broken and preset to a wrong value; the next pass had a new zero."
    source = "ISO 230-1:2012 (laser interferometer); the count is lost with the beam"
    keys = PASS_KEYS
    sizes = (Size("size", "m", -10e-6, 10e-6, "of the step"),)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each stop after the first of each pass but the last of a setup."""
        setups = [
            int(stops.setup[stops.pass_index == index][0]) for index in range(len(stops.lines))
        ]
        for index, line in enumerate(stops.lines):
            # In the last pass of a setup it is the same as a fringe slip.
            if setups[index] in setups[index + 1 :]:
                for number in range(1, int(np.count_nonzero(stops.pass_index == index))):
                    yield pass_setting(line, number)

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return size at the stop and at all that are measured later in its pass."""
        here = pass_rows(setting, stops) & (stops.number >= setting["from_stop"])
        return Change(reading=np.where(here, sizes["size"], 0.0))

    def label(self, setting: Setting) -> str:
        """Say for example ``beam-break jump on npp YZX forward, repeat 0, from stop 22``."""
        return f"{self.name} on {pass_words(setting)}, from stop {setting['from_stop']}"


EFFECT = BeamBreak()
