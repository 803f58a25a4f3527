"""``stepdiag budget``: how well the result of a bag is known, and what that is made of."""

from argparse import ArgumentParser, Namespace
from dataclasses import replace
from functools import partial

from stepdiag_ros.commands.air import add_air_options, air_choice
from stepdiag_ros.commands.arguments import Command, Group, add_bag, add_common, results_folder
from stepdiag_ros.commands.corrections import add_correction_options, corrected
from stepdiag_ros.commands.direct_files import add_direct_option, direct_measurement
from stepdiag_ros.commands.output import methods_help, number, progress_bar, warn
from stepdiag_ros.commands.standard_tests import show


def _add_options(parser: ArgumentParser) -> None:
    add_bag(parser)
    add_common(parser, "run")
    parser.add_argument(
        "--instrument",
        metavar="NAME|FILE",
        help="instrument file, with the uncertainties of laser, sensors, material and setup: a"
        " YAML file, or a name in config/instruments such as demo (default: readings only)",
    )
    add_common(
        parser,
        "method",
        default="least_squares",
        help="method of the solver, see below (default: least_squares)",
    )
    parser.add_argument(
        "--coverage",
        type=partial(number, low=0.5, high=0.9999),
        default=0.95,
        metavar="P",
        help="probability of the expanded uncertainty (default: 0.95)",
    )
    parser.add_argument(
        "--monte-carlo",
        action="store_true",
        help="check the budget by the adaptive Monte Carlo method, and state where it is valid",
    )
    parser.add_argument(
        "--digits",
        type=int,
        choices=(1, 2),
        default=1,
        help="significant digits of u that Monte Carlo settles (default: 1)",
    )
    parser.add_argument(
        "--trials",
        type=partial(number, low=5e4, high=1e7),
        default=400_000.0,
        metavar="N",
        help="maximum number of trials of the Monte Carlo method (default: 400000)",
    )
    add_common(parser, "seed", help="seed of the Monte Carlo method (default: 0)")
    parser.add_argument(
        "--recorded-lines",
        action="store_true",
        help="take the lines as recorded, do not assemble them again from the readings",
    )
    add_direct_option(parser)
    add_air_options(parser)
    add_correction_options(parser)
    add_common(parser, "json", help="print JSON (SI units), not tables")
    add_common(
        parser,
        "output",
        help="folder for budget.json, budget.txt and pictures (default: NAME_results)",
    )
    add_common(parser, "pictures")


def run(arguments: Namespace) -> int:
    """Make and show the budget; see the module."""
    from stepdiag_ros.bags.run import load_run
    from stepdiag_ros.configuration import load_instrument
    from stepdiag_ros.evaluation.budget import BudgetReport
    from stepdiag_ros.evaluation.recorded_run import (
        direct_origin,
        measurement_of,
        require_standing_beam,
    )
    from stepdiag_ros.metrology.uncertainty.budget import make_budget
    from stepdiag_ros.metrology.uncertainty.instrument import Instrument
    from stepdiag_ros.metrology.uncertainty.monte_carlo import check_budget
    from stepdiag_ros.plots.files.budget import draw_budget
    from stepdiag_ros.report.documents.budget import budget_json
    from stepdiag_ros.report.tables.budget import print_budget

    instrument = Instrument()
    if arguments.instrument is not None:
        instrument = load_instrument(arguments.instrument)[0]
    with progress_bar(f"reading {arguments.bag.name}") as progress:
        recorded = load_run(arguments.bag, arguments.run_id)
        require_standing_beam(recorded)
        air = air_choice(arguments)
        measured, remark = measurement_of(recorded, arguments.recorded_lines, progress, air, warn)
    measurement, corrections = corrected(measured, arguments)
    measurement = replace(measurement, direct=direct_measurement(arguments))
    if not measurement.lines:
        raise ValueError(f"{arguments.bag}: no line was finished, so there is nothing to solve")
    budget = make_budget(
        measurement,
        instrument,
        arguments.method,
        arguments.coverage,
        float("nan") if arguments.expansion is None else arguments.expansion,
        arguments.material_temperature,
    )
    check = None
    if arguments.monte_carlo:
        with progress_bar("Monte Carlo") as progress:
            check = check_budget(
                budget, arguments.digits, int(arguments.trials), arguments.seed, progress
            )
    report = BudgetReport(
        budget,
        check,
        recorded.run_id,
        recorded.path,
        (remark, *corrections, *direct_origin(measurement.direct)),
    )
    return show(
        "budget",
        budget_json(report),
        partial(print_budget, report),
        partial(draw_budget, report),
        arguments,
        results_folder(arguments.bag),
        ("budget", "budget_curves"),
    )


COMMAND = Command(
    "budget",
    Group.UNDERSTAND,
    60,
    _add_options,
    run,
    help="uncertainty budget by source, checked by Monte Carlo",
    description="List the uncertainty contributions to every result of a bag (squareness,"
    " positioning, straightness, the curves at every node) by source: laser, air, dead path,"
    " material, setup, repeatability, drift. The contributions are combined by the GUM with all"
    " correlations and, on request, checked by a Monte Carlo run of the solver over all sources"
    " (JCGM 101). A source that the instrument file does not state is unknown, and the total is"
    " then a lower bound.",
    epilog="examples:\n"
    "  stepdiag budget run.mcap                        from the readings alone\n"
    "  stepdiag budget run.mcap --instrument demo      with config/instruments/demo.yaml\n"
    "  stepdiag budget run.mcap --instrument my.yaml --monte-carlo\n"
    "  stepdiag budget run.mcap --instrument demo --expansion-per-K 11.5e-6 --json",
    further_help=partial(methods_help, replicable=True),
)
