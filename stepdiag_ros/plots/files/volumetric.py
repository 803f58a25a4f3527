"""The picture of machines that step diagonals do not tell apart."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture


def examples_picture() -> "Picture":
    """Draw E_d beside the volumetric accuracy of RL's three machines."""
    from stepdiag_ros.plots.volumes import diagonals_alone

    return diagonals_alone()
