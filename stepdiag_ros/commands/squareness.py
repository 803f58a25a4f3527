"""``stepdiag squareness``: squareness of the axes from face and body diagonals."""

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.commands.arguments import Command, Group, add_bag, add_common, results_folder
from stepdiag_ros.commands.output import progress_bar, warn_of_flaws
from stepdiag_ros.commands.standard_tests import (
    add_output_options,
    is_bag,
    refuse_for_table,
    show,
)

if TYPE_CHECKING:
    from stepdiag_ros.evaluation.squareness import SquarenessReport

_FORM = """\
a table is CSV, one row a diagonal; a single reading at each end is enough:
  diagonal                                 ppp npp pnp ppn, or pp0 np0 p0p n0p 0pp 0np
  start_x_mm start_y_mm start_z_mm         coordinates of its start
  finish_x_mm finish_y_mm finish_z_mm      and of its end
  length_mm                                measured length
  uncertainty_um                           its standard uncertainty, if known
  same_approach                            yes if both ends were read after a move in the same
                                           direction, no if not; empty if not known

the diagonals must start and finish at identical coordinates; the command refuses others.

examples:
  stepdiag squareness run.mcap         every pair of diagonals in the bag
  stepdiag squareness diagonals.csv    lengths measured by hand"""


def _add_options(parser: ArgumentParser) -> None:
    add_bag(parser, "a bag (.mcap), or a table (.csv)")
    add_common(parser, "run")
    add_output_options(parser, "NAME_squareness beside the source")


def run(arguments: Namespace) -> int:
    """Evaluate; see the module."""
    from stepdiag_ros.plots.files.squareness import draw_squareness
    from stepdiag_ros.report.documents.squareness import squareness_json
    from stepdiag_ros.report.tables.diagonal_squareness import print_squareness

    refuse_for_table(arguments.bag, {"--run": arguments.run_id})
    report = report_of(arguments.bag, arguments.run_id)
    return show(
        "squareness",
        squareness_json(report),
        lambda console: print_squareness(report, console),
        draw_squareness,
        arguments,
        results_folder(arguments.bag, "squareness"),
        ("squareness_sensitivity",),
    )


def report_of(source: Path, run_id: str | None = None) -> "SquarenessReport":
    """Evaluate the diagonals in a bag or a table.

    Args:
        source: the file.
        run_id: which run, where a bag holds several.

    Raises:
        ValueError: the file cannot be read, or its diagonals determine no squareness; one sentence.
    """
    from stepdiag_ros.evaluation.squareness import SquarenessReport
    from stepdiag_ros.metrology.standards.axis_test import all_runs
    from stepdiag_ros.metrology.standards.diagonal_squareness import squareness_from, squareness_of
    from stepdiag_ros.metrology.standards.iso230_2 import evaluate
    from stepdiag_ros.metrology.standards.iso230_6 import volumetric_warning

    if not is_bag(source):
        from stepdiag_ros.bags.diagonal_table import read_diagonal_table

        result = squareness_from(read_diagonal_table(source))
        return SquarenessReport(result, str(source), volumetric_warning(()))
    from stepdiag_ros.bags.run import load_run
    from stepdiag_ros.evaluation.recorded_run import require_standing_beam

    with progress_bar(f"reading {source.name}"):
        recorded = load_run(source, run_id)
    warn_of_flaws(recorded)
    require_standing_beam(recorded)
    measurement = recorded.measurement
    tests = [evaluate(runs) for runs in all_runs(measurement)]
    result = squareness_of(measurement)
    return SquarenessReport(result, str(source), volumetric_warning(tests))


COMMAND = Command(
    "squareness",
    Group.UNDERSTAND,
    40,
    _add_options,
    run,
    help="squareness of the axes from face and body diagonals",
    description="Compute the squareness of the axes from the lengths of diagonals (ISO"
    " 230-1:2012, 10.3.2.6), in both sign definitions and with its uncertainty: two diagonals of"
    " a face determine one angle, four body diagonals all three, and linear tests add one check."
    " The output shows how much a shift of the laser's reading would falsify the result.",
    epilog=_FORM,
)
