"""Names and directions of axes, error curves and measured lines.

``p`` in a diagonal's name: the axis runs from its first node to its last along the line; ``n``:
from its
last to its first. The beam's unit vector has the same signs (Ibaraki & Hata 2010, section 2, eq.
3).
"""

from collections.abc import Sequence
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.refusal import Refusal

Vector = NDArray[np.float64]
EDGE = 1e-9
"""m: a place so little beyond a range is on its edge; coordinates in files are rounded."""

AXES = ("X", "Y", "Z")
LINEAR_LINES = ("x", "y", "z")
BODY_DIAGONALS = ("ppp", "npp", "pnp", "ppn")
FACE_DIAGONALS = ("pp0", "np0", "p0p", "n0p", "0pp", "0np")
"""Two in each plane XY, XZ, YZ; 0: the axis stands."""
MOVE_ORDERS = tuple("".join(order) for order in permutations(AXES))
FACE_ORDERS = tuple("".join(order) for order in permutations(AXES, 2))
STEP_ORDERS = (*MOVE_ORDERS, *FACE_ORDERS)
"""Orders of the moves of a block of a step diagonal, of the body or of a face."""
CHAINS = MOVE_ORDERS
"""Orders of the axes from workpiece to tool."""

_SENSES = {"p": 1, "n": -1, "0": 0}

TRANSLATIONS = tuple(f"E_{error}{axis}" for axis in AXES for error in AXES)
"""E_XX E_YX …: error along the first letter as the axis of the second letter moves."""
ROTATIONS = tuple(f"E_{error}{axis}" for axis in AXES for error in "ABC")
"""E_AX E_BX …: rotation about X (A), Y (B), Z (C) as the axis of the last letter moves."""
CURVES = (*TRANSLATIONS, *ROTATIONS)
"""All eighteen in the order in which results hold them."""
SQUARENESS = ("C0Y", "B0Z", "A0Z")
"""Of Y to X, of Z to X, of Z to Y."""
FRAME = "mean slopes of E_YX, E_ZX and E_YZ over the travel are zero (Ibaraki & Hata 2010, eq. 17)"
FIXED_AT_END = ("E_YX", "E_ZX", "E_YZ")
"""Curves that end at zero in this frame."""
REFERENCE_POINT = (
    "curves of the mirror's point with the other axes at the first corner of the measured box, "
    "zero at the first node"
)
"""What all eighteen curves speak of. Mirror offset and machine zero need not be known for it."""


def translation(error: int, axis: int) -> str:
    """Return the ISO 230-1 name of the error along axis ``error`` (0, 1, 2) as ``axis`` moves."""
    return TRANSLATIONS[3 * axis + error]


def moving_axis(curve: str) -> int:
    """Return the axis (0, 1, 2) whose motion an error curve such as E_ZX or E_BX belongs to."""
    return AXES.index(curve[3])


def curve_unit(curve: str) -> str:
    """Return the unit of an error curve: m for a translation, rad for a rotation."""
    return "rad" if curve in ROTATIONS else "m"


def line_signs(line: str) -> NDArray[np.int64]:
    """Return the sense in which each axis runs along a line: +1, -1, or 0 if it stands; shape (3,).

    Raises:
        ValueError: the name is neither x, y, z nor three letters of p and n, one of them perhaps 0.
    """
    if line in LINEAR_LINES:
        return np.array([int(line == name) for name in LINEAR_LINES], dtype=np.int64)
    if len(line) == 3 and set(line) <= set(_SENSES) and line.count("0") <= 1:
        return np.array([_SENSES[letter] for letter in line], dtype=np.int64)
    raise Refusal(
        f"'{line}' is not a line: use x, y, z, a body diagonal such as ppp, npp, pnp, ppn, or a"
        " face diagonal such as pp0, n0p, 0np",
        fault="unknown",
    )


def move_orders(line: str) -> tuple[str, ...]:
    """Return the orders in which the axes of a step diagonal may move in a block.

    Six on a body diagonal (Ibaraki & Hata 2010, section 4.2), two on a face, such as XY and YX on
    pp0 and np0.

    Raises:
        ValueError: there is no such line.
    """
    moving = "".join(axis for axis, sign in zip(AXES, line_signs(line), strict=True) if sign)
    return tuple("".join(order) for order in permutations(moving))


def inner(one: Vector, other: Vector) -> Vector:
    """Return inner products over the last dimension, the same bit for bit on every processor.

    The libraries behind ``@`` sum in an order that depends on the processor. Readings and lines are
    compared bit for bit with those of a run on another computer, so they do without.

    Args:
        one: shape (..., n).
        other: shape (..., n), or one that fits it.
    """
    products: Vector = np.sum(one * other, axis=-1)
    return products


def cross(one: Vector, other: Vector) -> Vector:
    """Return cross products of vectors along the last dimension, shape (..., 3).

    For few vectors a fraction of the time of ``np.cross``, with the same bits.

    Args:
        one: shape (..., 3).
        other: shape (..., 3), or one that fits it.
    """
    parts = [
        one[..., i] * other[..., j] - one[..., j] * other[..., i]
        for i, j in ((1, 2), (2, 0), (0, 1))
    ]
    product: Vector = np.stack(parts, axis=-1)
    return product


def beam_direction(line: str, step: Vector) -> Vector:
    """Return the nominal unit vector of the beam of a line, shape (3,).

    Source: Ibaraki & Hata 2010, eq. 3.

    Args:
        line: name of the line.
        step: size of one block along X, Y, Z in m, shape (3,).
    """
    direction = line_signs(line) * np.asarray(step, dtype=np.float64)
    unit: Vector = direction / np.linalg.norm(direction)
    return unit


def places_of(nodes: Sequence[Vector]) -> Vector:
    """Return all points of a grid, the last axis fastest, shape (n, 3).

    Args:
        nodes: coordinates along each axis, m.
    """
    mesh = np.meshgrid(*nodes, indexing="ij")
    return np.stack([part.ravel() for part in mesh], axis=1)
