"""Writes the files of a plan: all of them or none, and never over one that is there."""

import io
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.planning.candidates import PURPOSES
from stepdiag_ros.planning.proposal import PlanProposal
from stepdiag_ros.report.publish import PICTURE_FORMATS, whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def picture_bytes(plan: Plan, machine: Machine, path: Path) -> bytes:
    """Return the picture of a plan in the format of a path's ending.

    Raises:
        ValueError: another ending than that of a picture.
    """
    from stepdiag_ros import plots

    return drawn(lambda: plots.plan(plan, machine), path)


def frontier_bytes(proposal: PlanProposal, path: Path) -> bytes:
    """Return the picture of uncertainty against time; see ``picture_bytes``."""
    from stepdiag_ros import plots

    front, chosen = proposal.front, proposal.chosen
    return drawn(
        lambda: plots.frontier(
            [(one.duration.total, one.uncertainty) for one in front],
            (chosen.duration.total, chosen.uncertainty),
            PURPOSES[proposal.request.purpose].unit,
            small_print=(
                f"U: expected expanded uncertainty (95 %) of {proposal.figure}.",
                f"Proposed: {proposal.reason}.",
            ),
        ),
        path,
    )


def drawn(draw: "Callable[[], Figure]", path: Path) -> bytes:
    """Return a picture in the format of a path's ending; see ``picture_bytes``."""
    ending = format_of(path)
    stream = io.BytesIO()
    draw().savefig(stream, format=ending)
    return stream.getvalue()


def format_of(picture: Path) -> str:
    """Return the format of a picture by the ending of its path; see ``picture_bytes``."""
    ending = picture.suffix.lstrip(".")
    if ending not in PICTURE_FORMATS:
        raise ValueError(f"{picture}: pictures are written as .{', .'.join(PICTURE_FORMATS)}")
    return ending


def write_new(files: Mapping[Path, bytes], overwrite: bool) -> None:
    """Write files, each whole or not at all; nothing is written if one of them is refused.

    Args:
        files: path → content.
        overwrite: files that are there may be written over.

    Raises:
        ValueError: a file is there already, or its folder is not.
        OSError: a file cannot be written.
    """
    check_new(files, overwrite)
    for path, content in files.items():
        with whole_file(path) as partial:
            partial.write_bytes(content)


def check_new(paths: Iterable[Path], overwrite: bool) -> None:
    """Refuse files that ``write_new`` would refuse.

    Raises:
        ValueError: a file is there already, or its folder is not.
    """
    for path in paths:
        if path.is_dir():
            raise ValueError(f"{path} is a folder; name a file")
        if path.exists() and not overwrite:
            raise ValueError(f"{path} is there already; name another file, or overwrite by --force")
        if not path.parent.is_dir():
            raise ValueError(f"there is no folder {path.parent}; make it first")
