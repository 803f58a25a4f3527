"""``stepdiag demo``: a complete measurement to look at, in one to two minutes."""

import argparse

from stepdiag_ros.commands.arguments import Command, Group
from stepdiag_ros.commands.run import add_run_options, run

FACTOR = 30.0


def _add_options(parser: argparse.ArgumentParser) -> None:
    add_run_options(parser, plan="demo", factor=FACTOR)


COMMAND = Command(
    "demo",
    Group.MEASURE,
    10,
    _add_options,
    run,
    help="measure a simulated machine and show the result (1 to 2 minutes)",
    description="Measure a simulated machine with three linear axes and four step diagonals of "
    "12 blocks of 10 mm, in both directions, twice, faster than real time; then show what "
    "each method finds beside the true errors. Its nodes are on the ROS domain of this terminal"
    " (ROS_DOMAIN_ID, else 0), which they keep from other simulated cells meanwhile.",
    epilog="example: stepdiag demo --output my_first_run",
)
