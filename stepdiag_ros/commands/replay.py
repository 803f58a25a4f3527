"""``stepdiag replay``: publish a recorded run into a live graph."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros import schemas
from stepdiag_ros.commands.arguments import Command, Group, add_common
from stepdiag_ros.commands.output import number, progress_bar, say

if TYPE_CHECKING:
    from stepdiag_ros.nodes.player import Played
    from stepdiag_ros.schemas.replay import Document


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "bag", type=Path, help="the recorded run (.mcap), or a folder of 'ros2 bag record'"
    )
    add_common(parser, "run")
    parser.add_argument(
        "--rate",
        type=_rate,
        default=1.0,
        help="recorded seconds in a real second; 0: as fast as the nodes take it (default: 1)",
    )
    parser.add_argument(
        "--check", action="store_true", help="assemble and solve again; compare with the recording"
    )
    parser.add_argument(
        "--wait-for",
        nargs="+",
        default=(),
        metavar="NODE",
        help="begin when these nodes subscribe, for example assembler solver",
    )
    add_common(parser, "json", help="print the outcome as JSON")


def _rate(text: str) -> float:
    return number(text, 0.0, 1e6)


def run(arguments: argparse.Namespace) -> int:
    """Replay, and compare if asked."""
    from stepdiag_ros.bags.folder import open_bag
    from stepdiag_ros.processes.replay import replay

    with open_bag(arguments.bag) as bag, progress_bar("replaying") as progress:
        played = replay(
            bag,
            arguments.rate,
            arguments.check,
            progress,
            arguments.wait_for,
            arguments.run_id,
        )
    if arguments.json:
        print(schemas.json_text(schemas.document("replay", _document(arguments.bag, played))))
    else:
        say(
            f"replayed {played.messages} messages, {played.recorded_seconds:.1f} s of recording in "
            f"{played.real_seconds:.1f} s ({played.recorded_seconds / played.real_seconds:.0f} x)"
        )
        for topic, same in played.same.items():
            words = played.differences.get(topic, "")
            print(f"{topic}: {'bit-identical' if same else f'DIFFERENT: {words}'}")
    if all(played.same.values()):
        return 0
    print("stepdiag: error: the replay differs from the recording", file=sys.stderr)
    return 1


def _document(bag: Path, played: "Played") -> "Document":
    from stepdiag_ros.schemas.parts import part_of
    from stepdiag_ros.schemas.replay import Document

    return part_of(Document, played, bag=str(bag))


COMMAND = Command(
    "replay",
    Group.WATCH,
    40,
    _add_options,
    run,
    help="publish a recorded run to live nodes, with its clock",
    description="Publish the recorded messages of the devices and the sequencer, with /clock, so"
    " that a running assembler, solver and diagnosis process them again. Only to view a run,"
    " use: stepdiag monitor RUN. With --check the command starts the evaluating nodes and"
    " compares their messages with the recorded ones bit for bit; of the diagnoses, only the"
    " final one.",
    epilog="example: stepdiag replay stepdiag_results/RUN.mcap --rate 100 --check",
)
