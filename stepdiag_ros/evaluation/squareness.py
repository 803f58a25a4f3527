"""Squareness from diagonals, and what it was made of."""

from dataclasses import dataclass

from stepdiag_ros.metrology.standards.diagonal_squareness import SquarenessResult


@dataclass(frozen=True)
class SquarenessReport:
    """What is shown of the squareness from diagonals of one source.

    Attributes:
        result: of ``metrology.standards.diagonal_squareness``.
        source: file that the data came from.
        warning: that diagonals alone are not volumetric accuracy, with what is missing.
    """

    result: SquarenessResult
    source: str
    warning: str
