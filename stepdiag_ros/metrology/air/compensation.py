"""What the refractive index does to the count of a laser interferometer, dead path included.

The counter holds the change of the optical path since its zero. With D the dead path (from the
interferometer's reference to the mirror at the zero), s the displacement since and n the index,

    count = n(t)·(D + s) - n(0)·D,   hence   s = [count - (n(t) - n(0))·D] / n(t).

The second term of the bracket is the dead-path correction: without it a change of the air by 1e-6
shifts all readings by 1 µm for each metre of dead path, whatever the machine does.
"""

from typing import TypeVar

from stepdiag_ros.metrology.geometry import Vector

Number = TypeVar("Number", float, Vector)


def raw_displacement(
    displacement: Number, dead_path: float, index: Number, index_at_zero: float
) -> Number:
    """Return what the counter shows, in vacuum wavelengths expressed in m.

    The counter holds the change of the optical path since its zero: with D the path from the
    interferometer's reference to the mirror at the zero and s the displacement since,
    ``n(t)·(D + s) - n(0)·D``.

    Args:
        displacement: s, m.
        dead_path: D, m.
        index: n(t), refractive index of the air on the path.
        index_at_zero: n(0), the same when the counter was zeroed.
    """
    return index * displacement + (index - index_at_zero) * dead_path


def compensated_displacement(
    raw: Number, dead_path: float, index: Number, index_at_zero: float
) -> Number:
    """Return the displacement in m that a count means; the inverse of ``raw_displacement``.

    Args:
        raw: count since zero, m in vacuum wavelengths.
        dead_path: D, m; 0 leaves the dead path uncorrected.
        index: n(t) as known from the weather sensors; NaN if the air is not known.
        index_at_zero: n(0) as known when the counter was zeroed; NaN if the air was not known.

    Returns:
        Displacement since zero, m; NaN if an index is NaN.
    """
    return (raw - (index - index_at_zero) * dead_path) / index
