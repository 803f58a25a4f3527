"""The least-squares problem of a measurement: its unknowns, its matrix, the exact model behind it.

Every pass has a free zero. Passes that stop at the same places enter as their weighted mean; what
they scatter about it beyond their zeros goes into χ². The matrix is that of the nominal setup; it
is factored once, and since misalignments are small the iteration with the exact model converges in
a few steps.

What was measured directly (``direct_rows``) adds rows that are linear in the curves.

Without a kinematic chain the unknowns are the nine translations, two angles for every diagonal
setup and a zero for every pass; with a chain, the nine rotations too, or some of them, the others
taken as zero. A reading then is

    s = g·(w + Σ t_i(q_i) + Σ v_i × ε_i(q_i)) + zero,     v_i = w - A_i(u),

with g the effective direction (unit vector), u the position from the first corner of the box, w
that from the line's first forward stop, and A_i(u) the part of u that the axes after i in the chain
make up; in a setup whose mirror is mounted elsewhere, v_i is less by that offset. This is
the first-order model of ``forward``, (ε_i × n)·(q - L_i - L0) = n·((q - L_i - L0) × ε_i),
with L0 = first stop + mirror offset - dead path · n, after three steps:

- The curves are those of the mirror's point with the other axes at the first corner q0: t_i here is
  t_i + ε_i × (L_i(q0) + mirror offset) of the chain's own. Levers from the machine's zero and the
  mirror offset are gone with that.
- The dead path is a lever along n, and (ε × n)·n = 0.
- Values at the first node are zero: a rotation ε_i(q0) that is left turns the mirror (a part of g)
  and the axes after i (their slopes, which are their curves' own).

What is left out is of second order: angles by errors, tilts by the dead path (0.3 m · 150 µrad ·
20 µrad = 1 nm), and a beam that misses the mirror's point at the first stop by b ⊥ n, which adds
Σ (ε_i × n)·b (1 mm · 20 µrad = 0.02 µm).
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from stepdiag_ros.metrology.forward import levers, perpendiculars
from stepdiag_ros.metrology.geometry import (
    AXES,
    CHAINS,
    FIXED_AT_END,
    ROTATIONS,
    TRANSLATIONS,
    Vector,
    moving_axis,
)
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.direct_rows import RowMaker
from stepdiag_ros.metrology.solvers.exact_model import LARGEST_TILT, ExactModel, ModelState, padded
from stepdiag_ros.metrology.solvers.fit import Fit
from stepdiag_ros.metrology.solvers.folded import fold, inverse_folded, places_in
from stepdiag_ros.metrology.solvers.observations import Integers, Observations
from stepdiag_ros.metrology.solvers.positive import (
    inverse_of_rank,
    inverse_positive,
    normal_of_entries,
)
from stepdiag_ros.metrology.solvers.result import NotDeterminable

_INFLATION_LIMIT = 1e8
"""Variance inflation (diagonal of C times that of H) beyond which a rank analysis is made."""
_FEW_UNKNOWNS = 200
_CONVERGED = 1e-13
_ITERATIONS = 60
_IDLE = 3
_OFF_GRID = 1e-4
_LEAST_NOISE = 1e-9
"""m: no interferometer knows the place of a machine better, though its readings may repeat."""


class Design:
    """The matrix of a measurement and its pseudo-inverse.

    Args:
        observations: the readings.
        chain: order of the axes from workpiece to tool: the rotations are unknowns too; empty: the
            translations only.
        effects: further columns, what a unit of each effect adds to each reading, m, shape (n, e);
            none if None. With effects no readings are averaged, and the passes of a setup share
            one zero, since an effect may act on single passes.
        rotations: those that are unknowns where there is a chain; the others are taken as zero.

    Attributes:
        observations: the readings; where they have no uncertainty and something was measured
            directly, with the one that a fit without that leaves.
        noise_estimated: that uncertainty, m; NaN where none had to be estimated.
        direct: rows of what was measured directly, by the unknowns.
        names: of the curves among the unknowns.
        arm: distance at which angles are counted in metres, so that all unknowns are of one size.
        group: averaged row of each reading, shape (n,).
        first: the first reading of each averaged row, shape (groups,).
        tilt_setups: indices of the setups that have two angles.
        unseen: orthonormal directions of the unknowns that the readings do not determine, (p, r).
        degrees_of_freedom: readings and direct rows minus determined unknowns.
        repeat_freedom: those of them by which repeats differ from their mean.
        tilt_known: 1 where a tilt is determined, else NaN, shape (diagonal setups, 2).

    Raises:
        NotDeterminable: something was measured directly, the readings have no uncertainty, and no
            degree of freedom is left to estimate it.
        ValueError: no such chain, or an axis that stands between nodes where its rotation counts.
    """

    def __init__(
        self,
        observations: Observations,
        chain: str = "",
        effects: Vector | None = None,
        rotations: Sequence[str] = ROTATIONS,
    ) -> None:
        if chain and chain not in CHAINS:
            raise Refusal(
                f"'{chain}' is not a kinematic chain; use one of {', '.join(CHAINS)}",
                fault="unknown",
            )
        self.noise_estimated, self._noise_freedom = float("nan"), float("inf")
        if observations.direct is not None and not observations.noise_known:
            self.noise_estimated, self._noise_freedom = _noise_without_direct(observations, chain)
            observations = replace(
                observations,
                uncertainty=np.full(len(observations.displacement), self.noise_estimated),
            )
        self.observations = observations
        self.chain = chain
        self._rotations = [ROTATIONS.index(name) for name in rotations] if chain else []
        self.names: tuple[str, ...] = (
            *TRANSLATIONS,
            *(ROTATIONS[place] for place in self._rotations),
        )
        volume = observations.volume
        self._size = volume.blocks + 1
        self.tilt_setups = [i for i, setup in enumerate(observations.setups) if setup.diagonal]
        count = len(observations.displacement)
        self._effects = np.zeros((count, 0)) if effects is None else effects
        if effects is None:
            self._zero = observations.zeros
            self.group, self.first = observations.averaged
        else:
            self._zero = observations.setup
            self.group, self.first = np.arange(count), np.arange(count)
        known = observations.noise_known
        single = 1.0 / observations.uncertainty**2 if known else np.ones(count)
        self.weight: Vector = np.bincount(self.group, single).astype(np.float64)
        self.mean: Vector = np.bincount(self.group, single * observations.excess) / self.weight
        self._repeat_squares, self.repeat_freedom = (
            observations.pure_error(single) if effects is None else (0.0, 0)
        )
        self._setup = observations.setup[self.first]
        self._way = observations.way[self.first]
        self._directions = np.array([setup.direction for setup in observations.setups])
        self._pairs = np.array(
            [perpendiculars(self._directions[setup]) for setup in self.tilt_setups]
        ).reshape(-1, 2, 3)
        self.arm = float(np.linalg.norm(np.asarray(volume.step)) * volume.blocks)
        self._number_unknowns()
        self._columns, self._values = self._entries()
        self._model = self._exact_model()
        maker = RowMaker(volume, self.names, chain, self.arm)
        self.direct = maker.rows(observations.direct).by_unknowns(self.curve_column, self.count)
        self._factor()
        determined = self.count - self.unseen.shape[1]
        rows = len(self.first) + len(self.direct.values)
        self.degrees_of_freedom = rows + self.repeat_freedom - determined

    def _number_unknowns(self) -> None:
        free = np.ones((len(self.names), self._size), dtype=bool)
        free[:, 0] = False
        for name in FIXED_AT_END:
            free[self.names.index(name), -1] = False
        curves = int(np.count_nonzero(free))
        zeros, tilted = int(np.max(self._zero)) + 1, len(self.tilt_setups)
        effects = self._effects.shape[1]
        self.count = curves + 2 * tilted + zeros + effects
        # Curve values that are zero by definition share a column beyond the last, which is cut off.
        self.curve_column: Integers = np.full((len(self.names), self._size), self.count)
        self.curve_column[free] = np.arange(curves)
        self.tilt_column: Integers = curves + np.arange(2 * tilted).reshape(tilted, 2)
        self.zero_column: Integers = curves + 2 * tilted + np.arange(zeros)
        self.effect_column: Integers = self.count - effects + np.arange(effects)

    def _entries(self) -> tuple[Integers, Vector]:
        """Return columns and values of the entries of the nominal matrix, (entries, groups) each.

        An entry belongs to one curve, angle, zero or effect; no column has two entries in a group.
        """
        groups, curves = len(self.first), len(self.names)
        width = curves + 3 + len(self.effect_column)
        columns = np.full((width, groups), self.count)
        values = np.zeros((width, groups))
        node = self.observations.node[self.first]
        direction = self._directions[self._setup]
        self._arms: Vector = np.zeros((0, 3, 3))
        if self.chain:
            self._arms = self._arm_vectors(node)
            turning = [np.cross(direction, self._arms[:, axis]) for axis in range(3)]
        for place, name in enumerate(self.names):
            axis = moving_axis(name)
            here = np.flatnonzero(node[:, axis] >= 0)
            columns[place, here] = self.curve_column[place, node[here, axis]]
            if name in TRANSLATIONS:
                values[place, here] = direction[here, AXES.index(name[2])]
            else:
                values[place, here] = turning[axis][here, "ABC".index(name[2])] / self.arm
        for row, setup in enumerate(self.tilt_setups):
            here = np.flatnonzero(self._setup == setup)
            columns[curves : curves + 2, here] = self.tilt_column[row][:, None]
            values[curves : curves + 2, here] = (self._way[here] @ self._pairs[row].T / self.arm).T
        columns[curves + 2] = self.zero_column[self._zero[self.first]]
        values[curves + 2] = 1.0
        columns[curves + 3 :] = self.effect_column[:, None]
        values[curves + 3 :] = self._effects[self.first].T
        return columns, values

    def _exact_model(self) -> ExactModel:
        return ExactModel(
            arm=self.arm,
            directions=self._directions,
            tilted=self.tilt_setups,
            pairs=self._pairs,
            setup=self._setup,
            way=np.ascontiguousarray(self._way.T),
            curves=self._columns[: len(self.names)],
            tilt_column=self.tilt_column,
            zero=self._columns[len(self.names) + 2],
            rotations=self._rotations,
            arms=np.ascontiguousarray(self._arms.transpose(1, 2, 0)),
            effect_column=self.effect_column,
            effects=self._values[len(self.names) + 3 :],
        )

    def _arm_vectors(self, node: Integers) -> Vector:
        """Return v_i of X, Y, Z for each group, m, (groups, 3, 3), and put standing axes in place.

        An axis that stands adds a constant where its lever lies along the beam or does not change,
        which the zero takes; that is so on every linear line. On a face diagonal it may not be so,
        and the errors of the node at which it stands are unknowns of the line.
        """
        position = self.observations.position[self.first]
        after = levers(position, self.chain)
        reach = self.observations.reach[self.first]
        arms = np.stack([reach - after[axis] for axis in range(3)], axis=1)
        step = np.asarray(self.observations.volume.step)
        for number, setup in enumerate(self.observations.setups):
            here = self._setup == number
            for axis in np.flatnonzero(setup.signs == 0):
                effect = np.cross(setup.direction, arms[here, axis])
                if np.max(np.abs(effect - effect[:1])) <= 1e-9 * self.arm:
                    continue
                counted = setup.start[axis] / step[axis]
                if not self._is_node(counted):
                    raise Refusal(
                        f"on {setup.name} the axis {AXES[axis]} stands {setup.start[axis]:g} m from"
                        " the first corner, which is not a node: the rotations of that axis count "
                        "there; move it to a node of the volume",
                        fault="mismatch",
                        aspect="node",
                    )
                node[here, axis] = round(counted)
        return arms

    def _is_node(self, counted: float) -> bool:
        nearest = round(counted)
        return abs(counted - nearest) <= _OFF_GRID and 0 <= nearest < self._size

    @property
    def matrix(self) -> Vector:
        """Return the nominal matrix, shape (groups, p): readings' excess by unknowns, m."""
        return self._dense(self._values)

    def _dense(self, values: Vector) -> Vector:
        """Return the matrix of these entries, shape (groups, p)."""
        groups = self._columns.shape[1]
        matrix = np.zeros((groups, self.count + 1))
        # Columns of a row differ except for the cut-off one.
        matrix[np.arange(groups), self._columns] = values
        return matrix[:, : self.count]

    def _factor(self) -> None:
        """Invert the normal matrix, by Cholesky if all is determined, else by rank analysis."""
        self.unseen: Vector = np.zeros((self.count, 0))
        # The normal matrix in the order of the levels, and the place of each unknown in it.
        self._folded: tuple[Vector, Integers] | None = None
        inverse, information = self._inverse()
        limit = _INFLATION_LIMIT
        if inverse is None or not np.all(np.diag(inverse) * information <= limit):
            alike = replace(self.direct, weight=np.ones(len(self.direct.values)))
            unweighted = self._normal(np.ones(len(self.weight))) + alike.normal()
            inverse, self.unseen = inverse_of_rank(self.normal, unweighted)
        self.covariance: Vector = inverse

    @cached_property
    def normal(self) -> Vector:
        """Return the weighted normal matrix, shape (p, p)."""
        if self._folded is not None:
            folded, place = self._folded
            return folded.take(place, axis=0).take(place, axis=1)
        normal: Vector = self._normal(self.weight) + self.direct.normal()
        return normal

    def _inverse(self) -> tuple[Vector | None, Vector]:
        """Return the inverse of the normal matrix, None if it is not positive, and its diagonal."""
        # Up to this size a general inverse is as fast.
        # What was measured directly ties all nodes of a curve.
        if self.count > _FEW_UNKNOWNS and not len(self.direct.values):
            levels = fold(self.curve_column, self._curve_places, self.count)
            if levels is not None:
                place = places_in(levels)
                normal = self._normal(self.weight, np.append(place, self.count))
                self._folded = normal, place
                return inverse_folded(normal, levels, place), np.diag(normal)[place]
        return inverse_positive(self.normal), np.diag(self.normal)

    def _normal(self, weight: Vector, place: Integers | None = None) -> Vector:
        """Return the normal matrix for weights of the groups, the unknowns at other places."""
        columns = self._columns if place is None else place[self._columns]
        return normal_of_entries(columns, self._values, weight, self.count)

    @property
    def _curve_places(self) -> Integers:
        """Return the unknowns of the curves that act on each group, shape (groups, curves)."""
        places: Integers = self._columns[: len(self.names)].T
        return places

    def noise_freedom(self, left: int) -> float:
        """Return the degrees of freedom of the readings' noise; infinite where it was stated.

        Args:
            left: by the fit that the noise is estimated from, where nothing was measured directly.
        """
        return self._noise_freedom if self.observations.noise_known else float(left)

    def fit(self, means: Vector | None = None) -> Fit:
        """Solve for the curves, tilts and zeros by the exact model.

        Args:
            means: excess of the readings' group means to solve for, m, shape (groups,) or for many
                replicates (replicates, groups); those of the observations if None.

        Raises:
            ValueError: the iteration does not converge, or to a tilt far beyond any alignment.
        """
        given = self.mean if means is None else means
        unknowns = np.zeros((*given.shape[:-1], self.count))
        many = given.ndim > 1
        solver = (
            (self.matrix * self.weight[:, None]) @ self.covariance if many else np.empty((0, 0))
        )
        modelled = np.zeros(given.shape)
        for _ in range(_ITERATIONS):
            left = given - modelled
            pulled = left @ solver if many else self.covariance @ self._pull(left * self.weight)
            change: Vector = np.asarray(pulled)
            if len(self.direct.values):
                change = change + self.direct.pull(unknowns) @ self.covariance
            unknowns = unknowns + change
            state = self._model.state(unknowns)
            modelled = state.excess
            size = float(np.max(np.abs(change)))
            if size <= _CONVERGED:
                break
        tilts = unknowns[..., self.tilt_column] / self.arm
        if not (size <= 1e-11 and np.all(np.abs(tilts) <= LARGEST_TILT)):
            raise Refusal(
                "the least-squares iteration does not converge: a setup must be misaligned by far "
                "more than any laser still reads; check the lines' names and positions",
                fault="failed",
            )
        squares = float("nan")
        if not many:
            unknowns, modelled = self._refined(given, unknowns, state)
            squares = float(np.sum(self.weight * (given - modelled) ** 2)) + self._repeat_squares
            squares += self.direct.squares(unknowns)
        return Fit(
            unknowns,
            padded(unknowns)[..., self.curve_column.reshape(-1)] / self.curve_scale,
            unknowns[..., self.tilt_column] / self.arm,
            modelled,
            squares,
        )

    def derivatives(self, fit: Fit) -> tuple[Vector, Vector]:
        """Return what the unknowns do to the readings at a fit, and what readings do to the fit.

        Fits of replicates end where the nominal matrix, transposed, times the residuals vanishes:
        Aᵀ W (r - f(u)) = 0, so that du/dr = (Aᵀ W J)⁻¹ Aᵀ W with J = df/du.

        Args:
            fit: of this design's own readings.

        Returns:
            J, shape (groups, p), and du/dr, shape (p, groups).
        """
        nominal = self.matrix
        exact = self._dense(self._model.derivatives(self._model.state(fit.unknowns), self._values))
        change = self.covariance @ (nominal.T * self.weight)
        # Written with A's own inverse, which stands for what the readings determine alone.
        by_tilts = np.eye(self.count) + change @ (exact - nominal)
        return exact, np.linalg.solve(by_tilts, change)

    def _refined(self, given: Vector, unknowns: Vector, state: ModelState) -> tuple[Vector, Vector]:
        """Go on to the very minimum from where the nominal matrix led.

        There its transpose times the residuals vanishes, in the minimum that of the exact model's
        derivatives: the two differ by the tilts times the noise, some 1e-4 of an uncertainty.
        (Monte Carlo replicates are left there.)
        """
        best, least, idle = (unknowns, state.excess), np.inf, 0
        # Rounding is left, or a tilt is beyond all alignment, when changes grow no smaller.
        while idle < _IDLE:
            weighted = (given - state.excess) * self.weight
            pulled = self._pull(weighted, self._model.derivatives(state, self._values))
            if len(self.direct.values):
                pulled = pulled + self.direct.pull(unknowns)
            change = self.covariance @ pulled
            unknowns = unknowns + change
            state = self._model.state(unknowns)
            size, idle = float(np.max(np.abs(change))), idle + 1
            if size < least:
                best, least, idle = (unknowns, state.excess), size, 0
        return best

    @property
    def curve_scale(self) -> Vector:
        """Return the factor from each stacked curve value to its unknown, 1 or m, (c(N+1),)."""
        factors = [self.arm if name in ROTATIONS else 1.0 for name in self.names]
        scale: Vector = np.repeat(np.array(factors), self._size)
        return scale

    def _pull(self, weighted: Vector, values: Vector | None = None) -> Vector:
        """Return a matrix of these entries' values (the nominal one), transposed, times weighted.

        Args:
            weighted: residuals, shape (groups,).
            values: of the entries; nominal ones if None.

        Returns:
            shape (p,).
        """
        values = self._values if values is None else values
        pulled = (values * weighted).reshape(-1)
        sums = np.bincount(self._columns.reshape(-1), pulled, minlength=self.count + 1)
        return sums[: self.count].astype(np.float64, copy=False)

    @property
    def tilt_known(self) -> Vector:
        """Return 1 where a tilt is determined, else NaN, shape (diagonal setups, 2)."""
        hidden = np.linalg.norm(self.unseen[self.tilt_column], axis=-1)
        return np.where(hidden <= 1e-6, 1.0, np.nan)

    def tilt_covariance(self) -> Vector:
        """Return the covariance of the tilts for unit scale, rad², shape (2m, 2m) for m setups."""
        place = self.tilt_column.reshape(-1)
        covariance: Vector = self.covariance[np.ix_(place, place)] / self.arm**2
        return covariance

    def tilt_readings(self) -> Vector:
        """Return what each tilt adds to each reading, m/rad, shape (n, 2 · diagonal setups)."""
        way, setup = self.observations.way, self.observations.setup
        columns = [
            np.where((setup == number)[:, None], way @ self._pairs[row].T, 0.0)
            for row, number in enumerate(self.tilt_setups)
        ]
        return np.column_stack(columns) if columns else np.zeros((len(way), 0))

    def of_curves(self, unknowns: Vector) -> Vector:
        """Return the stacked curve values of changes of the unknowns, m and rad.

        Args:
            unknowns: shape (p, k).

        Returns:
            shape (c(N+1), k).
        """
        padded = np.concatenate([unknowns, np.zeros((1, unknowns.shape[1]))])
        curves: Vector = padded[self.curve_column.reshape(-1)] / self.curve_scale[:, None]
        return curves

    def of_tilts(self, unknowns: Vector) -> Vector:
        """Return the tilts of changes of the unknowns, rad, shape (2 · diagonal setups, k)."""
        tilts: Vector = unknowns[self.tilt_column.reshape(-1)] / self.arm
        return tilts

    def curve_covariance(self) -> Vector:
        """Return the covariance of the stacked curves for unit scale, in their units."""
        place = self.curve_column.reshape(-1)
        # Values that are zero by definition have no row: another's is taken and put to zero.
        covariance: Vector = self.covariance.take(place, axis=0, mode="clip")
        covariance = covariance.take(place, axis=1, mode="clip")
        fixed = np.flatnonzero(place == self.count)
        covariance[fixed] = 0.0
        covariance[:, fixed] = 0.0
        if self.chain:
            covariance /= np.outer(self.curve_scale, self.curve_scale)
        return covariance

    def curves_unseen(self) -> Vector:
        """Return the curves' part of the undetermined directions, (c(N+1), r), angles by the arm.

        The rows of ``summary.CurveEstimate.unseen``. Of a straightness that nothing shows, the end
        that the frame fixes is not known either.
        """
        padded = np.concatenate([self.unseen, np.zeros((1, self.unseen.shape[1]))])
        ends = [
            self.names.index(name) * self._size + self._size - 1
            for name in FIXED_AT_END
            if not self.observations.shows(name)
        ]
        part: Vector = np.column_stack(
            [padded[self.curve_column.reshape(-1)], np.eye(self.curve_column.size)[:, ends]]
        )
        return part


def _noise_without_direct(observations: Observations, chain: str) -> tuple[float, float]:
    """Return the standard uncertainty of a reading that a fit to the readings alone leaves, m.

    Returns:
        the uncertainty and its degrees of freedom.
    """
    alone = Design(replace(observations, direct=None), chain)
    if alone.degrees_of_freedom == 0:
        raise NotDeterminable(
            "the readings have no uncertainty, and no degree of freedom is left to estimate it, so"
            " that directly measured errors cannot be weighed against them: measure repeats"
        )
    noise = float(np.sqrt(alone.fit().squares / alone.degrees_of_freedom))
    return max(noise, _LEAST_NOISE), float(alone.degrees_of_freedom)
