"""Where the targets of a test lie in the machine: along an axis, or along a diagonal of a box."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.imports.imported import Box, ImportOptions
from stepdiag_ros.metrology.geometry import (
    AXES,
    BODY_DIAGONALS,
    FACE_DIAGONALS,
    LINEAR_LINES,
    Vector,
    beam_direction,
    line_signs,
)
from stepdiag_ros.metrology.plan import DIAGONAL, FORWARD, LINEAR, Line, Volume

Signs = NDArray[np.int64]
DIAGONALS = (*BODY_DIAGONALS, *FACE_DIAGONALS)
TESTED = (*AXES, *DIAGONALS)
"""What a file can be a test of."""
_EVEN = 1e-4
"""Part of the mean distance of targets, by which they may lie beside an even grid."""
_LENGTH = 1e-3
"""Part of a diagonal's length by which the reach of its targets may differ: they are printed in
round millimetres."""


_UNEVEN = (
    "the targets are not evenly spaced, so that ISO 230-2 and ISO 230-6 can be evaluated but not"
    " the errors at the nodes of a measured box ('solve')"
)


class Placed(NamedTuple):
    """The targets of a test in the machine.

    Attributes:
        line: forward pass along them, repeat 0.
        volume: the measured box.
        positions: of the targets, m, shape (targets, 3).
        along: coordinate of the targets along the beam, m, shape (targets,).
        remarks: what was taken for granted, in words.
    """

    line: Line
    volume: Volume
    positions: Vector
    along: Vector
    remarks: tuple[str, ...]


def placed(source: str, name: str, targets: Vector, options: ImportOptions) -> Placed:
    """Return where the targets of a test lie.

    Args:
        source: of the file, for the text of an error.
        name: of the axis or diagonal, one of ``TESTED``.
        targets: ascending, m: coordinates of the axis, or distances along the diagonal.
        options: of the user: ``box`` and ``standing``.

    Raises:
        TableError: a diagonal without a box, or one of another length than its targets reach over.
    """
    signs = line_signs(name if name in DIAGONALS else LINEAR_LINES[AXES.index(name)])
    remarks = _remarks(signs, options)
    if name in AXES:
        return _along_axis(name, targets, options, remarks)
    if options.box is None:
        raise TableError(
            f"{source}: no file states of which box {name} is a diagonal. State it: --box X0 Y0"
            " Z0 X1 Y1 Z1 (its corners in machine coordinates, m)"
        )
    volume = _volume_of(options.box, len(targets) - 1)
    line = Line(DIAGONAL, name, "", 0, FORWARD, _offset(signs, volume, options))
    beam = beam_direction(name, np.asarray(volume.step))
    nodes = line.stops(volume)
    length = float((nodes[-1] - nodes[0]) @ beam)
    reach = float(targets[-1] - targets[0])
    if abs(reach - length) > _LENGTH * length:
        raise TableError(
            f"{source}: the targets reach over {1e3 * reach:.6g} mm, but {name} of the box is"
            f" {1e3 * length:.6g} mm long; check the box (--box) and the diagonal (--axis)"
        )
    # Deviations are kept; where the targets are even, the places are the nodes of the box.
    part = (targets - targets[0]) / reach
    positions = nodes[0] + part[:, np.newaxis] * (nodes[-1] - nodes[0])
    if _beside_grid(part, np.linspace(0.0, 1.0, len(targets))):
        remarks = (_UNEVEN, *remarks)
    else:
        positions = nodes
    return Placed(line, volume, positions, (positions - positions[0]) @ beam, remarks)


_BESIDE_BOX = "the targets are not at the nodes of the box, so that 'solve' cannot use them"


def _along_axis(
    name: str, targets: Vector, options: ImportOptions, remarks: tuple[str, ...]
) -> Placed:
    place = AXES.index(name)
    signs = line_signs(LINEAR_LINES[place])
    blocks = len(targets) - 1
    step = float(targets[-1] - targets[0]) / blocks
    if options.box is not None:
        volume = _volume_of(options.box, blocks)
        beside = _beside_grid(targets / step, volume.nodes(place) / step)
        remarks = (_BESIDE_BOX, *remarks) if beside else remarks
    else:
        # A box has three sides, a test of an axis one: the others get the same size.
        origin = list(options.standing or (0.0, 0.0, 0.0))
        origin[place] = float(targets[0])
        volume = Volume((origin[0], origin[1], origin[2]), (step, step, step), blocks)
        if _beside_grid(targets / step, targets[0] / step + np.arange(blocks + 1)):
            remarks = (_UNEVEN, *remarks)
    offset = _offset(signs, volume, options)
    positions = np.tile(np.asarray(volume.origin) + np.asarray(offset), (len(targets), 1))
    positions[:, place] = targets
    line = Line(LINEAR, LINEAR_LINES[place], "", 0, FORWARD, offset)
    return Placed(line, volume, positions, targets, remarks)


def _volume_of(box: Box, blocks: int) -> Volume:
    low, high = (np.asarray(corner) for corner in box)
    x, y, z = (round(float(size), 12) for size in (high - low) / blocks)
    return Volume(box[0], (x, y, z), blocks)


def _offset(signs: Signs, volume: Volume, options: ImportOptions) -> tuple[float, float, float]:
    """Return how far from the box's first corner the axes stand that do not move, m."""
    if options.standing is None:
        return 0.0, 0.0, 0.0
    away = np.where(signs == 0, np.subtract(options.standing, volume.origin), 0.0)
    x, y, z = (round(float(value), 12) + 0.0 for value in away)
    return x, y, z


def _remarks(signs: Signs, options: ImportOptions) -> tuple[str, ...]:
    standing = [axis for axis, sign in zip(AXES, signs, strict=True) if sign == 0]
    if options.standing is not None or not standing:
        return ()
    written = "0" if options.box is None else "the first corner of the box"
    both = " for both" if len(standing) > 1 else ""
    return (
        f"where {' and '.join(standing)} stood is not in the file; {written} is written{both}"
        " (--standing)",
    )


def _beside_grid(places: Vector, grid: Vector) -> bool:
    """Say whether places lie beside an even grid; both in a unit in which its length is known."""
    mean = float(grid[-1] - grid[0]) / (len(grid) - 1)
    return bool(np.max(np.abs(places - grid)) > _EVEN * mean)
