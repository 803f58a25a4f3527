"""Forward model: what an interferometer reads on a machine with known errors.

The exact model walks the kinematic chain from workpiece to tool as rigid bodies; the first-order
model says the same to the first power of every error and misalignment. Both are vectorised over
positions.

Signs: X, Y, Z right-handed; translations and rotations are motions of the tool relative to the
workpiece; rotations are right-handed about X (A), Y (B), Z (C); a reading grows when the mirror
moves along the beam. Squareness, as orientation of an axis's straight line by right-handed rotation
(ISO 230-1: C0Y of Y to X, B0Z of Z to X, A0Z of Z to Y): a turned axis shows as slopes of its own
curves,

    C0Y = -slope(E_XY) - slope(E_YX),  angle from +X to +Y is 90° + C0Y
    B0Z = +slope(E_XZ) + slope(E_ZX),  angle from +X to +Z is 90° - B0Z
    A0Z = -slope(E_YZ) - slope(E_ZY),  angle from +Y to +Z is 90° + A0Z

so the definition "angle larger than 90° is positive" has the other sign for B0Z only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.curve_set import require_curve, require_nodes
from stepdiag_ros.metrology.geometry import (
    AXES,
    CHAINS,
    TRANSLATIONS,
    Vector,
    cross,
    inner,
    moving_axis,
)
from stepdiag_ros.metrology.refusal import Refusal

_CORRECTION = 1e-4
"""A target that was corrected for errors lies some micrometres beyond the last node: no more, m."""

SQUARENESS_SLOPES: dict[str, tuple[float, tuple[str, str]]] = {
    "C0Y": (-1.0, ("E_XY", "E_YX")),
    "B0Z": (+1.0, ("E_XZ", "E_ZX")),
    "A0Z": (-1.0, ("E_YZ", "E_ZY")),
}
"""Squareness by right-handed rotation: factor on the sum of the slopes of these two curves."""

RIGHT_HANDED = "right-handed rotation of the axis's line (ISO 230-1 C0Y, B0Z, A0Z)"
OVER_90_DEGREES = "positive where the angle between the positive axes is larger than 90°"
SQUARENESS_DEFINITIONS: dict[str, dict[str, float]] = {
    RIGHT_HANDED: {"C0Y": 1.0, "B0Z": 1.0, "A0Z": 1.0},
    OVER_90_DEGREES: {"C0Y": 1.0, "B0Z": -1.0, "A0Z": 1.0},
}
"""Both sign definitions in use: the factor that turns a right-handed value into each."""


@dataclass(frozen=True)
class ErrorCurves:
    """Error motions of the three axes, linear between nodes.

    Beyond the first and last node nothing is known. ``at`` holds the curves there as at the node,
    for what is not measured: run-ups, overruns, ways to a line. Code that simulates a measurement
    or needs the true error at a place first checks whether it is ``outside``.

    Attributes:
        nodes: machine coordinates of the nodes of X, Y, Z, m, ascending, each shape (nodes of that
            axis,).
        values: of X, Y, Z: three translations (m) and three rotations (rad) at the nodes, each
            shape (nodes, 6), columns E_X E_Y E_Z E_A E_B E_C of that axis.
    """

    nodes: tuple[Vector, Vector, Vector]
    values: tuple[Vector, Vector, Vector]

    def __post_init__(self) -> None:
        require_nodes(self.nodes)
        for axis, nodes, values in zip(AXES, self.nodes, self.values, strict=True):
            if values.shape != (len(nodes), 6) or not np.all(np.isfinite(values)):
                raise Refusal(
                    f"errors of axis {axis}: expected 6 finite values at each node",
                    fault="out_of_range",
                )

    @classmethod
    def from_curves(cls, nodes: Sequence[Vector], curves: Mapping[str, Vector]) -> "ErrorCurves":
        """Make error motions from curves under their ISO 230-1 names; a missing curve is zero.

        Args:
            nodes: of X, Y, Z, m, each shape (nodes,).
            curves: name (E_XX … E_CZ) → values at the nodes of its axis, m or rad.

        Raises:
            ValueError: an unknown name, a wrong number of values, a value that is not finite.
        """
        x, y, z = (np.asarray(axis_nodes, dtype=np.float64) for axis_nodes in nodes)
        values = tuple(np.zeros((len(axis_nodes), 6)) for axis_nodes in (x, y, z))
        for name, curve in curves.items():
            require_curve(name, curve, (x, y, z))
            values[moving_axis(name)][:, "XYZABC".index(name[2])] = curve
        return cls((x, y, z), (values[0], values[1], values[2]))

    @property
    def turns(self) -> bool:
        """Say whether any rotation is not zero."""
        return any(bool(np.any(values[:, 3:])) for values in self.values)

    def outside(self, positions: Vector) -> str:
        """Say which place is farthest beyond the curves; empty if all are within.

        A target that was corrected for errors counts as the node that it belongs to.

        Args:
            positions: machine coordinates, m, shape (n, 3).
        """
        places = np.asarray(positions, dtype=np.float64).reshape(-1, 3)
        low = np.array([nodes[0] for nodes in self.nodes])
        high = np.array([nodes[-1] for nodes in self.nodes])
        beyond = np.maximum(low - places, places - high)
        if not beyond.size or np.max(beyond) <= _CORRECTION:
            return ""
        row, axis = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
        return (
            f"{AXES[axis]} = {places[row, axis] * 1e3:.6g} mm, where the errors of that axis are"
            f" given from {low[axis] * 1e3:.6g} to {high[axis] * 1e3:.6g} mm only"
        )

    def at(self, axis: int, positions: Vector) -> Vector:
        """Return the six errors of one axis at its positions (m), shape (positions, 6).

        Beyond the nodes they are those of the nearest node.
        """
        nodes, values = self.nodes[axis], self.values[axis]
        clipped = np.clip(positions, nodes[0], nodes[-1])
        upper = np.clip(np.searchsorted(nodes, clipped, side="right"), 1, len(nodes) - 1)
        share = (clipped - nodes[upper - 1]) / (nodes[upper] - nodes[upper - 1])
        below = values[upper - 1]
        interpolated: Vector = below + share[:, None] * (values[upper] - below)
        return interpolated


@dataclass(frozen=True)
class Alignment:
    """How laser and mirror stand on one line.

    Attributes:
        beam: unit vector of the beam, away from the laser, shape (3,).
        mirror_normal: unit normal of the mirror's plane before the machine turns it, along the
            beam, (3,).
        origin: reference point L0 of the laser in machine coordinates, m, shape (3,).
    """

    beam: Vector
    mirror_normal: Vector
    origin: Vector


def rotation_matrices(vectors: Vector) -> Vector:
    """Return the right-handed rotations by rotation vectors (direction: axis, length: angle, rad).

    For the three small rotations of an axis the vector is (E_A, E_B, E_C); another order
    of the rotations about X, Y, Z changes products of two of them only.

    Args:
        vectors: shape (n, 3).

    Returns:
        shape (n, 3, 3).
    """
    angle = np.linalg.norm(vectors, axis=-1)
    cross = np.zeros((*vectors.shape[:-1], 3, 3))
    cross[..., 0, 1], cross[..., 0, 2] = -vectors[..., 2], vectors[..., 1]
    cross[..., 1, 0], cross[..., 1, 2] = vectors[..., 2], -vectors[..., 0]
    cross[..., 2, 0], cross[..., 2, 1] = -vectors[..., 1], vectors[..., 0]
    # sin(a)/a and (1-cos a)/a² without division by zero at a = 0.
    first = np.sinc(angle / np.pi)[..., None, None]
    second = (0.5 * np.sinc(0.5 * angle / np.pi) ** 2)[..., None, None]
    turned: Vector = np.eye(3) + first * cross + second * _product(cross, cross)
    return turned


def _product(one: Vector, other: Vector) -> Vector:
    """Return products of matrices, shape (..., 3, 3); see ``geometry.inner``."""
    return inner(one[..., :, None, :], np.swapaxes(other, -1, -2)[..., None, :, :])


def rotation_vectors(matrices: Vector) -> Vector:
    """Return the rotation vectors (rad) of rotations by less than a quarter turn.

    The reverse of ``rotation_matrices``.

    Args:
        matrices: shape (n, 3, 3).

    Returns:
        shape (n, 3).
    """
    skew = 0.5 * np.stack(
        [
            matrices[..., 2, 1] - matrices[..., 1, 2],
            matrices[..., 0, 2] - matrices[..., 2, 0],
            matrices[..., 1, 0] - matrices[..., 0, 1],
        ],
        axis=-1,
    )
    sine = np.minimum(np.linalg.norm(skew, axis=-1, keepdims=True), 1.0)
    # a/sin(a), which is 1 + a²/6 where a is too small to divide by.
    factor = np.where(sine > 1e-4, np.arcsin(sine) / np.maximum(sine, 1e-4), 1.0 + sine**2 / 6.0)
    vectors: Vector = factor * skew
    return vectors


def tool_point(
    positions: Vector, errors: ErrorCurves, chain: str, offset: Vector | None = None
) -> tuple[Vector, Vector | None]:
    """Return where the tool (mirror) really is and how it is turned, exactly.

    Walks the chain from workpiece to tool: p ← p + R·(q_i ê_i + t_i(q_i)), R ← R·rot(ε_i(q_i)),
    then the offset of the mirror from the point that the coordinates speak of.

    Args:
        positions: machine coordinates q, m, shape (n, 3).
        errors: of the axes.
        chain: order of the axes from workpiece to tool, one of ``geometry.CHAINS``.
        offset: of the mirror from the tool point, in tool coordinates, m, shape (3,).

    Returns:
        points in m, shape (n, 3), and rotations, shape (n, 3, 3), or None where no axis turns.

    Raises:
        ValueError: no such chain.
    """
    if chain not in CHAINS:
        raise Refusal(
            f"'{chain}' is not a kinematic chain; use one of {', '.join(CHAINS)}", fault="unknown"
        )
    positions = np.asarray(positions, dtype=np.float64)
    turns = errors.turns
    point = np.zeros(positions.shape)
    rotation = np.broadcast_to(np.eye(3), (*positions.shape[:-1], 3, 3))
    for letter in chain:
        axis = AXES.index(letter)
        error = errors.at(axis, positions[:, axis])
        move = error[:, :3]
        move[:, axis] += positions[:, axis]
        if turns:
            point += inner(rotation, move[:, None, :])
            rotation = _product(rotation, rotation_matrices(error[:, 3:]))
        else:
            point += move
    if offset is not None:
        point += inner(rotation, np.asarray(offset, dtype=np.float64))
    return point, rotation if turns else None


def reading(
    positions: Vector,
    alignment: Alignment,
    errors: ErrorCurves,
    chain: str,
    offset: Vector | None = None,
) -> Vector:
    """Return the length of the beam from the laser's origin to the mirror's plane, exactly.

    The beam from L0 along the unit vector l meets the plane through the mirror's point p with the
    normal m turned by R: s = (p - L0)·(R m) / (l·(R m)).

    Args:
        positions: machine coordinates, m, shape (n, 3).
        alignment: of beam and mirror.
        errors: of the axes.
        chain: order of the axes from workpiece to tool.
        offset: of the mirror from the tool point, m, shape (3,); none is zero.

    Returns:
        s in m, shape (n,).
    """
    point, rotation = tool_point(positions, errors, chain, offset)
    normal = alignment.mirror_normal
    turned = normal[None, :] if rotation is None else inner(rotation, normal)
    length: Vector = np.sum((point - alignment.origin) * turned, axis=1) / inner(
        turned, alignment.beam
    )
    return length


def levers(positions: Vector, chain: str) -> tuple[Vector, Vector, Vector]:
    """Return the levers L_i(q) of X, Y, Z: the displacements of the axes after each in the chain.

    Args:
        positions: machine coordinates, m, shape (n, 3).
        chain: order of the axes from workpiece to tool.

    Returns:
        in m, each shape (n, 3).
    """
    made = []
    for letter in AXES:
        later = np.array([float(chain.index(other) > chain.index(letter)) for other in AXES])
        made.append(np.asarray(positions) * later)
    return made[0], made[1], made[2]


def reading_first_order(
    positions: Vector,
    direction: Vector,
    tilt: Vector,
    origin: Vector,
    errors: ErrorCurves,
    chain: str,
) -> Vector:
    """Return the reading to the first order of all errors and of the setup, but for a constant.

    s(q) = n·q + Σ n·t_i(q_i) + Σ (ε_i(q_i) × n)·(q - L_i(q) - L0) + d·(q - L0), with L_i the lever
    of axis i: misalignment acts through one effective direction, to this order the tilt of the
    mirror's normal. The beam's own direction is a scale of second order, |δl|²/2 - δl·δm.

    Args:
        positions: machine coordinates q, m, shape (n, 3).
        direction: nominal unit vector n of the beam, shape (3,).
        tilt: d, perpendicular to n, rad, shape (3,).
        origin: reference point L0 of the laser, m, shape (3,).
        errors: of the axes.
        chain: order of the axes from workpiece to tool.

    Returns:
        s in m, shape (n,).
    """
    positions = np.asarray(positions, dtype=np.float64)
    length: Vector = positions @ direction + (positions - origin) @ tilt
    for axis, lever in enumerate(levers(positions, chain)):
        error = errors.at(axis, positions[:, axis])
        length += error[:, :3] @ direction
        arm = positions - lever - origin
        length += np.sum(np.cross(error[:, 3:], direction) * arm, axis=1)
    return length


def perpendiculars(direction: Vector) -> tuple[Vector, Vector]:
    """Return two unit vectors that make a right-handed triple (u1, u2, n) with a direction n.

    u1 lies in the XY plane (along +Y for a direction along ±Z); the
    two setup angles of a line are the components of its effective direction along u1 and u2.
    """
    direction = np.asarray(direction, dtype=np.float64)
    horizontal = np.array([-direction[1], direction[0], 0.0])
    length = np.linalg.norm(horizontal)
    first: Vector = horizontal / length if length > 1e-9 else np.array([0.0, 1.0, 0.0])
    second = cross(direction, first)
    return first, second


def tilted(direction: Vector, tilts: Sequence[float]) -> Vector:
    """Return the unit vector with these components (rad) along the two ``perpendiculars``."""
    first, second = perpendiculars(direction)
    one, two = tilts
    turned: Vector = (
        np.sqrt(1.0 - one * one - two * two) * np.asarray(direction) + one * first + two * second
    )
    return turned


def in_result_frame(nodes: Sequence[Vector], curves: Mapping[str, Vector]) -> dict[str, Vector]:
    """Return translational curves from zero at the first node in the frame of the results.

    The coordinate system may be turned by any small θ, which adds θ × (q ê_i) to the curves of axis
    i; it is turned so that the mean slopes of E_YX, E_ZX and E_YZ are zero, that is, these end at
    zero (Ibaraki & Hata 2010, eq. 17).

    Args:
        nodes: of X, Y, Z, m, each shape (N + 1,).
        curves: all nine translations under their names, m, each shape (N + 1,).

    Returns:
        the same names, m.
    """
    way = [np.asarray(axis_nodes) - axis_nodes[0] for axis_nodes in nodes]
    moved = {name: np.asarray(curves[name]) - curves[name][0] for name in TRANSLATIONS}
    about_z = -moved["E_YX"][-1] / way[0][-1]
    about_y = moved["E_ZX"][-1] / way[0][-1]
    about_x = moved["E_YZ"][-1] / way[2][-1]
    turn = np.array([about_x, about_y, about_z])
    for axis, letter in enumerate(AXES):
        slopes = np.cross(turn, np.eye(3)[axis])
        for error, error_letter in enumerate(AXES):
            name = f"E_{error_letter}{letter}"
            moved[name] = moved[name] + slopes[error] * way[axis]
    for name in ("E_YX", "E_ZX", "E_YZ"):
        moved[name][-1] = 0.0
    return moved


AXES_OF = {"C0Y": ("X", "Y"), "B0Z": ("X", "Z"), "A0Z": ("Y", "Z")}
"""Squareness → the axis it refers to, and the axis that is out of square to it."""
