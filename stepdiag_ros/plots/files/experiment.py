"""The figures of Ibaraki & Hata 2010 and of KIMM for a measurement, by the names of their files."""

from typing import TYPE_CHECKING

from stepdiag_ros.evaluation.experiment import Experiment
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.plots.experiment import (
    FIGURE_OF_AXIS,
    angles_with_repeats,
    direct_comparison,
    motion_with_repeats,
)
from stepdiag_ros.plots.lines import line_errors
from stepdiag_ros.plots.stamps import stamp

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture


def draw_experiment(experiment: Experiment) -> "dict[str, Picture]":
    """Return the pictures by the name of their file without ending."""
    pictures: dict[str, Picture] = {}
    said = stamp(run_id=experiment.report.run_id, plan=experiment.report.plan)
    if experiment.repeats:
        for letter in AXES:
            name = f"figure_{FIGURE_OF_AXIS[letter]}_motion_of_{letter.lower()}"
            pictures[name] = motion_with_repeats(experiment, letter, stamp=said)
        angles = angles_with_repeats(experiment, stamp=said)
        if angles is not None:
            pictures["figure_10_angles"] = angles
        pictures["line_errors"] = line_errors(experiment.measurement, stamp=said)
    chosen = experiment.comparison_to_draw()
    if chosen is not None:
        pictures["direct_comparison"] = direct_comparison(chosen, stamp=said)
    return pictures
