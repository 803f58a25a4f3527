"""The geometric part of what was learned: a displacement of the tool by its place alone.

An error curve depends on the place of one axis. What depends on the places of several axes
together, such as a bend in one quadrant, is beside the curves in a map (``volumetric_map``).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import nan

import numpy as np

from stepdiag_ros.metrology.effects.domain import PLACES
from stepdiag_ros.metrology.effects.learned_shape import EFFECT as LEARNED
from stepdiag_ros.metrology.effects.learned_shape import (
    READING,
    THE_LINE,
    TIMES,
    LearnedShape,
    Places,
    driver,
    factors,
    product_of,
    quantities,
)
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.model import ModelEffect
from stepdiag_ros.metrology.refusal import Refusal

_FINE = 2001
"""Places over which the mean of a shape along an axis is taken."""


@dataclass(frozen=True)
class LearnedDisplacement:
    """A displacement of the tool along X, Y or Z by a product of shapes of places.

    Attributes:
        acts_on: X, Y or Z.
        shape: product of factors (``effects.learned_shape``).
        amplitude: m.
        box: axis (0, 1, 2) → machine coordinates between which its shapes count, m, of each axis
            on which it depends.

    Raises:
        ValueError: a factor does not exist or does not depend on a place, or the box lacks an axis.
    """

    acts_on: str
    shape: str
    amplitude: float
    box: Mapping[int, tuple[float, float]]

    def __post_init__(self) -> None:
        if self.acts_on not in AXES:
            raise Refusal(
                f"a displacement acts along X, Y or Z, not on '{self.acts_on}'", fault="unknown"
            )
        for name in quantities(self.shape):
            if name not in PLACES:
                raise Refusal(f"'{self.shape}' does not depend on places alone", fault="unknown")
            low, high = self.box.get(PLACES.index(name), (nan, nan))
            if not low < high:
                raise Refusal(
                    f"'{self.shape}' depends on {name[0]}, and its box lacks the range of"
                    f" {name[0]}",
                    fault="missing",
                )

    @property
    def label(self) -> str:
        """Return how the effect is called in a model."""
        return LEARNED.label({"acts_on": self.acts_on, "shape": self.shape})

    @property
    def axis(self) -> int:
        """Return the number of the axis along which it acts."""
        return AXES.index(self.acts_on)

    def product(self, positions: Vector) -> Vector:
        """Return the product of the shapes at machine coordinates (m, shape (n, 3)), shape (n,)."""
        return product_of(self.shape, Places(self._share(positions)))

    def along(self, axis: int, positions: Vector) -> Vector:
        """Return what curves can hold of it by the place of one axis alone.

        Of all sums of functions of one place each the one that is nearest to the product, in the
        mean of squares over the box: (f - mean f) times the mean of the other axes' shapes.

        Args:
            axis: 0, 1, 2.
            positions: of that axis, m, shape (n,).

        Returns:
            m, shape (n,).
        """
        if axis not in self.box:
            return np.zeros(len(positions))
        others = [mean for other, mean in self._means.items() if other != axis]
        own = self._of_axis(axis, np.asarray(positions, dtype=np.float64)) - self._means[axis]
        part: Vector = self.amplitude * float(np.prod(others)) * own
        return part

    def kinks(self, axis: int) -> list[float]:
        """Return the machine coordinates of an axis at which its slope changes at once, m."""
        if axis not in self.box:
            return []
        low, high = self.box[axis]
        bounds = re.compile(f"{AXES[axis].lower()}[<>](.+)")
        found = (bounds.fullmatch(text) for text in factors(self.shape))
        return [low + float(one[1]) * (high - low) for one in found if one]

    def _share(self, positions: Vector) -> Vector:
        share = np.zeros((len(positions), len(AXES)))
        for axis, (low, high) in self.box.items():
            share[:, axis] = (positions[:, axis] - low) / (high - low)
        return share

    def _of_axis(self, axis: int, positions: Vector) -> Vector:
        """Return the product of the shapes of one axis at its positions, m, shape (n,)."""
        places = np.zeros((len(positions), len(AXES)))
        places[:, axis] = positions
        share = Places(self._share(places))
        own = [text for text in factors(self.shape) if quantities(text) == (PLACES[axis],)]
        return product_of(TIMES.join(own), share)

    @cached_property
    def _means(self) -> dict[int, float]:
        return {
            axis: float(np.mean(self._of_axis(axis, np.linspace(low, high, _FINE))))
            for axis, (low, high) in self.box.items()
        }


def is_geometric(effect: ModelEffect) -> bool:
    """Say whether an effect is a learned displacement by places alone."""
    setting = effect.active.setting
    return (
        isinstance(effect.active.effect, LearnedShape)
        and setting["acts_on"] != READING
        and THE_LINE not in depends_on(effect)
        and all(name in PLACES for name in quantities(str(setting["shape"])))
    )


def depends_on(effect: ModelEffect) -> tuple[str, ...]:
    """Say on what a learned shape depends, for example ``the place of X`` and ``time``."""
    shape = str(effect.active.setting["shape"])
    return tuple(dict.fromkeys(driver(text) for text in factors(shape)))


def displacements(
    effects: Sequence[ModelEffect], low: Vector, high: Vector
) -> tuple[LearnedDisplacement, ...]:
    """Return geometric learned effects as they act in a measured box.

    Args:
        effects: learned displacements by places alone.
        low: first corner of the measured box, machine coordinates, m, shape (3,).
        high: last corner, m, shape (3,).

    Raises:
        ValueError: the box reaches beyond the domain in which an effect was learned.
    """
    return tuple(_displacement(effect, low, high) for effect in effects)


def _displacement(effect: ModelEffect, low: Vector, high: Vector) -> LearnedDisplacement:
    active = effect.active
    shape = str(active.setting["shape"])
    axes = [PLACES.index(name) for name in quantities(shape)]
    measured = {axis: (float(low[axis]), float(high[axis])) for axis in axes}
    domain = active.effect.domain if isinstance(active.effect, LearnedShape) else None
    if domain is not None:
        for seen in domain.ranges:
            here = seen._replace(
                low=measured[PLACES.index(seen.name)][0], high=measured[PLACES.index(seen.name)][1]
            )
            if not seen.holds(here):
                raise Refusal(
                    f"'{effect.label}' was learned over {seen.words}, and this run covers"
                    f" {here.words}: outside its domain it is not compensated. Learn it from this"
                    " run ('stepdiag diagnose --extend')",
                    fault="out_of_range",
                    about=effect.label,
                )
    return LearnedDisplacement(
        str(active.setting["acts_on"]),
        shape,
        active.sizes["amplitude"],
        measured if domain is None else domain.box(),
    )


def covariance_of(effects: Sequence[ModelEffect]) -> Vector:
    """Return the covariance of the amplitudes of learned effects, m², (k, k); NaN if unknown."""
    made = np.full((len(effects), len(effects)), 0.0)
    for row, one in enumerate(effects):
        made[row, row] = one.standard_uncertainty["amplitude"] ** 2
        for column, other in enumerate(effects):
            if row != column:
                made[row, column] = one.covariance.get(other.label, 0.0)
    return made
