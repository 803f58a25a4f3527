"""``stepdiag compare``: a result beside errors that were measured directly."""

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.commands.arguments import (
    Command,
    Group,
    add_bag,
    add_common,
    picture_formats,
    results_folder,
)
from stepdiag_ros.commands.output import add_result_options, progress_bar, say

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

_FORM = """\
the table of direct measurements is CSV in SI units; # begins a note:
  name                  a curve (E_XX ... E_CZ) or a squareness (C0Y, B0Z, A0Z)
  position_m            of the moving axis; empty for a squareness
  repeat                from 0; may be left out
  value                 m, or rad for angles and squareness
  standard_uncertainty  of the artefact, without repeatability; empty if unknown
  definition            of a squareness: rotation (right-handed, ISO 230-1) or
                        angle (positive where the angle between the positive
                        axes is larger than 90 degrees)
  x_m y_m z_m, reflector_x_m reflector_y_m reflector_z_m
                        where a straightness was measured, for 'solve --direct'
                        (docs/direct.md); not used here
a straightness may have any zero and slope: deviations from least-squares lines
are compared.

examples:
  stepdiag compare run.mcap --measured artefact.csv         tables, pictures
  stepdiag compare run.mcap --measured artefact.csv --json  the same as JSON
  stepdiag run --plan ibaraki_hata_2010 --cell ibaraki_hata_2010 --factor 60
                                                            a bag to try it on"""


def _add_options(parser: ArgumentParser) -> None:
    add_bag(parser)
    add_common(parser, "run")
    parser.add_argument(
        "--measured",
        type=Path,
        metavar="FILE",
        required=True,
        help="table of direct measurements (.csv), see below",
    )
    add_result_options(parser, "NAME_comparison beside the bag")


def run(arguments: Namespace) -> int:
    """Compare; see the module."""
    from stepdiag_ros.commands.solve import report_of
    from stepdiag_ros.configuration import read_text
    from stepdiag_ros.evaluation.experiment import experiment_of
    from stepdiag_ros.metrology.direct_reading import read_direct
    from stepdiag_ros.report.documents.experiment import experiment_json
    from stepdiag_ros.report.publish import experiment_texts, write_results
    from stepdiag_ros.report.tables.experiment import print_experiment
    from stepdiag_ros.text.console import make_console

    direct = read_direct(read_text(arguments.measured), str(arguments.measured))
    report = report_of(arguments.bag, run_id=arguments.run_id)
    try:
        experiment = experiment_of(report, direct)
    except ValueError as error:
        raise ValueError(f"{arguments.measured}: {error}") from None
    if experiment is None:
        reason = report.refused.get("setup_robust", "not all nine curves are determined")
        raise ValueError(f"{arguments.bag}: no result to compare with: {reason}")

    def draw() -> "dict[str, Picture]":
        from stepdiag_ros.plots.files.experiment import draw_experiment

        return draw_experiment(experiment)

    folder = arguments.output or results_folder(arguments.bag, "comparison")
    formats = picture_formats(arguments)
    with progress_bar("writing results") as progress:
        files = write_results(folder, experiment_texts(experiment), draw, formats, progress)
    if arguments.json:
        print(experiment_json(experiment))
    else:
        print_experiment(experiment, make_console(sys.stdout), arguments.squareness_sign)
    say(f"results in {folder}: {', '.join(path.name for path in files)}")
    return 0


COMMAND = Command(
    "compare",
    Group.UNDERSTAND,
    70,
    _add_options,
    run,
    help="compare a result with directly measured errors",
    description="Compare the errors identified from a bag with errors measured directly with"
    " an artefact or another instrument: Table 1 and Figures 7 to 10 of Ibaraki and Hata"
    " (2010), differences and normalised errors E_n, with pictures.",
    epilog=_FORM,
)
