"""``stepdiag foxglove``: a run, or a bag, in Foxglove."""

import signal
import sys
import threading
from argparse import ArgumentParser, Namespace
from pathlib import Path

from stepdiag_ros.commands.arguments import Command, Group, add_common, port
from stepdiag_ros.commands.onlooking import refuse_what_does_not_fit, ros_arguments
from stepdiag_ros.commands.output import number, say

_DEFAULT_PORT = 8765


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument("bag", type=Path, nargs="?", help="bag to play (default: the live run)")
    parser.add_argument(
        "--rate",
        type=lambda text: number(text, 0.001, 1000.0),
        default=None,
        help="for a bag: recorded seconds in a real second, until a viewer changes it (default: 1)",
    )
    add_common(parser, "run")
    add_common(parser, "namespace")
    parser.add_argument(
        "--use-sim-time",
        action="store_true",
        help="use the clock of a simulated cell or of 'stepdiag replay'",
    )
    parser.add_argument(
        "--address", default="127.0.0.1", help="address to serve on (default: %(default)s)"
    )
    parser.add_argument(
        "--port", type=port, default=_DEFAULT_PORT, help="(default: %(default)s; 0: any)"
    )
    parser.add_argument(
        "--open-to-network",
        action="store_true",
        help="allow an address that other computers can reach; everyone there can view the run",
    )


def run(arguments: Namespace) -> int:
    """Serve until Ctrl-C."""
    refuse_what_does_not_fit(arguments)
    if arguments.bag is not None:
        if arguments.use_sim_time:
            raise ValueError("--use-sim-time is for live nodes; a bag has its own time")
        return _replay(arguments)
    from stepdiag_ros.parameters.declaration import written

    sys.argv = ros_arguments("foxglove", "foxglove_server", arguments.namespace)
    for name in ("use_sim_time", "address", "port", "open_to_network"):
        sys.argv += ["-p", f"{name}:={written(getattr(arguments, name))}"]
    from stepdiag_ros.nodes.foxglove_server import main

    return main()


def _replay(arguments: Namespace) -> int:
    from stepdiag_ros.viewers.foxglove.replay import FoxgloveReplay
    from stepdiag_ros.viewers.foxglove.server import ServedPlace

    place = ServedPlace(arguments.address, arguments.port, arguments.open_to_network)
    rate = 1.0 if arguments.rate is None else arguments.rate
    replay = FoxgloveReplay(arguments.bag, arguments.run_id, rate, place, say)
    stop = threading.Event()

    def end(*_: object) -> None:
        stop.set()

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, end) for number in numbers}
    try:
        replay.server.start()
        say(f"viewers connect to {replay.server.url}; Ctrl-C ends it")
        if not place.is_local:
            say(f"everyone who can reach {place.address} can view the run: viewers do not log in")
        replay.play(stop)
    finally:
        replay.close()
        for number, handler in before.items():
            signal.signal(number, handler)
    return 0


COMMAND = Command(
    "foxglove",
    Group.WATCH,
    30,
    _add_options,
    run,
    help="in Foxglove",
    description="Serve what the nodes on this ROS domain publish, or a bag, to Foxglove and other"
    " viewers that speak its WebSocket protocol. Viewers only display; they control nothing but"
    " the playback of a bag. Load the layout config/foxglove/stepdiag.json there. Only this"
    " computer can connect, unless you give --address and --open-to-network (docs/foxglove.md)."
    " End with Ctrl-C.",
    epilog="examples:\n"
    "  stepdiag foxglove                       the live run\n"
    "  stepdiag foxglove RUN.mcap --rate 10    a recorded run, 10 times as fast\n"
    "  ssh -L 8765:127.0.0.1:8765 CELL         a run on another computer",
)
