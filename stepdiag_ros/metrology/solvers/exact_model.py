"""The exact model of a design's readings, and its derivatives; ``design`` says how it comes about.

Both need the same errors of the mirror and the same turned directions, so that these are computed
once for each set of unknowns (``ModelState``). Arrays have the readings last: sums over the few
curves and directions then run over whole rows, which is several times faster than over three
numbers.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stepdiag_ros.metrology.geometry import ROTATIONS, TRANSLATIONS, Vector
from stepdiag_ros.metrology.solvers.observations import Integers

LARGEST_TILT = 0.2
"""rad, of a setup; the model stands still beyond it, and no laser reads at a thousandth of it."""


@dataclass(frozen=True)
class ModelState:
    """What the model says for given unknowns.

    Attributes:
        excess: of the readings over a perfect machine and setup, m, shape (..., n).
        errors: Σ t_i + Σ v_i × ε_i of each reading, m, shape (..., 3, n).
        turned: what the tilts change of each reading's direction, shape (..., 3, n).
        tilts: rad, shape (..., diagonal setups, 2).
    """

    excess: Vector
    errors: Vector
    turned: Vector
    tilts: Vector


@dataclass(frozen=True)
class ExactModel:
    """The model of averaged readings.

    Attributes:
        arm: distance at which angles are counted in metres.
        directions: of the beam of each setup, shape (setups, 3).
        tilted: setups that have two angles.
        pairs: vectors by which these angles turn the direction, shape (diagonal setups, 2, 3).
        setup: of each reading, shape (n,).
        way: commanded position from the line's first forward stop, m, shape (3, n).
        curves: unknowns of the curves that act on each reading, shape (curves, n).
        tilt_column: unknowns of the angles, shape (diagonal setups, 2).
        zero: unknown of each reading's zero, shape (n,).
        rotations: places in ``geometry.ROTATIONS`` of those among the curves.
        arms: v_i of X, Y, Z of each reading, m, shape (3, 3, n); anything without rotations.
        effect_column: unknowns of the effects, shape (e,).
        effects: what a unit of each adds to each reading, m, shape (e, n).
    """

    arm: float
    directions: Vector
    tilted: list[int]
    pairs: Vector
    setup: Integers
    way: Vector
    curves: Integers
    tilt_column: Integers
    zero: Integers
    rotations: list[int]
    arms: Vector
    effect_column: Integers
    effects: Vector

    @cached_property
    def _along(self) -> Vector:
        along: Vector = np.ascontiguousarray(self.directions[self.setup].T)
        return along

    @cached_property
    def _rows(self) -> list[slice | Integers]:
        """Return the readings of each setup that has two angles, as a slice where they adjoin."""
        return [_span(np.flatnonzero(self.setup == setup)) for setup in self.tilted]

    @cached_property
    def _nominal(self) -> Vector:
        """Return the directions of the setups that have two angles, shape (diagonal setups, 3)."""
        nominal: Vector = self.directions[self.tilted]
        return nominal

    def state(self, unknowns: Vector) -> ModelState:
        """Return what the model says for unknowns of shape (..., p)."""
        # Much of this is small arrays, of which each call of numpy costs more than the sums.
        angles = unknowns.take(self.tilt_column, axis=-1) / self.arm
        tilts: Vector = np.minimum(np.maximum(angles, -LARGEST_TILT), LARGEST_TILT)
        turned = self._turn(tilts).take(self.setup, axis=-1)
        errors = self._mirror_errors(padded(unknowns).take(self.curves, axis=-1))
        parts = turned * (self.way + errors) + self._along * errors
        excess: Vector = parts[..., 0, :] + parts[..., 1, :] + parts[..., 2, :]
        if len(self.effect_column):
            excess = excess + unknowns[..., self.effect_column] @ self.effects
        return ModelState(excess + unknowns.take(self.zero, axis=-1), errors, turned, tilts)

    def derivatives(self, state: ModelState, nominal: Vector) -> Vector:
        """Return the derivatives of one state's excess, as values of the matrix's entries.

        Args:
            state: for unknowns of shape (p,).
            nominal: values of the entries of the nominal matrix, shape (entries, n).
        """
        values: Vector = nominal.copy()
        turned = self._along + state.turned
        count = len(self.curves)
        values[: len(TRANSLATIONS)].reshape(3, *turned.shape)[:] = turned
        if self.rotations:
            turning = _cross(turned, self.arms).reshape(len(ROTATIONS), -1)
            values[len(TRANSLATIONS) : count] = turning[self.rotations] / self.arm
        place = self.way + state.errors
        shortening = state.tilts / np.sqrt(1.0 - _squares(state.tilts))
        by_tilts = self.pairs - shortening[:, :, None] * self._nominal[:, None, :]
        for by_tilt, here in zip(by_tilts, self._rows, strict=True):
            values[count : count + 2, here] = by_tilt @ place[:, here] / self.arm
        # Curve values that are zero by definition have entries in the cut-off column.
        return values

    def _turn(self, tilts: Vector) -> Vector:
        """Return what the tilts change of each setup's direction, shape (..., 3, setups)."""
        change = np.zeros((*tilts.shape[:-2], *self.directions.shape))
        if self.tilted:
            square = _squares(tilts)
            # sqrt(1-x)-1 without cancellation
            shortening = -square / (1.0 + np.sqrt(1.0 - square))
            across = tilts[..., :, :, None] * self.pairs
            change[..., self.tilted, :] = shortening * self._nominal + (
                across[..., 0, :] + across[..., 1, :]
            )
        turned: Vector = np.swapaxes(change, -1, -2)
        return turned

    def _mirror_errors(self, values: Vector) -> Vector:
        """Return Σ t_i + Σ v_i × ε_i of each reading from its curves, m, shape (..., 3, n)."""
        errors: Vector = values[..., :3, :] + values[..., 3:6, :] + values[..., 6:9, :]
        if self.rotations:
            turns = np.zeros((*values.shape[:-2], len(ROTATIONS), values.shape[-1]))
            turns[..., self.rotations, :] = values[..., len(TRANSLATIONS) :, :]
            for axis in range(3):
                turn = turns[..., 3 * axis : 3 * axis + 3, :]
                errors = errors + _cross(self._arms_per_unit[axis], turn)
        return errors

    @cached_property
    def _arms_per_unit(self) -> Vector:
        return self.arms / self.arm


def _span(places: Integers) -> slice | Integers:
    """Return ascending places as a slice if they are consecutive, which costs no copy."""
    start, end = int(places[0]), int(places[-1]) + 1
    return slice(start, end) if end - start == len(places) else places


def _squares(tilts: Vector) -> Vector:
    """Return the sum of the squares of two angles each, shape (..., 1)."""
    square = tilts * tilts
    total: Vector = square[..., :1] + square[..., 1:]
    return total


def _cross(one: Vector, other: Vector) -> Vector:
    """Return cross products of vectors along the last dimension but one, shape (..., 3, n)."""
    product: Vector = np.empty(np.broadcast_shapes(one.shape, other.shape))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.multiply(one[..., i, :], other[..., j, :], out=product[..., k, :])
        product[..., k, :] -= one[..., j, :] * other[..., i, :]
    return product


def padded(unknowns: Vector) -> Vector:
    """Return unknowns with a zero after them, for curve values that are zero by definition."""
    return np.concatenate([unknowns, np.zeros((*unknowns.shape[:-1], 1))], axis=-1)
