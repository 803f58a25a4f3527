"""The pictures of a diagnosis, by the names of their files."""

from typing import TYPE_CHECKING

from stepdiag_ros.evaluation.diagnosis import DiagnosisReport
from stepdiag_ros.plots.curves import curves_before_after
from stepdiag_ros.plots.dependences import gap_dependences
from stepdiag_ros.plots.discrepancy import (
    gap_along_lines,
    gap_candidates,
    gap_map,
    gap_where,
    held_out,
)
from stepdiag_ros.plots.stamps import stamp

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture


def draw_diagnosis(report: DiagnosisReport) -> "dict[str, Picture]":
    """Draw all pictures that the diagnosis has something for, by the names of their files."""
    diagnosis, said = report.diagnosis, stamp(run_id=report.run_id)
    proof, curves = report.held_out, report.curves
    drawn = {
        "gap_map": gap_map(diagnosis, stamp=said),
        "gap_where": gap_where(diagnosis, stamp=said),
        "dependences": gap_dependences(diagnosis, stamp=said),
        "candidates": gap_candidates(diagnosis, stamp=said),
        "gap_traces": gap_along_lines(diagnosis, stamp=said),
        "held_out": None if proof is None else held_out(proof, stamp=said),
        "curves": None if curves is None else curves_before_after(*curves, stamp=said),
    }
    return {name: picture for name, picture in drawn.items() if picture is not None}
