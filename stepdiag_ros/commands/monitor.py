"""``stepdiag monitor``: one live page in the browser, of a run or of a bag."""

import signal
import sys
import threading
from argparse import ArgumentParser, Namespace
from pathlib import Path

from stepdiag_ros.commands.arguments import Command, Group, add_common, port
from stepdiag_ros.commands.onlooking import (
    add_rate_option,
    rate_of,
    refuse_what_does_not_fit,
    ros_arguments,
)
from stepdiag_ros.commands.output import say


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument("bag", type=Path, nargs="?", help="bag to play (default: the live run)")
    add_rate_option(parser)
    add_common(parser, "run")
    add_common(parser, "namespace")
    parser.add_argument(
        "--address", default="127.0.0.1", help="address to serve on (default: %(default)s)"
    )
    parser.add_argument("--port", type=port, default=8470, help="(default: %(default)s; 0: any)")
    parser.add_argument(
        "--token-file", default="", metavar="FILE", help="file whose first line is the token"
    )


def run(arguments: Namespace) -> int:
    """Serve until Ctrl-C."""
    refuse_what_does_not_fit(arguments)
    if arguments.bag is not None:
        return _replay(arguments)
    from stepdiag_ros.parameters.declaration import written

    given = {
        "address": arguments.address,
        "port": arguments.port,
        "token_file": arguments.token_file,
    }
    sys.argv = ros_arguments("monitor", "monitor", arguments.namespace)
    for name, value in given.items():
        sys.argv += ["-p", f"{name}:={written(value)}"]
    from stepdiag_ros.nodes.monitor import main

    return main()


def _replay(arguments: Namespace) -> int:
    from stepdiag_ros.viewers.page.access import make_access
    from stepdiag_ros.viewers.page.replay import Replay
    from stepdiag_ros.viewers.page.server import MonitorServer, Offer
    from stepdiag_ros.viewers.page.state import PageState

    state = PageState()
    access = make_access(arguments.address, arguments.token_file)
    replay = Replay(arguments.bag, state, arguments.run_id)
    offer = Offer(state, access, "replay", arguments.bag.name, ask=None, log=say)
    server = MonitorServer(offer, arguments.port)
    stop = threading.Event()
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        server.start()
        say(f"the page is at {server.url}; Ctrl-C ends it")
        count = replay.play(rate_of(arguments), stop)
        say(f"all of the recording is shown ({count} messages); Ctrl-C ends the page")
        while not stop.wait(3600.0):
            pass
    except KeyboardInterrupt:
        return 0
    finally:
        stop.set()
        server.close()
        replay.close()
        signal.signal(signal.SIGTERM, before)
    return 0


COMMAND = Command(
    "monitor",
    Group.WATCH,
    10,
    _add_options,
    run,
    help="in the browser, as a live page",
    description="Serve one page that shows the progress of the run, the beam, stops and blocks as"
    " they arrive, the error curves with their uncertainty, squareness, the gap to the model,"
    " the air and all faults. Without a bag, the page shows the run on this ROS domain, and"
    " an operator with the token can start, pause, resume and abort it. With a bag, the page"
    " plays the bag and controls nothing. Only this computer can open the page, unless you"
    " give --address and --token-file (docs/monitor.md). End with Ctrl-C.",
    epilog="examples:\n"
    "  stepdiag monitor                        the live run\n"
    "  stepdiag monitor RUN.mcap --rate 50     a recorded run, 50 times as fast\n"
    "  stepdiag monitor --address 0.0.0.0 --token-file ~/.stepdiag_token",
)
