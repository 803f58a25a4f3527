"""``stepdiag run``: a whole measurement on nodes of its own, in the simulated cell."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.commands.air import AS_MEASURED
from stepdiag_ros.commands.arguments import RESULTS, Command, Group, add_common
from stepdiag_ros.commands.output import (
    add_result_options,
    number,
    progress_bar,
    say,
    warn,
    warn_of_undetermined,
)
from stepdiag_ros.commands.until import RunTeller, add_until, until_of
from stepdiag_ros.parameters.devices import HIGHEST_SAMPLE_RATE

if TYPE_CHECKING:
    from stepdiag_ros.processes.following import RunNews
    from stepdiag_ros.processes.node_process import NodeProcess


def _add_options(parser: argparse.ArgumentParser) -> None:
    add_run_options(parser, plan="demo", factor=1.0)


def add_run_options(parser: argparse.ArgumentParser, plan: str, factor: float) -> None:
    """Add the options of a command that measures in the simulated cell, with its defaults."""
    add_cell_options(parser, plan, factor)
    add_until(parser)
    add_result_options(
        parser,
        str(RESULTS),
        "the bag RUN.mcap and, in RUN_results inside it, pictures, results.json and report.txt",
    )
    add_common(parser, "details")


def add_cell_options(parser: argparse.ArgumentParser, plan: str, factor: float) -> None:
    """Add the options that describe a simulated cell, with their defaults."""
    parser.add_argument("--plan", default=plan, help=f"YAML file, or a name (default: {plan})")
    parser.add_argument("--machine", default="demo", help="YAML file, or a name (default: demo)")
    parser.add_argument(
        "--cell", default="demo", help="simulated cell: YAML file, or a name (default: demo)"
    )
    parser.add_argument(
        "--model",
        default="free",
        help="model of the machine to compare with the run: YAML file, or a name (default: free,"
        " all error curves free and no further effects)",
    )
    parser.add_argument(
        "--factor",
        type=_factor,
        default=factor,
        help=f"simulated seconds in a real second (default: {factor:g})",
    )
    parser.add_argument(
        "--rate",
        type=_reading_rate,
        default=0.0,
        help="readings in a simulated second (default: the cell's)",
    )
    parser.add_argument(
        "--correction",
        type=Path,
        metavar="MAP",
        help="correct every target by this error map, volumetric_map.json of 'stepdiag compensate"
        " --for generic' (default: targets are sent as they are)",
    )
    add_common(parser, "seed", help="seed of the noise of the readings")


def _factor(text: str) -> float:
    return number(text, 0.001, 1000.0)


def _reading_rate(text: str) -> float:
    return number(text, 0.1, HIGHEST_SAMPLE_RATE)


def run(arguments: argparse.Namespace) -> int:
    """Measure, solve, show."""
    from stepdiag_ros.commands import solve
    from stepdiag_ros.processes.measure import MeasuringSession

    until = until_of(arguments)
    refuse_target(until, arguments)
    nodes, folder = cell_nodes(arguments)
    with progress_bar("") as progress:
        show = RunTeller(progress, say)

        def tell(told: "RunNews") -> None:
            show(told)
            if told.total and told.done == told.total:
                # While the recorder closes the bag: what is to be solved and drawn next.
                solve.prepare()

        session = MeasuringSession(nodes, folder, tell, until=until)
        try:
            bag = session.measure()
        except BaseException:
            # Of a run that ends well, the summary names the bag.
            if session.bag is not None:
                say(f"recorded {session.bag}")
            raise
    shown = {
        **vars(arguments),
        "bag": bag,
        "output": None,
        "recorded_lines": False,
        "truth": None,
        **AS_MEASURED,
        "direct": [],
        "rotations": None,
        "expansion": None,
        "material_temperature": None,
        "visibility": False,
        "run_id": None,
    }
    return solve.run(argparse.Namespace(**shown))


def refuse_target(until: str, arguments: argparse.Namespace) -> None:
    """Refuse a target that the plan does not determine, before anything is started.

    Raises:
        ValueError: it does not, or plan or machine cannot be used.
    """
    if not until:
        return
    from stepdiag_ros import configuration
    from stepdiag_ros.planning.undetermined import refuse_undetermined

    target = configuration.target_from_text(until, "--until")
    machine, _ = configuration.load_machine(arguments.machine)
    refuse_undetermined(target, configuration.load_plan(arguments.plan)[0], machine.chain)


def cell_nodes(arguments: argparse.Namespace) -> "tuple[list[NodeProcess], Path]":
    """Return the nodes of the simulated cell that was asked for, and the folder of its bags.

    Raises:
        ValueError: a file cannot be used, or machine or cell cannot execute the plan; nothing has
            been started.
    """
    from stepdiag_ros import configuration
    from stepdiag_ros.compensation.generic import correction_from_file
    from stepdiag_ros.metrology.live_effects import check_measurable
    from stepdiag_ros.processes.cell import simulated_cell
    from stepdiag_ros.report.files import try_folder
    from stepdiag_ros.run.feasibility import beyond_machine

    plan = str(configuration.find(arguments.plan, "plans"))
    machine = str(configuration.find(arguments.machine, "machines"))
    cell = str(configuration.find(arguments.cell, "cells"))
    compared = str(configuration.find(arguments.model, "models"))
    configuration.load_model(compared)
    test_plan, _ = configuration.load_plan(plan)
    truth, _ = configuration.load_cell(cell)
    model, _ = configuration.load_machine(machine)
    beyond = beyond_machine(test_plan, model)
    if beyond:
        raise ValueError(f"{plan} cannot be executed on {machine}: {beyond}")
    for text in check_measurable(test_plan, truth):
        warn(f"{cell}: {text}")
    warn_of_undetermined(test_plan)
    correction = ""
    if arguments.correction is not None:
        correction = str(arguments.correction.resolve())
        # What is not a map is refused here; how large a correction may be, the bridge judges.
        correction_from_file(arguments.correction, math.inf, model)
    folder = (arguments.output or RESULTS).resolve()
    try_folder(folder)
    nodes = simulated_cell(
        plan,
        machine,
        cell,
        folder,
        arguments.factor,
        arguments.rate,
        arguments.seed,
        compared,
        correction,
    )
    return nodes, folder


COMMAND = Command(
    "run",
    Group.MEASURE,
    30,
    _add_options,
    run,
    help="start all nodes, run a test plan, solve and show the result",
    description="Execute a test plan in the simulated cell: start every node in its own process,"
    " run the plan, record it into a bag, solve the bag and show the result, with the findings of"
    " the diagnosis. A pause for a setup ends at once, because the simulated cell is aligned"
    " already. Ctrl-C stops the machine and ends the run; the measured data stay in the bag.",
    epilog="examples:\n"
    "  stepdiag run --plan ibaraki_hata_2010 --factor 20\n"
    "  stepdiag run --until 4um --factor 20      ends as soon as that is known\n"
    "  stepdiag run --cell hidden_backlash --factor 20   with a hidden effect, which the"
    " diagnosis names",
)
