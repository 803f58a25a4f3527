"""What a tracker reads: the length model of ATLI eqs. 2-6, and the same for any machine errors.

ATLI writes the model for the X axis of a gantry. With s the commanded displacement along X from the
tracker's place, γ and β the squareness of X in XY and XZ, g the scale and ε the shift between the
actual and the estimated place of the tracker,

    δ = Ry(β) Rz(γ) (s, 0, 0) - (s, 0, 0)                                          (6)
    ŝ = (g s_x + ε_x + g δ_x, s_y + ε_y + δ_y, s_z + ε_z + δ_z)                    (5)
    ΔL_{i+1,i} = |s_{i+1}| - |s_i|,   ΔL'_{i+1,i} = |ŝ_{i+1}| - |ŝ_i|              (2), (3)

In (5) the scale acts on x alone; on a real axis it acts along the axis, which leans. The difference
is (g - 1) γ s across the line: 0.1 nm for the document's 0.03 mm/m, 0.2° and 1 m. The document's
"g_x" is 1 plus the positioning error per length. Y and Z follow by cyclic exchange.

Two things follow at once from (3), and the document's curves rest on them. A squareness error turns
a line about its own start: if the tracker stands on the line's start (ε = 0), no length changes,
whatever γ is. And what ε does to a line that runs away from the tracker is

    |ŝ| - g |s| ≈ ε·u + |ε⊥|² / (2 s)          u: direction of the line, ε⊥: part of ε across it

a constant, and a part that fades as the line gets away. A line that runs towards the tracker has
the same with s the distance that is left, which grows faster and faster.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.forward import ErrorCurves, tool_point
from stepdiag_ros.metrology.geometry import AXES, Vector


@dataclass(frozen=True)
class AxisErrors:
    """Errors of one axis that are constant along it (ATLI eqs. 4-6).

    Attributes:
        axis: 0, 1, 2 for X, Y, Z.
        scale: positioning error per length, m/m (the document's g_x - 1).
        gamma: squareness γ, rad: right-handed turn of the axis towards the next one (X to Y).
        beta: squareness β, rad: right-handed turn of the axis about the next one (X to -Z).
        shift: ε, from the estimated to the actual place of everything on the reflector's side, m.
    """

    axis: int = 0
    scale: float = 0.0
    gamma: float = 0.0
    beta: float = 0.0
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if self.axis not in (0, 1, 2):
            raise ValueError(f"the axis is {self.axis}; expected 0, 1 or 2 for X, Y, Z")

    @property
    def _order(self) -> list[int]:
        return [self.axis, (self.axis + 1) % 3, (self.axis + 2) % 3]

    @property
    def direction(self) -> Vector:
        """Return where the axis runs, unit vector: Ry(β) Rz(γ) x̂ for X, shape (3,)."""
        made = np.empty(3)
        made[self._order] = (
            np.cos(self.beta) * np.cos(self.gamma),
            np.sin(self.gamma),
            -np.sin(self.beta) * np.cos(self.gamma),
        )
        return made

    def reached(self, start: Vector, ways: Vector) -> Vector:
        """Return where the axis arrives, by ATLI eqs. 5 and 6.

        Args:
            start: where the axis turns and from where it is counted, m, shape (3,).
            ways: commanded displacements from there along the axis, m, shape (n,).

        Returns:
            positions, m, shape (n, 3).
        """
        ways = np.asarray(ways, dtype=np.float64)
        moved = ways[:, None] * self.direction
        moved[:, self.axis] *= 1.0 + self.scale
        made: Vector = np.asarray(start) + np.asarray(self.shift) + moved
        return made

    def curves(self, low: float, high: float, pivot: float) -> dict[str, Vector]:
        """Return the same errors as curves under their ISO 230-1 names, without the shift.

        Args:
            low: first node of the axis, m.
            high: last node, m.
            pivot: position of the axis where its errors are zero, m.

        Returns:
            E_XX E_YX E_ZX (of X; the same for Y, Z) at the two nodes, m.
        """
        ways = np.array([low, high]) - pivot
        errors = self.reached(np.zeros(3), ways) - np.asarray(self.shift)
        errors[:, self.axis] -= ways
        letter = AXES[self.axis]
        return {f"E_{name}{letter}": errors[:, column] for column, name in enumerate(AXES)}


def lengths(points: Vector, station: Vector) -> Vector:
    """Return the distances from a station to points (m, shape (n, 3)), m, shape (n,)."""
    made: Vector = np.linalg.norm(np.asarray(points) - np.asarray(station), axis=-1)
    return made


def length_changes(points: Vector, station: Vector) -> Vector:
    """Return the changes of length from each point to the next, m, shape (n - 1,).

    ATLI eq. 2 (with the ideal points) and eq. 3 (with the actual ones), the tracker at a station
    instead of the origin.
    """
    made: Vector = np.diff(lengths(points, station))
    return made


def length_deviations(commanded: Vector, reached: Vector, station: Vector) -> Vector:
    """Return how far the length change since the first point departs from the ideal one, m, (n,).

    The sum of ΔL' - ΔL of ATLI eqs. 2 and 3 up to each point.

    Args:
        commanded: ideal points, m, shape (n, 3).
        reached: actual points, m, shape (n, 3).
        station: of the tracker, m, shape (3,).
    """
    deviation = lengths(reached, station) - lengths(commanded, station)
    made: Vector = deviation - deviation[0]
    return made


def proportional_share(uncertainty: Vector, lengths: Vector) -> float:
    """Return the b of standard uncertainties √(a² + (b L)²) of lengths L (m, shape (n,)), m/m.

    It is what all lengths may be wrong by in common, as by the wavelength. 0 if none grows.
    """
    rows = np.column_stack([np.ones(len(lengths)), np.asarray(lengths) ** 2])
    solution = np.linalg.lstsq(rows, np.asarray(uncertainty) ** 2, rcond=None)[0]
    return float(np.sqrt(max(solution[1], 0.0)))


def machine_lengths(
    positions: Vector,
    station: Vector,
    errors: ErrorCurves,
    chain: str,
    offset: Vector | None = None,
) -> Vector:
    """Return the lengths that a tracker sees on a machine with all its errors, exactly.

    The reflector sits at an offset from the tool point and is carried and turned by the machine;
    the station stands for the tracker's centre at ``station + offset`` on the workpiece side. With
    the tracker on the carriage and the reflector on the table the length is the same.

    Args:
        positions: commanded machine coordinates, m, shape (n, 3).
        station: see ``metrology.tracker``, m, shape (3,).
        errors: of the machine's axes.
        chain: order of the axes from workpiece to tool.
        offset: of the reflector from the tool point, m, shape (3,); none is zero.

    Returns:
        m, shape (n,).
    """
    place = np.asarray(station, dtype=np.float64)
    if offset is not None:
        place = place + np.asarray(offset)
    point, _ = tool_point(positions, errors, chain, offset)
    return lengths(point, place)
