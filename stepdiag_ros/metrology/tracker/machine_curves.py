"""What a tracker's readings know of a machine's error curves before they are evaluated.

A length sees the displacement e(q) of the reflector along the beam. To first order, with t_i and
ε_i the translations and rotations of axis i and L_i its lever from the first corner q_0 of the
measured box (``forward.levers``),

    e(q) = A (q - q_0) + Σ_i t_i(q_i) + Σ_i ε_i(q_i) × L_i(q - q_0)

A: scales and squareness (``joint``). Passes over a place meet the same curves, so what curves do
does not average out, and seven lines do not determine eighteen curves. They enter as random
curves instead, sums of half waves over the travel with amplitudes in proportion to their lengths,
rotations with a slope in place of the longest wave. All positioning curves have one size, all
straightnesses and all rotations. Beside them stand what differs between passes: the counter's zero,
the scale of the lengths (air), and reversal errors. The readings determine the sizes as far as they
can (``mixed_model``), but not below those of a good machine.

Where the chain of the axes is not known, every axis's rotations act through both other axes. That
is not a machine there is: it gives values, and a rough expectation of a test, but no uncertainty.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.forward import levers
from stepdiag_ros.metrology.geometry import AXES, CURVES, FRAME, ROTATIONS, Vector
from stepdiag_ros.metrology.plan import FORWARD
from stepdiag_ros.metrology.solvers.summary import slope_weights
from stepdiag_ros.metrology.tracker.mixed_model import Effects, GroupSize
from stepdiag_ros.metrology.tracker.readings import LOCATE, TrackerReading

SIZES = (
    GroupSize("the readings' uncertainty, as a factor", 1.0, 2.0),
    GroupSize("positioning, m", 1.5e-6, 2.0, least=1.2e-6),
    GroupSize("straightness, m", 1.0e-6, 2.0, least=0.8e-6),
    GroupSize("rotation, rad", 6.0e-6, 2.0, least=5.0e-6),
    GroupSize("zero of a pass, m", 0.1e-6, 4.0),
    GroupSize("reversal error, m", 0.3e-6, 4.0),
    GroupSize("scale of the lengths in a pass, m/m", 0.1e-6, 3.0),
)
"""What is known of machines before anything is measured. Machine tools and coordinate measuring
machines are within two standard deviations. Seven lines see a part of the curves only, and what
they see may be small by chance, so no curve is taken for smaller than a good machine's."""
_POSITIONING, _STRAIGHTNESS, _ROTATION, _ZERO, _LOST, _SCALE = range(1, len(SIZES))
_WAVES = 10
"""Half waves over the travel that a curve may have, amplitudes in proportion to their lengths."""
NODES = 21
"""Nodes along each side of the measured box of which mean slopes are made."""


AFFINE_PLACES = (
    (0, 0, 1.0),
    (1, 1, 1.0),
    (2, 2, 1.0),
    (0, 1, -1.0),
    (0, 2, 1.0),
    (2, 1, -1.0),
)
"""Row, column and sign in A of scale X, Y, Z, C0Y, B0Z, A0Z."""


@dataclass(frozen=True)
class MeasuredBox:
    """The box of all measured places.

    Attributes:
        low: its first corner q_0, m, shape (3,).
        high: its last corner, m, shape (3,).
    """

    low: Vector
    high: Vector

    @classmethod
    def around(cls, points: Vector) -> "MeasuredBox":
        """Return the box of places, m, shape (n, 3)."""
        return cls(points.min(axis=0), points.max(axis=0))

    @property
    def side(self) -> Vector:
        """Return its sides, m, 1 where it has none, shape (3,)."""
        way = self.high - self.low
        return np.where(way > 0, way, 1.0)

    def nodes(self, axis: int) -> Vector:
        """Return the nodes along a side, m, shape (NODES,)."""
        return np.linspace(self.low[axis], self.high[axis], NODES)


@dataclass(frozen=True)
class MachineCurves:
    """Scales, squareness and smooth curves of a machine, as unknowns.

    The unknowns are six numbers in A, then what each smooth curve has of each of its shapes.

    Attributes:
        box: of the measured places.
        chain: order of the axes from workpiece to tool; empty if not known.
    """

    box: MeasuredBox
    chain: str = ""

    @property
    def groups(self) -> NDArray[np.intp]:
        """Return the place in ``SIZES`` of each curve unknown."""
        kinds = [
            _ROTATION if name in ROTATIONS else (_STRAIGHTNESS, _POSITIONING)[name[2] == name[3]]
            for name in CURVES
        ]
        return np.repeat(np.array(kinds, dtype=np.intp), _WAVES)

    def affine(self, points: Vector) -> Vector:
        """Return the derivatives of e(q) by the six numbers in A alone, shape (n, 3, 6)."""
        near = np.asarray(points, dtype=np.float64) - self.box.low
        made = np.zeros((len(near), 3, len(AFFINE_PLACES)))
        for index, (row, column, sign) in enumerate(AFFINE_PLACES):
            made[:, row, index] = sign * near[:, column]
        return made

    def displacement(self, points: Vector) -> Vector:
        """Return the derivatives of e(q) by all unknowns.

        Args:
            points: commanded, m, shape (n, 3).

        Returns:
            shape (n, 3, 6 + curve unknowns).
        """
        near = np.asarray(points, dtype=np.float64) - self.box.low
        count = len(near)
        columns = [self.affine(points)]
        arms = self._arms(near)
        for axis in range(3):
            shares = near[:, axis] / self.box.side[axis]
            straight = _shapes(shares, turns=False)
            for error in range(3):
                moved = np.zeros((count, 3, straight.shape[1]))
                moved[:, error] = straight
                columns.append(moved)
        for axis in range(3):
            shares = near[:, axis] / self.box.side[axis]
            turning = _shapes(shares, turns=True)
            for about in range(3):
                by_angle = np.cross(np.eye(3)[about], arms[axis])
                columns.append(by_angle[:, :, None] * turning[:, None, :])
        return np.concatenate(columns, axis=2)

    def slope(self, curve: str, by_ends: bool = False) -> Vector:
        """Return a translation's mean slope in terms of the unknowns, shape (unknowns,).

        Args:
            curve: its name, E_XX … E_ZZ; with the other axes at the box's first corner.
            by_ends: from its ends, as the frame has it, instead of by its least-squares line.
        """
        error, axis = AXES.index(curve[2]), AXES.index(curve[3])
        nodes = self.box.nodes(axis)
        points = np.tile(self.box.low, (len(nodes), 1))
        points[:, axis] = nodes
        moved = self.displacement(points)[:, error]
        if by_ends or self.box.high[axis] <= self.box.low[axis]:
            made: Vector = (moved[-1] - moved[0]) / self.box.side[axis]
            return made
        weighted: Vector = slope_weights(nodes) @ moved
        return weighted

    def turn(self) -> Vector:
        """Return the turn into the frame of the results in terms of the unknowns, (3, unknowns)."""
        about_z = -self.slope("E_YX", by_ends=True)
        about_y = self.slope("E_ZX", by_ends=True)
        about_x = self.slope("E_YZ", by_ends=True)
        return np.array([about_x, about_y, about_z])

    @property
    def place(self) -> str:
        """Say of which lines scales and squareness speak, in words."""
        corner = ", ".join(f"{1e3 * value:.4g}" for value in self.box.low)
        return (
            "scales and squareness are the slopes of least-squares lines of the error curves over"
            f" the measured box, of the reflector, with the other axes at ({corner}) mm"
        )

    @property
    def frame(self) -> str:
        """Say in which frame the tracker's place is, in words."""
        return f"{FRAME}; no error at the first corner of the measured box"

    def _arms(self, near: Vector) -> Sequence[Vector]:
        if self.chain:
            return levers(near, self.chain)
        return [near * (np.arange(3) != axis) for axis in range(3)]


def _shapes(shares: Vector, *, turns: bool) -> Vector:
    """Return shapes of unit size, zero at the start, whose random sum is a smooth curve.

    Args:
        shares: of the travel, 0..1, shape (n,).
        turns: a rotation, which has a slope in place of the longest wave; that of a translation is
            in A.

    Returns:
        shape (n, shapes).
    """
    waves = np.arange(1, _WAVES + 1)
    shapes: Vector = (np.cos(np.pi * np.outer(shares, waves)) - 1.0) * 2.0 / waves
    if turns:
        shapes[:, 0] = shares
    return shapes


def pass_effects(
    readings: Sequence[TrackerReading], changes: Vector
) -> tuple[Vector, NDArray[np.intp]]:
    """Return what differs between passes: effects on the lengths, (n, m), and their groups, (m,).

    A pass is a line once along; all locating places are one pass, each of which was reached from a
    side of its own.

    Args:
        readings: in their order.
        changes: their lengths less that of the counter's zero, m, shape (n,).
    """
    columns: list[Vector] = []
    groups: list[int] = []

    def add(column: Vector, group: int) -> None:
        columns.append(column)
        groups.append(group)

    passes = [
        (one.line,) if one.line == LOCATE else (one.line, one.run, one.direction)
        for one in readings
    ]
    for found in dict.fromkeys(passes):
        inside = np.array([one == found for one in passes], dtype=np.float64)
        add(inside, _ZERO)
        add(inside * changes, _SCALE)
    sense = np.array([0.5 if one.direction == FORWARD else -0.5 for one in readings])
    lines = np.array([one.line for one in readings])
    for name in dict.fromkeys(lines):
        if name != LOCATE:
            add(np.where(lines == name, sense, 0.0), _LOST)
    for index in np.flatnonzero(lines == LOCATE):
        add(0.5 * (np.arange(len(readings)) == index), _LOST)
    return np.column_stack(columns), np.array(groups, dtype=np.intp)


def effects_of(
    machine: MachineCurves,
    readings: Sequence[TrackerReading],
    unit: Vector,
    changes: Vector,
    sizes: tuple[GroupSize, ...] = SIZES,
) -> Effects:
    """Return all random effects on the lengths: curves, then what differs between passes.

    Args:
        machine: its unknowns.
        readings: in their order.
        unit: unit vectors from the tracker to the places, shape (n, 3).
        changes: lengths less that of the counter's zero, m, shape (n,).
        sizes: what is known of the sizes.
    """
    points = np.array([one.position for one in readings])
    by_curve = np.einsum("na,nap->np", unit, machine.displacement(points)[:, :, 6:])
    by_pass, groups = pass_effects(readings, changes)
    design = np.hstack([by_curve, by_pass])
    return Effects(design, np.concatenate([machine.groups, groups]), sizes)
