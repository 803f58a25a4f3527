"""Solvers: from measured lines to volumetric errors, all with one result type."""

from collections.abc import Callable
from dataclasses import replace

from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.alternative import solve_alternative
from stepdiag_ros.metrology.solvers.conventional import solve_conventional
from stepdiag_ros.metrology.solvers.least_squares import solve_least_squares
from stepdiag_ros.metrology.solvers.limits import left_out
from stepdiag_ros.metrology.solvers.result import NotDeterminable, VolumetricErrors
from stepdiag_ros.metrology.solvers.rigid_body import solve_rigid_body
from stepdiag_ros.metrology.solvers.setup_robust import solve_setup_robust
from stepdiag_ros.metrology.solvers.soons import solve_soons

Solver = Callable[[Measurement], VolumetricErrors]

SOLVERS: dict[str, Solver] = {
    "conventional": solve_conventional,
    "setup_robust": solve_setup_robust,
    "alternative": solve_alternative,
    "soons": solve_soons,
    "least_squares": solve_least_squares,
    "rigid_body": solve_rigid_body,
}
"""Name of the method → solver, from the plainest to the one that uses everything."""
_WEIGHING = ("least_squares", "rigid_body")
"""Methods that use what was measured directly."""


def solve(measurement: Measurement, method: str = "least_squares") -> VolumetricErrors:
    """Solve by one method.

    Raises:
        NotDeterminable: the lines are not enough for this method.
        ValueError: no such method, or the lines contradict the volume or each other.
    """
    if method not in SOLVERS:
        raise Refusal(
            f"'{method}' is no method; use one of {', '.join(SOLVERS)}",
            fault="unknown",
            aspect="method",
        )
    result = SOLVERS[method](measurement)
    if measurement.direct is None or method in _WEIGHING:
        return result
    return replace(
        result,
        remarks=(*result.remarks, "What was measured directly is not used by this method."),
    )


def solve_all(
    measurement: Measurement,
) -> tuple[dict[str, VolumetricErrors], dict[str, str]]:
    """Solve by all methods, but for those that the run is too large for (``limits``).

    Returns:
        method → result, for those that can be determined, and method → why not, for the rest.

    Raises:
        ValueError: the lines contradict the volume or each other.
    """
    results: dict[str, VolumetricErrors] = {}
    reasons: dict[str, str] = {}
    too_large = left_out(measurement.volume.blocks)
    for method in SOLVERS:
        if method in too_large:
            reasons[method] = too_large[method]
            continue
        try:
            results[method] = solve(measurement, method)
        except NotDeterminable as missing:
            reasons[method] = str(missing)
    return results, reasons
