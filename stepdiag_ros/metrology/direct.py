"""Errors measured directly, with an artefact or another instrument.

They are compared with a result (``comparison``) or weighed into it (``solvers.direct_rows``).

The table is CSV with a header, SI units, one row a value; lines that begin with ``#`` are notes
(instrument, artefact, certificate, date):

    name,position_m,repeat,value,standard_uncertainty,definition
    E_YX,0.000,0,0.00e-6,0.08e-6,
    E_YX,0.010,0,0.05e-6,0.08e-6,
    C0Y,,0,-1.0e-5,3.3e-6,angle

``name`` is an error curve (E_XX … E_CZ, value in m or rad) or a squareness (C0Y, B0Z, A0Z, value
in rad). ``position_m`` is the machine coordinate of the moving axis, empty for a squareness.
``repeat`` counts from 0 and may be left out. ``standard_uncertainty`` is that of the value but for
its repeatability, so mostly the artefact's; empty: unknown. ``definition`` says which sign a
squareness has: ``rotation`` (right-handed, ISO 230-1) or ``angle`` (positive where the angle is
larger than 90°). The zero and, of a straightness, the slope of a curve are free.

Six more columns may say where a translation or a squareness was measured, in which rotations then
show by their levers: ``x_m,y_m,z_m``, where the axes stood that did not move, and
``reflector_x_m,reflector_y_m,reflector_z_m``, how far the point that was measured lies from the
mirror of the laser lines. Without them: the mirror's own point, the other axes at the first corner
of the measured box. The comparison does not use them.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, CURVES, ROTATIONS, SQUARENESS, Vector, moving_axis
from stepdiag_ros.metrology.refusal import Refusal

_FORMULA = re.compile(r"[,;]+(?=\W*[=+\-@＝＋－＠])")
NEEDED_COLUMNS = ("name", "position_m", "value")
STANDING_COLUMNS = ("x_m", "y_m", "z_m")
REFLECTOR_COLUMNS = ("reflector_x_m", "reflector_y_m", "reflector_z_m")
COLUMNS = (
    *NEEDED_COLUMNS,
    "repeat",
    "standard_uncertainty",
    "definition",
    *STANDING_COLUMNS,
    *REFLECTOR_COLUMNS,
)
EDGE_SHARE = 1e-4
"""Share of a step by which a position may lie beyond the first or last node."""


class DirectPlace(NamedTuple):
    """Where an error was measured.

    Attributes:
        standing: machine coordinates of the axes that stood, m; NaN where unknown.
        reflector: from the mirror of the laser lines to the point that was measured, m.
    """

    standing: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    reflector: tuple[float, float, float] = (0.0, 0.0, 0.0)


ANYWHERE = DirectPlace()
"""Default: the mirror's own point."""


@dataclass(frozen=True)
class DirectCurve:
    """A curve as it was measured directly.

    Attributes:
        name: ISO 230-1 name.
        positions: machine coordinates, m, ascending, shape (n,).
        values: of each repeat, m or rad, shape (repeats, n).
        stated_uncertainty: standard uncertainty of a value but for its repeatability, shape (n,);
            NaN if unknown.
        place: where it was measured.
    """

    name: str
    positions: Vector
    values: Vector
    stated_uncertainty: Vector
    place: DirectPlace = ANYWHERE

    @property
    def mean(self) -> Vector:
        """Return the mean of the repeats, shape (n,)."""
        found: Vector = np.mean(self.values, axis=0)
        return found

    @property
    def nuisance(self) -> Vector:
        """Return what is free in each repeat: a zero, and a slope of a straightness, shape (n, k).

        An angular interferometer or autocollimator reads from its first position, a straightness
        interferometer or straightedge lies at any angle. The slope of a positioning error or of an
        angle is measured.
        """
        ones = np.ones(len(self.positions))
        if self.name in ROTATIONS or self.name[2] == self.name[3]:
            return ones[:, None]
        return np.column_stack([ones, self.positions - np.mean(self.positions)])

    def between(self, low: float, high: float) -> "DirectCurve":
        """Return the part of the curve whose positions lie within [low, high], m."""
        inside = (self.positions >= low) & (self.positions <= high)
        return replace(
            self,
            positions=self.positions[inside],
            values=self.values[:, inside],
            stated_uncertainty=self.stated_uncertainty[inside],
        )

    def interpolation(self, nodes: Vector) -> Vector:
        """Return the matrix from values at nodes (m) to values at the curve's positions.

        Between nodes values lie on straight lines.

        Raises:
            ValueError: a position is outside the nodes.
        """
        slack = EDGE_SHARE * (nodes[1] - nodes[0])
        outside = (self.positions < nodes[0] - slack) | (self.positions > nodes[-1] + slack)
        if np.any(outside):
            position = float(self.positions[outside][0])
            raise Refusal(
                f"{self.name} was measured directly at {AXES[moving_axis(self.name)]} ="
                f" {position:g} m, outside the measured travel of {nodes[0]:g} to {nodes[-1]:g} m",
                fault="out_of_range",
            )
        return between_nodes(nodes, self.positions)

    def evaluate(self, functionals: Vector) -> tuple[Vector, Vector]:
        """Return values and standard uncertainties of linear functionals of the curve.

        What is stated is taken as independent between positions. Repeatability is the scatter of
        the functionals over the repeats, not of the values: a straightedge that lies another way in
        every repeat does not count where the functionals do not see its slope.

        Args:
            functionals: shape (m, n).

        Returns:
            mean over the repeats and its standard uncertainty, NaN if unknown, each shape (m,).
        """
        found = self.values @ functionals.T
        stated = np.sqrt(functionals**2 @ self.stated_uncertainty**2)
        return np.mean(found, axis=0), np.hypot(stated, _of_mean(found))


def between_nodes(nodes: Vector, positions: Vector) -> Vector:
    """Return the matrix from values at nodes to values between them, shape (positions, nodes)."""
    inside = np.clip(positions, nodes[0], nodes[-1])
    upper = np.clip(np.searchsorted(nodes, inside), 1, len(nodes) - 1)
    share = (inside - nodes[upper - 1]) / (nodes[upper] - nodes[upper - 1])
    matrix = np.zeros((len(inside), len(nodes)))
    rows = np.arange(len(inside))
    matrix[rows, upper] = share
    matrix[rows, upper - 1] = 1.0 - share
    return matrix


@dataclass(frozen=True)
class DirectSquareness:
    """A squareness as it was measured directly, as a right-handed rotation (ISO 230-1).

    Attributes:
        name: C0Y, B0Z or A0Z.
        values: of each repeat, rad, shape (repeats,).
        stated_uncertainty: standard uncertainty of a value but for its repeatability, rad; NaN if
            unknown.
        place: where both its axes were measured.
    """

    name: str
    values: Vector
    stated_uncertainty: float
    place: DirectPlace = ANYWHERE

    @property
    def mean(self) -> float:
        """Return the mean of the repeats, rad."""
        return float(np.mean(self.values))

    @property
    def standard_uncertainty(self) -> float:
        """Return that of the mean, rad: what is stated, and the scatter of the repeats."""
        return float(np.hypot(self.stated_uncertainty, _of_mean(self.values)))


class DirectFile(NamedTuple):
    """A file that something was measured directly in.

    Attributes:
        name: what the user calls it.
        sha256: of its bytes, hexadecimal.
        errors: names of the curves and squareness in it.
    """

    name: str
    sha256: str
    errors: tuple[str, ...]


@dataclass(frozen=True)
class DirectMeasurement:
    """Everything that was measured directly.

    Attributes:
        curves: by name, in the order of ``geometry.CURVES``.
        squareness: by name.
        notes: of the file.
        files: that it was read from.
    """

    curves: Mapping[str, DirectCurve]
    squareness: Mapping[str, DirectSquareness]
    notes: tuple[str, ...] = ()
    files: tuple[DirectFile, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of all errors in it."""
        return (*self.curves, *self.squareness)

    def origin(self, name: str) -> str:
        """Return the name of an error with that of its file, where it is known."""
        files = [f"{name} in {file.name}" for file in self.files if name in file.errors]
        return files[0] if files else name


def joined(parts: Sequence[DirectMeasurement]) -> DirectMeasurement:
    """Return several direct measurements as one.

    Raises:
        ValueError: an error is in two of them.
    """
    curves: dict[str, DirectCurve] = {}
    squareness: dict[str, DirectSquareness] = {}
    for part in parts:
        twice = [name for name in part.names if name in curves or name in squareness]
        if twice:
            raise Refusal(
                f"{', '.join(twice)} is in more than one file of direct measurements; give it once,"
                " as repeats of one table if it was measured again",
                fault="twice",
            )
        curves.update(part.curves)
        squareness.update(part.squareness)
    return DirectMeasurement(
        {name: curves[name] for name in CURVES if name in curves},
        {name: squareness[name] for name in SQUARENESS if name in squareness},
        tuple(note for part in parts for note in part.notes),
        tuple(file for part in parts for file in part.files),
    )


def direct_text(direct: DirectMeasurement) -> str:
    """Return the table of a direct measurement, which ``read_direct`` reads back."""
    # One line each, and no cell that a spreadsheet would execute.
    rows = [f"# {_FORMULA.sub(' ', ' '.join(note.split()))}" for note in direct.notes]
    rows.append(",".join(COLUMNS))

    def add(
        name: str, position: str, repeat: int, value: float, u: float, place: DirectPlace
    ) -> None:
        cells = [name, position, repr(float(value)), str(repeat), _cell(u)]
        cells.append("rotation" if name in SQUARENESS else "")
        rows.append(",".join([*cells, *map(_cell, (*place.standing, *place.reflector))]))

    for name, curve in direct.curves.items():
        for repeat, values in enumerate(curve.values):
            cells = zip(curve.positions, values, curve.stated_uncertainty, strict=True)
            for position, value, uncertainty in cells:
                add(name, repr(float(position)), repeat, value, uncertainty, curve.place)
    for name, angle in direct.squareness.items():
        for repeat, value in enumerate(angle.values):
            add(name, "", repeat, value, angle.stated_uncertainty, angle.place)
    return "\n".join(rows) + "\n"


def _cell(value: float) -> str:
    return repr(float(value)) if math.isfinite(value) else ""


def _of_mean(values: Vector) -> Vector:
    """Return the type A standard uncertainty of the mean over the first index; 0 for one value.

    With a single value the repeatability is part of what is stated.
    """
    if len(values) < 2:
        return np.zeros(np.shape(values)[1:])
    scatter: Vector = np.std(values, axis=0, ddof=1) / np.sqrt(len(values))
    return scatter
