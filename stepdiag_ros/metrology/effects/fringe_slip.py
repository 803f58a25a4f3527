"""Fringe slip: the counter loses or gains fringes and stays wrong until it is zeroed again."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Setting, Size
from stepdiag_ros.metrology.effects.passes import PASS_KEYS, pass_rows, pass_setting, pass_words
from stepdiag_ros.metrology.effects.stops import Stops


class FringeSlip(Effect):
    """Step of the reading that stays to the end of its setup."""

    name = "fringe slip"
    sentence = "The counter has lost or gained fringes: all that follows in the setup is shifted."
    source = (
        "ISO 230-1:2012 (laser interferometer); a fringe is half a wavelength or less by the optics"
    )
    keys = PASS_KEYS
    sizes = (Size("size", "m", -10e-6, 10e-6, "of the step"),)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each stop after the first of each setup."""
        seen: set[int] = set()
        for index, line in enumerate(stops.lines):
            inside = stops.pass_index == index
            setup = int(stops.setup[inside][0])
            for number in range(0 if setup in seen else 1, int(np.count_nonzero(inside))):
                yield pass_setting(line, number)
            seen.add(setup)

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return size at the stop and at all that are measured later in its setup."""
        inside = pass_rows(setting, stops)
        moment = np.min(stops.time[inside & (stops.number >= setting["from_stop"])])
        here = (stops.setup == stops.setup[inside][0]) & (stops.time >= moment)
        return Change(reading=np.where(here, sizes["size"], 0.0))

    def label(self, setting: Setting) -> str:
        """Say for example ``fringe slip on npp YZX forward, repeat 0, from stop 22``."""
        return f"{self.name} on {pass_words(setting)}, from stop {setting['from_stop']}"


EFFECT = FringeSlip()
