"""What remains of a machine's errors after compensation, computed from the files as written.

The control sends the axes from a target w to s(w); the tool is then at s + e(s), so what remains is
s(w) + e(s(w)) - w, with the reversal error of each axis added on the way forward and taken off on
the way back. Everything is counted from the first corner of the box, as the errors are: a constant
shift of the whole volume is not an error. No new measurement is in it: the figures say what the
table does to the errors that were found, not how well they were found.
"""

from dataclasses import dataclass
from math import nan

import numpy as np

from stepdiag_ros.compensation.applied import Applied
from stepdiag_ros.compensation.identified import Identified
from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES
from stepdiag_ros.metrology.geometry import AXES, TRANSLATIONS, Vector, moving_axis
from stepdiag_ros.metrology.target_correction import held_errors
from stepdiag_ros.metrology.uncertainty.longest_vector import spread_after_correction

BETWEEN = 4
"""Places between two nodes that are looked at along an axis."""
MOST_PLACES = 30_000
"""Of the volume; a box of more nodes is looked at in every second node, or every third …"""
MOST_WITH_UNCERTAINTY = 1000
"""Places of the volume whose uncertainty is computed, evenly spread."""


@dataclass(frozen=True)
class AxisRemainder:
    """Errors along one axis, the others at the first corner, before and after.

    Attributes:
        axis: 0, 1, 2.
        positions: m, shape (n,).
        before: error vectors on the way forward and backward, m, shape (2, n, 3).
        after: the same with the compensation, m, shape (2, n, 3).
    """

    axis: int
    positions: Vector
    before: Vector
    after: Vector


@dataclass(frozen=True)
class BeforeAndAfter:
    """One figure before and after.

    Attributes:
        name: for example ``positioning E_XX``.
        unit: ``m`` or ``rad``.
        before: NaN where not known.
        after: NaN where not known.
        corrected: the control has a table for it.
    """

    name: str
    unit: str
    before: float
    after: float
    corrected: bool

    @property
    def factor(self) -> float:
        """Return how many times smaller it is; NaN where not known or nothing was there."""
        if not self.before > 0.0:
            return nan
        return self.before / self.after if self.after > 0.0 else float("inf")


@dataclass(frozen=True)
class Remainder:
    """What remains.

    Attributes:
        axes: along X, Y, Z.
        changes: of the nine translations, of squareness, and of the volume (rms and largest).
        places: how many places of the volume were looked at.
        known: how many of them have a known error.
        rms_uncertainty: rms over the volume of the standard uncertainty of the error vectors, m:
            below this no error can be compensated; NaN where not known.
        largest_uncertainty: standard uncertainty of the longest error vector that is left where all
            known errors are corrected (``longest_vector``), m; NaN where not known.
    """

    axes: tuple[AxisRemainder, AxisRemainder, AxisRemainder]
    changes: tuple[BeforeAndAfter, ...]
    places: int
    known: int
    rms_uncertainty: float
    largest_uncertainty: float = nan

    def change(self, name: str) -> BeforeAndAfter:
        """Return the figure of that name.

        Raises:
            KeyError: the name is unknown.
        """
        for one in self.changes:
            if one.name == name:
                return one
        raise KeyError(f"there is no figure '{name}'")


def remainder(identified: Identified, applied: Applied, corrects: tuple[str, ...]) -> Remainder:
    """Return what remains of the identified errors with a compensation.

    Args:
        identified: the errors.
        applied: the compensation, as read back from its files.
        corrects: the translations that the control has tables for.
    """
    axes = tuple(_along(identified, applied, axis) for axis in range(3))
    changes: list[BeforeAndAfter] = []
    for name in TRANSLATIONS:
        axis, error = moving_axis(name), AXES.index(name[2])
        one = axes[axis]
        kind = "positioning" if axis == error else "straightness"
        before, after = (
            _span(part[..., error], one.positions, kind == "straightness")
            for part in (one.before, one.after)
        )
        changes.append(BeforeAndAfter(f"{kind} {name}", "m", before, after, name in corrects))
    for name, (factor, pair) in SQUARENESS_SLOPES.items():
        before, after = (
            abs(factor * sum(_slope(axes[moving_axis(curve)], curve, when) for curve in pair))
            for when in (0, 1)
        )
        told = all(curve in corrects for curve in pair)
        changes.append(BeforeAndAfter(f"squareness {name}", "rad", before, after, told))
    places = identified.error_map.some_nodes(MOST_PLACES)
    bare = np.stack([_errors(identified, places, places, forward) for forward in (True, False)])
    left = np.stack(
        [
            _errors(identified, places, applied.sent(places, forward), forward)
            for forward in (True, False)
        ]
    )
    every = len(corrects) == len(TRANSLATIONS)
    for words, take in (("rms", _rms), ("largest", _largest)):
        changes.append(BeforeAndAfter(f"volume, {words}", "m", take(bare), take(left), every))
    some = places[:: -(-len(places) // MOST_WITH_UNCERTAINTY)]
    spread = identified.error_map.standard_uncertainty_at(some)
    return Remainder(
        axes=(axes[0], axes[1], axes[2]),
        changes=tuple(changes),
        places=len(places),
        known=int(np.count_nonzero(np.all(np.isfinite(bare[0]), axis=1))),
        rms_uncertainty=_rms(spread[None]),
        largest_uncertainty=spread_after_correction(identified.error_map),
    )


def _errors(identified: Identified, wanted: Vector, sent: Vector, forward: bool) -> Vector:
    """Return s + e(s) - w with the reversal error, m, shape (n, 3)."""
    vectors = sent + held_errors(identified.error_map, sent) - wanted
    for axis in range(3):
        half = identified.half_reversal(axis, sent[:, axis])
        vectors[:, axis] += half if forward else -half
    return vectors


def _along(identified: Identified, applied: Applied, axis: int) -> AxisRemainder:
    error_map = identified.error_map
    nodes = error_map.nodes[axis]
    count = (len(nodes) - 1) * (BETWEEN + 1) + 1
    positions = np.interp(
        np.arange(count) / (BETWEEN + 1.0), np.arange(len(nodes), dtype=np.float64), nodes
    )
    places = np.tile(error_map.low, (count, 1))
    places[:, axis] = positions
    before = [_errors(identified, places, places, forward) for forward in (True, False)]
    after = [
        _errors(identified, places, applied.sent(places, forward), forward)
        for forward in (True, False)
    ]
    return AxisRemainder(axis, positions, _from_corner(before), _from_corner(after))


def _from_corner(both: list[Vector]) -> Vector:
    """Return errors counted from the first place, mean of both directions."""
    stacked = np.stack(both)
    counted: Vector = stacked - np.mean(stacked[:, :1], axis=0, keepdims=True)
    return counted


def _span(both: Vector, positions: Vector, straight: bool) -> float:
    """Return the range of both directions together; of a straightness, their mean off its line."""
    values = both
    if straight:
        # The axis that is looked at stands; from which side it came there is another matter.
        values = np.mean(both, axis=0)
        if np.all(np.isfinite(values)):
            # The line is that of the nodes (Ibaraki & Hata 2010, section 4.1).
            every = BETWEEN + 1
            line = np.polyfit(positions[::every], values[::every], 1)
            values = values - np.polyval(line, positions)
    return float(np.max(values) - np.min(values))


def _slope(axis: AxisRemainder, curve: str, when: int) -> float:
    """Return the mean slope of a curve before (0) or after (1), rad; NaN where not known."""
    values = np.mean((axis.before, axis.after)[when][..., AXES.index(curve[2])], axis=0)
    nodes = axis.positions[:: BETWEEN + 1]
    centred = nodes - np.mean(nodes)
    return float(centred @ values[:: BETWEEN + 1] / (centred @ centred))


def _rms(vectors: Vector) -> float:
    """Return the rms length of vectors that are known, less the first corner's; (m, n, 3)."""
    lengths = _lengths(vectors)
    return float(np.sqrt(np.mean(lengths**2))) if lengths.size else nan


def _largest(vectors: Vector) -> float:
    lengths = _lengths(vectors)
    return float(np.max(lengths)) if lengths.size else nan


def _lengths(vectors: Vector) -> Vector:
    corner = np.mean(vectors[:, :1], axis=0, keepdims=True)
    counted = vectors - np.where(np.isfinite(corner), corner, 0.0)
    lengths: Vector = np.linalg.norm(counted, axis=2).ravel()
    return lengths[np.isfinite(lengths)]


COMPUTED = (
    "Before and after are computed from the files as written, with their rounding and spacing, for"
    " the errors that were found, both directions of approach; only a new measurement is a proof."
)
