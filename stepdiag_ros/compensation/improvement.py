"""How much better a machine has become: two measurements of it, before and after compensation."""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.compensation.identified import Identified
from stepdiag_ros.compensation.remaining import Change, remainder
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.volumetric_map import EDGE

SURE = 2.0
"""Standard uncertainties up to which an error may be nothing but the measurement's own."""


@dataclass(frozen=True)
class Unchanged:
    """No compensation beyond what was at work in the run (``applied.Applied``)."""

    def sent(self, targets: Vector, forward: bool) -> Vector:  # noqa: ARG002
        """Return the targets as they are."""
        return targets


@dataclass(frozen=True)
class Improvement:
    """What two measurements say of one machine.

    Attributes:
        before: origin and errors of the first.
        after: of the second.
        changes: the same figures of both; ``corrected`` says nothing here.
        rms_uncertainty: rms over the volume of the standard uncertainty of the second's error
            vectors, m; NaN where not known.
    """

    before: Identified
    after: Identified
    changes: tuple[Change, ...]
    rms_uncertainty: float

    @property
    def words(self) -> str:
        """Say in one sentence how much better the volume has become."""
        rms = next(one for one in self.changes if one.name == "volume, rms")
        if not np.isfinite(rms.before) or not np.isfinite(rms.after):
            return "How much better the volume is cannot be told: curves are not determined."
        limit = SURE * self.rms_uncertainty
        if rms.after <= limit:
            return (
                f"The volume's rms error went from {rms.before * 1e6:.3f} µm to"
                f" {rms.after * 1e6:.3f} µm, which is no more than this measurement can tell from"
                f" nothing ({limit * 1e6:.3f} µm): at least {rms.before / limit:.1f} times better."
            )
        better = "better" if rms.factor >= 1.0 else "WORSE"
        times = rms.factor if rms.factor >= 1.0 else 1.0 / rms.factor
        return (
            f"The volume's rms error went from {rms.before * 1e6:.3f} µm to"
            f" {rms.after * 1e6:.3f} µm: {times:.1f} times {better}."
        )


def improvement(before: Identified, after: Identified) -> Improvement:
    """Return how two measurements of a machine differ.

    Args:
        before: of the first.
        after: of the second.

    Raises:
        ValueError: they are not of the same box.
    """
    one, other = before.error_map, after.error_map
    for axis, letter in enumerate(AXES):
        ends = np.array([one.nodes[axis][[0, -1]], other.nodes[axis][[0, -1]]])
        if np.max(np.abs(ends[0] - ends[1])) > EDGE:
            low, high = ends * 1e3
            raise ValueError(
                f"the measured boxes differ: {letter} from {low[0]:g} to {low[1]:g} mm and from"
                f" {high[0]:g} to {high[1]:g} mm; measure the same box again"
            )
    first, second = (remainder(each, Unchanged(), ()) for each in (before, after))
    changes = tuple(
        Change(was.name, was.unit, was.before, now.before, corrected=False)
        for was, now in zip(first.changes, second.changes, strict=True)
    )
    return Improvement(before, after, changes, second.rms_uncertainty)
