"""``stepdiag node``: start one node, as ``ros2 run stepdiag_ros NAME`` does."""

import argparse
import sys
from importlib import import_module

from stepdiag_ros.commands.arguments import Command, Group

NODES = (
    "archive",
    "assembler",
    "bridge",
    "by_hand",
    "clock",
    "diagnosis",
    "evaluator",
    "foxglove_server",
    "interferometer",
    "monitor",
    "recorder",
    "scene",
    "sequencer",
    "solver",
    "weather",
)


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "name", choices=NODES, type=_module, metavar="NODE", help=f"one of {', '.join(NODES)}"
    )
    parser.add_argument(
        "ros_arguments",
        nargs=argparse.REMAINDER,
        help="--ros-args and what follows, or --help for the parameters of the node",
    )


def _module(name: str) -> str:
    """Return the module of a node that is named as in the graph, such as cnc_bridge."""
    from stepdiag_ros.parameters.nodes import declared_node

    return declared_node(name).module


def run(arguments: argparse.Namespace) -> int:
    """Run the node in this process, or print its help."""
    if not {"-h", "--help"}.isdisjoint(arguments.ros_arguments):
        from stepdiag_ros.parameters.documents import help_text
        from stepdiag_ros.parameters.nodes import declared_node

        sys.stdout.write(help_text(declared_node(arguments.name)))
        return 0
    _check_parameter_files(arguments.name, arguments.ros_arguments)
    sys.argv = [arguments.name, *arguments.ros_arguments]
    module = import_module(f"stepdiag_ros.nodes.{arguments.name}")
    code: int = module.main()
    return code


def _check_parameter_files(module: str, arguments: list[str]) -> None:
    """Refuse a parameter file that names an unknown node, as the launch files do.

    ROS 2 leaves such parameters out, and a bridge without parameters is a simulated controller.

    Raises:
        ValueError: says which file, and what is wrong there.
    """
    from stepdiag_ros.embedded.arguments import ArgumentError, parse
    from stepdiag_ros.parameters.nodes import NODES, declared_node
    from stepdiag_ros.processes.cell_file import given_to

    try:
        given = parse(arguments)
    except ArgumentError:
        # The ROS client says so, or knows an argument that the embedded one does not.
        return
    own = given.node_name(declared_node(module).name)
    namespace = given.node_namespace(own, "").strip("/")
    names = {f"{namespace}/{name}".lstrip("/") for name in (own, *(node.name for node in NODES))}
    for path in given.parameter_files:
        given_to(path, names)


COMMAND = Command(
    "node",
    Group.LOOK_AFTER,
    60,
    _add_options,
    run,
    help="start one node of a measurement",
    description="Start one node and run it until Ctrl-C. Give parameters and names as in ROS 2,"
    " after --ros-args; 'stepdiag node NAME --help' explains the parameters of the node.",
    epilog="examples:\n"
    "  stepdiag node solver --help\n"
    "  stepdiag node solver --ros-args -p use_sim_time:=true",
)
