"""Options of the commands that look on, at live nodes or at a bag."""

import os
from argparse import ArgumentParser, Namespace

from stepdiag_ros.commands.output import number

_BAG_RATE = 20.0
_HEARTBEAT_TIMEOUT = 10.0
"""Real seconds of silence after which a view reports a node as silent: as long as in a simulated
cell. The nodes of a machine report it themselves, after their own limit."""


def add_rate_option(parser: ArgumentParser) -> None:
    """Add the option that says how fast a bag is played.

    Args:
        parser: of the command.
    """
    parser.add_argument(
        "--rate",
        type=lambda text: number(text, 0.0, 1e6),
        default=None,
        help="for a bag: recorded seconds in a real second; 0: as fast as possible"
        f" (default: {_BAG_RATE:g})",
    )


def rate_of(arguments: Namespace) -> float:
    """Return how fast a bag is played.

    Args:
        arguments: parsed, with ``bag`` and the options of a bag.
    """
    return _BAG_RATE if arguments.rate is None else float(arguments.rate)


def refuse_what_does_not_fit(arguments: Namespace) -> None:
    """Refuse options of a bag where none is given, and those of live nodes where one is.

    Args:
        arguments: parsed, with ``bag``, the options of a bag and the namespace.

    Raises:
        ValueError: there is one.
    """
    if arguments.bag is not None:
        if arguments.namespace:
            raise ValueError("--namespace is for live nodes; of a bag, --run says which run")
        return
    for name, option in (("rate", "--rate"), ("run_id", "--run")):
        if getattr(arguments, name) is not None:
            raise ValueError(f"{option} is for a bag, and none is given")


def ros_arguments(command: str, enclave: str, namespace: str) -> list[str]:
    """Return the arguments of a command that is a node itself.

    Several people may look on at once, each with a command of their own, and nodes of one name are
    an error: the node is named after its enclave and its process.

    Args:
        command: its name.
        enclave: of its keys in a protected cell.
        namespace: such as ``/cell_1``; empty for none.
    """
    from stepdiag_ros.parameters.declaration import HEARTBEAT_TIMEOUT
    from stepdiag_ros.processes.node_process import ENCLAVE

    made = [command, "--ros-args", "--enclave", f"{ENCLAVE}/{enclave}"]
    made += ["-r", f"__node:={enclave}_{os.getpid()}"]
    made += ["-p", f"{HEARTBEAT_TIMEOUT.name}:={_HEARTBEAT_TIMEOUT}"]
    return made + (["-r", f"__ns:={namespace}"] if namespace else [])
