"""``stepdiag cell``: the simulated cell with all nodes, waiting for a run."""

import argparse
import os
from typing import TYPE_CHECKING

from stepdiag_ros.commands.arguments import RESULTS, Command, Group, add_common
from stepdiag_ros.commands.output import progress_bar, say
from stepdiag_ros.commands.run import add_cell_options, cell_nodes

if TYPE_CHECKING:
    from stepdiag_ros.processes.following import RunNews


def _add_options(parser: argparse.ArgumentParser) -> None:
    add_cell_options(parser, plan="demo", factor=1.0)
    add_common(parser, "output", help=f"folder for bags and logs (default: {RESULTS})")


def run(arguments: argparse.Namespace) -> int:
    """Start the nodes and keep them up; see the module."""
    from stepdiag_ros.processes.measure import MeasuringSession

    nodes, folder = cell_nodes(arguments)
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    with progress_bar("starting") as progress:

        def tell(news: "RunNews") -> None:
            progress(0.0, news.text)

        def ready() -> None:
            progress(1.0)
            say(
                f"{len(nodes)} nodes are up on ROS domain {domain}; bags go to {folder}. Nothing"
                " moves before a run is started: stepdiag measure. Ctrl-C or SIGTERM ends the cell."
            )

        MeasuringSession(nodes, folder, tell).keep_up(ready)


COMMAND = Command(
    "cell",
    Group.MEASURE,
    45,
    _add_options,
    run,
    help="start the nodes of a simulated cell and wait for runs",
    description="Start every node of the simulated cell in its own process, and keep them running"
    " until Ctrl-C. Nothing moves before you start a run: 'stepdiag measure', the action"
    " /sequencer/measure or the service /sequencer/start. ROS 2 need not be installed: without it"
    " the nodes run on the embedded client, and any ROS 2 node on this computer sees them.",
    epilog="examples:\n"
    "  stepdiag cell --plan quick --factor 10   in one terminal\n"
    "  stepdiag measure                         in another: start a run and follow it\n"
    "  stepdiag monitor                         in a third: watch it in the browser",
)
