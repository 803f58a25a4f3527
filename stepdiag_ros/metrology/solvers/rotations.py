"""Rotations of the axes as random functions beside a translations-only least squares.

The readings left by the nine free curves, angles and zeros are r = Z c + e: c the rotations' modes
(``plausible``) with variance s², e the noise. From S = Zᵀ Z and b = Zᵀ r, with Z and r in units of
the noise and beyond all that is free, follow the evidence for each s and, given s, the mean and the
covariance of c (best linear unbiased prediction; Robinson 1991, Statistical Science 6, 15):

    c = (S + 1/s²)⁻¹ b,     cov c = (S + 1/s²)⁻¹,
    ln p(r | s) = -½ Σ ln(1 + s² λ) + ½ Σ (v·b)² s² / (1 + s² λ) + const,    S v = λ v.

Values are averaged over s by its evidence times what is plausible. For their uncertainty a size
below the plausible one counts as that one: that the rotations which the readings show are small
says nothing of one that acts on no reading, because one axis may turn alone. For the same reason
other readings act on c as they do at the plausible size or above (``Turned.factors``).
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.forward import levers
from stepdiag_ros.metrology.geometry import CHAINS, ROTATIONS, TRANSLATIONS, Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plausible import mode_count, modes, rotation_readings
from stepdiag_ros.metrology.solvers.design import Design
from stepdiag_ros.metrology.solvers.direct_rows import told_rotations
from stepdiag_ros.metrology.solvers.fit import Fit
from stepdiag_ros.metrology.solvers.lengths import by_lengths
from stepdiag_ros.metrology.solvers.noise_factor import noise_factor, widening
from stepdiag_ros.metrology.solvers.observations import Integers, Observations
from stepdiag_ros.metrology.solvers.summary import CurveEstimate

SHOWN = 0.01
"""Probability of a gain below which a run counts as showing rotations."""
_RATIOS = np.geomspace(1e-3, 30.0, 60)
"""Sizes s that are averaged over, as multiples of the plausible one."""
_STUDENT = 4.0
"""Degrees of freedom of the plausible size's distribution."""
_RANK_LIMIT = 1e-9
"""Share of the largest eigenvalue of S below which the readings show nothing of a direction."""


@dataclass(frozen=True)
class Rotations:
    """What a run shows of the rotations, and what they may be beyond that.

    Attributes:
        readings: what each mode adds to the averaged readings, m/rad, shape (groups, k).
        information: of the modes' factors beyond all that is free, 1/rad², shape (k, k).
        reaction: of the factors to the pull of the residuals on each mode, where axes turn by what
            is plausible or more, rad m, shape (k, k).
        scatter: what the noise of the readings does to the mean, per standard deviation of
            independent causes, rad, shape (k, seen).
        mean: of the modes' factors, rad, shape (k,).
        best: factors of any size that fit the readings best, rad, shape (k,); zero where these show
            nothing, or where rotations are taken as zero.
        covariance: mean square and products of their errors, rad², shape (k, k).
        second_moment: mean square and products of the factors themselves, rad², shape (k, k).
        noise_factor: χ² per degree of freedom of what no rotation explains, where it is more than
            chance, or the variance of a reading where that is not known; NaN: unknown.
        covariance_factor: the factor on covariances of readings that are weighted as if that were
            1: the noise factor, widened where the noise is estimated (``noise_factor.widening``).
        explained: what rotations of the sizes that are averaged over take from χ², in its units.
        gain: what χ², in units of the noise, loses by free rotations.
        seen: number of independent sums of the rotations that the readings show.
        degrees_of_freedom: left by the fit with free rotations.
        size: root mean square of s, none below the plausible one, rad.
    """

    readings: Vector
    information: Vector
    reaction: Vector
    scatter: Vector
    mean: Vector
    best: Vector
    covariance: Vector
    second_moment: Vector
    noise_factor: float
    covariance_factor: float
    explained: float
    gain: float
    seen: int
    degrees_of_freedom: int
    size: float

    @property
    def chance(self) -> float:
        """Return the chance of such a gain if no axis turns (F test); NaN where none is seen."""
        from scipy.special import fdtrc

        if not self.seen or self.degrees_of_freedom < 1:
            return float("nan")
        return float(fdtrc(self.seen, self.degrees_of_freedom, self.gain / self.seen))


def translations_design(observations: Observations, chain: str) -> Design:
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


def mode_readings(observations: Observations, chain: str, without: Sequence[str] = ()) -> Vector:
    """Return what each mode of each rotation adds to each reading, m/rad, shape (n, k).

    Where the chain is not known, every chain may be the one: the modes of all six are there, each
    with a sixth of the variance.

    Args:
        observations: the readings.
        chain: order of the machine's axes; empty if not known.
        without: rotations that have no modes.
    """
    volume = observations.volume
    travel = np.asarray(volume.step) * volume.blocks
    direction = np.array([setup.direction for setup in observations.setups])[observations.setup]
    position, reach = observations.position, observations.reach
    parts = []
    count = mode_count(volume.blocks)
    chains = (chain,) if chain else CHAINS
    for one in chains:
        arms = np.stack([reach - lever for lever in levers(position, one)], axis=1)
        of_all = rotation_readings(position / travel, direction, arms, count)
        parts.append(of_all.take(_places(without, count), axis=1))
    readings: Vector = np.column_stack(parts) / np.sqrt(len(chains))
    return readings


def _places(without: Sequence[str], count: int) -> Integers:
    """Return the modes of the rotations that are not left out, of so many each."""
    kept = np.array([name not in without for name in ROTATIONS])
    return np.flatnonzero(np.repeat(kept, count))


@dataclass(frozen=True)
class Turned:
    """The fit of translations, and the rotations beside it.

    Attributes:
        design: of translations, and of rotations that were measured directly.
        fit: of them.
        rotations: that the run shows or that are plausible.
        change: of the design's stacked curve values by a unit of each mode, shape (c(N+1), k).
        tilt_change: of the tilts by a unit of each mode, shape (2 · diagonal setups, k).
        by_lengths: what each uncertain scale of the laser does to the unknowns, shape (p, q).
        by_reading: of each reading by a unit of each mode, m/rad, shape (n, k).
        names: of the rotations that have modes; none where the chain is not known.
        curves: these at the nodes by a unit of each mode, shape (len(names)(N+1), k).
    """

    design: Design
    fit: Fit
    rotations: Rotations
    change: Vector
    tilt_change: Vector
    by_lengths: Vector
    by_reading: Vector
    names: tuple[str, ...]
    curves: Vector

    @property
    def tilts(self) -> Vector:
        """Return the tilts of the diagonal setups, rad, shape (2m,); NaN where not determined."""
        known = self.design.tilt_known.reshape(-1)
        found: Vector = known * (
            self.fit.tilts.reshape(-1) + self.tilt_change @ self.rotations.mean
        )
        return found

    @property
    def tilt_covariance(self) -> Vector:
        """Return the covariance of the tilts, rad², shape (2m, 2m); NaN where not determined."""
        known = self.design.tilt_known.reshape(-1)
        scale = self.design.of_tilts(self.by_lengths)
        covariance = (
            self.rotations.covariance_factor * self.design.tilt_covariance()
            + self.tilt_change @ self.rotations.covariance @ self.tilt_change.T
            + scale @ scale.T
        )
        made: Vector = covariance * np.outer(known, known)
        return made

    @property
    def size(self) -> int:
        """Return the number of values of the nine translations."""
        return len(TRANSLATIONS) * (self.design.observations.volume.blocks + 1)

    def left_by_rotations(self, left: Vector) -> Vector:
        """Return the residuals of a fit with rotations of any size, m, shape (groups,).

        Args:
            left: averaged readings less the fitted ones, m, shape (groups,).
        """
        design, turn = self.design, self.rotations.readings @ self.rotations.best
        absorbed = design.matrix @ (design.covariance @ (design.matrix.T @ (design.weight * turn)))
        rest: Vector = left - turn + absorbed
        return rest

    def factors(self, left: Vector) -> Vector:
        """Return the modes' factors that other residuals would show, rad, shape (..., k).

        Those of the run itself are its own. Others react to a change of the residuals as they do
        where axes turn by the plausible size or more: if such rotations made the change, the
        readings would show them, and less of them would be taken for chance than in this run.

        Args:
            left: averaged readings less the fitted ones, m, shape (..., groups).
        """
        own = self.design.mean - self.fit.fitted
        pull = ((left - own) * self.design.weight) @ self.rotations.readings
        found: Vector = self.rotations.mean + pull @ self.rotations.reaction
        return found

    def factor_changes(self, model: Vector, change: Vector) -> Vector:
        """Return what each averaged reading does to the modes' factors, rad/m, shape (k, groups).

        Args:
            model: of the readings by the unknowns, shape (groups, p); see ``Design.derivatives``.
            change: of the unknowns by the readings, shape (p, groups).
        """
        pull = self.rotations.readings.T * self.design.weight
        found: Vector = self.rotations.reaction @ (pull - (pull @ model) @ change)
        return found

    def scatter(self) -> Vector:
        """Return what the readings' noise does to the curves by way of ``factors``, m²."""
        by_noise = self.change @ self.rotations.scatter
        covariance: Vector = self.rotations.covariance_factor * by_noise @ by_noise.T
        return covariance


def turned(measurement: Measurement, observations: Observations) -> Turned:
    """Fit translations to a measurement and determine the influence of rotations on them.

    Raises:
        ValueError: the lines contradict the volume or each other.
    """
    design = translations_design(observations, measurement.chain)
    fit = design.fit()
    by_reading = mode_readings(observations, measurement.chain, design.names)
    plausible = measurement.plausible
    matrix = design.matrix
    rotations, change = plausible_rotations(design, matrix, fit, by_reading, plausible.rotation)
    names = [name for name in ROTATIONS if measurement.chain and name not in design.names]
    blocks = observations.volume.blocks
    shape = modes(np.linspace(0.0, 1.0, blocks + 1), mode_count(blocks))
    return Turned(
        design=design,
        fit=fit,
        rotations=rotations,
        change=design.of_curves(change),
        tilt_change=design.of_tilts(change),
        by_lengths=by_lengths(design, matrix, plausible),
        by_reading=by_reading,
        names=tuple(names),
        curves=np.asarray(np.kron(np.eye(len(names)), shape), dtype=np.float64),
    )


def with_rotations(
    values: Vector,
    covariance: Vector,
    unseen: Vector,
    turned: Turned,
    change: Vector,
    predicted: bool,
) -> CurveEstimate:
    """Return the curves with what the rotations make uncertain of them.

    Args:
        values: of the translations, and of rotations among the unknowns, shape (c(N+1),).
        covariance: of them by the readings alone.
        unseen: directions of them that are not determined, shape (c(N+1), r).
        turned: rotations of the run.
        change: of the true values behind the same readings by each mode, shape (c(N+1), k).
        predicted: take the rotations that the run shows out of the values; if not, these stay as
            the method gives them, and the uncertainty contains what that makes wrong.

    Returns:
        the curves, then the other rotations; these not where the chain is not known.
    """
    rotations = turned.rotations
    root = root_of(rotations.covariance if predicted else rotations.second_moment)
    if predicted:
        values = values + change @ rotations.mean
    given = TRANSLATIONS if len(values) == turned.size else turned.design.names
    if not turned.names:
        return CurveEstimate(values, covariance, unseen, given, turned.design.arm, change @ root)
    angles = turned.curves @ rotations.mean if predicted else np.zeros(len(turned.curves))
    return CurveEstimate(
        np.concatenate([values, angles]),
        covariance,
        np.concatenate([unseen, np.zeros((len(angles), unseen.shape[1]))]),
        (*given, *turned.names),
        turned.design.arm,
        np.concatenate([change, turned.curves]) @ root,
    )


def root_of(moment: Vector) -> Vector:
    """Return columns whose products sum to a second moment; NaN where that is not known.

    Args:
        moment: positive semidefinite, shape (k, k).
    """
    if not np.all(np.isfinite(moment)):
        return np.full(moment.shape, np.nan)
    with suppress(np.linalg.LinAlgError):
        return np.asarray(np.linalg.cholesky(moment), dtype=np.float64)
    values, vectors = np.linalg.eigh(moment)
    root: Vector = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def rotation_remarks(measurement: Measurement, rotations: Rotations) -> list[str]:
    """Say what the readings show of rotations, and what the uncertainties contain for the rest."""
    if not measurement.plausible.rotation:
        return ["Rotations of the axes are taken as zero, as stated for this machine."]
    known = all(np.all(np.isfinite(one.standard_uncertainty)) for one in measurement.lines)
    misfit = known and rotations.noise_factor > 1.0
    plausible = measurement.plausible.rotation * 1e6
    size = f"{rotations.size * 1e6:.2g} µrad"
    chain = "" if measurement.chain else " The chain is not known, so that any of the six may act."
    if not rotations.seen:
        return [
            "These readings cannot show rotations of the axes. All uncertainties contain plausible "
            f"ones of {plausible:.3g} µrad over the measured travel.{chain}"
        ]
    if rotations.chance < SHOWN and misfit:
        return [
            f"A part of the lack of fit looks like rotations of the axes, {size} in size (p ="
            f" {rotations.chance:.1g}); the diagnosis says what it is. All uncertainties contain"
            f" rotations of that size.{chain}"
        ]
    if rotations.chance < SHOWN:
        return [
            f"The readings show rotations of the axes, {size} in size (χ² falls by"
            f" {rotations.gain:.3g} with {rotations.seen} free sums of them, p ="
            f" {rotations.chance:.1g}). All uncertainties contain what the readings do not show"
            f" of them.{chain}"
        ]
    return [
        "The readings show no rotation of the axes beyond chance. All uncertainties contain what"
        f" the readings do not determine of rotations of {size}.{chain}"
    ]


def plausible_rotations(
    design: Design, matrix: Vector, fit: Fit, readings: Vector, plausible: float
) -> tuple[Rotations, Vector]:
    """Return what a run shows of the rotations, and how they change the unknowns of the fit.

    Args:
        design: of translations, without effects.
        matrix: of the design.
        fit: of its readings.
        readings: what each mode adds to each reading, m/rad, shape (n, k).
        plausible: size of the rotations, rad; 0: they are taken as zero.

    Returns:
        the rotations, and what a unit of each mode changes in the unknowns, shape (p, k).
    """
    rows = readings[design.first]
    weighted = rows * design.weight[:, None]
    pulled = matrix.T @ weighted
    change: Vector = -(design.covariance @ pulled)
    information = rows.T @ weighted + pulled.T @ change
    left = design.mean - fit.fitted
    score = weighted.T @ left
    values, vectors = np.linalg.eigh(0.5 * (information + information.T))
    largest = float(np.max(np.sum(rows * weighted, axis=0), initial=0.0))
    seen = values > _RANK_LIMIT * largest
    values = np.where(seen, values, 0.0)
    parts = np.where(seen, vectors.T @ score, 0.0)
    gain = float(np.sum(parts[seen] ** 2 / values[seen]))
    count = int(np.count_nonzero(seen))
    free = count if plausible else 0
    squares, freedom = fit.squares - (gain if free else 0.0), design.degrees_of_freedom - free
    factor = noise_factor(squares, freedom, design.observations.noise_known)
    unit = factor if np.isfinite(factor) else 1.0
    share, sizes = _sizes(values / unit, parts / unit, plausible)
    # Rounding alone pulls on what the readings do not show.
    shrunk = np.where(seen, share @ _given(sizes, values / unit) / unit, 0.0)
    mean = shrunk * parts
    sizes = np.maximum(sizes, plausible)
    given = _given(sizes, values / unit)
    reaction = np.where(seen, share @ given / unit, 0.0)
    factors, weight = (given * parts / unit)[:, seen], np.sqrt(share)[:, None]
    shown, unseen = vectors[:, seen], float(share @ sizes**2)

    def moment(about: Vector | float) -> Vector:
        # What the readings do not show of the factors is as uncertain as they are large.
        away = (factors - about) * weight
        made: Vector = (shown @ (np.diag((share @ given)[seen] - unseen) + away.T @ away)) @ shown.T
        made.flat[:: len(made) + 1] += unseen
        return made

    rotations = Rotations(
        readings=rows,
        information=information,
        reaction=(vectors * reaction) @ vectors.T,
        mean=vectors @ mean,
        best=shown @ (parts[seen] / values[seen]) * bool(plausible),
        scatter=shown * (shrunk * np.sqrt(values))[seen],
        covariance=moment(mean[seen]),
        second_moment=moment(0.0),
        noise_factor=factor,
        covariance_factor=factor * widening(design.noise_freedom(freedom)),
        explained=float(shrunk @ parts**2),
        gain=gain / unit,
        seen=count,
        degrees_of_freedom=freedom,
        size=float(np.sqrt(unseen)),
    )
    return rotations, change


def expected_moments(information: Vector, plausible: float) -> tuple[Vector, Vector, Vector]:
    """Return what is to be expected of the modes' factors if axes turn as is plausible.

    Those of ``plausible_rotations`` with the mean squares of v·b, λ + s² λ², in place of squares.
    They are diagonal in the eigenvectors v of S.

    Args:
        information: of the factors beyond all that is free, 1/rad², shape (k, k).
        plausible: size of the rotations, rad.

    Returns:
        along each eigenvector the variance of the factors, rad², shape (k,); the mean square of
        their estimates, which a result that gives no rotations leaves to the uncertainty, rad²,
        shape (k,); and the eigenvectors as columns, shape (k, k).
    """
    values, vectors = np.linalg.eigh(0.5 * (information + information.T))
    values = np.where(values > _RANK_LIMIT * np.max(values, initial=0.0), values, 0.0)
    square = values + (plausible * values) ** 2
    share, sizes = _sizes(values, np.sqrt(square), plausible)
    shrunk = share @ _given(sizes, values)
    given = _given(np.maximum(sizes, plausible), values)
    spread = share @ given + share @ (given - shrunk) ** 2 * square
    return spread, shrunk**2 * square, vectors


def _given(sizes: Vector, values: Vector) -> Vector:
    """Return the variance that each size leaves to each factor, rad², shape (m, k)."""
    square = sizes[:, None] ** 2
    left: Vector = square / (1.0 + square * values)
    return left


def _sizes(values: Vector, parts: Vector, plausible: float) -> tuple[Vector, Vector]:
    """Return sizes s that are averaged over, and the share of each by its evidence.

    Args:
        values: λ in units of the noise, shape (k,).
        parts: v·b in units of the noise, shape (k,).
        plausible: size, rad.

    Returns:
        shares, which sum to 1, and sizes, rad, shape (m,) each.
    """
    if not plausible:
        return np.ones(1), np.zeros(1)
    sizes = plausible * _RATIOS
    square = sizes[:, None] ** 2
    spread = 1.0 + square * values
    # Sizes in equal ratios: the last term is their density.
    evidence = (
        np.sum(0.5 * parts**2 * square / spread - 0.5 * np.log(spread), axis=1)
        - 0.5 * (_STUDENT + 1.0) * np.log1p((sizes / plausible) ** 2 / _STUDENT)
        + np.log(sizes)
    )
    share = np.exp(evidence - np.max(evidence))
    return share / np.sum(share), sizes
