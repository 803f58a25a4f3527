"""``stepdiag run``: a whole measurement on nodes of its own, in the simulated cell."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.commands.output import add_result_options, progress_bar, say

if TYPE_CHECKING:
    from stepdiag_ros.run.session import Told

DEFAULT_FOLDER = Path("stepdiag_results")


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "run",
        help="measure: start all nodes, execute a test plan, solve and show the result",
        description="Execute a test plan in the simulated cell: starts every node as a process of "
        "its own, runs the plan, records it into a bag, solves the bag and shows the "
        "result. Ctrl-C stops the machine and ends the run; what was measured stays in "
        "the bag.",
        epilog="example: stepdiag run --plan paper_like --factor 20",
    )
    add_run_options(parser, plan="demo", factor=1.0)
    parser.set_defaults(run=run)


def add_run_options(parser: argparse.ArgumentParser, plan: str, factor: float) -> None:
    """Add the options of a command that measures, with its defaults."""
    parser.add_argument("--plan", default=plan, help=f"YAML file, or a name (default: {plan})")
    parser.add_argument("--machine", default="demo", help="YAML file, or a name (default: demo)")
    parser.add_argument(
        "--cell", default="demo", help="simulated cell: YAML file, or a name (default: demo)"
    )
    parser.add_argument(
        "--factor",
        type=_factor,
        default=factor,
        help=f"simulated seconds in a real second (default: {factor:g})",
    )
    parser.add_argument(
        "--rate",
        type=float,
        default=0.0,
        help="readings in a simulated second (default: the cell's)",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the noise of the readings")
    add_result_options(parser, f"{DEFAULT_FOLDER}/RUN_results; the bag goes beside it")


def _factor(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no number") from None
    if not 0.001 <= value <= 1000.0:
        raise argparse.ArgumentTypeError(f"{text} is not between 0.001 and 1000")
    return value


def run(arguments: argparse.Namespace) -> int:
    """Measure, solve, show."""
    from stepdiag_ros import configuration
    from stepdiag_ros.commands import solve
    from stepdiag_ros.run.cell import simulated_cell
    from stepdiag_ros.run.session import Session

    # Refused here, before any process is started.
    plan = str(configuration.find(arguments.plan, "plans"))
    machine = str(configuration.find(arguments.machine, "machines"))
    cell = str(configuration.find(arguments.cell, "cells"))
    configuration.load_plan(plan)
    configuration.load_machine(machine)
    configuration.load_cell(cell)
    folder = (arguments.output or DEFAULT_FOLDER).resolve()
    nodes = simulated_cell(
        plan, machine, cell, folder, arguments.factor, arguments.rate, arguments.seed
    )
    with progress_bar("measuring") as progress:

        def tell(told: "Told") -> None:
            progress(told.done / told.total if told.total else 0.0, told.text)

        bag = Session(nodes, folder, tell).measure()
    say(f"recorded {bag}")
    shown = {**vars(arguments), "bag": bag, "output": None, "recorded_lines": False, "truth": None}
    return solve.run(argparse.Namespace(**shown))
