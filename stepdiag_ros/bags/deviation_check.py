"""Refuses a deviation that differs so far from the others of its run that its unit is doubtful."""

from collections.abc import Sequence
from typing import NamedTuple

from stepdiag_ros.bags.table_rows import refusal

LARGEST_PART = 0.002
LARGEST_ANYWHERE = 0.2e-3
"""Part of the measured length, and m on short ones, by which deviations of a run may differ; more
is taken for a mistaken unit."""


class Deviation(NamedTuple):
    """One deviation of a run.

    Attributes:
        row: line of the file.
        target: commanded position, m.
        value: measured less commanded position, m.
    """

    row: int
    target: float
    value: float


def check_deviations(source: str, run: Sequence[Deviation], length: float) -> None:
    """Compare the deviations of a run with their median.

    Args:
        source: of the file, for the text of an error.
        run: at least one deviation.
        length: from the first to the last target, m.

    Raises:
        TableError: a deviation differs by more than ``LARGEST_PART`` of the length and by more than
            ``LARGEST_ANYWHERE``; names file and row.
    """
    middle = sorted(one.value for one in run)[len(run) // 2]
    for one in run:
        if abs(one.value - middle) > max(LARGEST_PART * length, LARGEST_ANYWHERE):
            raise refusal(
                source,
                one.row,
                f"the deviation {1e6 * one.value:g} µm at {1e3 * one.target:g} mm differs"
                f" from the others of its run by {1e6 * (one.value - middle):.4g} µm;"
                " check its unit",
                fault="mismatch",
            )
