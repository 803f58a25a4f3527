"""``stepdiag node``: start one node, as ``ros2 run stepdiag_ros NAME`` does."""

import argparse
import sys
from importlib import import_module

NODES = (
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


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "node",
        help="start one node of a measurement",
        description="Start one node and run it until Ctrl-C. Parameters and names are given the "
        "ROS 2 way, behind --ros-args; 'stepdiag parameters NAME' shows what there is.",
        epilog="example: stepdiag node solver --ros-args -p use_sim_time:=true",
    )
    parser.add_argument("name", choices=NODES, help="which node")
    parser.add_argument(
        "ros_arguments", nargs=argparse.REMAINDER, help="--ros-args and what follows"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the node in this process."""
    sys.argv = [arguments.name, *arguments.ros_arguments]
    module = import_module(f"stepdiag_ros.nodes.{arguments.name}")
    code: int = module.main()
    return code
