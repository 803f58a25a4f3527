"""What every figure of a seven-line test with a ± ought to be on a simulated machine."""

from collections.abc import Iterator

import numpy as np
from random_machines import PLACES, Measured

from stepdiag_ros.metrology.forward import tool_point
from stepdiag_ros.metrology.tracker.campaign import true_values
from stepdiag_ros.metrology.tracker.evaluation import SevenLineResult
from stepdiag_ros.metrology.tracker.joint import NAMES
from stepdiag_ros.metrology.tracker.readings import points_of


def figures(result: SevenLineResult, one: Measured) -> Iterator[tuple[str, float, float, float]]:
    """Yield kind, value, standard uncertainty and truth of each figure of a result."""
    low = points_of(one.readings).min(axis=0)
    high = points_of(one.readings).max(axis=0)
    turn = turn_into_frame(one, low, high)

    def moved(points):
        """Return the error at places in the frame of the results, zero at the first corner."""
        both, _ = tool_point(np.vstack([low, points]), one.cell.errors, one.cell.chain)
        error = both - np.vstack([low, points])
        return error[1:] - error[0] + np.cross(turn, points - low)

    truth = dict(zip(NAMES, true_values(one.cell, result.joint.machine.box), strict=True))
    spread = result.joint.standard_uncertainty
    for name, value, u in zip(NAMES, result.joint.values, spread, strict=True):
        yield f"joint {name.split()[0] if 'scale' in name else 'squareness'}", value, u, truth[name]
    at_low, _ = tool_point(low[None, :], one.cell.errors, one.cell.chain)
    station = np.array(PLACES[one.place][1]) - (at_low[0] - low)
    station = station + np.cross(turn, station - low)
    for axis in range(3):
        u = np.sqrt(result.joint.place_covariance[axis, axis])
        yield "joint place", result.joint.position[axis], u, station[axis]
        u = result.location.standard_uncertainty[axis]
        yield "place from places", result.location.position[axis], u, station[axis]
    for words, lines in (("located", result.located), ("corrected", result.corrected)):
        slopes = {}
        for slope in lines.slopes:
            error = moved(slope.targets) @ slope.direction
            way = (slope.targets - slope.targets[0]) @ slope.direction
            slopes[slope.name] = np.polyfit(way, error, 1)[0]
            yield (
                f"slope of a line, {words}",
                slope.slope,
                slope.standard_uncertainty,
                slopes[slope.name],
            )
        for angle in lines.squareness:
            yield (
                f"squareness of a face line, {words}",
                angle.value,
                angle.standard_uncertainty,
                truth[angle.name],
            )
    for name, single in result.separations.items():
        if isinstance(single, str):
            continue
        rows = [r for r in one.readings if r.line == name]
        targets = np.array([r.position for r in {r.stop: r for r in rows}.values()])
        error = moved(targets)
        way = targets - targets[0]
        direction = way[-1] / np.linalg.norm(way[-1])
        for what, value, u, along in (
            ("scale", single.scale, single.standard_uncertainty[0], direction),
            ("lean", single.lean, single.standard_uncertainty[1], single.towards),
        ):
            true = np.polyfit(way @ direction, error @ along, 1)[0]
            yield f"{what} of a single line", value, u, true


def turn_into_frame(one: Measured, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the turn that makes the mean slopes of E_YX, E_ZX and E_YZ zero."""
    ends = low + np.diag(high - low)
    both, _ = tool_point(np.vstack([low, ends]), one.cell.errors, one.cell.chain)
    error = both[1:] - ends - (both[0] - low)
    side = high - low
    return np.array([error[2, 1] / side[2], error[0, 2] / side[0], -error[0, 1] / side[0]])
