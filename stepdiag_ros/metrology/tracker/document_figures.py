"""Figures 4 and 5 of ATLI, computed; the document gives the errors, but not where things stood.

Its CMM is a gantry of 1400 x 700 x 600 mm, and the test runs along X. What the figures show settles
the rest:

Figure 4 (squareness 0.1° alone): the deviation grows faster than the length. An axis
that rotates about its own start changes no length for a tracker at that start, and next to nothing
for one behind it (D s/(D + s) · γ²/2 at a distance D, which grows more slowly than the length). It
does what the figure shows when the line runs *towards* the tracker: there the path misses the
tracker by more and more while the distance that is left shrinks,

    |D x̂ - s u| - (D - s) ≈ D s / (D - s) · γ²/2.

Figure 5 (squareness 0.2°, positioning 0.03 mm/m): first falling, then rising, from -20 to -34 µm.
The line runs away from the tracker, and the tracker is not where eq. 1 put it, because the places
that it was located from were reached by the erroneous machine. With ε the shift, ε⊥ its part across
the line, and e0 the error of L0, the reading counted from L0 departs from the ideal length s by

    ε·u + e0 + g s + |ε⊥|² / (2 s):      an offset, a rise with s, and a part that fades.

The minimum is at s = |ε⊥|/√(2 g). A line from s = 0.1 m to 1.0 m whose ends lie 14 µm above its
minimum needs that at 0.32 m, so |ε⊥| = 2.4 mm: 0.2° over 0.7 m, the middle of the X travel as seen
from the tracker. Places that are mostly in the tracker's own XZ plane turn its estimate with them
by just that; which six are taken decides the offset, from -1 mm to +1 mm. Those below give the
printed range. They are found, not derived: others do as well.

The document wonders at the offset, because "the estimated accuracy was only 13 µm". What
six places show of their own accuracy is the size of the residuals that one or two redundant
readings leave; here that is of the same order, and it says nothing of the 2 mm by which the tracker
is misplaced, nearly all of which the fit absorbs. The offset itself is harmless: every parameter of
ISO 230-2 and -6 is a difference of deviations. The shape is not: a compensation table made of it
would bend a straight scale. (The range of the curve, 14 µm, is its E: that may be meant by 13 µm,
too.)
"""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.tracker.lengths import AxisErrors, length_deviations, lengths
from stepdiag_ros.metrology.tracker.location import Location, locate

LINE_STEPS = 91


@dataclass(frozen=True)
class FigureCurve:
    """One curve of a figure.

    Attributes:
        label: what it shows, in words.
        distance: along the line from its start, m, shape (n,).
        deviation: of the length from the ideal one, m, shape (n,).
    """

    label: str
    distance: Vector
    deviation: Vector


@dataclass(frozen=True)
class FigureFour:
    """ATLI Fig. 4: squareness alone.

    Attributes:
        gamma: squareness of X to Y, rad.
        distance: from the line's start to the tracker, m.
        towards: the line runs towards the tracker, as in the figure.
        away: the same line with the tracker as far behind its start, for comparison.
    """

    gamma: float
    distance: float
    towards: FigureCurve
    away: FigureCurve


@dataclass(frozen=True)
class FigureFive:
    """ATLI Fig. 5: squareness and positioning, the tracker located by the erroneous machine.

    Attributes:
        errors: of the X axis.
        station: where the tracker is, m, shape (3,).
        places: commanded, from which it was located, m, shape (6, 3).
        location: what eq. 1 and the refinement made of them.
        shift: from the estimated to the actual place, m, shape (3,).
        located: the curve with the tracker where it was estimated.
        true_place: the same line, calculated from the tracker's true place.
    """

    errors: AxisErrors
    station: Vector
    places: Vector
    location: Location
    shift: Vector
    located: FigureCurve
    true_place: FigureCurve


def figure_four(
    gamma: float = np.radians(0.1), line_length: float = 1.4, distance: float = 1.6
) -> FigureFour:
    """Return the curves of ATLI Fig. 4; see the module for the geometry.

    Args:
        gamma: squareness of X to Y, rad; the document has 0.1°.
        line_length: m; the X travel of the document's machine.
        distance: of the tracker from the line's start, ahead of its end, m.

    Raises:
        ValueError: the line would run through the tracker.
    """
    if not 0.0 < line_length < distance:
        raise Refusal(
            "the line must end before the tracker", fault="out_of_range", aspect="tracker"
        )
    ways = np.linspace(0.0, line_length, LINE_STEPS)
    commanded = ways[:, None] * np.array([1.0, 0.0, 0.0])
    reached = AxisErrors(axis=0, gamma=gamma).reached(np.zeros(3), ways)
    curves = [
        FigureCurve(
            label,
            ways,
            length_deviations(commanded, reached, np.array([sign * distance, 0.0, 0.0])),
        )
        for label, sign in (
            ("line runs towards the tracker", 1.0),
            ("line runs away from the tracker", -1.0),
        )
    ]
    return FigureFour(gamma, distance, curves[0], curves[1])


FIVE_STATION = (-0.1, 0.35, 0.3)
"""Before the X travel, at the middle of Y and Z, m."""
FIVE_PLACES = (
    (1.4, 0.35, 0.3),
    (1.05, 0.35, 0.3),
    (0.7, 0.35, 0.0),
    (0.7, 0.7, 0.0),
    (0.35, 0.0, 0.0),
    (0.35, 0.0, 0.3),
)
"""Six places of the document's machine from which the tracker is located, m."""


def figure_five(
    scale: float = 30e-6, gamma: float = np.radians(0.2), line_length: float = 0.9
) -> FigureFive:
    """Return the curves of ATLI Fig. 5; see the module for the geometry.

    Args:
        scale: positioning error of X per length; the document has 0.03 mm/m.
        gamma: squareness of X to Y, rad; the document has 0.2°.
        line_length: of the test line along +X, which begins 0.1 m from the tracker, m.

    Raises:
        ValueError: the line has no length.
    """
    if line_length <= 0:
        raise ValueError("the test line needs a length")
    errors = AxisErrors(axis=0, scale=scale, gamma=gamma)
    station, places = np.array(FIVE_STATION), np.array(FIVE_PLACES)
    seen = lengths(_on_the_machine(places, errors), station)
    location = locate(places, seen - seen[0])
    begin = -station[0]
    ways = np.linspace(begin, begin + line_length, LINE_STEPS)
    curves = []
    for label, place, start in (
        ("calculated from the located tracker", location.position, location.start_length),
        ("calculated from the tracker's true place", station, float(seen[0])),
    ):
        line = place + ways[:, None] * np.array([1.0, 0.0, 0.0])
        changes = lengths(_on_the_machine(line, errors), station) - seen[0]
        curves.append(FigureCurve(label, ways, changes + start - ways))
    return FigureFive(
        errors, station, places, location, station - location.position, curves[0], curves[1]
    )


def _on_the_machine(points: Vector, errors: AxisErrors) -> Vector:
    """Return where a machine arrives whose X axis alone has errors, zero at X = 0, m, (n, 3)."""
    reached = errors.reached(np.zeros(3), points[:, 0])
    reached[:, 1:] += points[:, 1:]
    return reached
