"""``stepdiag import``: make a bag from a measurement that another program wrote."""

import argparse
import math
from argparse import ArgumentParser, Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepdiag_ros import schemas
from stepdiag_ros.commands.arguments import Command, Group, add_common
from stepdiag_ros.commands.output import number, say
from stepdiag_ros.metrology.refusal import Refusal

if TYPE_CHECKING:
    from stepdiag_ros.bags.imports.imported import ImportOptions
    from stepdiag_ros.bags.imports.source import SourceFile
    from stepdiag_ros.bags.run import RecordedRun

_FORMATS = """\
formats, detected by content (docs/import.md describes each of them):
  run table            CSV of this package in SI units, see below
  Renishaw .rtl        linear positioning (also .rtl2, if it is such a text)
  table of an axis     cycle,direction,target_mm,position_mm ('stepdiag iso230')
  anything else        text with columns, by a mapping file (config/imports)

columns of a run table, in SI units, one row a stop in order of time:
  time_s, kind (linear, step_diagonal or diagonal),
  line (x y z; of a diagonal ppp npp pnp ppn, pp0 np0 p0p n0p 0pp 0np),
  order (XYZ …, empty unless step_diagonal), repeat (from 0),
  direction (forward or backward), stop (from 0), x_m, y_m, z_m (commanded),
  reading_m (zero at the line's first stop), air_temperature_degC,
  air_pressure_Pa, relative_humidity (0 to 1), material_temperature_degC;
  and only where they are needed (docs/import.md): setup, overrun_m,
  mirror_offset_m, standard_uncertainty_m, settled, attempt, line_index

examples:
  stepdiag import run.csv                    writes run.mcap beside it
  stepdiag import run.csv --case case.yaml   with chain, box and noise
  stepdiag import axis.rtl --axis X          a positioning test of another laser
  stepdiag import d1.rtl d2.rtl d3.rtl d4.rtl run.mcap --axis ppp npp pnp ppn
      --box 0 0 0 0.5 0.4 0.3                four diagonals, one measurement
  stepdiag import laser.csv --mapping runs_in_columns
  stepdiag import stream.csv --mapping readings_in_time --plan quick
  stepdiag iso230 axis.mcap                  then evaluates it"""


def _position(text: str) -> tuple[float, float, float]:
    parts = text.split(",")
    if len(parts) != 3:
        raise argparse.ArgumentTypeError(f"'{text}' is not three numbers: X,Y,Z in metres")
    x, y, z = (number(part, -1000.0, 1000.0) for part in parts)
    return x, y, z


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument(
        "paths",
        type=Path,
        nargs="*",
        metavar="file",
        help="file to import; or several files with a test of one line each, with an --axis for"
        " each. The bag to make may follow (default: NAME.mcap beside the first file)",
    )
    parser.add_argument(
        "--case",
        type=Path,
        metavar="FILE",
        help="of a run table: YAML with chain, origin_m, step_m, blocks, dead_path_m,"
        " reading_noise_m, one_alignment_per_diagonal and other keys of the plan (docs/import.md;"
        " default: case.yaml beside the table, if there is one)",
    )
    parser.add_argument(
        "--mapping",
        default="",
        metavar="FILE",
        help="YAML file that describes the columns: a path, or a name of config/imports",
    )
    parser.add_argument(
        "--axis",
        nargs="+",
        default=[],
        metavar="NAME",
        help="tested axis or diagonal of each file, in the order of the files: X Y Z, or a"
        " diagonal (ppp npp pnp ppn, pp0 np0 p0p n0p 0pp 0np: p, the axis runs up, n, it runs"
        " down). Targets of a diagonal are distances along it",
    )
    parser.add_argument(
        "--box",
        nargs=6,
        type=lambda text: number(text, -1000.0, 1000.0),
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="for diagonals: two corners of the measured volume, between which they run from the"
        " first target to the last, machine coordinates in m",
    )
    parser.add_argument(
        "--chain",
        default="",
        choices=("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"),
        help="for a tracker's table: order of the axes from workpiece to tool",
    )
    parser.add_argument(
        "--standing",
        type=_position,
        metavar="X,Y,Z",
        help="positions of the standing axes, machine coordinates in m",
    )
    parser.add_argument(
        "--directions",
        default="",
        choices=("same", "alternating"),
        help="direction of the runs, if all have the same order in the file",
    )
    parser.add_argument(
        "--overrun",
        type=lambda text: number(text, 0.0, 1.0),
        metavar="M",
        help="how far beyond its first target each run along an axis began, so that the first"
        " target was approached in the direction of the run (default: 0 in a run table, else"
        " unknown)",
    )
    parser.add_argument("--encoding", default="", help="encoding of the text (default: detected)")
    parser.add_argument(
        "--decimal",
        default=".",
        choices=(".", ","),
        metavar="SIGN",
        help="decimal sign in a .rtl, a point or a comma (default: .)",
    )
    parser.add_argument(
        "--plan",
        default="",
        metavar="PLAN",
        help="plan of the measurement, for a stream of readings",
    )
    add_common(parser, "json", help="print what was imported as JSON")


def run(arguments: Namespace) -> int:
    """Import the file; see the module."""
    from stepdiag_ros.bags.imports.made import what_was_made
    from stepdiag_ros.bags.imports.registry import is_run_table, recognised
    from stepdiag_ros.bags.imports.source import read_source
    from stepdiag_ros.bags.run import load_run

    axes, paths = _axes_and_paths(arguments.axis, arguments.paths)
    tables, target = _files_and_bag(paths, len(axes))
    sources = [read_source(path) for path in tables]
    run_table = len(sources) == 1 and not arguments.mapping
    asked_for = arguments.case is not None and recognised(sources[0]) is None
    if run_table and (asked_for or is_run_table(sources[0])):
        document = _run_table(arguments, tables[0], target, sources[0])
    else:
        document = _foreign(arguments, axes, tables, target, sources)
    made = load_run(target)
    document["remarks"] += _limits(made)
    if arguments.json:
        print(schemas.json_text(schemas.document("import", document)))
        return 0
    what = f"{document['lines']} passes with {document['stops']} stops"
    if document["readings"]:
        what = f"{document['readings']} readings"
    print(f"{target}: {what}, {document['blocks']} blocks ({document['format']})")
    for sentence in what_was_made(made):
        print(sentence)
    for remark in document["remarks"]:
        say(f"note: {remark}")
    return 0


def _limits(run: "RecordedRun") -> list[str]:
    """Return what an imported run lacks: runs, errors that it does not determine, digits, chain."""
    from stepdiag_ros.bags.imports.made import NO_CHAIN, lacks_chain, unequal_runs
    from stepdiag_ros.metrology.solvers.observations import observe, unevenly_spaced
    from stepdiag_ros.planning.undetermined import undetermined

    # 'solve' cannot use unevenly spaced targets, so that further lines would not help.
    solvable = run.plan.tracker is None and not unevenly_spaced(
        run.measurement.lines, run.plan.volume
    )
    unknown = undetermined(run.plan).sentence if solvable else ""
    return [
        *unequal_runs(run),
        *filter(None, [unknown]),
        *(observe(run.measurement).rounding_remarks if solvable else []),
        *([NO_CHAIN] if lacks_chain(run) else []),
    ]


def _axes_and_paths(named: list[str], paths: list[Path]) -> tuple[list[str], list[Path]]:
    """Take the files out of what stands behind --axis: they may be named before it or after it."""
    from stepdiag_ros.bags.imports.placing import TESTED

    known = {name.lower(): name for name in TESTED}
    axes = [known[one.lower()] for one in named if one.lower() in known]
    behind = [Path(one) for one in named if one.lower() not in known]
    for one in behind:
        if not one.suffix and not one.exists():
            raise ValueError(f"--axis: '{one}' is unknown. Use one of {', '.join(TESTED)}")
    if not paths and not behind:
        raise ValueError("no file is named; say which to import")
    return axes, [*paths, *behind]


def _files_and_bag(paths: list[Path], axes: int) -> tuple[list[Path], Path]:
    """Return the files to read and the bag to make.

    Raises:
        ValueError: it cannot be seen which is which.
    """
    count = axes
    if not axes:
        # Every file says itself what it is a test of; the bag is known by its name.
        ends = len(paths) == 2 or (len(paths) > 2 and paths[-1].suffix == ".mcap")
        count = len(paths) - ends
    if len(paths) not in (count, count + 1):
        raise ValueError(
            f"{len(paths)} files and {count} names behind --axis: name for each file the axis or"
            " diagonal that it is a test of, in the same order; the bag to make comes last"
        )
    default = paths[0].parent / f"{paths[0].stem}.mcap"
    return paths[:count], paths[count] if len(paths) > count else default


def _run_table(
    arguments: Namespace, table: Path, target: Path, source: "SourceFile"
) -> dict[str, Any]:
    from stepdiag_ros.bags.imports.made import overrun_passed_over
    from stepdiag_ros.bags.table import import_table

    for name in ("axis", "box", "standing", "directions", "plan", "chain", "encoding", "decimal"):
        if getattr(arguments, name) and getattr(arguments, name) != ".":
            raise Refusal(
                f"--{name} has no effect on {table}, a run table: it contains its lines and"
                f" places, and is UTF-8 with decimal points. Leave out --{name}",
                fault="mismatch",
                about=f"--{name}",
            )
    made = import_table(table, arguments.case, target, arguments.overrun)
    measurement = made.measurement
    return {
        "table": str(table),
        "bag": str(target),
        "lines": len(measurement.lines),
        "stops": sum(line.displacement.size for line in measurement.lines),
        "origin_m": list(measurement.volume.origin),
        "step_m": list(measurement.volume.step),
        "blocks": measurement.volume.blocks,
        "format": "run table",
        "readings": 0,
        "source_sha256": source.sha256,
        "files": _files([source]),
        "facts": dict(made.case.facts),
        "remarks": overrun_passed_over(arguments.overrun or 0.0, measurement.lines),
    }


def _foreign(
    arguments: Namespace,
    axes: list[str],
    tables: list[Path],
    target: Path,
    sources: list["SourceFile"],
) -> dict[str, Any]:
    from stepdiag_ros.bags.imports.registry import import_files

    if arguments.case is not None:
        raise Refusal(
            f"--case is for a run table, and {tables[0]} is not read as one. "
            + ("State chain and box in the mapping file" if arguments.mapping else "Leave it out"),
            fault="mismatch",
            about="--case",
        )
    said = _options(arguments)
    options = [replace(said, axis=axis) for axis in axes or [""] * len(tables)]
    made = import_files(tables, target, options)
    return {
        "table": str(tables[0]),
        "bag": str(target),
        "lines": len(made.lines),
        "stops": made.stops,
        "origin_m": list(made.volume.origin),
        "step_m": list(made.volume.step),
        "blocks": made.volume.blocks,
        "format": made.format,
        "readings": len(made.readings),
        "source_sha256": sources[0].sha256,
        "files": _files(sources),
        "facts": dict(made.facts),
        "remarks": list(made.remarks),
    }


def _files(sources: list["SourceFile"]) -> list[dict[str, str]]:
    return [{"file": source.name, "sha256": source.sha256} for source in sources]


def _options(arguments: Namespace) -> "ImportOptions":
    from stepdiag_ros.bags.imports.imported import ImportOptions
    from stepdiag_ros.configuration import find, read_text

    box = None
    if arguments.box:
        x0, y0, z0, x1, y1, z1 = arguments.box
        if not (x0 < x1 and y0 < y1 and z0 < z1):
            raise ValueError("--box: X1, Y1 and Z1 must be larger than X0, Y0 and Z0")
        box = ((x0, y0, z0), (x1, y1, z1))
    return ImportOptions(
        box=box,
        standing=arguments.standing,
        directions=arguments.directions,
        chain=arguments.chain,
        encoding=arguments.encoding,
        overrun=math.nan if arguments.overrun is None else arguments.overrun,
        decimal=arguments.decimal,
        mapping=arguments.mapping,
        plan=read_text(find(arguments.plan, "plans")) if arguments.plan else "",
    )


COMMAND = Command(
    "import",
    Group.EXCHANGE,
    10,
    _add_options,
    run,
    help="make a bag from a measurement of another program",
    description="Make a bag from a run table, a file of another laser system or any table of"
    " text. The file goes into the bag byte for byte. The command refuses a file that it cannot"
    " read or that is incomplete or contradictory, and names the row and the reason. Values that"
    " the file does not state are unknown.",
    epilog=_FORMATS,
)
