"""Shapes as a three-dimensional picture is made of them, and their colours."""

from dataclasses import dataclass
from enum import Enum
from math import floor, log10

import numpy as np

from stepdiag_ros.metrology.frames import MACHINE
from stepdiag_ros.metrology.geometry import Vector


class Kind(Enum):
    """What a shape is; the values say what its points and its size mean."""

    ARROW = "from the first point to the second; size: diameters of shaft and head, head's length"
    LINES = "each pair of points is a line; size: width"
    PATH = "one line through all points; size: width"
    BOX = "around its one point; size: along x, y, z"
    TEXT = "at its one point, always facing the viewer; size: height of a capital letter, last"


@dataclass(frozen=True)
class Shape:
    """One thing in a picture.

    Attributes:
        group: what it belongs to, such as ``least_squares/vectors``; a viewer can hide a group.
        number: identifies it within its group, from 0; the same from picture to picture.
        kind: what it is.
        points: m, in its frame, shape (n, 3).
        size: m; see ``Kind``.
        colours: red, green, blue, opacity, each 0..1: one for each point, shape (n, 4), or one for
            all, shape (1, 4).
        text: of a TEXT.
        frame: in which the points are, and with which the shape moves.
    """

    group: str
    number: int
    kind: Kind
    points: Vector
    size: tuple[float, float, float]
    colours: Vector
    text: str = ""
    frame: str = MACHINE


def colour(red: float, green: float, blue: float, opacity: float = 1.0) -> Vector:
    """Return one colour as a shape takes it, shape (1, 4)."""
    return np.array([[red, green, blue, opacity]])


GREY = colour(0.62, 0.62, 0.62, 0.8)
WHITE = colour(1.0, 1.0, 1.0)
SKY_BLUE = colour(0.34, 0.71, 0.91)
ORANGE = colour(0.90, 0.62, 0.0)
VERMILION = colour(0.84, 0.37, 0.0)
PURPLE = colour(0.80, 0.47, 0.65)
"""The last four after Okabe & Ito: distinguishable with every kind of colour vision."""

_RAMP = np.array(
    [
        [0.18, 0.36, 0.80],
        [0.40, 0.50, 0.68],
        [0.62, 0.63, 0.56],
        [0.83, 0.75, 0.38],
        [1.00, 0.90, 0.15],
    ]
)
"""From blue to yellow by grey: brighter from step to step, so it needs no sight of red or green."""


def ramp(shares: Vector, opacity: float = 1.0) -> Vector:
    """Return the colours of sizes on a scale from blue (0) to yellow (1), shape (n, 4).

    Args:
        shares: of the largest size, 0..1, shape (n,).
        opacity: of all.
    """
    places = np.clip(np.asarray(shares, dtype=np.float64), 0.0, 1.0) * (len(_RAMP) - 1)
    parts = [np.interp(places, np.arange(len(_RAMP)), _RAMP[:, part]) for part in range(3)]
    colours: Vector = np.column_stack([*parts, np.full(len(places), opacity)])
    return colours


def round_below(value: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is not above a value > 0."""
    power = 10.0 ** floor(log10(value))
    # A value that should be 5 may come as 4.9999999 by rounding.
    return max(
        factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power <= value * (1 + 1e-9)
    )


def spread(count: int, most: int) -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    """Return which of ``count`` >= 2 things in a row to show where ``most`` >= 2 are enough.

    The first and the last are always among them. They are equally far apart if that takes no more
    than half of them away; else the steps between differ by one.
    """
    steps = count - 1
    least = -(-steps // (most - 1))
    for step in range(least, 2 * least + 1):
        if steps % step == 0:
            return np.arange(0, count, step)
    return np.unique(np.linspace(0, steps, most).round().astype(np.int64))
