"""``stepdiag import``: make a bag from a measurement that another program wrote."""

import argparse
import math
from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepdiag_ros import schemas
from stepdiag_ros.commands.output import HelpFormatter, number, say

if TYPE_CHECKING:
    from stepdiag_ros.bags.imports.imported import ImportOptions
    from stepdiag_ros.bags.imports.source import SourceFile

_FORMATS = """\
formats, found by content (docs/import.md says of each what is known and what is refused):
  run table            the plain form in which measurements are exchanged, see below
  Renishaw .rtl        linear positioning (also .rtl2, as far as it is text of this form)
  table of an axis     cycle,direction,target_mm,position_mm (as 'stepdiag iso230' reads it)
  anything else        text with columns, by a mapping file (config/imports has examples)

columns of a run table, in SI units, one row a stop in order of time:
  time_s, kind (linear, step_diagonal or diagonal),
  line (x y z; of a diagonal ppp npp pnp ppn, pp0 np0 p0p n0p 0pp 0np),
  order (XYZ …, empty unless step_diagonal), repeat (from 0), direction (forward or backward),
  stop (from 0), x_m, y_m, z_m (commanded), reading_m (zero at the line's first stop),
  air_temperature_degC, air_pressure_Pa, relative_humidity (0 to 1), material_temperature_degC;
  and only where they are needed (docs/import.md): setup, overrun_m, standard_uncertainty_m,
  settled, attempt, line_index

examples:
  stepdiag import run.csv                    writes run.mcap beside it
  stepdiag import run.csv --case case.yaml   with the chain, the box and the noise of the readings
  stepdiag import axis.rtl --axis X          a positioning test of another laser
  stepdiag import laser.csv --mapping runs_in_columns
  stepdiag import stream.csv --mapping readings_in_time --plan quick
  stepdiag iso230 axis.mcap                  then evaluates it"""


def _position(text: str) -> tuple[float, float, float]:
    parts = text.split(",")
    if len(parts) != 3:
        raise argparse.ArgumentTypeError(f"'{text}' is not three numbers: X,Y,Z in metres")
    x, y, z = (number(part, -1000.0, 1000.0) for part in parts)
    return x, y, z


def add_parser(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "import",
        help="make a bag from a measurement that another program wrote",
        description="Make a bag from a run table, a file of another laser system or any table of"
        " text. The file goes into the bag byte for byte. What cannot be read, is incomplete or"
        " contradicts itself is refused with the row and the reason; what the file does not tell"
        " is unknown.",
        epilog=_FORMATS,
        formatter_class=HelpFormatter,
    )
    parser.add_argument("table", type=Path, metavar="file", help="the file")
    parser.add_argument(
        "bag", type=Path, nargs="?", help="the bag to make (default: NAME.mcap beside the file)"
    )
    parser.add_argument(
        "--case",
        type=Path,
        metavar="FILE",
        help="of a run table: YAML with chain, origin_m, step_m, blocks, dead_path_m,"
        " reading_noise_m (default: case.yaml beside the table, if there is one)",
    )
    parser.add_argument(
        "--mapping",
        default="",
        metavar="FILE",
        help="YAML that says what the columns are: a path, or a name of config/imports",
    )
    parser.add_argument("--axis", default="", choices=("X", "Y", "Z"), help="that was tested")
    parser.add_argument(
        "--standing",
        type=_position,
        metavar="X,Y,Z",
        help="where the axes stood that did not move, machine coordinates in m",
    )
    parser.add_argument(
        "--directions",
        default="",
        choices=("same", "alternating"),
        help="how runs were measured that all stand in the same order in the file",
    )
    parser.add_argument(
        "--overrun",
        type=lambda text: number(text, 0.0, 1.0),
        metavar="M",
        help="how far beyond its first target each run along an axis began, so that this was"
        " approached in the sense of the run (default: not at all in a run table, else not known)",
    )
    parser.add_argument("--encoding", default="", help="of the text (default: found out)")
    parser.add_argument(
        "--decimal", default=".", choices=(".", ","), help="decimal sign in a .rtl (default: .)"
    )
    parser.add_argument(
        "--plan", default="", metavar="PLAN", help="that a stream of readings was measured by"
    )
    parser.add_argument("--json", action="store_true", help="print what was imported as JSON")
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Import the file; see the module."""
    from stepdiag_ros.bags.imports.registry import is_run_table
    from stepdiag_ros.bags.imports.source import read_source

    source = read_source(arguments.table)
    target = arguments.bag or arguments.table.parent / f"{arguments.table.stem}.mcap"
    if not arguments.mapping and (arguments.case is not None or is_run_table(source)):
        document = _run_table(arguments, target, source)
    else:
        document = _foreign(arguments, target, source)
    if arguments.json:
        print(schemas.json_text(schemas.document("import", document)))
        return 0
    what = f"{document['lines']} lines with {document['stops']} stops"
    if document["readings"]:
        what = f"{document['readings']} readings"
    print(f"{target}: {what}, {document['blocks']} blocks ({document['format']})")
    for remark in document["remarks"]:
        say(f"note: {remark}")
    return 0


def _run_table(arguments: Namespace, target: Path, source: "SourceFile") -> dict[str, Any]:
    from stepdiag_ros.bags.table import import_table

    measurement = import_table(
        arguments.table, arguments.case, target, arguments.overrun
    ).measurement
    return {
        "table": str(arguments.table),
        "bag": str(target),
        "lines": len(measurement.lines),
        "stops": sum(line.displacement.size for line in measurement.lines),
        "origin_m": list(measurement.volume.origin),
        "step_m": list(measurement.volume.step),
        "blocks": measurement.volume.blocks,
        "format": "run table",
        "readings": 0,
        "source_sha256": source.sha256,
        "facts": {},
        "remarks": [],
    }


def _foreign(arguments: Namespace, target: Path, source: "SourceFile") -> dict[str, Any]:
    from stepdiag_ros.bags.imports.registry import import_file

    made = import_file(arguments.table, target, _options(arguments))
    return {
        "table": str(arguments.table),
        "bag": str(target),
        "lines": len(made.lines),
        "stops": made.stops,
        "origin_m": list(made.volume.origin),
        "step_m": list(made.volume.step),
        "blocks": made.volume.blocks,
        "format": made.format,
        "readings": len(made.readings),
        "source_sha256": source.sha256,
        "facts": dict(made.facts),
        "remarks": list(made.remarks),
    }


def _options(arguments: Namespace) -> "ImportOptions":
    from stepdiag_ros.bags.imports.imported import ImportOptions
    from stepdiag_ros.configuration import find, read_text

    return ImportOptions(
        axis=arguments.axis,
        standing=arguments.standing,
        directions=arguments.directions,
        encoding=arguments.encoding,
        overrun=math.nan if arguments.overrun is None else arguments.overrun,
        decimal=arguments.decimal,
        mapping=arguments.mapping,
        plan=read_text(find(arguments.plan, "plans")) if arguments.plan else "",
    )
