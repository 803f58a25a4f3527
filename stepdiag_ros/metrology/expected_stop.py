"""Where a stop must be if the recording is of this plan: within what errors can explain.

A program of another plan may have steps so near to those of this one that each of them fits by
itself (``rest_matching.Tolerance``). What it cannot do is stay near over a whole line, for no
machine and no setup is that wrong. From a line's first stop to any other the reading goes by

    n·q + d·q + what the machine, the air and the beam do to it      (``forward``)

with q from the first stop to the other, n the beam and d ⊥ n the tilt of the mirror. So it may be
off by

- ``SCALE`` of the way along the beam: errors of the machine that grow with the way, its
  temperature, air, cosine error;
- ``TILT`` of the way beside the beam, which the single moves of a step diagonal make;
- ``Tolerance.least``: errors of the machine from place to place, reversal errors, drift;

but never by more than ``Tolerance.most``, the part of the smallest step by which two
stops are distinguished. Nothing is fitted, so nothing can hide a shift.
"""

import numpy as np

from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.rest_matching import Tolerance

SCALE = 1e-3
"""Largest part of its way along the beam by which a reading can be off.

It is the sum of 4e-4 for positioning and squareness (machine tools have 1e-5 to 1e-4), 2.5e-4 for
the growth of steel by 20 K, 2.7e-4 for air that is not compensated at all, and 0.5e-4 for the
cosine of a beam that is off by ``TILT``."""
TILT = 0.01
"""rad; a mirror that is tilted by more sends the beam back 20 mm beside itself after 1 m, and past
the aperture of an interferometer (some 8 mm) from 0.4 m on."""


class ExpectedStops:
    """The stops of one line of a plan, as the readings must show them.

    Args:
        plan: of the measurement.
        line_index: of its line.
        tolerance: of a step of that plan.
    """

    def __init__(self, plan: Plan, line_index: int, tolerance: Tolerance) -> None:
        line = plan.lines[line_index]
        self._name = str(line)
        self._beam = beam_direction(line.name, np.asarray(plan.volume.step))
        self._targets = line.stops(plan.volume)
        self._tolerance = tolerance

    def departure(self, first: int, stop: int, went: float) -> float:
        """Return by how much a reading is off where the plan has a stop, m.

        Args:
            first: stop that it is counted from.
            stop: that the mirror is believed to stand at.
            went: by which the reading has changed between the two, m.
        """
        return went - float(self._beam @ (self._targets[stop] - self._targets[first]))

    def explained(self, first: int, stop: int) -> float:
        """Return the largest departure that machine and setup can explain, m."""
        way = self._targets[stop] - self._targets[first]
        along = float(self._beam @ way)
        beside = float(np.linalg.norm(way - along * self._beam))
        least, most = self._tolerance.least, self._tolerance.most
        return min(SCALE * abs(along) + TILT * beside + least, most)

    def objection(self, first: int, stop: int, went: float) -> str:
        """Say why the mirror cannot stand at a stop of this plan; empty if it can.

        Args:
            first: as in ``departure``.
            stop: as there.
            went: as there.
        """
        off, most = self.departure(first, stop, went), self.explained(first, stop)
        if abs(off) <= most:
            return ""
        return (
            f"stop {stop} of {self._name} stands {off * 1e3:+.4f} mm from where the plan has it, "
            f"and no more than {most * 1e3:.2g} mm is due to machine and setup: give the plan "
            "whose program ran"
        )
