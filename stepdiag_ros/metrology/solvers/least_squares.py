"""One weighted least-squares estimate over everything measured.

Unknowns: the nine translational curves, free at every node; two angles for every step-diagonal
    setup; one
zero for every setup. A mirror is set to return the beam, so both are taken to be turned together:
the reading of the exact model is then s = g·(q + Σ t_i(q_i)) + zero with a unit vector g, which has
the cosine error of a tilted line in it (second order, not in Ibaraki & Hata 2010, eq. 4). Tilts of
linear lines act on the reading in the second order only and cannot be told; they are taken as zero.
Angular errors of the machine are not in this model; ``rigid_body`` has them too. Those that were
measured directly at every node are unknowns here as well, told by that measurement and its
uncertainty; the other rotations are taken as zero.

The frame is that of Ibaraki & Hata 2010, eq. 17: E_YX, E_ZX and E_YZ end at zero.
"""

import numpy as np

from stepdiag_ros.metrology.geometry import (
    AXES,
    FRAME,
    REFERENCE_POINT,
    ROTATIONS,
    TRANSLATIONS,
)
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.design import Design, Fit
from stepdiag_ros.metrology.solvers.direct_rows import remarks_of, told_rotations
from stepdiag_ros.metrology.solvers.observations import Observations, observe
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors
from stepdiag_ros.metrology.solvers.summary import (
    CurveEstimate,
    deviations_from_line,
    make_result,
    shape_determined,
)
from stepdiag_ros.metrology.solvers.verdicts import DETERMINED, Verdicts

_SIGNIFICANT = 2.3263
"""Standard normal quantile of p = 0.01, one-sided."""


def solve_least_squares(measurement: Measurement) -> VolumetricErrors:
    """Estimate the volumetric errors from any lines: 1 to 4 diagonals, linear, both ways, partial.

    What the lines do not determine is NaN and named; whatever follows from them all the same
    (squareness from four diagonals without linear lines, a straightness without its slope) is
    given. Where readings come without uncertainty, their noise is estimated from the residuals.
    Where the residuals are larger than the uncertainties explain (p < 0.01), the covariance is
    enlarged by χ²/dof.

    Raises:
        NotDeterminable: there is no reading at all.
        ValueError: the lines contradict the volume or each other.
    """
    design = least_squares_design(observe(measurement), measurement.chain)
    return solve_design("least_squares", design, measurement.chain)


def least_squares_design(observations: Observations, chain: str) -> Design:
    """Return the design of the translations and of the rotations that were measured directly.

    Args:
        observations: the readings.
        chain: order of the machine's axes; empty if not known.

    Raises:
        ValueError: rotations were measured directly, and the chain is not known.
    """
    turning = [
        name for name in ROTATIONS if observations.direct and name in observations.direct.curves
    ]
    if turning and not chain:
        raise ValueError(
            f"{', '.join(turning)} cannot be used: the order of the machine's axes from workpiece"
            " to tool (chain), by which rotations act, is not known for this measurement"
        )
    known = told_rotations(observations.direct, observations.volume) if chain else ()
    return Design(observations, chain if known else "", rotations=known)


def solve_design(method: str, design: Design, chain: str) -> VolumetricErrors:
    """Return the weighted least-squares result of a design, of translations or of all errors.

    Args:
        method: name of the solver.
        design: of the readings.
        chain: of the machine; empty if not known.
    """
    observations = design.observations
    fit = design.fit()
    freedom = design.degrees_of_freedom
    remarks: list[str] = []
    factor = 1.0
    chi_squared = float("nan")
    if not observations.noise_known:
        factor = fit.squares / freedom if freedom > 0 else float("nan")
        remarks.append(
            "The readings have no uncertainty, and no degree of freedom is left to estimate one: "
            "uncertainties are unknown."
            if freedom == 0
            else f"The readings have no uncertainty: {np.sqrt(factor) * 1e6:.3g} µm was estimated "
            f"from the residuals ({freedom} degrees of freedom)."
        )
    elif freedom == 0:
        remarks.append(
            "No degree of freedom is left: these lines cannot show a disagreement with the model."
        )
    else:
        chi_squared = fit.squares
        if exceeds_chance(chi_squared, freedom):
            factor = chi_squared / freedom
            remarks.append(
                f"The residuals are {np.sqrt(factor):.3g} times larger than the readings' "
                f"uncertainties explain (χ²/dof = {factor:.3g}, p < 0.01): something is not in the "
                "model. All uncertainties were multiplied by this factor."
            )
            if chain and not set(ROTATIONS) <= set(design.names):
                remarks.append(
                    "Not all angular errors of the machine are in this model: see whether the "
                    "method rigid_body, which has them, explains the readings."
                )
    if np.isfinite(design.noise_estimated):
        remarks.append(
            f"The readings have no uncertainty: {design.noise_estimated * 1e6:.3g} µm was estimated"
            " from the residuals of a fit without what was measured directly."
        )
    if observations.direct is not None:
        remarks.extend(remarks_of(observations.direct, observations.volume, design.names))
        left = [name for name in ROTATIONS if name not in design.names]
        if design.chain and left:
            remarks.append(f"{', '.join(left)} are taken as zero: they were not measured directly.")
    if design.unseen.shape[1] == 0 and design.tilt_setups:
        remarks.extend(_large_tilts(design, fit))
    estimate = CurveEstimate(
        fit.curves,
        factor * design.curve_covariance(),
        design.curves_unseen(),
        design.names,
        design.arm,
    )
    words = _not_told(design) if design.chain else _not_determined(observations, estimate)
    return make_result(
        method,
        observations.volume,
        estimate,
        [setup.line for setup in observations.setups],
        observations.lines,
        _tilt_figures(design, fit, factor),
        chi_squared,
        freedom,
        words,
        remarks,
        frame=f"{FRAME}; {REFERENCE_POINT}" if design.chain else FRAME,
        chain=design.chain,
    )


def _not_told(design: Design) -> list[str]:
    """Say of every error that is not determined what can do the same."""
    return [
        f"{row.name}: {row.words}." for row in Verdicts(design).rows() if row.status != DETERMINED
    ]


def exceeds_chance(chi_squared: float, freedom: int) -> bool:
    """Say whether χ² is too large for chance, p < 0.01 (Wilson & Hilferty 1931, any dof ≥ 1)."""
    spread = 2.0 / (9.0 * freedom)
    normal = (np.cbrt(chi_squared / freedom) - (1.0 - spread)) / np.sqrt(spread)
    return bool(normal > _SIGNIFICANT)


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


def _tilt_figures(design: Design, fit: Fit, factor: float) -> list[Figure]:
    """Return both angles of each step-diagonal setup along ``forward.perpendiculars``, rad."""
    uncertainty = np.sqrt(factor) * design.tilt_uncertainty()
    return [
        Figure(
            f"tilt {design.observations.setups[setup].name} {which + 1}",
            float(fit.tilts[row, which]) if np.isfinite(design.tilt_known[row, which]) else np.nan,
            float(uncertainty[row, which]),
            "rad",
        )
        for row, setup in enumerate(design.tilt_setups)
        for which in range(2)
    ]


def _not_determined(observations: Observations, estimate: CurveEstimate) -> list[str]:
    """Say in words what the lines cannot tell."""
    size = observations.volume.blocks + 1
    known = estimate.curves_determined().reshape(9, size)
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
            partly.append(f"{name} at the nodes {at}: the lines so far do not tell these points.")
        else:
            nothing.append(name)
    words = []
    measured = {setup.line for setup in observations.setups}
    if nothing:
        words.append(f"{', '.join(nothing)}: the lines so far do not tell these curves.")
    words.extend(partly)
    if shape_only:
        text = f"{', '.join(shape_only)}: only the shape is determined, not the slope."
        linear = [line for line in "xyz" if line not in measured]
        if linear:
            text += f" Measure the linear lines {', '.join(linear)}."
        words.append(text)
    return words
