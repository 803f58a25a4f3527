"""Files of directly measured errors, as an option of the commands that solve a bag."""

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stepdiag_ros.metrology.direct import DirectMeasurement


def add_direct_option(parser: ArgumentParser) -> None:
    """Add the option that names the files."""
    parser.add_argument(
        "--direct",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="table of angles, straightness or squareness that were measured directly (.csv,"
        " form: 'stepdiag compare --help'), weighted by their uncertainty; may be given more than"
        " once. 'stepdiag direct' makes it from files of other programs",
    )


def direct_measurement(arguments: Namespace) -> "DirectMeasurement | None":
    """Return what was measured directly; None where nothing was.

    Raises:
        ValueError: a file cannot be read; one sentence.
    """
    if not arguments.direct:
        return None
    from stepdiag_ros.bags.direct_table import load_direct

    return load_direct(arguments.direct)
