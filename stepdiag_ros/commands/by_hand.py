"""``stepdiag by-hand``: a run from readings alone, of an instrument that is not connected."""

import argparse
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros import schemas
from stepdiag_ros.commands.arguments import Command, Group, add_common
from stepdiag_ros.commands.output import say, warn_of_undetermined

if TYPE_CHECKING:
    from stepdiag_ros.bags.hand_run import HandRun
    from stepdiag_ros.schemas.by_hand import Document


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument(
        "recordings",
        type=Path,
        nargs="+",
        metavar="recording",
        help="file with readings over time, or a bag with them; several in order of measurement",
    )
    parser.add_argument(
        "--plan", required=True, help="plan that was measured: YAML file, or a name"
    )
    parser.add_argument(
        "--mapping",
        default="",
        metavar="FILE",
        help="YAML file that describes the columns: a path, or a name of config/imports",
    )
    parser.add_argument(
        "--lines",
        action="append",
        type=_lines,
        metavar="FIRST-LAST",
        help="passes that the recording holds, by their number in the NC program (PASS 1 OF 28),"
        " such as 1-4 or 3; once for each recording (default: all; of several recordings one setup"
        " each, or one pass each)",
    )
    parser.add_argument(
        "--machine", help="machine: YAML file, or a name; for the order of its axes"
    )
    add_common(
        parser, "output", metavar="BAG", help="(default: NAME_by_hand.mcap beside the first)"
    )
    add_common(parser, "json", help="print what was found as JSON")


def _lines(text: str) -> tuple[int, int]:
    first, _, last = text.partition("-")
    if not first.isascii() or not first.isdigit() or not (last or first).isdigit():
        raise argparse.ArgumentTypeError(f"'{text}' is not a range of lines. Write it like 1-4")
    return int(first), int(last or first)


def run(arguments: Namespace) -> int:
    """Find the stops and write the bag; see the module."""
    from stepdiag_ros.bags.hand_run import lines_of_recordings, measure_by_hand, write_hand_run
    from stepdiag_ros.bags.imports.made import WITHOUT_CHAIN
    from stepdiag_ros.bags.recording import one_after_another, read_recording
    from stepdiag_ros.configuration import load_machine, load_plan
    from stepdiag_ros.metrology.by_hand import plan_by_hand, require_standing_beam
    from stepdiag_ros.planning.plan_text import plan_text

    plan, text = load_plan(arguments.plan)
    require_standing_beam(plan, str(arguments.plan))
    warn_of_undetermined(plan)
    if arguments.lines is None:
        lines = lines_of_recordings(plan, len(arguments.recordings))
    else:
        lines = _given_lines(arguments, len(plan.lines))
    machine_text = load_machine(arguments.machine)[1] if arguments.machine else ""
    recordings = one_after_another(
        [read_recording(path, arguments.mapping, text) for path in arguments.recordings]
    )
    as_measured = plan_text(plan_by_hand(plan), (f"measured by hand; from {arguments.plan}",))
    found = measure_by_hand(plan, as_measured, machine_text, recordings, lines)
    first = arguments.recordings[0]
    target = arguments.output or first.with_name(f"{first.stem}_by_hand.mcap")
    if not found.lines:
        for sentence in found.words:
            say(f"  {sentence}")
        raise ValueError("no line of the plan was found; nothing was written")
    run_id = write_hand_run(target, found)
    if arguments.json:
        print(schemas.json_text(schemas.document("by_hand", _document(found, target, run_id))))
        return 0
    complete = sum(line.complete for line in found.lines)
    print(
        f"{target}: {len(found.lines)} of {len(found.looked_for)} lines found,"
        f" {complete} of them complete"
    )
    for sentence in found.words:
        say(f"  {sentence}")
    _say_how_to_complete(found, lines)
    if not machine_text:
        say(f"note: {WITHOUT_CHAIN}. Name the machine: --machine FILE")
    return 0


def _say_how_to_complete(found: "HandRun", lines: list[list[int]]) -> None:
    """Say which lines are missing, what was seen instead, and how they are added."""
    from stepdiag_ros.metrology.hand_lines import steps_seen

    plan, measured = found.plan, {line.line_index for line in found.lines}
    missing = [index for index in range(len(plan.lines)) if index not in measured]
    if not missing:
        return
    for recording, one in zip(found.recordings, found.found, strict=True):
        if not one.hint and any(line.refusal for line in one.lines):
            say(f"  {recording.path.name}: {steps_seen(one.rests, one.places)}")
    setups: dict[str, list[int]] = {}
    for index in missing:
        setups.setdefault(plan.setup_of(plan.lines[index]), []).append(index)
    say("missing: " + "; ".join(f"line {n + 1} ({plan.lines[n]})" for n in missing))
    given = [(one.path.name, own) for one, own in zip(found.recordings, lines, strict=True)]
    again = [(f"again_{n}.csv", own) for n, own in enumerate(setups.values(), start=1)]
    files = " ".join(name for name, _ in given + again)
    ranges = " ".join(f"--lines {own[0] + 1}-{own[-1] + 1}" for _, own in given + again)
    say("To add them, measure each missing setup again into a file of its own, and give all files:")
    say(f"  stepdiag by-hand {files} {ranges} …")


def _given_lines(arguments: Namespace, count: int) -> list[list[int]]:
    if len(arguments.lines) != len(arguments.recordings):
        raise ValueError(
            f"{len(arguments.lines)} times --lines for {len(arguments.recordings)} recordings."
            " Give it once for each, or not at all"
        )
    for first, last in arguments.lines:
        if not 1 <= first <= last <= count:
            raise ValueError(f"--lines {first}-{last}: the plan has the lines 1 to {count}")
    return [list(range(first - 1, last)) for first, last in arguments.lines]


def _document(found: "HandRun", target: Path, run_id: str) -> "Document":
    from stepdiag_ros.schemas.by_hand import Document, Line, Recording

    measured = {line.line_index: line for line in found.lines}
    return Document(
        bag=str(target),
        run_id=run_id,
        recordings=[
            Recording(
                file=str(recording.path),
                readings=len(recording.readings),
                rests=len(one.rests),
                hint=one.hint,
            )
            for recording, one in zip(found.recordings, found.found, strict=True)
        ],
        lines=[
            Line(
                line=str(found.plan.lines[line.line_index]),
                line_index=line.line_index,
                found=line.line_index in measured,
                complete=line.line_index in measured and measured[line.line_index].complete,
                refusal=line.refusal,
                remarks=line.remarks,
            )
            for line in found.looked_for
        ],
        remarks=found.words,
    )


COMMAND = Command(
    "by-hand",
    Group.MEASURE,
    50,
    _add_options,
    run,
    help="find the stops of a plan in a recording without commands",
    description="Make a run from the recording of an instrument that was not connected to the"
    " control. The machine ran the NC program of 'stepdiag plan --nc' while the laser was"
    " recorded. The command matches the rests in the readings to the stops of the plan. A"
    " line with an ambiguous match gives no result, and the output states why. The bag is"
    " like that of any other run: use it with solve, diagnose, iso230 and replay --check."
    " docs/by_hand.md explains how to measure.",
    epilog="examples:\n"
    "  stepdiag by-hand laser.csv --mapping readings_in_time --plan my_plan.yaml\n"
    "  stepdiag by-hand x.csv y.csv z.csv ppp.csv --mapping my_laser.yaml --plan my_plan.yaml\n"
    "  stepdiag by-hand again.csv --lines 5-8 --mapping my_laser.yaml --plan my_plan.yaml\n"
    "  stepdiag solve laser_by_hand.mcap",
)
