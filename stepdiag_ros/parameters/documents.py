"""The declared parameters for people: a page of tables, a file to be filled in, a node's help."""

import textwrap
from collections.abc import Sequence

from stepdiag_ros.parameters.declaration import COMMON, Declaration, DeclaredNode, written

WIDTH = 100
"""Characters in a line of the parameter file."""
HELP_WIDTH = 80
"""Characters in a line of the help of a node."""
COLUMNS = ("Parameter", "Type", "Default", "Unit", "Range or choices", "Can be set", "Meaning")

_INTRODUCTION = """\
# Parameters of the nodes

Made by `stepdiag parameters --markdown` from `stepdiag_ros/parameters/nodes.py`; do not edit it.

Values are given as for any ROS 2 node: `--ros-args -p NAME:=VALUE` for one node,
`--ros-args --params-file FILE` or a launch file for all. `stepdiag parameters --yaml` prints such a
file with every parameter at its default. A number of type double is written with a point: 1.0.

A wrong value, or a parameter that the node does not have, is refused when the node starts: one
sentence, exit code 1. What can be set later is set with `ros2 param set NODE NAME VALUE`, which
prints the reason if it is refused. What the numbers of a run depend on can be set between runs, not
while one is going on. The settings of a device can be set while it is closed, and are used when it
is opened: `ros2 lifecycle set NODE deactivate` and `cleanup`, `ros2 param set`, `configure`
and `activate`. The recorder keeps all parameters of all nodes in every bag.

`ros2 param describe NODE NAME` prints what is in these tables.

## Every node
"""


def row(declaration: Declaration) -> tuple[str, ...]:
    """Return the cells of a parameter, in the order of ``COLUMNS``."""
    return (
        declaration.name,
        declaration.type_name,
        written(declaration.default),
        declaration.unit,
        declaration.limits,
        declaration.change.value,
        declaration.description,
    )


def markdown(nodes: Sequence[DeclaredNode]) -> str:
    """Return the page of all nodes, each with its table."""
    parts = [_INTRODUCTION, _table(COMMON)]
    for node in nodes:
        parts.append(f"\n## {node.name}\n")
        started = f"`ros2 run stepdiag_ros {node.module}` or `stepdiag node {node.module}`"
        parts.append(f"\n{_sentence(node.purpose)} Started by {started}.\n")
        if not node.parameters:
            parts.append("\nIt has no parameters of its own.\n")
            continue
        parts.append(_table(node.parameters))
    return "".join(parts)


def _table(declarations: Sequence[Declaration]) -> str:
    lines = [_line(COLUMNS), _line(["---"] * len(COLUMNS))]
    for declaration in declarations:
        name, kind, default, *rest = row(declaration)
        lines.append(_line([f"`{name}`", kind, f"`{default}`", *rest]))
    return "\n" + "".join(lines)


def parameter_file(nodes: Sequence[DeclaredNode]) -> str:
    """Return a ROS 2 parameter file with all parameters at their defaults, each explained."""
    lines = [
        "# Parameters of stepdiag_ros nodes, all at their defaults; leave out what stays so.",
        "# To be given to nodes with --ros-args --params-file FILE; each takes what is its own.",
        "# '/**/' in front of a name: in whatever namespace the node is.",
    ]
    for node in nodes:
        lines += ["", *_comment(_sentence(node.purpose), 0), f"/**/{node.name}:"]
        lines.append("  ros__parameters:")
        for declaration in (*COMMON, *node.parameters):
            unit = f" {declaration.unit}" if declaration.unit else ""
            told = [declaration.description]
            told += [f"{declaration.limits}{unit}"] if declaration.limits else []
            told += [f"can be set {declaration.change.value}"]
            lines += _comment(_sentence("; ".join(told)), 4)
            lines.append(f"    {declaration.name}: {written(declaration.default)}")
    return "\n".join(lines) + "\n"


def help_text(node: DeclaredNode) -> str:
    """Return what a node is for, its parameters and how they are given, for a terminal."""
    start = f"stepdiag node {node.module} --ros-args"
    lines = [f"usage: {start} -p NAME:=VALUE ...", f"       {start} --params-file FILE", ""]
    lines += [*_wrapped(_sentence(node.purpose), "", ""), "", "parameters:"]
    for declaration in (*node.parameters, *COMMON):
        unit = f" {declaration.unit}" if declaration.unit else ""
        facts = [declaration.type_name, f"default {written(declaration.default)}{unit}"]
        facts += [f"{declaration.limits}{unit}"] if declaration.limits else []
        lines += _wrapped(f"{declaration.name} ({'; '.join(facts)})", "  ", " " * 6)
        told = f"{declaration.description}; can be set {declaration.change.value}"
        lines += _wrapped(_sentence(told), " " * 6, " " * 6)
    shown = (*node.parameters, *COMMON)[0]
    return "\n".join(
        [*lines, "", f"example: {start} -p {shown.name}:={written(shown.default)}", ""]
    )


def _wrapped(text: str, begin: str, go_on: str) -> list[str]:
    return textwrap.wrap(
        text, HELP_WIDTH, initial_indent=begin, subsequent_indent=go_on, break_on_hyphens=False
    )


def _sentence(phrase: str) -> str:
    return f"{phrase[:1].upper()}{phrase[1:]}."


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


def _comment(text: str, indent: int) -> list[str]:
    begin = " " * indent + "# "
    return textwrap.wrap(text, WIDTH, initial_indent=begin, subsequent_indent=begin)
