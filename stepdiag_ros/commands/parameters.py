"""``stepdiag parameters``: what can be set on the nodes, as a table, a page or a parameter file."""

import sys
from argparse import ArgumentParser, Namespace

from stepdiag_ros.commands.arguments import Command, Group
from stepdiag_ros.metrology.spelling import nearest, suggestion
from stepdiag_ros.parameters.declaration import DeclaredNode
from stepdiag_ros.parameters.nodes import NODES

_EXAMPLES = """\
examples:
  stepdiag parameters interferometer
  stepdiag parameters --yaml > cell.yaml            all nodes, to be edited
  stepdiag node interferometer --ros-args --params-file cell.yaml"""


def _add_options(parser: ArgumentParser) -> None:
    names = [node.module for node in NODES]
    parser.add_argument(
        "nodes",
        nargs="*",
        metavar="NODE",
        help=f"nodes to list (default: all): {', '.join(names)}; in the graph and in"
        " parameter files, the bridge is named cnc_bridge",
    )
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--yaml", action="store_true", help="print a ROS 2 parameter file")
    form.add_argument("--markdown", action="store_true", help="print the page docs/parameters.md")


def run(arguments: Namespace) -> int:
    """Print the parameters; see the module.

    Raises:
        ValueError: there is no such node.
    """
    from stepdiag_ros.parameters.documents import markdown, parameter_file

    nodes = [_node(name) for name in arguments.nodes] or list(NODES)
    if arguments.yaml:
        sys.stdout.write(parameter_file(nodes))
    elif arguments.markdown:
        sys.stdout.write(markdown(nodes))
    else:
        _print(nodes)
    return 0


def _node(name: str) -> DeclaredNode:
    for node in NODES:
        if name in (node.module, node.name):
            return node
    known = [node.module for node in NODES]
    near = nearest(name, known)
    hint = suggestion(near, f"use {', '.join(known)}")
    raise ValueError(f"there is no node '{name}'; {hint}")


def _print(nodes: list[DeclaredNode]) -> None:
    from stepdiag_ros.parameters.documents import COLUMNS, row
    from stepdiag_ros.text.console import make_console
    from stepdiag_ros.text.table import Column, Table

    console = make_console(sys.stdout)
    for node in nodes:
        console.sentence(f"{node.name}: {node.purpose}")
        if not node.parameters:
            console.print("  no parameters of its own\n")
            continue
        table = Table("", [Column(name) for name in COLUMNS])
        table.columns[-1].wraps = True
        for declaration in node.parameters:
            table.add_row(*row(declaration))
        console.print(table)


COMMAND = Command(
    "parameters",
    Group.LOOK_AFTER,
    50,
    _add_options,
    run,
    help="list the parameters of the nodes: unit, range, default",
    description="Show the parameters of the nodes with unit, range, default and meaning, or print"
    " a ROS 2 parameter file that explains them.",
    epilog=_EXAMPLES,
)
