"""``stepdiag compensate-nc``: an NC program rewritten with the identified errors of the machine."""

import argparse
import hashlib
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepdiag_ros.commands.arguments import Command, Group, add_common
from stepdiag_ros.commands.compensate import (
    add_despite_option,
    add_seal_option,
    each_once,
    permitted,
    refuse_unsealed,
)
from stepdiag_ros.commands.output import number, progress_bar
from stepdiag_ros.metrology.refusal import Refusal

if TYPE_CHECKING:
    from stepdiag_ros.compensation.identified import Identified
    from stepdiag_ros.compensation.nc_rewrite import RewriteSettings

_MILLI, _MICRO = 1e-3, 1e-6
# Every byte is a sign of its own in it: what is not changed stays as it is, in any encoding.
_BYTES = "latin-1"
_EPILOG = """\
the command reads ISO 6983 programs: G0 to G3 (I J K, or R), G17 to G19,
G20/G21, G53 to G59.3, G90/G91, G43 H, G28/G30, N words, comments, F S T M. It
refuses everything else that moves the axes or changes the meaning of
coordinates, and names the line: cutter compensation, subprograms, macros,
probing, rotated, scaled and polar coordinates, other axes. See
docs/compensate_nc.md.

The work offsets are those set in the control when the program runs: machine
coordinates of the workpiece zero. The errors depend on where the axes really
stand, so the program is correct only for these work offsets.

examples:
  stepdiag compensate-nc part.nc run.mcap --offset G54=150,-150,-300
  stepdiag compensate-nc part.nc run_results/results.json \\
      --offset G54=150,-150,-300 --tool-length 1=85.2 --tolerance 1 \\
      --outside hold --output part_corrected.nc"""


def _triple(text: str) -> tuple[float, float, float]:
    parts = text.split(",")
    if len(parts) != 3:
        raise argparse.ArgumentTypeError(f"'{text}' is not three numbers: X,Y,Z in mm")
    x, y, z = (_MILLI * number(part, -1e6, 1e6) for part in parts)
    return x, y, z


def _offset(text: str) -> tuple[str, tuple[float, float, float]]:
    name, equals, place = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"'{text}' is not G54=X,Y,Z")
    return name.strip().upper(), _triple(place)


def _tool(text: str) -> tuple[int, float]:
    name, equals, length = text.partition("=")
    digits = name.strip().upper().removeprefix("H")
    if not equals or not digits.isdecimal():
        raise argparse.ArgumentTypeError(f"'{text}' is not H=LENGTH, for example 1=85.2")
    return int(digits), _MILLI * number(length, -1e4, 1e4)


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument("program", type=Path, help="the NC program")
    parser.add_argument(
        "result",
        type=Path,
        help="the measurement (.mcap), results.json of 'stepdiag solve', or the map of 'stepdiag"
        " compensate --for generic'",
    )
    add_common(parser, "run")
    add_common(parser, "method")
    parser.add_argument(
        "--offset",
        type=_offset,
        action="append",
        default=[],
        metavar="G54=X,Y,Z",
        help="machine coordinates of a workpiece zero in mm; once for each system in use",
    )
    parser.add_argument(
        "--tool-length",
        type=_tool,
        action="append",
        default=[],
        metavar="H=MM",
        help="what G43 H adds to the machine coordinate Z, in mm; once for each H in use",
    )
    parser.add_argument(
        "--start",
        type=_triple,
        metavar="X,Y,Z",
        help="machine coordinates where the program begins, in mm (default: not known)",
    )
    parser.add_argument(
        "--tolerance",
        type=lambda text: _MICRO * number(text, 0.01, 1000.0),
        default=2e-6,
        metavar="UM",
        help="largest deviation of the tool from its path in feed moves, in µm (default: 2)",
    )
    parser.add_argument(
        "--decimals",
        type=int,
        choices=range(3, 8),
        default=4,
        help="decimals of a millimetre in the written program (default: 4)",
    )
    parser.add_argument(
        "--outside",
        choices=("refuse", "hold"),
        default="refuse",
        help="outside the measured box: refuse the program, or use the correction of the nearest"
        " point of the box (default: refuse)",
    )
    parser.add_argument(
        "--cycles",
        choices=("refuse", "pass"),
        default="refuse",
        help="canned cycles: refuse them, or pass them uncorrected (default: refuse)",
    )
    add_common(parser, "output", metavar="FILE", help="default: NAME_corrected beside the program")
    add_seal_option(parser)
    add_despite_option(parser)
    add_common(parser, "json", help="print the report as JSON")


def run(arguments: Namespace) -> int:
    """Rewrite the program; see the module."""
    from stepdiag_ros.compensation.nc_proof import prove
    from stepdiag_ros.compensation.nc_readback import refuse_foreign_words
    from stepdiag_ros.compensation.nc_rewrite import rewrite
    from stepdiag_ros.evaluation.nc_correction import NcReport
    from stepdiag_ros.report.documents.nc_correction import nc_json
    from stepdiag_ros.report.files import whole_file
    from stepdiag_ros.report.tables.nc_correction import text_lines

    program: Path = arguments.program
    data = program.read_bytes()
    target = arguments.output or program.with_name(f"{program.stem}_corrected{program.suffix}")
    if target.exists():
        raise ValueError(f"{target} exists already; a program is never overwritten")
    with progress_bar(f"rewriting {program.name}") as progress:
        refuse_unsealed(arguments, arguments.result)
        identified = permitted(
            _identified(arguments.result, arguments.method, arguments.run_id),
            *(arguments.result, arguments.despite_verdict),
        )
        settings = _settings(arguments)
        text = data.decode(_BYTES)
        digest = hashlib.sha256(data).hexdigest()
        progress(0.3, "correcting")
        made = rewrite(
            text, str(program), identified.error_map, settings, _header(identified, program, digest)
        )
        if not made.changed:
            raise Refusal(
                f"{program} has no move that can be corrected; nothing is written. Name a program"
                " that moves X, Y or Z",
                fault="missing",
                about="move",
                where=str(program),
            )
        progress(0.6, "proving")
        refuse_foreign_words(text, made)
        proof = prove(text, made, identified.error_map, settings.program)
    report = NcReport(
        program=str(program),
        program_sha256=digest,
        written=str(target),
        origin=identified.origin,
        settings=settings,
        rewritten=made,
        proof=proof,
        remarks=identified.remarks,
    )
    if proof.after.largest > settings.tolerance:
        raise ValueError(
            f"{program}: the tool would be {1e6 * proof.after.largest:.3g} µm away from its way in"
            f" line {proof.after.line}, more than the tolerance; nothing is written"
        )
    with whole_file(target) as partial:
        partial.write_bytes(made.text.encode(_BYTES))
    if arguments.json:
        print(nc_json(report))
    else:
        print("\n".join([*text_lines(report), f"written: {target}"]))
    return 0


def _identified(path: Path, method: str, run_id: str | None) -> "Identified":
    from stepdiag_ros import schemas
    from stepdiag_ros.commands.compensate import load_identified
    from stepdiag_ros.commands.standard_tests import is_bag
    from stepdiag_ros.compensation.generic import map_from_text
    from stepdiag_ros.compensation.identified import require_run
    from stepdiag_ros.configuration import read_text

    if not is_bag(path) and schemas.identifier("volumetric_map") in read_text(path):
        return require_run(map_from_text(read_text(path), str(path)), path, run_id)
    return load_identified(path, method, run_id)


def _settings(arguments: Namespace) -> "RewriteSettings":
    from stepdiag_ros.compensation.nc_reading import NcSettings
    from stepdiag_ros.compensation.nc_rewrite import RewriteSettings

    given: dict[str, Any] = {
        "offsets": each_once("--offset", arguments.offset),
        "tool_lengths": each_once("--tool-length", arguments.tool_length),
        "start": arguments.start,
        "cycles": arguments.cycles == "pass",
    }
    return RewriteSettings(
        tolerance=arguments.tolerance,
        decimals=arguments.decimals,
        outside=arguments.outside,
        program=NcSettings(**given),
    )


def _header(identified: "Identified", program: Path, digest: str) -> list[str]:
    """Return what the program was made from, text by text."""
    from stepdiag_ros import __version__

    return [
        f"corrected by stepdiag_ros {__version__} from {program.name}",
        f"SHA-256 of that program: {digest}",
        *identified.origin.lines(),
        "only for the machine and the set-up that it was made for",
    ]


COMMAND = Command(
    "compensate-nc",
    Group.CORRECT,
    20,
    _add_options,
    run,
    help="rewrite an NC program for the errors of a machine",
    description="Replace every target of an NC program by the target with which the tool of this"
    " machine reaches the programmed position, divide feed moves so that the tool stays within a"
    " tolerance of its path, and run both programs through the model of the machine to show the"
    " remaining errors.",
    epilog=_EPILOG,
)
