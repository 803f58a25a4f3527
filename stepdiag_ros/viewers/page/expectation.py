"""What the model expects of a stop: the reading by the errors and the alignment found so far."""

from collections.abc import Iterable

import numpy as np

from stepdiag_ros.metrology.forward import ErrorCurves, perpendiculars, reading_first_order
from stepdiag_ros.metrology.geometry import AXES, ROTATIONS, Vector, beam_direction
from stepdiag_ros.metrology.plan import STEP_DIAGONAL, Line, Volume
from stepdiag_ros.metrology.solvers.result import VolumetricErrors


def nominal_displacement(line: Line, volume: Volume, start: Vector, end: Vector) -> float:
    """Return by how much a perfect machine and setup change the reading between two places, m.

    Args:
        line: whose beam it is.
        volume: the measured box.
        start: position of the first stop, m, shape (3,).
        end: position of the last stop, m, shape (3,).
    """
    return float(line.beam(volume).between(np.asarray(start), np.asarray(end)))


def expected_displacement(
    results: Iterable[VolumetricErrors],
    line: Line,
    setup: str,
    volume: Volume,
    chain: str,
    places: tuple[Vector, Vector],
) -> tuple[float, str]:
    """Return the change of the reading between two places that a result predicts.

    It is the forward model to first order (``metrology.forward.reading_first_order``) with the
    curves of a result and, on a step diagonal, the tilt that the result found for this setup.

    Args:
        results: the one to rely on first.
        line: that is measured.
        setup: identity of its alignment, as the results name it.
        volume: the measured box.
        chain: order of the machine's axes; empty if not known: results with angles are passed over.
        places: from which to which, m, each shape (3,).

    Returns:
        m and the method of the first result that determines it; NaN and nothing if none does.
    """
    for result in results:
        found = _by_result(result, line, setup, volume, chain, places)
        if np.isfinite(found):
            return found, result.method
    return float("nan"), ""


def _by_result(
    result: VolumetricErrors,
    line: Line,
    setup: str,
    volume: Volume,
    chain: str,
    places: tuple[Vector, Vector],
) -> float:
    if line.tracked is not None:
        return float("nan")  # until all its readings are evaluated, the tracker's place is rough
    beam = beam_direction(line.name, np.asarray(volume.step))
    tilt = np.zeros(3)
    if line.kind == STEP_DIAGONAL:
        values = {figure.name: figure.value for figure in result.figures}
        angles = [values.get(f"tilt {setup} {number}", np.nan) for number in (1, 2)]
        if not np.all(np.isfinite(angles)):
            return float("nan")
        tilt = np.asarray(angles) @ np.stack(perpendiculars(beam))
    # What has no part in this reading need not be known.
    curves = {
        name: values
        for name, values in result.curves.items()
        if name in ROTATIONS or beam[AXES.index(name[2])]
    }
    turns = any(name in ROTATIONS for name in curves)
    if (turns and not chain) or not all(np.all(np.isfinite(v)) for v in curves.values()):
        return float("nan")
    errors = ErrorCurves.from_curves(result.nodes, curves)
    positions = np.asarray(places, dtype=np.float64)
    readings = reading_first_order(
        positions, beam, tilt, np.asarray(volume.origin), errors, chain or "".join(AXES)
    )
    return float(readings[1] - readings[0])
