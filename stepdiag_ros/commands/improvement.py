"""``stepdiag improvement``: how much better a machine is after compensation."""

import sys
from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path

from stepdiag_ros.commands.compensate import load_identified
from stepdiag_ros.commands.output import HelpFormatter


def add_parser(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "improvement",
        help="how much better a machine is: two measurements, before and after compensation",
        description="Compare two measurements of the same box: positioning, straightness,"
        " squareness and the error vectors in the volume, before and after.",
        epilog="examples:\n"
        "  stepdiag improvement before.mcap after.mcap\n"
        "  stepdiag improvement before.mcap after.mcap --json",
        formatter_class=HelpFormatter,
    )
    for name in ("before", "after"):
        parser.add_argument(name, type=Path, help="the measurement (.mcap), or its results.json")
    parser.add_argument(
        "--method", default="", help="of the solver (default: the one to rely on, least_squares)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON in SI units")
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Compare; see the module."""
    from stepdiag_ros.compensation.improvement import improvement
    from stepdiag_ros.report.improvement import improvement_json, print_improvement
    from stepdiag_ros.report.tables import make_console

    found = improvement(
        load_identified(arguments.before, arguments.method),
        load_identified(arguments.after, arguments.method),
    )
    if arguments.json:
        print(improvement_json(found))
    else:
        print_improvement(found, make_console(sys.stdout))
    return 0
