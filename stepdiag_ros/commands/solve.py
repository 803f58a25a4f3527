"""``stepdiag solve``: from a bag to volumetric errors, without any node."""

import sys
from argparse import ArgumentParser, Namespace
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.commands.air import add_air_options, air_choice
from stepdiag_ros.commands.arguments import (
    Command,
    Group,
    add_bag,
    add_common,
    picture_formats,
    results_folder,
)
from stepdiag_ros.commands.corrections import add_correction_options, corrected
from stepdiag_ros.commands.direct_files import add_direct_option, direct_measurement
from stepdiag_ros.commands.output import (
    add_result_options,
    methods_help,
    progress_bar,
    show_report,
    warn,
)

FREE = "free"
"""Model of ``stepdiag run`` that is no more than what is solved: all error curves free."""

if TYPE_CHECKING:
    from stepdiag_ros.bags.run import RecordedRun
    from stepdiag_ros.evaluation.report import Report


def _add_options(parser: ArgumentParser) -> None:
    add_bag(parser, "a bag (.mcap), or a folder of 'ros2 bag record'")
    add_common(parser, "run")
    parser.add_argument(
        "--recorded-lines",
        action="store_true",
        help="solve from the lines as recorded, do not assemble them again from the readings",
    )
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="FILE",
        help="compare with known error curves: YAML with E_XX ... E_ZZ, one value in m for each"
        " node; not needed for a simulated cell, whose true errors are in the bag",
    )
    parser.add_argument(
        "--visibility",
        action="store_true",
        help="show for each of the 21 errors whether these lines determine it, what it is"
        " confounded with, and its expected uncertainty",
    )
    add_direct_option(parser)
    parser.add_argument(
        "--rotations",
        type=rotation_size,
        metavar="SIZE",
        help="plausible size of the angular errors over the measured travel, in all uncertainties"
        " where the lines do not determine them: rad, or precision, machining_centre, large_machine"
        " (default: as in the machine file, else machining_centre, 10e-6)",
    )
    add_air_options(parser)
    add_correction_options(parser)
    add_result_options(parser, "NAME_results beside the bag")
    add_common(parser, "details")


def rotation_size(text: str) -> float:
    """Return a plausible size of rotations from the command line, rad."""
    from argparse import ArgumentTypeError

    from stepdiag_ros.metrology.plausible import size_of

    try:
        return size_of(text)
    except ValueError as wrong:
        raise ArgumentTypeError(str(wrong)) from None


def run(arguments: Namespace) -> int:
    """Solve the bag; see the module."""
    from stepdiag_ros.evaluation.recorded_run import judged
    from stepdiag_ros.report.beside import process_beside, result_of
    from stepdiag_ros.report.publish import drawn_pictures, get_ready_to_draw

    folder = results_folder(arguments.bag)
    formats, details = picture_formats(arguments), arguments.details or arguments.visibility
    with ExitStack() as stack:
        pool = None
        # Drawing is got ready while the bag is read, unless this process can draw already.
        if formats and arguments.bag.exists() and "matplotlib.figure" not in sys.modules:
            pool = stack.enter_context(process_beside(get_ready_to_draw))
        recorded, report = _solved(arguments)
        if report is None:
            from stepdiag_ros.commands.tracker_evaluate import show_run

            return show_run(recorded, arguments, folder)
        pictures = None
        if pool is not None:
            sign = arguments.squareness_sign
            pictures = partial(
                result_of, pool.submit(drawn_pictures, report, formats, sign, details)
            )
        report = _with_model_named(judged(report), arguments)
        return show_report(report, arguments, folder, details, pictures)


def _solved(arguments: Namespace) -> "tuple[RecordedRun, Report | None]":
    """Return the run and its report without a verdict; None for one with a tracker."""
    from stepdiag_ros.bags.run import load_run
    from stepdiag_ros.evaluation.budget import with_budget
    from stepdiag_ros.evaluation.recorded_run import report_of_run
    from stepdiag_ros.metrology.solvers.limits import BUDGET, DIAGNOSIS

    with progress_bar(f"reading {arguments.bag.name}") as progress:
        recorded = load_run(arguments.bag, arguments.run_id)
        if recorded.plan.tracker is not None:
            return recorded, None
        report = report_of_run(
            recorded,
            progress,
            arguments.recorded_lines,
            arguments.truth,
            lambda measurement: corrected(measurement, arguments),
            arguments.visibility,
            air_choice(arguments),
            warn,
            direct=direct_measurement(arguments),
            rotation=arguments.rotations,
            further=(BUDGET, DIAGNOSIS),
        )
        expansion = nan if arguments.expansion is None else arguments.expansion
        return recorded, with_budget(report, expansion, arguments.material_temperature)


def _with_model_named(report: "Report", arguments: Namespace) -> "Report":
    """Say that the verdict on solved errors is without the model that a run was compared with.

    What is solved contains nothing but error curves (``evaluation.diagnosing.verdict_on``).
    """
    model = getattr(arguments, "model", FREE)
    if model == FREE or report.verdict is None:
        return report
    from stepdiag_ros.words.lead import from_here

    words = (
        f"{report.verdict.sentence} This verdict is without the model {model}, since the errors"
        f" below are; with it: 'stepdiag diagnose {from_here(arguments.bag)} --model {model}'."
    )
    return replace(report, verdict=replace(report.verdict, sentence=words))


def prepare() -> None:
    """Import what ``run`` needs and what takes long to import; harmless when called again."""
    import stepdiag_ros.bags.run
    import stepdiag_ros.evaluation.budget
    import stepdiag_ros.evaluation.recorded_run
    import stepdiag_ros.plots.files.run
    import stepdiag_ros.report.publish  # noqa: F401


def report_of(bag: Path, with_visibility: bool = False, run_id: str | None = None) -> "Report":
    """Solve a bag by every method.

    Args:
        bag: the file.
        with_visibility: state for each error whether these lines determine it.
        run_id: which run, where the bag holds several.

    Raises:
        ValueError: the bag cannot be read or solved; one sentence.
    """
    from stepdiag_ros.bags.run import load_run
    from stepdiag_ros.evaluation.recorded_run import report_of_run

    with progress_bar(f"reading {bag.name}") as progress:
        return report_of_run(
            load_run(bag, run_id),
            progress,
            with_visibility=with_visibility,
            warn=warn,
            with_verdict=True,
        )


COMMAND = Command(
    "solve",
    Group.UNDERSTAND,
    10,
    _add_options,
    run,
    help="compute the volumetric errors of a recorded measurement",
    description="Compute positioning, straightness and squareness errors of all axes from a bag,"
    " by every method that the measured lines suffice for. If the bag has the interferometer's"
    " readings, the command assembles the lines again from them, as in the live run, and compares"
    " the result with the recorded one bit for bit. It also diagnoses the lines: the summary"
    " begins with whether the run is complete, the verdict and what remains unknown.",
    epilog="examples:\n"
    "  stepdiag solve run.mcap                 tables here, pictures in run_results/\n"
    "  stepdiag solve run.mcap --json          the same as JSON\n"
    "  stepdiag solve run.mcap --pictures pdf  pictures for print\n"
    "  stepdiag solve run.mcap --visibility    what these lines show of each error\n"
    "  stepdiag solve run.mcap --expansion-per-K 11.5e-6   corrected to 20 °C\n"
    "  stepdiag solve run.mcap --air own --dead-path 0.35  compensated for the air again\n"
    "  stepdiag solve run.mcap --direct angles.csv             with angles measured directly",
    further_help=methods_help,
)
