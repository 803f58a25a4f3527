"""``stepdiag info``: what is in a bag, and whether it is whole."""

import sys
from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

from stepdiag_ros import schemas
from stepdiag_ros.commands.arguments import Command, Group, add_bag, add_common
from stepdiag_ros.commands.output import progress_bar

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stepdiag_ros.bags.info import BagInfo, RunInBag, SequenceGap
    from stepdiag_ros.bags.sample_check import SampleCheck
    from stepdiag_ros.metrology.time_alignment import RunTiming
    from stepdiag_ros.text.table import Table

_MOST_GAPS = 10


def _add_options(parser: ArgumentParser) -> None:
    add_bag(parser, "a bag (.mcap), or a folder of 'ros2 bag record'")
    add_common(parser, "run")
    add_common(parser, "json", help="print the summary as JSON")


def run(arguments: Namespace) -> int:
    """Show the summary; see the module."""
    from stepdiag_ros.bags.info import bag_info

    with progress_bar(f"checking {arguments.bag.name}"):
        info = bag_info(arguments.bag, arguments.run_id)
    if arguments.json:
        print(schemas.json_text(schemas.document("info", info.document())))
    else:
        _print(info)
    if info.problem:
        raise ValueError(info.problem)
    return 0


def _print(info: "BagInfo") -> None:
    from stepdiag_ros.text.console import make_console

    console = make_console(sys.stdout)
    rows = [("File", f"{info.path}, {info.size:,} bytes")]
    if info.header is not None:
        rows += [
            ("Run", info.header.run_id),
            ("Plan", info.header.plan_name),
            ("Made by", f"stepdiag_ros {info.header.software_version}, {info.header.middleware}"),
        ]
        rows += [("Source", text) for text in _source(info.header.facts)]
        rows += [("Run ended", _end(run)) for run in info.runs if run.end]
    else:
        rows += [("Run", _words_of(run)) for run in info.runs]
    rows += [
        ("Bag", _state(info)),
        ("Seal", "none" if info.seal is None else info.seal.text),
        *(("Recording", flaw.sentence) for flaw in info.flaws),
    ]
    if info.intact is not False and info.complete:
        rows += [
            ("Messages", _messages(info)),
            ("Lines", str(len(info.lines))),
            ("Readings", _gaps(info)),
        ]
        rows += [("Samples", _samples(check)) for check in info.samples.values()]
        if info.timing is not None:
            rows.append(("Timing", _timing(info.timing, info.settle)))
        if info.diagnosis:
            rows.append(("Diagnosis", info.diagnosis))
    for name, text in rows:
        console.sentence(f"{name + ':':<11}{text}", indent=" " * 11)
    if info.topics:
        console.print()
        console.print(_topics(info))


def _source(facts: "Mapping[str, str]") -> list[str]:
    """Return what an imported bag states about its source file, in lines."""
    if "source_file" not in facts:
        return []
    told = [f"{facts['source_file']}, SHA-256 {facts.get('source_sha256', 'unknown')}"]
    for name, text in facts.items():
        if name.startswith("source: "):
            told.append(f"{name.removeprefix('source: ')}: {text}")
        elif name.startswith("remark "):
            told.append(f"note: {text}")
    return told


def _words_of(run: "RunInBag") -> str:
    where = "" if run.namespace == "/" else f" in {run.namespace}"
    plan = run.plan or "with a plan that cannot be read"
    end = f": {_end(run)}" if run.end else ""
    return f"{run.run_id}{where}: {plan} (stepdiag_ros {run.software_version}){end}"


def _end(run: "RunInBag") -> str:
    stops = f" ({run.stops_done} of {run.stops_total} stops)" if run.stops_total else ""
    return run.end + stops


def _state(info: "BagInfo") -> str:
    if not info.complete:
        return "not closed: still being recorded, or cut off (then: stepdiag recover)"
    if info.intact is None:
        return "complete, checksums not checked"
    return "complete, every checksum is right" if info.intact else "DAMAGED: a checksum is wrong"


def _messages(info: "BagInfo") -> str:
    again = f"; {info.repetitions} of them repeated" if info.repetitions else ""
    return f"{info.messages} over {info.duration:.1f} s in {info.chunks} chunks{again}"


def _gaps(info: "BagInfo") -> str:
    from stepdiag_ros.topics import READING

    counts = [count for name, count in info.topics.values() if name == READING.type_name]
    if not counts:
        return "none recorded"
    if not info.gaps:
        return f"{sum(counts)}, none missing"
    found = []
    gaps = [gap for gap in info.gaps if gap.missing]
    if gaps:
        missing = sum(gap.missing for gap in gaps)
        found.append(f"{missing} MISSING in {len(gaps)} gaps of the sequence: {_listed(gaps)}")
    restarts = [gap for gap in info.gaps if not gap.missing]
    if restarts:
        found.append(
            f"the count went back {len(restarts)} times ({_listed(restarts)}); how many readings"
            " are missing there is unknown"
        )
    return "; ".join(found)


def _listed(gaps: "Sequence[SequenceGap]") -> str:
    more = " …" if len(gaps) > _MOST_GAPS else ""
    return ", ".join(f"{gap.after} to {gap.before}" for gap in gaps[:_MOST_GAPS]) + more


def _samples(check: "SampleCheck") -> str:
    missing = f"{check.missing:,} MISSING" if check.missing else "none missing"
    told = f"{check.samples:,} at {check.rate:,.0f} Hz in {check.blocks:,} blocks, {missing}"
    if check.different:
        return f"{told}; {check.different} of {check.made} readings DO NOT FOLLOW from them"
    return f"{told}; {check.made:,} readings follow from them, bit for bit"


def _timing(timing: "RunTiming", settle: float) -> str:
    from stepdiag_ros.run.timing import effect_on_stops, in_words, worrying

    told = in_words(timing)
    if timing.offset.reason:
        return told
    mark = "TOO LATE: " if worrying(timing.offset, settle) else ""
    return f"{mark}{told}; {effect_on_stops(timing.offset, settle)}"


def _topics(info: "BagInfo") -> "Table":
    from stepdiag_ros.text.table import Column, Table

    columns = [Column("topic", wraps=True), Column("type", wraps=True)]
    table = Table("", [*columns, Column("messages", number=True, wraps=True)], gap=3)
    for name, (type_name, count) in info.topics.items():
        table.add_row(name, type_name, str(count))
    return table


COMMAND = Command(
    "info",
    Group.LOOK_AFTER,
    10,
    _add_options,
    run,
    help="show the contents of a bag, and whether it is complete",
    description="Show the measurement that a bag holds, the recorded topics, whether every"
    " checksum is right and whether readings of the interferometer are missing. The exit code is"
    " 1 if the bag is damaged or cut off.",
    epilog="example:\n  stepdiag info run.mcap",
)
