"""What any choice of lines will leave uncertain: the solver's model, made once for all lines.

The unknowns and the matrix are those of ``solvers.design``, the rotations those of
``solvers.rotations``, the laser's scales those of ``solvers.lengths``. Each pass has a zero of its
own, so their information adds up: with A the readings by curves and tilts, Z by the modes c of the
rotations, both whitened and beyond the zero, and n the number of measurements of each line,

    N = Σ n AᵀA,   X = Σ n AᵀZ,   Y = Σ n ZᵀZ,   H = Σ n AᵀL,
    S = Y - Xᵀ N⁻¹ X,
    cov x = N⁻¹ + (N⁻¹X) cov c (N⁻¹X)ᵀ + (N⁻¹H)(N⁻¹H)ᵀ,

L the scales of the laser in standard uncertainties, cov c by S and the plausible size s of the
rotations (``rotations.expected_moments``; about (S + 1/s²)⁻¹). That is ``least_squares`` for a
machine that turns as much as is plausible. Drift at the machine's rate is
not in that model: what it does to the solution follows from ``Information.gain``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES
from stepdiag_ros.metrology.geometry import (
    CURVES,
    ROTATIONS,
    SQUARENESS,
    TRANSLATIONS,
    Vector,
    moving_axis,
    places_of,
)
from stepdiag_ros.metrology.plan import Plan, Volume
from stepdiag_ros.metrology.plausible import Plausible, mode_count, modes
from stepdiag_ros.metrology.solvers.design import Design
from stepdiag_ros.metrology.solvers.lengths import length_readings
from stepdiag_ros.metrology.solvers.observations import observe
from stepdiag_ros.metrology.solvers.rotations import expected_moments, mode_readings
from stepdiag_ros.metrology.solvers.summary import deviations_from_line, slope_weights
from stepdiag_ros.metrology.target import VOLUMETRIC
from stepdiag_ros.metrology.volumetric_map import VolumetricMap
from stepdiag_ros.planning.expectation import nominal_measurement
from stepdiag_ros.planning.offers import Offer

OPEN = 1e-4
"""m or rad: beyond it nothing determines a quantity but what is assumed of it."""
_ASSUMED = 1e-3
"""Standard uncertainty of every unknown before any line, m: it keeps the matrix regular."""
_MOST_MODES = 120
"""Of a machine whose chain is not known, the strongest sums of the modes of all six."""
STRAIGHTNESS_OF = "straightness "
"""Begins the name of a curve's largest deviation from its line."""
ROTATING = "rotations of the axes"
SOURCES = ("the noise of the stops", ROTATING, "the laser's scale")
_KNOWN = 1e-12
"""rad: of a rotation that is as good as known."""


@dataclass(frozen=True)
class Quantities:
    """What is to be determined, as weights on the unknowns.

    Attributes:
        names: of the quantity that each row belongs to.
        curves: weights on the unknowns of the design, shape (m, p).
        modes: weights on the modes of the rotations, shape (m, k).
        apart: variance that no line changes, m² or rad², shape (m,).
    """

    names: tuple[str, ...]
    curves: Vector
    modes: Vector
    apart: Vector


@dataclass(frozen=True)
class Standing:
    """What some lines leave uncertain.

    Attributes:
        quantities: the rows.
        parts: variances by noise, rotations and scale (``SOURCES``), shape (3, m).
    """

    quantities: Quantities
    parts: Vector

    @property
    def uncertainty(self) -> Vector:
        """Return the standard uncertainty of each row, shape (m,)."""
        spread: Vector = np.sqrt(np.sum(self.parts, axis=0))
        return spread

    def largest(self) -> dict[str, float]:
        """Return the largest standard uncertainty of each quantity; inf where it is open."""
        made: dict[str, float] = {}
        for name, spread in zip(self.quantities.names, self.uncertainty, strict=True):
            made[name] = max(made.get(name, 0.0), float(spread))
        return {name: u if u < OPEN else np.inf for name, u in made.items()}


class Information:
    """The offers of a plan and what they determine of some quantities.

    Args:
        offers: the lines.
        volume: the measured box.
        chain: order of the machine's axes; empty if not known.
        plausible: size of its rotations, and of the laser's scales.
        names: of the quantities: ``volumetric``, curves (largest over the nodes), squareness
            errors, or ``STRAIGHTNESS_OF`` and a curve.
    """

    def __init__(
        self,
        offers: Sequence[Offer],
        volume: Volume,
        chain: str,
        plausible: Plausible,
        names: Sequence[str],
    ) -> None:
        self.offers = tuple(offers)
        lines = tuple(offer.line for offer in offers)
        plan = Plan("offers", volume, lines, 1.0, one_alignment_per_diagonal=True)
        measurement = replace(nominal_measurement(plan, 1.0), chain=chain, plausible=plausible)
        observations = observe(measurement)
        self._design = Design(observations)
        first = self._design.first
        own = self._design.matrix[:, : self._design.zero_column[0]]
        turning = mode_readings(observations, chain)[first]
        mixing = np.eye(turning.shape[1])
        if len(mixing) > _MOST_MODES:
            mixing = np.linalg.eigh(turning.T @ turning)[1][:, -_MOST_MODES:]
        turning = turning @ mixing
        scales = length_readings(observations, plausible)[first]
        self._size, self._chain = plausible.rotation, chain
        self._rows: list[tuple[Vector, Vector, Vector]] = []
        scaled = []
        for number, offer in enumerate(offers):
            here = np.flatnonzero(observations.passes[first] == number)
            here = here[np.argsort(observations.stop[first][here])]
            white = _beyond_zero(offer.covariance)
            self._rows.append((white, white @ own[here], white @ turning[here]))
            scaled.append(self._rows[-1][1].T @ white @ scales[here])
        self._own = np.array([a.T @ a for _, a, _ in self._rows])
        self._cross = np.array([a.T @ z for _, a, z in self._rows])
        self._turning = np.array([z.T @ z for _, _, z in self._rows])
        self._scaled = np.array(scaled)
        self.quantities = _quantities(names, volume, chain, plausible, self._design, mixing)

    def standing(self, counts: Vector, beyond: Vector | None = None) -> Standing:
        """Return what is uncertain with so many measurements of each offer.

        Args:
            counts: shape (offers,).
            beyond: information on each mode of the rotations from elsewhere, 1/rad², shape (k,);
                a mode that has any is taken out of the result.
        """
        some = np.flatnonzero(counts)
        n = counts[some].astype(np.float64)
        normal = np.tensordot(n, self._own[some], 1)
        normal.flat[:: len(normal) + 1] += _ASSUMED**-2
        factor = cho_factor(normal, lower=True, check_finite=False)
        rows = self.quantities
        half = solve_triangular(factor[0], rows.curves.T, lower=True, check_finite=False)
        noise = np.sum(half**2, axis=0)
        solved = cho_solve(factor, rows.curves.T, check_finite=False).T
        scale = np.sum((solved @ np.tensordot(n, self._scaled[some], 1)) ** 2, axis=1)
        turned = rows.apart
        if self._size:
            cross = np.tensordot(n, self._cross[some], 1)
            left = solve_triangular(factor[0], cross, lower=True, check_finite=False)
            known = np.tensordot(n, self._turning[some], 1) - left.T @ left
            if beyond is not None:
                known.flat[:: len(known) + 1] += beyond
            open_to = rows.modes - solved @ cross
            spread, estimated, vectors = expected_moments(known, self._size)
            turned = turned + (open_to @ vectors) ** 2 @ spread
            # The map of a result without rotations does not turn by what the lines show of them.
            shown = rows.modes if beyond is None else np.where(beyond > 0.0, 0.0, rows.modes)
            turned = turned + (shown @ vectors) ** 2 @ estimated
        return Standing(rows, np.array([noise, turned, scale]))

    def limit(self, counts: Vector, name: str) -> str:
        """Return what makes most of a quantity's uncertainty, in words.

        Of the rotations, the one that would take most of the variance away if it were known.
        """
        standing = self.standing(counts)
        rows = [row for row, one in enumerate(self.quantities.names) if one == name]
        worst = rows[int(np.argmax(standing.uncertainty[rows]))]
        source = SOURCES[int(np.argmax(standing.parts[:, worst]))]
        if source != ROTATING or not self._chain:
            return source
        left = []
        for places in np.split(np.arange(self.quantities.modes.shape[1]), len(ROTATIONS)):
            told = np.zeros(self.quantities.modes.shape[1])
            told[places] = _KNOWN**-2
            left.append(self.standing(counts, told).parts[1, worst])
        return f"{source}, {ROTATIONS[int(np.argmin(left))]} the most"

    def gain(self, counts: Vector) -> dict[int, Vector]:
        """Return what readings that nobody models do to the solution of so many measurements.

        Returns:
            of each row by a unit in the mean readings of each line that is measured: index of the
            offer → shape (m, stops).
        """
        some = np.flatnonzero(counts)
        n = counts[some].astype(np.float64)
        normal = np.tensordot(n, self._own[some], 1)
        normal.flat[:: len(normal) + 1] += _ASSUMED**-2
        rows = self.quantities
        solved = np.linalg.solve(normal, rows.curves.T).T
        shrunk = np.zeros((len(solved), 0))
        cross = np.tensordot(n, self._cross[some], 1)
        change = np.linalg.solve(normal, cross)
        if self._size:
            known = np.tensordot(n, self._turning[some], 1) - cross.T @ change
            known.flat[:: len(known) + 1] += self._size**-2
            shrunk = np.linalg.solve(known, (rows.modes - solved @ cross).T).T
        made = {}
        for index, count in zip(some, n, strict=True):
            white, a, z = self._rows[index]
            row = solved @ a.T
            if self._size:
                row = row + shrunk @ (z - a @ change).T
            made[int(index)] = count * row @ white
        return made


def _beyond_zero(covariance: Vector) -> Vector:
    """Return the matrix that whitens readings and takes out their common zero."""
    root = np.linalg.cholesky(covariance)
    white = np.linalg.inv(root)
    zero = white @ np.ones(len(white))
    zero /= np.linalg.norm(zero)
    made: Vector = white - np.outer(zero, zero @ white)
    return made


def _quantities(
    names: Sequence[str],
    volume: Volume,
    chain: str,
    plausible: Plausible,
    design: Design,
    mixing: Vector,
) -> Quantities:
    size, count = volume.blocks + 1, int(design.zero_column[0])
    told: list[str] = []
    stacked, turning, apart = [], [], []
    for name in names:
        if name == VOLUMETRIC:
            rows, by_modes, fixed = _of_corners(volume, chain, plausible)
        else:
            rows = _of_curves(name, volume)
            by_modes, fixed = np.zeros((len(rows), 0)), np.zeros(len(rows))
        told.extend([name] * len(rows))
        stacked.append(rows)
        turning.append(by_modes if by_modes.size else np.zeros((len(rows), len(mixing))))
        apart.append(fixed)
    every = np.concatenate(stacked)
    # Values that are zero by definition are added to a column that is cut off.
    made = np.zeros((len(every), count + 1))
    column = np.minimum(design.curve_column.reshape(-1)[: len(TRANSLATIONS) * size], count)
    np.add.at(made.T, column, every.T)
    return Quantities(
        tuple(told), made[:, :count], np.concatenate(turning) @ mixing, np.concatenate(apart)
    )


def _of_curves(name: str, volume: Volume) -> Vector:
    """Return a curve at its nodes, its deviations from its line, or a squareness error."""
    size, nodes = volume.blocks + 1, volume.all_nodes
    curve = name.removeprefix(STRAIGHTNESS_OF)
    parts: dict[str, Vector]
    if name in SQUARENESS:
        factor, pair = SQUARENESS_SLOPES[name]
        parts = {one: factor * slope_weights(nodes[moving_axis(one)])[None, :] for one in pair}
    elif curve != name:
        parts = {curve: deviations_from_line(nodes[moving_axis(curve)])}
    else:
        parts = {curve: np.eye(size)}
    rows = np.zeros((len(next(iter(parts.values()))), len(TRANSLATIONS) * size))
    for one, matrix in parts.items():
        start = TRANSLATIONS.index(one) * size
        rows[:, start : start + size] = matrix
    return rows


def _of_corners(volume: Volume, chain: str, plausible: Plausible) -> tuple[Vector, Vector, Vector]:
    """Return the error of the mirror's point at the corners of the box, in each direction.

    By the curves and by the modes; and what rotations add where no chain says how they act.
    """
    size, nodes = volume.blocks + 1, volume.all_nodes
    count = len(TRANSLATIONS) * size
    curves = {name: np.zeros(size) for name in (CURVES if chain else TRANSLATIONS)}
    corners = places_of([axis[[0, -1]] for axis in nodes])
    errors = VolumetricMap(
        nodes, curves, chain=chain, covariance=np.zeros((count, count)), plausible=plausible
    )
    weights, _ = errors.sensitivities(corners)
    rows = weights.reshape(-1, weights.shape[-1])
    moving = rows[:, :count]
    shown = np.any(moving != 0.0, axis=1)
    if not chain:
        fixed = np.diagonal(errors.covariance_at(corners), axis1=1, axis2=2).reshape(-1)
        return moving[shown], np.zeros((0, 0)), fixed[shown]
    turns = rows[:, count:].reshape(len(rows), -1, size)
    by_modes = (turns @ modes(np.linspace(0.0, 1.0, size), mode_count(volume.blocks))).reshape(
        len(rows), -1
    )
    return moving[shown], by_modes[shown], np.zeros(int(np.count_nonzero(shown)))
