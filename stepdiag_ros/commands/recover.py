"""``stepdiag recover``: recover a bag that was cut off or damaged."""

import math
from argparse import ArgumentParser, Namespace
from pathlib import Path

from stepdiag_ros import schemas
from stepdiag_ros.commands.arguments import Command, Group, add_common
from stepdiag_ros.commands.output import progress_bar, say


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument("bag", type=Path, help="the damaged bag (.mcap)")
    parser.add_argument(
        "target",
        type=Path,
        nargs="?",
        help="the clean bag (default: NAME_recovered.mcap beside it)",
    )
    add_common(parser, "json", help="print what was recovered and lost as JSON")


def run(arguments: Namespace) -> int:
    """Recover the bag; see the module."""
    from stepdiag_ros.bags.recover import default_target, recover
    from stepdiag_ros.schemas.parts import part_of
    from stepdiag_ros.schemas.recovery import Document

    target = arguments.target or default_target(arguments.bag)
    with progress_bar(f"recovering {arguments.bag.name}"):
        report = recover(arguments.bag, target)
    if not arguments.json:
        print(report.text)
        return 0
    duration = math.nan
    if report.start_time is not None and report.end_time is not None:
        duration = (report.end_time - report.start_time) / 1e9
    document = part_of(
        Document,
        report,
        source=str(report.source),
        target=str(report.target),
        source_was_closed=report.was_closed,
        duration_s=duration,
    )
    print(schemas.json_text(schemas.document("recovery", document)))
    for loss in report.losses:
        say(loss)
    return 0


COMMAND = Command(
    "recover",
    Group.LOOK_AFTER,
    20,
    _add_options,
    run,
    help="recover a bag that was cut off or damaged",
    description="Copy all complete records from a bag whose recording was cut off (power, full"
    " disk, a killed program) or whose bytes were damaged, and report what was lost. The command"
    " does not change the damaged bag.",
    epilog="example:\n  stepdiag recover run.mcap      writes run_recovered.mcap beside it",
)
