"""``stepdiag import``: make a bag from a run table (CSV)."""

from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path

from stepdiag_ros import schemas
from stepdiag_ros.commands.output import HelpFormatter

_COLUMNS = """\
columns, in SI units, one row a stop in order of time:
  time_s, kind (linear or step_diagonal), line (x y z, ppp npp pnp ppn),
  order (XYZ …, empty if linear), repeat (from 0), direction (forward or backward),
  stop (from 0), x_m, y_m, z_m (commanded), reading_m (zero at the line's first stop),
  air_temperature_degC, air_pressure_Pa, relative_humidity (0 to 1), material_temperature_degC

examples:
  stepdiag import run.csv                  writes run.mcap beside it
  stepdiag import run.csv --case case.yaml with the chain, the box and the noise of the readings
  stepdiag solve run.mcap                  then computes the errors"""


def add_parser(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "import",
        help="make a bag from a table of a measurement (CSV)",
        description="Make a bag from a run table, the plain form in which measurements are "
        "exchanged. A table that cannot be read, is incomplete or contradicts itself is refused"
        " with the row and the reason.",
        epilog=_COLUMNS,
        formatter_class=HelpFormatter,
    )
    parser.add_argument("table", type=Path, help="the run table (.csv)")
    parser.add_argument(
        "bag", type=Path, nargs="?", help="the bag to make (default: NAME.mcap beside the table)"
    )
    parser.add_argument(
        "--case",
        type=Path,
        metavar="FILE",
        help="YAML with chain, origin_m, step_m, blocks, dead_path_m, reading_noise_m"
        " (default: case.yaml beside the table, if there is one)",
    )
    parser.add_argument("--json", action="store_true", help="print what was imported as JSON")
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Import the table; see the module."""
    from stepdiag_ros.bags.table import import_table

    target = arguments.bag or arguments.table.parent / f"{arguments.table.stem}.mcap"
    measurement = import_table(arguments.table, arguments.case, target).measurement
    stops = sum(line.displacement.size for line in measurement.lines)
    if arguments.json:
        document = {
            "table": str(arguments.table),
            "bag": str(target),
            "lines": len(measurement.lines),
            "stops": stops,
            "origin_m": list(measurement.volume.origin),
            "step_m": list(measurement.volume.step),
            "blocks": measurement.volume.blocks,
        }
        print(schemas.json_text(schemas.document("import", document)))
    else:
        print(
            f"{target}: {len(measurement.lines)} lines with {stops} stops,"
            f" {measurement.volume.blocks} blocks"
        )
    return 0
