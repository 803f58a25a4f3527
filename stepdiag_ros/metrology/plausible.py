"""What may act on a measurement although no reading shows it, and how large it plausibly is.

Rotations of the axes. Step diagonals and linear lines see few of the nine rotations (33 of 108
values for one move order: ``rigid_body``), yet all of them act on the result. Taking the unseen
ones as zero makes an uncertainty that is too small. They are taken instead as random functions:
zero at the first node, of an unknown common size ``s``, which the standard deviation of a rotation
at the far end of its travel is. Each is a Brownian path over the travel, the roughest curve that a
guideway makes, by its leading sine functions (Karhunen and Loève):

    ε(u) = s Σ_j c_j √2 sin((j - 1/2) π u) / ((j - 1/2) π),     c_j independent, variance 1.

The readings determine ``s`` as far as they see rotations at all. What is known of the machine
before that is the ``plausible`` size: given by the user, or that of a class of machines. It is the
scale of Student's distribution with 4 degrees of freedom, so that readings may overrule it by far.
For the uncertainties they only enlarge it: one axis may turn where no line shows it, and the others
hardly.

The laser's scale. An interferometer that is compensated by sensors is wrong by what these are wrong
by, the same in all setups, and by the air on the beam not being that at the sensor, separately in
each.
"""

import math
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import Vector, cross

CLASSES: dict[str, float] = {
    "precision": 3e-6,
    "machining_centre": 10e-6,
    "large_machine": 30e-6,
}
"""Class of machine → plausible size of its rotations over the measured travel, rad. ISO 10791-1
allows 60 µrad for an axis of a machining centre; a third of a tolerance is a usual size."""
DEFAULT_CLASS = "machining_centre"
PLAUSIBLE_SCALE = 0.12e-6
"""Standard uncertainty of the laser's scale in all setups: sensors with u = 0.1 K and 25 Pa."""
PLAUSIBLE_SHIFT = 0.12e-6
"""Of its scale from setup to setup: the air on the beam is within 0.13 K of the sensor's."""
FEWEST_MODES = 8
"""Sine functions of each rotation: they hold 97 % of the variance of the path."""
MOST_MODES = 24
"""They hold 99.2 % of it. As many as there are blocks hold all of it at the nodes."""


ROTATIONS_KEY = "rotations"
"""Key of a machine's or a case's YAML: a class of machine, or the size in rad."""
_LARGEST = 1e-3


def size_of(told: object) -> float:
    """Return the plausible size of rotations that a user gives, rad.

    Args:
        told: a class of machine, or a number in rad (0: the axes do not turn), as text or not.

    Raises:
        ValueError: it is neither.
    """
    if isinstance(told, str) and told in CLASSES:
        return CLASSES[told]
    try:
        size = float(told)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        size = -1.0
    if isinstance(told, bool) or not 0.0 <= size <= _LARGEST:
        raise ValueError(
            f"'{told}' is not a size of rotations. Give one of {', '.join(CLASSES)}, or rad from"
            f" 0 to {_LARGEST:g}, such as 5e-6"
        )
    return size


@dataclass(frozen=True)
class Plausible:
    """What is plausible of a machine and of its measurement before the readings are looked at.

    Attributes:
        rotation: size of the axes' rotations over the measured travel, rad; 0: they do not turn.
        scale: standard uncertainty of the laser's relative scale, common to all setups.
        shift: the same, separately in each setup.
        misaligned: beams and mirrors are off their lines by as much as the readings show; if not,
            they stand as the conventional formulation takes them.
    """

    rotation: float = CLASSES[DEFAULT_CLASS]
    scale: float = PLAUSIBLE_SCALE
    shift: float = PLAUSIBLE_SHIFT
    misaligned: bool = True

    @property
    def one_setup(self) -> float:
        """Return the standard uncertainty of the laser's relative scale in a single setup."""
        return math.hypot(self.scale, self.shift)


ORDINARY = Plausible()
"""Plausible size where nothing is known of the machine."""
NOTHING = Plausible(0.0, 0.0, 0.0, misaligned=False)
"""Nothing acts but what the readings show: their noise alone makes a result uncertain."""


def mode_count(blocks: int) -> int:
    """Return how many sine functions stand for a rotation over some blocks.

    Fewer than blocks leave a part of a rotation at the nodes out. Readings that are more certain
    than that part take it for large rotations that they hardly show.
    """
    return min(max(blocks, FEWEST_MODES), MOST_MODES)


def modes(share: Vector, count: int) -> Vector:
    """Return the sine functions of a rotation of size 1.

    Args:
        share: position over travel, shape (n,).
        count: of the functions.

    Returns:
        shape (n, count).
    """
    wave = (np.arange(count) + 0.5) * np.pi
    values: Vector = np.sqrt(2.0) * np.sin(share[:, None] * wave) / wave
    return values


def rotation_readings(share: Vector, direction: Vector, arms: Vector, count: int) -> Vector:
    """Return what each mode of each rotation, of size 1 rad, adds to readings, m.

    To first order it is (ε × n)·v with the arm v of the axis (``forward``).

    Args:
        share: position of X, Y, Z over the travel, shape (n, 3).
        direction: of the beam, shape (n, 3).
        arms: v of the axes X, Y, Z, m, shape (n, 3, 3).
        count: of the modes of each.

    Returns:
        shape (n, 9 · count), rotations in the order of ``geometry.ROTATIONS``.
    """
    readings = np.empty((len(share), 3, 3, count))
    for axis in range(3):
        # An axis stands at the same few places again and again.
        places, at = np.unique(share[:, axis], return_inverse=True)
        by_angle, shapes = cross(direction, arms[:, axis]), modes(places, count)[at]
        np.multiply(by_angle[:, :, None], shapes[:, None, :], out=readings[:, axis])
    return readings.reshape(len(share), -1)
