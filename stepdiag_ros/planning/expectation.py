"""What a plan will determine, and how well: from its design matrix alone, before anything moves.

The covariance of a least-squares estimate does not depend on the readings but on where they are
taken and how uncertain each of them is. So a measurement of a perfect machine, with the commanded
stops as its readings, has the uncertainty that the real one will have, as far as the stops'
uncertainties are right. By noise alone (``expect``) it holds neither what is common to all stops
(wavelength, expansion, dead path) nor errors that the model does not know; with rotations of a
plausible size (``expect_with_rotations``) it is what ``least_squares`` prints.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES
from stepdiag_ros.metrology.geometry import (
    AXES,
    ROTATIONS,
    SQUARENESS,
    TRANSLATIONS,
    Vector,
    beam_direction,
    moving_axis,
    translation,
)
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import Line, Plan, Volume
from stepdiag_ros.metrology.plausible import Plausible
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.design import Design
from stepdiag_ros.metrology.solvers.least_squares import estimate_of, result_of
from stepdiag_ros.metrology.solvers.observations import observe
from stepdiag_ros.metrology.solvers.rotations import expected_moments, turned
from stepdiag_ros.metrology.solvers.summary import (
    CurveEstimate,
    deviations_from_line,
    slope_weights,
)
from stepdiag_ros.metrology.volumetric_map import VolumetricMap

STRAIGHTNESS = tuple(name for name in TRANSLATIONS if name[2] != name[3])
Noise = float | Callable[[Line], Vector]
"""Standard uncertainty of every stop, m, or of each stop of a line, m, shape (stops,)."""
_PLACES_ALONG_AXIS = 6
"""Errors of rotations grow towards the ends of the axes: few places find the largest."""
POSITIONING = tuple(name for name in TRANSLATIONS if name[2] == name[3])


@dataclass(frozen=True)
class PlanExpectation:
    """Expected standard uncertainties of a plan; NaN where the plan does not determine something.

    Attributes:
        squareness: C0Y, B0Z, A0Z → rad.
        straightness: E_YX … → largest over the nodes, of the deviation from the least-squares line,
            m.
        positioning: E_XX, E_YY, E_ZZ → largest over the nodes, m.
        angular: E_AX … → largest over the nodes, rad; empty where the model has no rotations.
        volumetric: largest over all nodes of the volume and the three directions, of the error of
            the mirror's point by the nine translations, m.
        degrees_of_freedom: of the fit; 0: the plan fits any readings.
    """

    squareness: dict[str, float]
    straightness: dict[str, float]
    positioning: dict[str, float]
    angular: dict[str, float]
    volumetric: float
    degrees_of_freedom: int

    def scaled(self, factor: float) -> "PlanExpectation":
        """Return the same with all uncertainties multiplied; degrees of freedom are left."""
        return replace(
            self,
            squareness={name: factor * u for name, u in self.squareness.items()},
            straightness={name: factor * u for name, u in self.straightness.items()},
            positioning={name: factor * u for name, u in self.positioning.items()},
            angular={name: factor * u for name, u in self.angular.items()},
            volumetric=factor * self.volumetric,
        )


def expect(plan: Plan, stop_uncertainty: Noise, chain: str = "") -> PlanExpectation:
    """Return the uncertainties to be expected of a plan by weighted least squares.

    Args:
        plan: what is measured.
        stop_uncertainty: of each stop: the mean of its readings, and how well the machine comes
            back to the place.
        chain: order of the axes from workpiece to tool: the rotations are estimated too, as by
            the method rigid_body; empty: the translations alone, as by least_squares.

    Raises:
        ValueError: the uncertainty is not positive, or there is no such chain.
    """
    if not callable(stop_uncertainty) and not 0.0 < stop_uncertainty < 1.0:
        raise Refusal(
            f"the uncertainty of a stop is {stop_uncertainty:g} m; it must be positive",
            fault="out_of_range",
            aspect="uncertainty",
        )
    # In units of a stop's uncertainty the matrices are the same for every laser.
    of_each = callable(stop_uncertainty)
    design = Design(observe(nominal_measurement(plan, stop_uncertainty if of_each else 1.0)), chain)
    estimate = CurveEstimate(
        values=np.zeros(len(design.names) * (plan.volume.blocks + 1)),
        covariance=design.curve_covariance(),
        unseen=design.curves_unseen(),
        names=design.names,
        arm=design.arm,
    )
    volumetric = _volumetric(estimate, plan.volume)
    rotations = [name for name in design.names if name in ROTATIONS]
    expectation = _expectation(
        estimate, plan.volume, rotations, volumetric, design.degrees_of_freedom
    )
    return expectation if callable(stop_uncertainty) else expectation.scaled(stop_uncertainty)


def expect_with_rotations(
    plan: Plan, stop_uncertainty: Noise, chain: str, rotation: float
) -> PlanExpectation:
    """Return the uncertainties that ``least_squares`` will print of a plan.

    Beside the noise of the stops they hold what pitch, yaw and roll make uncertain, as far as no
    line shows them, and the laser's scale. The machine turns as much as is plausible.

    Args:
        plan: what is measured.
        stop_uncertainty: of each stop.
        chain: order of the axes from workpiece to tool; empty if not known: any may act.
        rotation: plausible size of the rotations over the measured travel, rad.
    """
    plausible = Plausible(rotation)
    nominal = nominal_measurement(plan, stop_uncertainty)
    measurement = replace(nominal, chain=chain, plausible=plausible)
    both = turned(measurement, observe(measurement))
    volume = plan.volume
    places = _some_places(volume)
    if rotation:
        spread, estimated, vectors = expected_moments(both.rotations.information, rotation)
        covariance = (vectors * spread) @ vectors.T
        both = replace(both, rotations=replace(both.rotations, covariance=covariance))
    result = result_of(measurement, both)
    if rotation and result.turned_factor.size:
        # The lines of a perfect machine show no rotations; those of one that turns do.
        shown = both.curves @ (vectors * np.sqrt(estimated))
        still = np.zeros((len(result.turned_factor) - len(shown), shown.shape[1]))
        factor = np.column_stack([result.turned_factor, np.concatenate([still, shown])])
        result = replace(result, turned_factor=factor)
    error_map = VolumetricMap.of_result(result, chain, plausible)
    variance = np.diagonal(error_map.covariance_at(places), axis1=1, axis2=2)
    return _expectation(
        estimate_of(both),
        volume,
        (),
        float(np.sqrt(np.max(variance))),
        both.design.degrees_of_freedom,
    )


def _expectation(
    estimate: CurveEstimate,
    volume: Volume,
    rotations: Iterable[str],
    volumetric: float,
    degrees_of_freedom: int,
) -> PlanExpectation:
    every = np.eye(volume.blocks + 1)
    return PlanExpectation(
        squareness={name: _squareness(estimate, volume, name) for name in SQUARENESS},
        straightness={
            name: _largest(estimate, name, deviations_from_line(volume.nodes(moving_axis(name))))
            for name in STRAIGHTNESS
        },
        positioning={name: _largest(estimate, name, every) for name in POSITIONING},
        angular={name: _largest(estimate, name, every) for name in rotations},
        volumetric=volumetric,
        degrees_of_freedom=degrees_of_freedom,
    )


def _some_places(volume: Volume) -> Vector:
    """Return nodes of the volume with all its corners, a few along each axis, m, shape (n, 3)."""
    few = min(volume.blocks + 1, _PLACES_ALONG_AXIS)
    at = np.linspace(0, volume.blocks, few).round().astype(int)
    grid = np.meshgrid(*(volume.nodes(axis)[at] for axis in range(3)), indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, 3)


def nominal_measurement(plan: Plan, stop_uncertainty: Noise) -> Measurement:
    """Return what a perfect machine, laser and setup would give: the commanded displacements."""
    made = []
    step = np.asarray(plan.volume.step)
    for index, line in enumerate(plan.lines):
        targets = line.stops(plan.volume)
        first = replace(line, direction="forward").stops(plan.volume)[0]
        count = len(targets)
        u = stop_uncertainty(line) if callable(stop_uncertainty) else stop_uncertainty
        made.append(
            MeasuredLine(
                line=line,
                line_index=index,
                attempt=1,
                setup=plan.setup_of(line),
                time=np.arange(count, dtype=np.float64),
                end_time=0,
                target=targets,
                displacement=(targets - first) @ beam_direction(line.name, step),
                standard_uncertainty=np.full(count, u),
                environment=np.full((count, 4), np.nan),
                overrun=plan.overrun_of(line),
            )
        )
    return Measurement(plan.volume, tuple(made))


def worst(uncertainties: Iterable[float]) -> float:
    """Return the largest of some uncertainties; NaN if one is not determined, or without any."""
    listed = list(uncertainties)
    return float(np.max(listed)) if listed else float("nan")


def _largest(estimate: CurveEstimate, name: str, matrix: Vector) -> float:
    """Return the largest uncertainty of the rows of a matrix times a curve; NaN if one is open."""
    rows = np.zeros((len(matrix), len(estimate.values)))
    rows[:, estimate.place(name)] = matrix
    # A row that is the first node alone is zero by definition and no measured value.
    return float(np.max(estimate.evaluate(rows)[1]))


def _squareness(estimate: CurveEstimate, volume: Volume, name: str) -> float:
    row = np.zeros((1, len(estimate.values)))
    factor, pair = SQUARENESS_SLOPES[name]
    for curve in pair:
        row[0, estimate.place(curve)] = factor * slope_weights(volume.nodes(moving_axis(curve)))
    return float(estimate.evaluate(row)[1][0])


def _volumetric(estimate: CurveEstimate, volume: Volume) -> float:
    """Return the largest uncertainty of E_.X(i) + E_.Y(j) + E_.Z(k) over all i, j, k, m."""
    size = volume.blocks + 1
    largest = 0.0
    for error in range(3):
        place = [estimate.place(translation(error, axis)) for axis in range(len(AXES))]
        every = np.zeros((3 * size, len(estimate.values)))
        for axis in range(3):
            every[axis * size : (axis + 1) * size, place[axis]] = np.eye(size)
        if not np.all(estimate.determined(every)):
            return float("nan")
        c = [[estimate.covariance[one, other] for other in place] for one in place]
        x, y, z = (np.diag(c[axis][axis]) for axis in range(3))
        variance = (
            x[:, None, None]
            + y[None, :, None]
            + z[None, None, :]
            + 2.0 * (c[0][1][:, :, None] + c[0][2][:, None, :] + c[1][2][None, :, :])
        )
        largest = max(largest, float(np.max(variance)))
    return float(np.sqrt(largest))
