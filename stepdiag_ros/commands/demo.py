"""``stepdiag demo``: a complete measurement to look at, in one to two minutes."""

import argparse

from stepdiag_ros.commands.run import add_run_options, run

FACTOR = 30.0


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "demo",
        help="see it work: a whole simulated measurement, solved and drawn, in one to two minutes",
        description="Measure a simulated machine with three linear axes and four step diagonals of "
        "12 blocks of 10 mm, both ways, twice, faster than real time; then show what "
        "each method makes of it beside the truth.",
        epilog="example: stepdiag demo --output my_first_run",
    )
    add_run_options(parser, plan="demo", factor=FACTOR)
    parser.set_defaults(run=run)
