"""The volumetric error map: where in the measured box the tool is how far from where it should be.

The error vector at q is the tool point less q, motions of the tool relative to the workpiece, zero
at the corner of the first nodes, in the frame of the curves. It is computed by the exact forward
model (``forward.tool_point``), so that it has the signs of the readings that it was found from.

A map holds for the box that was measured and for nothing beyond it: outside, the error is unknown.
It is unknown, too, wherever a curve that acts there was not determined: a translation acts
everywhere, a rotation where an axis after it in the chain is away from the first corner. Rotations
that the method did not estimate at all are not in it; ``left_out`` names them. Their influence
is in the uncertainty: as the result states, with what they did to its curves, or else as large as
is plausible (``metrology.plausible``).

A displacement that depends on the places of several axes together is in no curve. Where one was
learned (``learned_displacement``), the map has it beside the curves, from the first corner on.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import nan

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.curve_set import CurveSet, require_curve, require_nodes
from stepdiag_ros.metrology.forward import ErrorCurves, levers, tool_point
from stepdiag_ros.metrology.geometry import (
    AXES,
    CHAINS,
    CURVES,
    EDGE,
    FRAME,
    ROTATIONS,
    TRANSLATIONS,
    Vector,
    moving_axis,
    places_of,
    translation,
)
from stepdiag_ros.metrology.learned_displacement import LearnedDisplacement
from stepdiag_ros.metrology.plausible import ORDINARY, Plausible, mode_count, modes
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.result import VolumetricErrors


@dataclass(frozen=True)
class VolumetricMap(CurveSet):
    """Errors of a machine in the box that reaches from the first to the last nodes.

    It has all nine translations, and rotations or none.

    Attributes:
        standard_uncertainty: of some or all of the curves, same shapes; NaN where not known.
        chain: order of the axes from workpiece to tool; empty if not known.
        frame: of the curves, in words.
        not_determined: what the lines did not determine, in words.
        covariance: of all curves stacked in their order, see ``VolumetricErrors``; empty if not
            known.
        turned_factor: of all eighteen, see ``VolumetricErrors``; empty if not known.
        plausible: how large rotations are of which nothing else is known.
        learned: displacements beside the curves.
        learned_covariance: of the amplitudes of these, m², shape (k, k); NaN where not known.

    Raises:
        ValueError: nodes that do not ascend, an unknown or missing curve, a wrong number of values,
            rotations without a chain.
    """

    standard_uncertainty: Mapping[str, Vector] = field(default_factory=dict)
    chain: str = ""
    frame: str = FRAME
    not_determined: tuple[str, ...] = ()
    covariance: Vector = field(default_factory=lambda: np.empty((0, 0)), repr=False, compare=False)
    turned_factor: Vector = field(
        default_factory=lambda: np.empty((0, 0)), repr=False, compare=False
    )
    plausible: Plausible = ORDINARY
    learned: tuple[LearnedDisplacement, ...] = ()
    learned_covariance: Vector = field(
        default_factory=lambda: np.empty((0, 0)), repr=False, compare=False
    )

    def __post_init__(self) -> None:
        require_nodes(self.nodes)
        for name, values in (*self.curves.items(), *self.standard_uncertainty.items()):
            require_curve(name, values, self.nodes)
        count = len(self.learned)
        if self.learned_covariance.shape != (count, count):
            raise Refusal(
                f"the covariance of {count} learned displacements is not {count} rows of {count}",
                fault="mismatch",
                aspect="learned",
            )
        missing = [name for name in TRANSLATIONS if name not in self.curves]
        if missing:
            raise Refusal(
                f"an error map needs {', '.join(missing)}", fault="missing", aspect="curves"
            )
        if self.chain and self.chain not in CHAINS:
            raise Refusal(
                f"'{self.chain}' is not a kinematic chain; use one of {', '.join(CHAINS)}",
                fault="unknown",
                aspect="chain",
            )
        if not self.chain and any(name in ROTATIONS for name in self.curves):
            raise Refusal(
                "a map with rotations needs the order of the machine's axes (chain)",
                fault="missing",
                aspect="chain",
            )

    @classmethod
    def of_result(
        cls, result: VolumetricErrors, chain: str = "", plausible: Plausible = ORDINARY
    ) -> "VolumetricMap":
        """Return the map of a solver's result.

        The frame makes three curves end at zero (``forward.in_result_frame``). Where nothing
        between the ends was determined, this zero is not a finding, and the end counts as unknown.

        Args:
            result: of a solver.
            chain: order of the axes from workpiece to tool; needed where it has rotations.
            plausible: size of rotations that the result does not determine.

        Raises:
            ValueError: see the class.
        """
        return cls(
            nodes=result.nodes,
            curves={name: _told_by_lines(curve) for name, curve in result.curves.items()},
            standard_uncertainty=result.standard_uncertainty,
            chain=chain,
            frame=result.frame,
            not_determined=result.not_determined,
            covariance=result.covariance,
            turned_factor=result.turned_factor,
            plausible=plausible,
        )

    @property
    def low(self) -> Vector:
        """Return the first corner of the box, m, shape (3,)."""
        return np.array([nodes[0] for nodes in self.nodes])

    @property
    def high(self) -> Vector:
        """Return the last corner of the box, m, shape (3,)."""
        return np.array([nodes[-1] for nodes in self.nodes])

    @property
    def left_out(self) -> tuple[str, ...]:
        """Return the rotations that are not in the map, because they were not estimated."""
        return tuple(name for name in ROTATIONS if name not in self.curves)

    @cached_property
    def unknown_curves(self) -> tuple[str, ...]:
        """Return the curves that are not determined at some node at least."""
        return tuple(n for n, values in self.curves.items() if not np.all(np.isfinite(values)))

    def inside(self, positions: Vector) -> NDArray[np.bool_]:
        """Say which places lie in the box, shape (n,).

        Args:
            positions: machine coordinates, m, shape (n, 3).
        """
        places = np.asarray(positions, dtype=np.float64)
        within = (places >= self.low - EDGE) & (places <= self.high + EDGE)
        answer: NDArray[np.bool_] = np.all(within, axis=-1)
        return answer

    def nearest(self, positions: Vector) -> Vector:
        """Return the places in the box that are nearest to given ones, m, shape (n, 3)."""
        placed: Vector = np.clip(np.asarray(positions, dtype=np.float64), self.low, self.high)
        return placed

    def errors(self, positions: Vector) -> Vector:
        """Return the error vectors at some places, m, shape (n, 3); NaN where not known.

        Between nodes the curves are straight; what was learned beside them follows its formula.
        Outside the box nothing is known.

        Args:
            positions: machine coordinates, m, shape (n, 3).
        """
        places = np.asarray(positions, dtype=np.float64)
        ways = self.nearest(places) - self.low
        errors, zero = self._forward
        actual, _ = tool_point(ways, errors, self.chain or CHAINS[0])
        vectors: Vector = actual - ways - zero
        for one, weights in zip(self.learned, self._learned_weights(places).T, strict=True):
            vectors[:, one.axis] += one.amplitude * weights
        vectors[self._unknown(ways) | ~self.inside(places)] = nan
        return vectors

    def standard_uncertainty_at(self, positions: Vector) -> Vector:
        """Return the standard uncertainty of each component of the error, m, shape (n, 3).

        NaN where that or the error is not known; see ``covariance_at``.

        Args:
            positions: machine coordinates, m, shape (n, 3).
        """
        spread: Vector = np.sqrt(np.einsum("nii->ni", self.covariance_at(positions)))
        return spread

    def covariance_at(self, positions: Vector) -> Vector:
        """Return the covariance of the error vectors at some places, m², shape (n, 3, 3).

        By the law of propagation (JCGM 100:2008, 5.2), to first order, with the covariance of the
        curves and what the rotations do that are left out; NaN where that or the error is not
        known. That the map is straight between nodes is not in it. What was learned counts as
        independent of the curves: they take up a part of an error of its amplitude, so that this
        is rather too much.

        Args:
            positions: machine coordinates, m, shape (n, 3).
        """
        weights, covariance, unknown = self._covariances(positions)
        if not covariance.size:
            return np.full((len(weights), 3, 3), nan)
        made: Vector = np.einsum("nij,jk,nlk->nil", weights, covariance, weights, optimize=True)
        if self.left_out:
            made = made + self._of_left_out(positions, weights)
        if self.learned:
            made = made + self._of_learned(positions)
        spot = np.arange(3)
        made[:, spot, spot] = np.maximum(made[:, spot, spot], 0.0)
        made[unknown] = nan
        return made

    def _covariances(self, positions: Vector) -> tuple[Vector, Vector, NDArray[np.bool_]]:
        """Return sensitivities, covariance of the curves, and where the error's is not known.

        Returns:
            as ``sensitivities``; zero where not known, empty without a covariance; shape (n,).
        """
        weights, unknown = self.sensitivities(positions)
        if self.covariance.shape != (weights.shape[-1],) * 2:
            return weights, np.empty((0, 0)), unknown
        known = np.isfinite(self.covariance)
        acts = weights[..., ~np.diag(known)] != 0.0
        return weights, np.where(known, self.covariance, 0.0), unknown | np.any(acts, axis=(1, 2))

    def factors_at(self, positions: Vector) -> Vector:
        """Return what causes of standard deviation 1 do to the error vectors at places, m.

        The causes are independent of each other and the same at all places: ``covariance_at`` holds
        the products at one place. Rotations that are left out, and of which the result does not
        state how they go with its curves, are as large as is plausible; of a chain that is not
        known, the one in which they do most.

        Args:
            positions: machine coordinates, m, shape (n, 3).

        Returns:
            shape (n, 3, causes); NaN where ``covariance_at`` is.
        """
        weights, covariance, unknown = self._covariances(positions)
        if not covariance.size:
            return np.full((len(weights), 3, 1), nan)
        size, parts = len(covariance), []
        if self.left_out and self._left_out_known():
            curves, rotations = self.turned_factor[:size], self.turned_factor[size:]
            covariance = covariance - curves @ curves.T
            parts.append(weights @ curves + self.rotation_weights(positions) @ rotations)
        elif self.left_out:
            chains = (self.chain,) if self.chain else CHAINS
            turned = (self._plausible_turns(positions, chain) for chain in chains)
            parts.append(max(turned, key=lambda one: float(np.sum(one**2))))
        parts.append(weights @ _root(covariance))
        if self.learned:
            parts.append(self._learned_moves(positions) @ _root(self.learned_covariance))
        factors: Vector = np.concatenate(parts, axis=2)
        factors[unknown] = nan
        return factors

    def _plausible_turns(self, positions: Vector, chain: str) -> Vector:
        """Return what each mode of plausible rotations that are left out does, m, (n, 3, modes)."""
        ways = self.nearest(positions) - self.low
        share, arms = ways / (self.high - self.low), levers(ways, chain)
        parts = []
        for name in self.left_out:
            axis = moving_axis(name)
            turn = np.cross(np.eye(3)["ABC".index(name[2])], arms[axis])
            shapes = modes(share[:, axis], mode_count(len(self.nodes[axis]) - 1))
            parts.append(self.plausible.rotation * turn[:, :, None] * shapes[:, None, :])
        return np.concatenate(parts, axis=2)

    def _of_left_out(self, positions: Vector, weights: Vector) -> Vector:
        """Return what the rotations that are left out add to the covariance, m², (n, 3, 3)."""
        size = weights.shape[-1]
        if self._left_out_known():
            turning = self.rotation_weights(positions)
            # What it tells of the curves themselves is in their covariance.
            turned = turning @ self.turned_factor[size:]
            beside = weights @ self.turned_factor[:size] @ turned.transpose(0, 2, 1)
            made: Vector = turned @ turned.transpose(0, 2, 1)
            made += beside + beside.transpose(0, 2, 1)
            return made
        ways = self.nearest(positions) - self.low
        share = ways / (self.high - self.low)
        chains = (self.chain,) if self.chain else CHAINS
        every = []
        for chain in chains:
            arms = levers(ways, chain)
            turns = [
                np.sqrt(share[:, moving_axis(name), None])
                * np.cross(np.eye(3)["ABC".index(name[2])], arms[moving_axis(name)])
                for name in self.left_out
            ]
            every.append(np.einsum("rni,rnj->nij", turns, turns))
        # Of a chain that is not known, that in which the rotations do most at each place.
        most = np.argmax(np.einsum("cnii->cn", every), axis=0)
        largest: Vector = self.plausible.rotation**2 * np.array(every)[most, np.arange(len(ways))]
        return largest

    def left_out_variance(self, positions: Vector, along: Vector) -> float:
        """Return what left-out rotations add to the variance of a sum over places, m².

        Args:
            positions: machine coordinates, m, shape (n, 3).
            along: factor of each component of the error vector at each place, shape (n, 3).

        Returns:
            negative where they take back what they do to the curves; 0 where none is left out.
        """
        if not self.left_out:
            return 0.0
        weights, _ = self.sensitivities(positions)
        if not self._left_out_known():
            # How they go together from place to place is not known: at most, all one way.
            covariance = self._of_left_out(positions, weights)
            each = np.einsum("ni,nij,nj->n", along, covariance, along)
            return float(np.sum(np.sqrt(np.maximum(each, 0.0))) ** 2)
        size = weights.shape[-1]
        turning = self.rotation_weights(positions)
        turned = np.einsum("ni,nij->j", along, turning) @ self.turned_factor[size:]
        curves = np.einsum("ni,nij->j", along, weights) @ self.turned_factor[:size]
        return float(turned @ turned + 2.0 * curves @ turned)

    def _learned_weights(self, positions: Vector) -> Vector:
        """Return what a unit of each learned amplitude does at places, shape (n, k)."""
        places = self.nearest(positions)
        weights = np.zeros((len(places), len(self.learned)))
        for column, one in enumerate(self.learned):
            weights[:, column] = one.product(places) - one.product(self.low[None, :])
        return weights

    def _learned_moves(self, positions: Vector) -> Vector:
        """Return what a unit of each learned amplitude moves the tool by, shape (n, 3, k)."""
        weights = self._learned_weights(positions)
        moves = np.zeros((len(weights), 3, len(self.learned)))
        for column, one in enumerate(self.learned):
            moves[:, one.axis, column] = weights[:, column]
        return moves

    def _of_learned(self, positions: Vector) -> Vector:
        """Return what the learned amplitudes add to the covariance, m², shape (n, 3, 3)."""
        moves = self._learned_moves(positions)
        made: Vector = np.einsum(
            "nij,jk,nlk->nil", moves, self.learned_covariance, moves, optimize=True
        )
        return made

    def _left_out_known(self) -> bool:
        """Say whether it is known how the rotations, all left out, go with the curves."""
        count = sum(len(self.nodes_of(curve)) for curve in CURVES)
        told = len(self.turned_factor) == count and len(self.left_out) == len(ROTATIONS)
        return told and bool(self.chain)

    def uncertainty_limit_at(self, positions: Vector) -> Vector:
        """Return what the standard uncertainty cannot exceed, m, shape (n, 3).

        u(Σ w_i x_i) <= Σ |w_i| u(x_i), however the errors of the curves are correlated; for maps
        whose covariance is not at hand. NaN where not known. Rotations that are left out count with
        their plausible size.

        Args:
            positions: machine coordinates, m, shape (n, 3).
        """
        weights, unknown = self.sensitivities(positions)
        each = np.concatenate(
            [
                self.standard_uncertainty.get(name, np.full(curve.shape, nan))
                for name, curve in self.curves.items()
            ]
        )
        missing = ~np.isfinite(each)
        limit: Vector = np.abs(weights) @ np.where(missing, 0.0, each)
        if self.left_out:
            others = np.einsum("nii->ni", self._of_left_out(positions, weights))
            limit = limit + np.sqrt(np.maximum(others, 0.0))
        if self.learned:
            limit = limit + np.sqrt(np.einsum("nii->ni", self._of_learned(positions)))
        limit[unknown | np.any(weights[..., missing] != 0.0, axis=(1, 2))] = nan
        return limit

    def held_by_curves(self, name: str, positions: Vector) -> Vector:
        """Return a curve with that part of what was learned that depends on its axis alone.

        Straight between nodes but for what was learned; constant beyond the ends.

        Args:
            name: of the curve, such as E_YX.
            positions: of its axis, m, shape (n,).
        """
        axis = moving_axis(name)
        nodes = self.nodes[axis]
        values: Vector = np.interp(positions, nodes, self.curves[name])
        placed = np.clip(positions, nodes[0], nodes[-1])
        for one in self.learned:
            if name == translation(one.axis, axis):
                values = values + one.along(axis, placed) - one.along(axis, nodes[:1])
        return values

    def grid(self, between: int = 0) -> Vector:
        """Return the nodes of the box as places, m, shape (n, 3).

        Args:
            between: number of further places between two nodes, evenly spread.
        """
        return places_of([_refined(nodes, between) for nodes in self.nodes])

    def planes(self, axis: int) -> Vector:
        """Return the places of an axis at which the slope of the errors may change at once, m."""
        kinks = [place for one in self.learned for place in one.kinks(axis)]
        return np.unique(np.concatenate([self.nodes[axis], kinks]))

    def some_nodes(self, most: int) -> Vector:
        """Return the nodes as places, m, shape (n, 3): of too many every second or third."""
        every = 1
        while np.prod([len(nodes[::every]) for nodes in self.nodes]) > most:
            every += 1
        return places_of([nodes[::every] for nodes in self.nodes])

    def tells_any_node(self) -> bool:
        """Say whether the error vector of any node but the first, where it is zero, is determined.

        A box of many blocks has millions of nodes, so that they are looked at layer by layer.
        """
        whole, *others = self.nodes
        for number, place in enumerate(whole):
            layer = places_of([np.array([place]), *others])
            told = np.all(np.isfinite(self.errors(layer)), axis=1)
            if np.any(told[0 if number else 1 :]):
                return True
        return False

    @cached_property
    def _forward(self) -> tuple[ErrorCurves, Vector]:
        """Return the curves from the first corner on, zero where unknown, and the error there."""
        shifted = [nodes - nodes[0] for nodes in self.nodes]
        known = {name: np.nan_to_num(curve, nan=0.0) for name, curve in self.curves.items()}
        errors = ErrorCurves.from_curves(shifted, known)
        zero, _ = tool_point(np.zeros((1, 3)), errors, self.chain or CHAINS[0])
        return errors, zero[0]

    def _unknown(self, ways: Vector) -> NDArray[np.bool_]:
        """Say at which ways from the first corner, in the box, a curve that acts is not known."""
        unknown = np.zeros(len(ways), dtype=bool)
        arms = levers(ways, self.chain or CHAINS[0])
        for name in self.unknown_curves:
            axis = moving_axis(name)
            shifted = self.nodes[axis] - self.nodes[axis][0]
            holes = np.isnan(self.curves[name]).astype(np.float64)
            # Between two nodes a curve is as little known as at either of them.
            gap = np.interp(ways[:, axis], shifted, holes) > 0.0
            acts = np.ones(len(ways), dtype=bool)
            if name in ROTATIONS:
                acts = np.any(np.abs(arms[axis]) > EDGE, axis=1)
            unknown |= gap & acts
        return unknown

    def sensitivities(self, positions: Vector) -> tuple[Vector, NDArray[np.bool_]]:
        """Return the derivative of the error by all curve values, and where it is not known.

        To first order e(q) = Σ_i t_i(q_i) + ε_i(q_i) × L_i(q), less the same at the first corner,
        from which q counts and where the levers L_i are zero.

        Args:
            positions: machine coordinates, m, shape (n, 3).

        Returns:
            shape (n, 3, all values in the order of the curves); shape (n,).
        """
        places = np.asarray(positions, dtype=np.float64)
        ways = self.nearest(places) - self.low
        weights = self._weights(ways, list(self.curves), self.chain or CHAINS[0])
        return weights, self._unknown(ways) | ~self.inside(places)

    def rotation_weights(self, positions: Vector) -> Vector:
        """Return the derivative of the error by all nine rotations, those that are left out too.

        The chain must be known.

        Args:
            positions: machine coordinates, m, shape (n, 3).

        Returns:
            m/rad, shape (n, 3, 9(N+1)), in the order of ``geometry.ROTATIONS``.
        """
        return self._weights(self.nearest(positions) - self.low, list(ROTATIONS), self.chain)

    def _weights(self, ways: Vector, names: list[str], chain: str) -> Vector:
        arms = levers(ways, chain)
        parts = []
        for name in names:
            axis = moving_axis(name)
            shares = _interpolation(self.nodes[axis] - self.nodes[axis][0], ways[:, axis])
            part = np.zeros((len(ways), 3, shares.shape[1]))
            if name in TRANSLATIONS:
                shares[:, 0] -= 1.0
                part[:, AXES.index(name[2]), :] = shares
            else:
                turn = np.cross(np.eye(3)["ABC".index(name[2])], arms[axis])
                part = turn[:, :, None] * shares[:, None, :]
            parts.append(part)
        return np.concatenate(parts, axis=2)


def _root(covariance: Vector) -> Vector:
    """Return a factor whose product with its transpose is the covariance, shape (n, n)."""
    variances, vectors = np.linalg.eigh(covariance)
    root: Vector = vectors * np.sqrt(np.maximum(variances, 0.0))
    return root


def _told_by_lines(curve: Vector) -> Vector:
    """Return a curve without an end that is known by the definition of the frame alone."""
    inner = curve[1:-1]
    if inner.size == 0 or not np.all(np.isnan(inner)):
        return curve
    return np.concatenate([curve[:1], np.full(len(curve) - 1, nan)])


def _refined(nodes: Vector, between: int) -> Vector:
    count = (len(nodes) - 1) * (between + 1) + 1
    fine: Vector = np.interp(
        np.arange(count) / (between + 1.0), np.arange(len(nodes), dtype=np.float64), nodes
    )
    return fine


def _interpolation(nodes: Vector, places: Vector) -> Vector:
    """Return the weights of linear interpolation between nodes, shape (places, nodes)."""
    upper = np.clip(np.searchsorted(nodes, places, side="right"), 1, len(nodes) - 1)
    share = (places - nodes[upper - 1]) / (nodes[upper] - nodes[upper - 1])
    weights = np.zeros((len(places), len(nodes)))
    rows = np.arange(len(places))
    weights[rows, upper - 1] = 1.0 - share
    weights[rows, upper] = share
    return weights
