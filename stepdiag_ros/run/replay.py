"""A recorded run into a live graph, with an assembler and a solver to compare if wanted."""

import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros import topics
from stepdiag_ros.run.processes import NodeProcess, Processes

if TYPE_CHECKING:
    from stepdiag_ros.bags.reader import BagReader
    from stepdiag_ros.nodes.player import Played

START_LIMIT = 20.0
"""Real seconds within which assembler and solver must be up."""
QUIET = 2.0
"""Real seconds without a new message after which assembler and solver are taken to be done."""


def replay(
    bag: "BagReader", rate: float, check: bool, progress: Callable[[float], None]
) -> "Played":
    """Publish a bag into the live graph.

    Args:
        bag: the recorded run.
        rate: recorded seconds in a real second; 0 for as fast as possible.
        check: start an assembler and a solver, and compare their messages with the recorded ones.
        progress: is told the part that has been published, 0..1.

    Raises:
        ValueError: a node could not be started.
    """
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from stepdiag_ros.nodes.player import PlayerNode

    has_readings = any(
        (found := topics.topic_of(name)) is not None and found[0] is topics.READING
        for name in bag.topics
    )
    roles = ["assembler", "solver"] if has_readings else ["solver"]
    with ExitStack() as stack:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        stack.callback(rclpy.try_shutdown)
        player = PlayerNode(bag, derived=not has_readings)
        if check:
            player.refuse_company(roles)
            logs = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            nodes = [NodeProcess(role, {"use_sim_time": True}) for role in roles]
            processes = stack.enter_context(Processes(nodes, logs))
            player.wait_for(roles, START_LIMIT, processes.ended)
            player.listen_to_derived()
        played = player.play(rate, progress)
        return player.compare(played, QUIET) if check else played
