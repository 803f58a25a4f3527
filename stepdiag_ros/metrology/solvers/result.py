"""The one result type of all solvers."""

from dataclasses import dataclass, field

import numpy as np

from stepdiag_ros.metrology.curve_set import CurveSet
from stepdiag_ros.metrology.geometry import FRAME, Vector
from stepdiag_ros.metrology.refusal import Refusal


class NotDeterminable(Refusal):
    """These lines are not enough for this method; the text says what is missing."""


@dataclass(frozen=True)
class Figure:
    """A single figure of a result.

    Attributes:
        name: for example ``C0Y``, ``straightness E_YX``, ``positioning E_XX``, ``tilt ppp XYZ 1``.
        value: in the unit; NaN if not determined.
        standard_uncertainty: in the unit; NaN if not known.
        unit: ``m`` or ``rad``.
    """

    name: str
    value: float
    standard_uncertainty: float
    unit: str


@dataclass(frozen=True)
class VolumetricErrors(CurveSet):
    """Error curves with their uncertainty, and what follows from them.

    Each curve has N + 1 nodes and is zero at the first. A method holds the curves that it estimates
    in the order of ``geometry.CURVES``: the nine translations, all eighteen, or some.

    Attributes:
        method: name of the solver.
        standard_uncertainty: ISO 230-1 name → standard uncertainties, m or rad, same names and
            shape; NaN where not known.
        figures: squareness, straightness, positioning, setup errors.
        lines: number of lines used.
        chi_squared: of the fit; NaN where the method leaves no degrees of freedom.
        degrees_of_freedom: of the fit.
        not_determined: what these lines do not determine, in words.
        remarks: for the reader, in words.
        covariance: of all curves stacked in the order of ``curves``, in the products of their
            units, shape (c(N+1), c(N+1)) for c curves; NaN rows and columns where not determined.
        frame: of the results, in words.
        readings_covariance: the part of ``covariance`` by the readings' noise alone, which scatters
            from one measurement of the same machine to the next; the rest stays the same.
        turned_factor: what rotations, where they are not among ``curves`` but are known to be so
            large, do to the errors of all eighteen curves stacked in the order of
            ``geometry.CURVES``: the effects of independent causes of standard deviation 1, m and
            rad, shape (18(N+1), q). Its product with its transpose holds the rotations' second
            moments, and how they go with the errors of the curves. Empty if not known.
    """

    method: str
    standard_uncertainty: dict[str, Vector]
    figures: tuple[Figure, ...]
    lines: int
    chi_squared: float
    degrees_of_freedom: int
    not_determined: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    covariance: Vector = field(default_factory=lambda: np.empty((0, 0)), repr=False, compare=False)
    frame: str = FRAME
    readings_covariance: Vector = field(
        default_factory=lambda: np.empty((0, 0)), repr=False, compare=False
    )
    turned_factor: Vector = field(
        default_factory=lambda: np.empty((0, 0)), repr=False, compare=False
    )

    def figure(self, name: str) -> Figure:
        """Return the figure of that name.

        Raises:
            KeyError: the result has no such figure.
        """
        for figure in self.figures:
            if figure.name == name:
                return figure
        raise KeyError(f"the {self.method} result has no figure '{name}'")
