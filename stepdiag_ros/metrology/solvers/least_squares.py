"""One weighted least-squares estimate over everything measured.

Unknowns: the nine translational curves, free at every node; two angles for every setup of a step
diagonal; one zero for every pass. A mirror is set to return the beam, so both are taken to be
turned together: the reading of the exact model is then s = g·(q + Σ t_i(q_i)) + zero with a unit
vector g, which has the cosine error of a tilted line in it (second order, not in Ibaraki & Hata
2010, eq. 4). Tilts of linear lines act on the reading in the second order only and cannot be
determined; they are taken as zero. Rotations of the axes are random functions of a size that the
readings determine (``rotations``): those that the readings show are taken out, and what they do not
show is in the uncertainties, as large as is plausible. Those that were measured directly at every
node are unknowns instead, determined by the direct measurement and its uncertainty. ``rigid_body``
has all rotations as free curves.

The frame is that of Ibaraki & Hata 2010, eq. 17: E_YX, E_ZX and E_YZ end at zero.
"""

from functools import partial

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, FRAME, REFERENCE_POINT, TRANSLATIONS, Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plausible import Plausible
from stepdiag_ros.metrology.solvers.design import Design
from stepdiag_ros.metrology.solvers.direct_rows import remarks_of
from stepdiag_ros.metrology.solvers.fit import Fit
from stepdiag_ros.metrology.solvers.lengths import by_lengths
from stepdiag_ros.metrology.solvers.method import Method
from stepdiag_ros.metrology.solvers.monte_carlo import LeastSquaresEstimator
from stepdiag_ros.metrology.solvers.noise_factor import noise_factor, widening
from stepdiag_ros.metrology.solvers.observations import Observations, observe
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors
from stepdiag_ros.metrology.solvers.rotations import (
    Turned,
    rotation_remarks,
    turned,
    with_rotations,
)
from stepdiag_ros.metrology.solvers.summary import (
    CurveEstimate,
    deviations_from_line,
    make_result,
    shape_determined,
)
from stepdiag_ros.metrology.solvers.verdicts import DETERMINED, Verdicts


def solve_least_squares(measurement: Measurement) -> VolumetricErrors:
    """Estimate the volumetric errors from any lines: diagonal, linear, bidirectional or partial.

    What the lines do not determine is NaN and named; whatever follows from them all the same
    (squareness from four diagonals without linear lines, a straightness without its slope) is
    given. Where readings come without uncertainty, their noise is estimated from the residuals, and
    u is widened so that 1.96 u is the coverage interval of Student's distribution.
    Where the residuals are larger than the uncertainties explain (p < 0.01), the covariance is
    enlarged by χ²/dof.

    Raises:
        NotDeterminable: there is no reading at all.
        ValueError: the lines contradict the volume or each other.
    """
    return result_of(measurement, turned(measurement, observe(measurement)))


def result_of(measurement: Measurement, both: Turned) -> VolumetricErrors:
    """Return the volumetric errors by a fit with rotations beside it.

    Args:
        measurement: the lines.
        both: fit of them.
    """
    design, fit, rotations = both.design, both.fit, both.rotations
    observations = design.observations
    remarks = [*observations.rounding_remarks, *_noise_remarks(design, rotations.noise_factor)]
    remarks += _direct_remarks(design)
    remarks += rotation_remarks(measurement, rotations)
    if design.unseen.shape[1] == 0 and design.tilt_setups:
        remarks.extend(_large_tilts(design, fit))
    estimate = estimate_of(both)
    by_readings = both.scatter()
    by_readings += estimate.covariance
    known = observations.noise_known and design.degrees_of_freedom > 0
    return make_result(
        "least_squares",
        observations.volume,
        estimate,
        [setup.line for setup in observations.setups],
        observations.lines,
        _tilt_figures(design, both.tilts, both.tilt_covariance),
        fit.squares - rotations.explained if known else float("nan"),
        design.degrees_of_freedom,
        _not_determined(observations, estimate),
        remarks,
        chain=measurement.chain,
        shown=design.names,
        by_readings=by_readings,
    )


def estimate_of(both: Turned) -> CurveEstimate:
    """Return the curves of a fit with rotations beside it, with all that makes them uncertain."""
    design = both.design
    scale = design.of_curves(both.by_lengths)
    covariance = design.curve_covariance()
    covariance *= both.rotations.covariance_factor
    covariance += scale @ scale.T
    unseen = design.curves_unseen()
    return with_rotations(both.fit.curves, covariance, unseen, both, both.change, predicted=True)


def solve_design(method: str, design: Design, plausible: Plausible) -> VolumetricErrors:
    """Return the weighted least-squares result of a design of all eighteen curves.

    Args:
        method: name of the solver.
        design: of the readings.
        plausible: what may act although no reading shows it; the rotations are free here.
    """
    observations = design.observations
    fit = design.fit()
    freedom = design.degrees_of_freedom
    factor = noise_factor(fit.squares, freedom, observations.noise_known)
    wide = factor * widening(design.noise_freedom(freedom))
    remarks = [*observations.rounding_remarks, *_noise_remarks(design, factor)]
    remarks += _direct_remarks(design)
    if design.unseen.shape[1] == 0 and design.tilt_setups:
        remarks.extend(_large_tilts(design, fit))
    lengths = by_lengths(design, design.matrix, plausible)
    scale, turn = design.of_curves(lengths), design.of_tilts(lengths)
    known = design.tilt_known.reshape(-1)
    estimate = CurveEstimate(
        fit.curves,
        wide * design.curve_covariance() + scale @ scale.T,
        design.curves_unseen(),
        design.names,
        design.arm,
    )
    return make_result(
        method,
        observations.volume,
        estimate,
        [setup.line for setup in observations.setups],
        observations.lines,
        _tilt_figures(
            design,
            known * fit.tilts.reshape(-1),
            (wide * design.tilt_covariance() + turn @ turn.T) * np.outer(known, known),
        ),
        fit.squares if observations.noise_known and freedom > 0 else float("nan"),
        freedom,
        _not_told(design),
        remarks,
        frame=f"{FRAME}; {REFERENCE_POINT}",
        chain=design.chain,
    )


def _noise_remarks(design: Design, factor: float) -> list[str]:
    """Say where the noise was taken from, and whether the residuals are larger than it."""
    freedom = design.degrees_of_freedom
    if not design.observations.noise_known:
        return [
            "The readings have no uncertainty, and no degree of freedom is left to estimate one: "
            "uncertainties are unknown."
            if not np.isfinite(factor)
            else f"The readings have no uncertainty: {np.sqrt(factor) * 1e6:.3g} µm was estimated "
            f"from the residuals ({freedom} degrees of freedom)."
        ]
    if freedom == 0:
        return [
            "No degree of freedom is left: these lines cannot show a disagreement with the model."
        ]
    if factor > 1.0:
        return [
            f"The residuals are {np.sqrt(factor):.3g} times larger than the readings' "
            f"uncertainties explain (χ²/dof = {factor:.3g}, p < 0.01): something is not in the "
            "model. All uncertainties were multiplied by this factor."
        ]
    return []


def _direct_remarks(design: Design) -> list[str]:
    """Say how what was measured directly was used."""
    observations = design.observations
    remarks = []
    if np.isfinite(design.noise_estimated):
        remarks.append(
            f"The readings have no uncertainty: {design.noise_estimated * 1e6:.3g} µm was estimated"
            " from the residuals of a fit without what was measured directly."
        )
    if observations.direct is not None:
        remarks += remarks_of(observations.direct, observations.volume, design.names)
    return remarks


def _not_told(design: Design) -> list[str]:
    """Say of every error that is not determined what can do the same."""
    return [
        f"{row.name}: {row.words}." for row in Verdicts(design).rows() if row.status != DETERMINED
    ]


def _large_tilts(design: Design, fit: Fit) -> list[str]:
    tilts = np.linalg.norm(fit.tilts, axis=1)
    worst = int(np.argmax(tilts))
    if tilts[worst] < 2e-3:
        return []
    name = design.observations.setups[design.tilt_setups[worst]].name
    return [
        f"The setup '{name}' is tilted by {tilts[worst] * 1e3:.2g} mrad: align it, since beam and "
        "mirror are only assumed to be turned together."
    ]


def _tilt_figures(design: Design, tilts: Vector, covariance: Vector) -> list[Figure]:
    """Return both angles of each step-diagonal setup along ``forward.perpendiculars``, rad."""
    names = [
        f"tilt {design.observations.setups[setup].name} {which + 1}"
        for setup in design.tilt_setups
        for which in range(2)
    ]
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return [
        Figure(name, float(value), float(uncertainty), "rad")
        for name, value, uncertainty in zip(names, tilts, spread, strict=True)
    ]


def _not_determined(observations: Observations, estimate: CurveEstimate) -> list[str]:
    """Return in words what the lines do not determine."""
    size = observations.volume.blocks + 1
    known = estimate.curves_determined()[: 9 * size].reshape(9, size)
    shape_only, partly, nothing = [], [], []
    for row, name in enumerate(TRANSLATIONS):
        if np.all(known[row]):
            continue
        axis = AXES.index(name[3])
        place = slice(row * size, (row + 1) * size)
        matrix = deviations_from_line(observations.volume.nodes(axis))
        if shape_determined(estimate, matrix, place):
            shape_only.append(name)
        elif np.any(known[row, 1:-1]):
            at = ", ".join(str(node) for node in np.flatnonzero(~known[row]))
            partly.append(
                f"{name} at the nodes {at}: the lines so far do not determine these points."
            )
        else:
            nothing.append(name)
    words = []
    if nothing:
        words.append(f"{', '.join(nothing)}: the lines so far do not determine these curves.")
    words.extend(partly)
    if shape_only:
        words.append(f"{', '.join(shape_only)}: only the shape is determined, not the slope.")
    return words


METHOD = Method(
    name="least_squares",
    title="Least squares",
    summary="nine curves and the tilts of the setups, all readings weighted by their uncertainty",
    needs="any lines",
    source="forward model; frame of IH eq. 17",
    solve=solve_least_squares,
    order=50,
    reliance=6,
    curves=TRANSLATIONS,
    weighs_direct=True,
    estimator=partial(LeastSquaresEstimator, rotations=False),
)
