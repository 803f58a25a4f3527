"""``stepdiag cell``: all nodes of a simulated cell or of a machine, waiting for a run."""

import argparse
import os
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.archive import require_libraries
from stepdiag_ros.commands.arguments import RESULTS, Command, Group, add_common
from stepdiag_ros.commands.output import progress_bar, say, tolerance
from stepdiag_ros.commands.run import add_cell_options, cell_nodes
from stepdiag_ros.metrology.units import IN_MICRO

if TYPE_CHECKING:
    from stepdiag_ros.processes.following import RunNews
    from stepdiag_ros.processes.node_process import NodeProcess


def _add_options(parser: argparse.ArgumentParser) -> None:
    add_cell_options(parser, plan="demo", factor=1.0)
    parser.add_argument(
        "--tolerance",
        type=tolerance,
        metavar="UM",
        help="largest permissible error vector in the volume, µm; result/verdict then states"
        " whether the machine conforms (ISO 14253-1)",
    )
    add_common(parser, "output", help=f"folder for bags and logs (default: {RESULTS})")
    # Without defaults, so that an option which does not fit a machine can be refused.
    simulated = {one.dest: one.default for one in parser._actions if one.dest != "help"}
    parser.set_defaults(**dict.fromkeys(simulated), simulated=simulated)
    add_common(parser, "namespace")
    parser.add_argument(
        "--archive",
        default="",
        metavar="PLACE",
        help="add the bag of each run to this archive: a folder, or a URL; /diagnostics states"
        " whether the machine's history calls for attention",
    )
    machine = parser.add_argument_group("a machine in place of the simulated cell")
    machine.add_argument(
        "--parameters",
        type=Path,
        metavar="FILE",
        help="ROS 2 parameter file with the devices and parameters of the cell, as 'stepdiag"
        " parameters --yaml' prints it",
    )


def run(arguments: argparse.Namespace) -> int:
    """Start the nodes and keep them up; see the module."""
    from stepdiag_ros.processes.measure import MeasuringSession

    if arguments.archive:
        require_libraries()
    namespace = arguments.namespace
    nodes, folder = _nodes(arguments)
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    where = f"ROS domain {domain}" + (f" in namespace {namespace}" if namespace else "")
    measure = "stepdiag measure" + (f" --namespace {namespace}" if namespace else "")
    up, said = False, ""
    with ExitStack() as bar:
        progress = bar.enter_context(progress_bar(""))

        def tell(news: "RunNews") -> None:
            nonlocal said
            if up or (news.text != said and not sys.stderr.isatty()):
                said = news.text
                say(said)
            else:
                progress(0.0, news.text)

        def ready(missing: str) -> None:
            nonlocal up
            up = True
            # Nothing is waited for any more.
            bar.close()
            say(
                f"{len(nodes)} nodes are up on {where}; bags go to {folder}. Nothing moves before"
                f" a run is started: {measure}. Ctrl-C or SIGTERM ends the cell."
            )
            if missing:
                say(f"no run can start yet. {missing}")

        machine = arguments.parameters is not None
        MeasuringSession(nodes, folder, tell, namespace, machine).keep_up(ready)


def _nodes(arguments: argparse.Namespace) -> "tuple[list[NodeProcess], Path]":
    """Return the nodes that were asked for, and the folder of their bags.

    Raises:
        ValueError: an option or a file does not fit; nothing has been started.
    """
    from stepdiag_ros.processes.cell import archiving, machine_cell
    from stepdiag_ros.processes.cell_file import folder_of_bags

    given = [name for name in arguments.simulated if getattr(arguments, name) is not None]
    if arguments.parameters is None:
        chosen = {name: getattr(arguments, name) for name in given}
        nodes, folder = cell_nodes(argparse.Namespace(**{**arguments.simulated, **chosen}))
        if arguments.tolerance is not None:
            tolerance = {"tolerance": arguments.tolerance / IN_MICRO}
            nodes = [
                replace(one, parameters={**one.parameters, **tolerance})
                if one.name == "solver"
                else one
                for one in nodes
            ]
        nodes += archiving(arguments.archive, simulated=True)
        return _in_namespace(nodes, arguments.namespace), folder
    if given:
        raise ValueError(
            f"--{given[0]} is for the simulated cell; of a machine, {arguments.parameters} holds"
            " all settings, and 'stepdiag measure --plan' names the plan of a run"
        )
    path, namespace = str(arguments.parameters), arguments.namespace
    nodes = [
        replace(one, ros_arguments=("--params-file", path))
        for one in (*machine_cell(path, namespace), *archiving(arguments.archive, simulated=False))
    ]
    return _in_namespace(nodes, namespace), folder_of_bags(path, namespace)


def _in_namespace(nodes: "list[NodeProcess]", namespace: str) -> "list[NodeProcess]":
    """Return the nodes in a namespace; unchanged if it is empty."""
    more = ("-r", f"__ns:={namespace}") if namespace else ()
    return [replace(one, ros_arguments=(*one.ros_arguments, *more)) for one in nodes]


COMMAND = Command(
    "cell",
    Group.MEASURE,
    45,
    _add_options,
    run,
    help="start the nodes of a simulated cell, or of a machine, and wait for runs",
    description="Start every node of the simulated cell, or with --parameters of a measurement on"
    " a machine, in its own process, and keep them running until Ctrl-C. Nothing moves before you"
    " start a run: 'stepdiag measure', the action /sequencer/measure or the service"
    " /sequencer/start. Ctrl-C stops the machine and ends all nodes. ROS 2 need not be installed:"
    " without it the nodes run on the embedded client, and any ROS 2 node on this computer sees"
    " them.",
    epilog="examples:\n"
    "  stepdiag cell --plan quick --factor 10   in one terminal\n"
    "  stepdiag measure                         in another: start a run and follow it\n"
    "  stepdiag monitor                         in a third: watch it in the browser\n"
    "  stepdiag cell --tolerance 10             with a verdict on conformity\n"
    "  stepdiag cell --parameters cell.yaml     the nodes of a machine\n"
    "  stepdiag cell --archive /data/machines   and each bag into an archive\n"
    "\nEach simulated cell needs a ROS domain of its own, also in a namespace, because all"
    " simulated cells of a domain would share /clock. A machine may share its domain with one of"
    " them.",
)
