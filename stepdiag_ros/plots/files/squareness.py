"""The pictures of squareness from diagonals, by the names of their files."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture


def draw_squareness() -> "dict[str, Picture]":
    """Return all pictures by the name of their file without ending."""
    from stepdiag_ros.plots.angles import squareness_sensitivity

    return {"squareness_sensitivity": squareness_sensitivity()}
