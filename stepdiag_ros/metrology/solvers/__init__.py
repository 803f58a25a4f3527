"""Solvers: from measured lines to volumetric errors, all with one result type."""

from dataclasses import replace

from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.catalogue import methods, own_methods, solvers
from stepdiag_ros.metrology.solvers.limits import left_out
from stepdiag_ros.metrology.solvers.result import NotDeterminable, VolumetricErrors

__all__ = ["methods", "solve", "solve_all", "solvers"]

# Whoever limits the threads of the numerical libraries before solving must have them loaded.
own_methods()


def solve(measurement: Measurement, method: str = "least_squares") -> VolumetricErrors:
    """Solve by one method.

    Raises:
        NotDeterminable: the lines are not enough for this method.
        ValueError: no such method, or the lines contradict the volume or each other.
    """
    known = solvers()
    if method not in known:
        raise Refusal(
            f"'{method}' is not a method; use one of {', '.join(known)}",
            fault="unknown",
            aspect="method",
        )
    result = known[method](measurement)
    if measurement.direct is None or methods()[method].weighs_direct:
        return result
    return replace(
        result,
        remarks=(*result.remarks, "What was measured directly is not used by this method."),
    )


def solve_all(measurement: Measurement) -> tuple[dict[str, VolumetricErrors], dict[str, str]]:
    """Solve by all methods, but for those that the run is too large for (``limits``).

    Returns:
        method → result, for those that can be determined, and method → why not, for the rest.

    Raises:
        ValueError: the lines contradict the volume or each other.
    """
    results: dict[str, VolumetricErrors] = {}
    reasons: dict[str, str] = {}
    too_large = left_out(measurement.volume.blocks)
    for method in solvers():
        if method in too_large:
            reasons[method] = too_large[method]
            continue
        try:
            results[method] = solve(measurement, method)
        except NotDeterminable as missing:
            reasons[method] = str(missing)
    return results, reasons
