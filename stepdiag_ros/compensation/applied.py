"""What a control does with its tables: the positions to which it sends a machine.

A table is read at the position of one axis and corrects one axis, the same or another. ``TableSet``
applies tables as a control does, so that what remains of the errors can be computed from a file
that was written, its rounding and spacing included, before anybody loads it.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stepdiag_ros.metrology.geometry import Vector


class Applied(Protocol):
    """A compensation that is switched on."""

    def sent(self, targets: Vector, forward: bool) -> Vector:
        """Return where the axes are sent for some targets.

        Args:
            targets: machine coordinates, m, shape (n, 3).
            forward: every axis comes to its target in the positive direction; else in the negative.

        Returns:
            m, shape (n, 3).
        """
        ...


@dataclass(frozen=True)
class ControlTable:
    """One table of a control.

    Attributes:
        moving: axis (0, 1, 2) at whose position the table is read.
        corrected: axis (0, 1, 2) that is corrected.
        positions: of the moving axis, m, ascending, shape (n,), n >= 1.
        forward: what the control adds to the target of the corrected axis while the moving axis
            goes in the positive direction, m, shape (n,).
        backward: the same for the negative direction.
        stepped: the correction jumps in the middle between two positions; else it is linear.

    Raises:
        ValueError: the positions do not ascend, or shapes do not fit.
    """

    moving: int
    corrected: int
    positions: Vector
    forward: Vector
    backward: Vector
    stepped: bool = False

    def __post_init__(self) -> None:
        if len(self.positions) < 1 or not np.all(np.diff(self.positions) > 0):
            raise ValueError("the positions of a compensation table do not ascend")
        if not self.positions.shape == self.forward.shape == self.backward.shape:
            raise ValueError("a compensation table has not as many values as positions")

    def at(self, positions: Vector, forward: bool) -> Vector:
        """Return the correction at positions of the moving axis, m; constant beyond the ends."""
        values = self.forward if forward else self.backward
        if self.stepped and len(values) > 1:
            middles = 0.5 * (self.positions[1:] + self.positions[:-1])
            picked: Vector = values[np.searchsorted(middles, positions, side="right")]
            return picked
        linear: Vector = np.interp(positions, self.positions, values)
        return linear


@dataclass(frozen=True)
class TableSet:
    """All tables of a control; those that correct the same axis add up (``Applied``)."""

    tables: tuple[ControlTable, ...]

    def sent(self, targets: Vector, forward: bool) -> Vector:
        """Return where the axes are sent (see ``Applied.sent``)."""
        places = np.array(targets, dtype=np.float64)
        for table in self.tables:
            places[:, table.corrected] += table.at(targets[:, table.moving], forward)
        return places

    def total(self, moving: int, corrected: int, positions: Vector, forward: bool) -> Vector:
        """Return what all tables of one pair of axes add, m, shape (n,)."""
        added = np.zeros(len(positions))
        for table in self.tables:
            if (table.moving, table.corrected) == (moving, corrected):
                added += table.at(positions, forward)
        return added


@dataclass(frozen=True)
class Beyond:
    """A compensation seen by errors that were measured with other tables at work (``Applied``).

    The errors were found for the targets that the old tables made of the commanded ones. Only what
    the new tables do beyond the old ones changes them.

    Attributes:
        new: as it will be loaded.
        old: tables that were at work in the measured run.
    """

    new: Applied
    old: TableSet

    def sent(self, targets: Vector, forward: bool) -> Vector:
        """Return the targets as the measured machine would have to be commanded."""
        further: Vector = (
            targets + self.new.sent(targets, forward) - self.old.sent(targets, forward)
        )
        return further
