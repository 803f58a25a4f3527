"""Scales and squareness of all three axes together with the tracker's place, from all readings.

A tracker that is located by an erroneous machine stands in the wrong place, and every line that is
then evaluated from there is bent (ATLI Fig. 5). The cure is to estimate both from the same lengths:

    ΔL = |q + e(q) - t| - L0,       e(q) = A (q - q_0) + smooth curves (``machine_curves``)

            s_X    -C0Y     B0Z
    A   =    0      s_Y      0
             0     -A0Z     s_Z

Ten unknowns are free: three scales, three squareness angles (right-handed), t and L0. The curves
and what differs between passes are random effects (``mixed_model``): positioning, straightness and
rotations repeat in every pass over a line, so no number of passes makes them smaller, and without
them in the model the uncertainty is false by the root of that number. The three directions of the
frame are not unknowns: turning machine and tracker together changes no length.

Scales and squareness are those of the whole machine, A and curves: the slopes of least-squares
lines of E_XX, E_YY, E_ZZ, and the sums of ``forward.SQUARENESS_SLOPES``, over the measured box with
the other axes at its first corner. On a machine that turns, other lines have other slopes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES
from stepdiag_ros.metrology.geometry import AXES, SQUARENESS, Vector
from stepdiag_ros.metrology.tracker.adjustment import Model, PoorGeometry, adjust
from stepdiag_ros.metrology.tracker.agreement import PassDeparture, departures
from stepdiag_ros.metrology.tracker.lengths import proportional_share
from stepdiag_ros.metrology.tracker.location import station_model
from stepdiag_ros.metrology.tracker.machine_curves import (
    AFFINE_PLACES,
    SIZES,
    MachineCurves,
    MeasuredBox,
    effects_of,
)
from stepdiag_ros.metrology.tracker.mixed_model import Effects, MixedFit, fit, fit_with_sizes
from stepdiag_ros.metrology.tracker.readings import (
    TrackerReading,
    changes_of,
    points_of,
    uncertainties_of,
)

NAMES = ("scale X", "scale Y", "scale Z", *SQUARENESS)
"""In the order of the values; scales in m/m, squareness in rad."""
_FREE = 10
_STEPS = 3
_TYPICAL_NOISE = 1e-6
_UNKNOWN_NOISE = 10.0
"""Factor by which the noise may differ from the typical one where no uncertainty is given."""
_FALSE_ALARMS = 0.01


@dataclass(frozen=True)
class JointEstimate:
    """Scales and squareness, with the tracker's place.

    Attributes:
        values: of ``NAMES``, shape (6,).
        covariance: of them, shape (6, 6), with what the machine's curves may do.
        position: of the station in the frame of the results, m, shape (3,).
        start_length: L0, m.
        place_covariance: of position and L0, m², shape (4, 4).
        sizes: name in ``machine_curves.SIZES`` → size that the readings make the likeliest.
        machine: the curves' model, with the box that the values speak of.
        residuals: what neither errors, curves nor passes explain, m, shape (n,).
        warnings: what is wrong with the readings, in words.
        passes: how far each pass departs from what all others say of it.
    """

    values: Vector
    covariance: Vector
    position: Vector
    start_length: float
    place_covariance: Vector
    sizes: dict[str, float]
    machine: MachineCurves
    residuals: Vector
    warnings: tuple[str, ...]
    passes: tuple[PassDeparture, ...]
    _mean: Vector
    _covariance: Vector

    @property
    def standard_uncertainty(self) -> Vector:
        """Return the standard uncertainties of ``NAMES``, shape (6,)."""
        made: Vector = np.sqrt(np.diag(self.covariance))
        return made

    @property
    def machine_position(self) -> Vector:
        """Return where the machine would have to go for the reflector to meet the tracker, m, (3,).

        With scales and squareness alone. Lines are calculated from there.
        """
        corner = self.machine.box.low
        near = np.linalg.solve(error_matrix(self.values), self.position - corner)
        made: Vector = near + corner
        return made

    def without_bands(self) -> "JointEstimate":
        """Return the same values with unknown uncertainties."""
        return replace(
            self,
            covariance=np.full_like(self.covariance, np.nan),
            place_covariance=np.full_like(self.place_covariance, np.nan),
            _covariance=np.full_like(self._covariance, np.nan),
        )

    def told(self, functionals: Vector) -> tuple[Vector, Vector]:
        """Return what is known of functionals of the machine's errors.

        Args:
            functionals: on the unknowns of ``machine``, shape (r, unknowns).

        Returns:
            values, shape (r,), and their covariance, shape (r, r).
        """
        return functionals @ self._mean, functionals @ self._covariance @ functionals.T


def error_matrix(values: Vector) -> Vector:
    """Return 1 + A of these scales and squareness angles (``NAMES``), shape (3, 3)."""
    matrix = np.eye(3)
    for value, (row, column, sign) in zip(values, AFFINE_PLACES, strict=True):
        matrix[row, column] += sign * value
    return matrix


def functionals_of(machine: MachineCurves) -> Vector:
    """Return ``NAMES`` in terms of the machine's unknowns, shape (6, unknowns)."""
    rows = [machine.slope(f"E_{letter}{letter}") for letter in AXES]
    for name in SQUARENESS:
        factor, (first, second) = SQUARENESS_SLOPES[name]
        rows.append(factor * (machine.slope(first) + machine.slope(second)))
    return np.array(rows)


def estimate(
    readings: Sequence[TrackerReading],
    station: Vector,
    start_length: float,
    chain: str = "",
    sizes: Sequence[float] | None = None,
) -> JointEstimate:
    """Estimate scales, squareness and the tracker's place together; see the module.

    Args:
        readings: all with one zero of the counter, measured.
        station: rough place of the tracker, m, shape (3,), see ``location.locate``.
        start_length: rough L0, m.
        chain: order of the axes from workpiece to tool; empty if not known.
        sizes: of ``machine_curves.SIZES`` if they are given; None: the readings determine them.

    Raises:
        PoorGeometry: the places do not determine all ten unknowns.
        ValueError: some readings have an uncertainty and some have none.
    """
    points, changes, spread = _arrays(readings)
    machine = MachineCurves(MeasuredBox.around(points), chain)
    corner = machine.box.low

    def model(at: Vector) -> tuple[Vector, Vector]:
        reached = (points - corner) @ error_matrix(at[:6]).T + corner
        length, by_station = station_model(reached, at[6:])
        by_errors = np.einsum("na,nap->np", -by_station[:, :3], machine.affine(points))
        return length, np.column_stack([by_errors, by_station])

    start = np.concatenate([np.zeros(6), station, [start_length]])
    at = _rough(model, changes, spread, start)
    predicted, free = model(at)
    known = bool(np.all(np.isfinite(uncertainties_of(readings))))
    usual = SIZES if known else (replace(SIZES[0], factor=_UNKNOWN_NOISE), *SIZES[1:])
    effects = effects_of(machine, readings, -free[:, 6:9], changes, usual)
    medians = [size.median for size in SIZES] if sizes is None else sizes
    for _ in range(_STEPS):
        step = fit_with_sizes(changes - predicted, spread, free, effects, medians)
        at = at + step.mean[:_FREE]
        predicted, free = model(at)
    left = changes - predicted
    if sizes is None:
        found = fit(left, spread, free, effects)
    else:
        found = fit_with_sizes(left, spread, free, effects, sizes)
    residuals = left - np.hstack([free, effects.design]) @ found.mean
    warnings = _warnings(residuals / (spread * found.sizes[0]), residuals, readings)
    made = _result(
        found, at, machine, residuals, warnings, proportional_share(spread, changes + at[9])
    )
    return replace(made, passes=_departures(readings, left, spread, free, effects, found.sizes))


def _departures(
    readings: Sequence[TrackerReading],
    left: Vector,
    spread: Vector,
    free: Vector,
    effects: Effects,
    sizes: Vector,
) -> tuple[PassDeparture, ...]:
    """Return the departures of the passes where the sizes are the likeliest ones."""
    likeliest = fit_with_sizes(left, spread, free, effects, [float(size) for size in sizes])
    design = np.hstack([free, effects.design])
    residuals = left - design @ likeliest.mean
    return departures(readings, residuals, spread * sizes[0], design, likeliest.covariance)


def _arrays(readings: Sequence[TrackerReading]) -> tuple[Vector, Vector, Vector]:
    spread = uncertainties_of(readings)
    known = np.isfinite(spread)
    if known.any() and not known.all():
        raise ValueError(
            "some readings have an uncertainty and some have none; give all of them one, or none"
        )
    if np.any(spread[known] <= 0):
        raise ValueError("the uncertainty of a reading is not more than zero")
    return (
        points_of(readings),
        changes_of(readings),
        np.where(known, spread, _TYPICAL_NOISE),
    )


def _rough(model: Model, changes: Vector, spread: Vector, start: Vector) -> Vector:
    try:
        return adjust(model, changes, spread, start).parameters
    except PoorGeometry:
        raise PoorGeometry(
            "scales, squareness and the tracker's place cannot be determined from these places"
            " together; measure all seven lines, and places on other sides of the tracker"
        ) from None


def _warnings(
    standardised: Vector, residuals: Vector, readings: Sequence[TrackerReading]
) -> tuple[str, ...]:
    from scipy.special import ndtri

    limit = -float(ndtri(0.5 * _FALSE_ALARMS / len(standardised)))
    worst = int(np.argmax(np.abs(standardised)))
    if abs(standardised[worst]) <= limit:
        return ()
    return (
        f"{readings[worst]}: the residual of {residuals[worst] * 1e6:.3g} µm is"
        f" {abs(standardised[worst]):.3g} times its standard uncertainty, the largest of all; look"
        " at this reading first.",
    )


def _result(
    found: MixedFit,
    at: Vector,
    machine: MachineCurves,
    residuals: Vector,
    warnings: tuple[str, ...],
    common_scale: float,
) -> JointEstimate:
    """Put scales, squareness and place into the frame of the results."""
    # The order of the fit: A, station, L0, curves, passes.
    ours = np.concatenate([np.arange(6), _FREE + np.arange(len(machine.groups))])
    mean = found.mean[ours].copy()
    mean[:6] += at[:6]
    covariance = found.covariance[np.ix_(ours, ours)].copy()
    covariance[:3, :3] += common_scale**2
    functionals = functionals_of(machine)
    station = at[6:9] + found.mean[6:9]
    start_length = float(at[9] + found.mean[9])
    away = station - machine.box.low
    # θ × (t - q_0), beside the station itself.
    by_turn = np.cross(machine.turn().T, away).T
    place = np.zeros((4, len(found.mean)))
    place[:3, ours] = by_turn
    place[:, 6:_FREE] += np.eye(4)
    lengths = np.append(away, start_length)
    return JointEstimate(
        values=functionals @ mean,
        covariance=functionals @ covariance @ functionals.T,
        position=station + by_turn @ mean,
        start_length=start_length,
        place_covariance=place @ found.covariance @ place.T
        + common_scale**2 * np.outer(lengths, lengths),
        sizes={size.name: float(one) for size, one in zip(SIZES, found.sizes, strict=True)},
        machine=machine,
        residuals=residuals,
        warnings=warnings,
        passes=(),
        _mean=mean,
        _covariance=covariance,
    )
