"""``stepdiag direct``: a table of directly measured errors from a file of another program."""

import math
from argparse import ArgumentParser, Namespace
from functools import partial
from pathlib import Path

from stepdiag_ros.commands.arguments import Command, Group, add_common
from stepdiag_ros.commands.output import number, say
from stepdiag_ros.metrology.units import MILLI

_CURVES = tuple(f"E_{error}{axis}" for axis in "XYZ" for error in "XYZABC")
_UNITS = ("urad", "mrad", "arcsec", "nm", "um", "mm")
"""As in ``bags.imports.renishaw_direct``, which is slow to import."""

_EXAMPLES = """\
the file states neither the error nor its unit nor its uncertainty, so you give
them. They must agree with the kind of test (angles or straightness) and the axis
that the file states.

examples:
  stepdiag direct pitch.rta --curve E_BX --unit arcsec --uncertainty 0.2
                                                  writes pitch_E_BX.csv beside it
  stepdiag direct side.rts --curve E_YX --unit um --uncertainty 0.1 --standing 0 150 80
                                                  measured with Y at 150 mm and Z at 80 mm
  stepdiag solve run.mcap --direct pitch_E_BX.csv uses it"""


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="the file")
    parser.add_argument(
        "--curve", required=True, choices=_CURVES, metavar="NAME", help="the error, such as E_BX"
    )
    parser.add_argument(
        "--unit", required=True, choices=_UNITS, help="unit of the deviations in the file"
    )
    parser.add_argument(
        "--uncertainty",
        required=True,
        type=partial(number, low=1e-9, high=1e6),
        metavar="U",
        help="standard uncertainty of a deviation without its scatter over the runs, in this unit",
    )
    for name, what in (
        (
            "standing",
            "positions of the axes, machine coordinates in mm; the value for the moving axis is"
            " ignored (default: unknown)",
        ),
        (
            "reflector",
            "vector from the mirror of the laser lines to the point that was measured, in mm"
            " (default: 0 0 0)",
        ),
    ):
        parser.add_argument(
            f"--{name}",
            type=partial(number, low=-1e5, high=1e5),
            nargs=3,
            metavar=("X", "Y", "Z"),
            help=what,
        )
    parser.add_argument(
        "--decimal",
        choices=(".", ","),
        default=".",
        metavar="SIGN",
        help="decimal sign, a point or a comma (default: .)",
    )
    parser.add_argument("--encoding", default="", help="encoding of the text (default: detected)")
    add_common(parser, "output", metavar="TABLE", help="default: NAME_CURVE.csv beside the file")


def run(arguments: Namespace) -> int:
    """Write the table; see the module."""
    from stepdiag_ros.bags.imports.renishaw_direct import UNITS, FileFacts, read_direct_test
    from stepdiag_ros.bags.imports.source import read_source
    from stepdiag_ros.metrology.direct import DirectPlace, direct_text
    from stepdiag_ros.report.files import write_new

    def point(given: "list[float] | None", untold: float) -> tuple[float, float, float]:
        x, y, z = [untold] * 3 if given is None else [MILLI * value for value in given]
        return x, y, z

    told = FileFacts(
        curve=arguments.curve,
        unit=arguments.unit,
        uncertainty=arguments.uncertainty * UNITS[arguments.unit],
        place=DirectPlace(point(arguments.standing, math.nan), point(arguments.reflector, 0.0)),
        decimal=arguments.decimal,
        encoding=arguments.encoding,
    )
    direct = read_direct_test(read_source(arguments.file), told)
    target = arguments.output or arguments.file.with_name(
        f"{arguments.file.stem}_{arguments.curve}.csv"
    )
    content = direct_text(direct).encode()
    write_new({target: content}, remedy="name another file with --output")
    curve = direct.curves[arguments.curve]
    repeats, positions = curve.values.shape
    say(f"{arguments.curve} at {positions} positions, {repeats} runs: {target}")
    return 0


COMMAND = Command(
    "direct",
    Group.EXCHANGE,
    20,
    _add_options,
    run,
    help="make a table of directly measured errors (.rta, .rts)",
    description="Make the table of direct measurements for 'stepdiag solve --direct' and"
    " 'stepdiag compare --measured' from a file of Renishaw's laser software: angles (.rta),"
    " straightness (.rts) or positioning (.rtl).",
    epilog=_EXAMPLES,
)
