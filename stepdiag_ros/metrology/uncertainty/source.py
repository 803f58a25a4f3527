"""One source of uncertainty: what is known of an input, and what it does to every reading."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.solvers.observations import Integers
from stepdiag_ros.metrology.uncertainty.instrument import (
    ARCSINE,
    NORMAL,
    RECTANGULAR,
    TRIANGULAR,
    Spread,
)

SQUARED_ANGLE = "squared angle"
"""Half the square of an angle with two normal components: exponential, never negative."""
PRODUCT = "product of two normal"

INSTRUMENT = "instrument"
AIR = "air"
MATERIAL = "material"
DEAD_PATH = "dead path"
SETUP = "setup"
REPEATABILITY = "repeatability"
DRIFT = "drift between passes"
MODEL = "misfit of the model"
"""Lack of fit; a name in published documents, so it stays."""
ANGULAR = "angular errors"
DIRECT = "measured directly"
GROUPS = (
    INSTRUMENT,
    AIR,
    DEAD_PATH,
    MATERIAL,
    SETUP,
    REPEATABILITY,
    DRIFT,
    MODEL,
    ANGULAR,
    DIRECT,
)
"""Groups of sources in the order in which they are shown."""

COMMON = "common to all readings"
PER_SETUP = "independent for each setup"
PER_PASS = "independent for each pass"
PER_PLACE = "independent for each place of each setup"
PER_READING = "independent for each reading"
PER_POSITION = "independent for each position"


@dataclass(frozen=True)
class Source:
    """An input quantity with its uncertainty, its correlation over the readings and its effect.

    The reading i changes by ``Σ_c slopes[c, i]·x[c, member[i]]`` when the input, which has
    ``max(member) + 1`` independent values of each of its c components, changes by x.

    Attributes:
        name: of the input.
        group: one of ``GROUPS``.
        standard_uncertainty: of each value of the input, in its unit; NaN if unknown.
        unit: of the input, as people write it.
        evaluation: ``A`` (from the readings' own scatter) or ``B`` (from other knowledge).
        distribution: that each value is drawn from.
        degrees_of_freedom: of the standard uncertainty; infinite if it is taken as exact.
        correlation: ``COMMON``, or one of the ``PER_…``.
        slopes: change of each reading by a unit of each component, m per unit, shape (c, n).
        member: which value of the input acts on each reading, shape (n,).
        note: what the reader should know of it; often empty.
        truly: name of a quantity → what a unit of each component changes of its true value, shape
            (c,): a reading that shows this does not err. Of inputs that are common to all readings.
    """

    name: str
    group: str
    standard_uncertainty: float
    unit: str
    evaluation: str
    distribution: str
    degrees_of_freedom: float
    correlation: str
    slopes: Vector
    member: Integers
    note: str = ""
    truly: Mapping[str, Vector] = field(default_factory=dict)

    @property
    def known(self) -> bool:
        """Say whether its standard uncertainty and its effect are known."""
        return bool(np.isfinite(self.standard_uncertainty) and np.all(np.isfinite(self.slopes)))

    def errors(self, matrix: Vector, names: Sequence[str]) -> Vector:
        """Return ``factors`` less what the input does to the true values of the quantities.

        Args:
            matrix: see ``factors``.
            names: of the quantities.
        """
        made = self.factors(matrix)
        size = self.standard_uncertainty if np.isfinite(self.standard_uncertainty) else 1.0
        for row, name in enumerate(names):
            if name in self.truly:
                made[row] -= size * self.truly[name]
        return made

    def factors(self, matrix: Vector) -> Vector:
        """Return what the values of the input do to output quantities, each in its unit.

        Args:
            matrix: derivatives of the quantities by the readings, shape (q, n).

        Returns:
            for one standard uncertainty of each value, shape (q, c·values); its product with its
            own transpose is the contribution to the covariance. Per unit of the input where the
            standard uncertainty is not known.
        """
        size = self.standard_uncertainty if np.isfinite(self.standard_uncertainty) else 1.0
        values = int(self.member.max()) + 1
        made = []
        for slope in self.slopes:
            column = np.nan_to_num(slope, nan=1.0) * size
            if values == len(self.member):
                made.append(matrix * column)
                continue
            gathered = np.zeros((len(self.member), values))
            gathered[np.arange(len(self.member)), self.member] = column
            made.append(matrix @ gathered)
        joined: Vector = np.concatenate(made, axis=1)
        return joined

    def draw(self, count: int, rng: np.random.Generator) -> tuple[Vector, dict[str, Vector]]:
        """Return what the source does in many trials.

        Returns:
            to the readings, m, shape (count, n); to the true values of quantities, by their names,
            each shape (count,).
        """
        values = int(self.member.max()) + 1
        effect = np.zeros((count, len(self.member)))
        # The scale of a type A evaluation is itself uncertain, and the same for all its values:
        # together a multivariate t (JCGM 101, 6.4.9).
        scale = np.full((count, 1), self.standard_uncertainty)
        if np.isfinite(self.degrees_of_freedom):
            freedom = self.degrees_of_freedom
            scale = scale * np.sqrt(freedom / rng.chisquare(freedom, (count, 1)))
        true = {name: np.zeros(count) for name in self.truly}
        for number, slope in enumerate(self.slopes):
            drawn = _standard(self.distribution, (count, values), rng) * scale
            for name, changes in self.truly.items():
                true[name] += drawn[:, 0] * changes[number]
            if values == 1:
                effect += drawn * slope
            else:
                effect += drawn[:, self.member] * slope
        return effect, true


@dataclass(frozen=True)
class DirectSource(Source):
    """What was measured directly beside the readings: it acts on no reading.

    Attributes:
        by_direct: change of the output quantities by one standard uncertainty of each of its
            values, shape (q, values).
    """

    by_direct: Vector = field(default_factory=lambda: np.zeros((0, 0)))

    def factors(self, matrix: Vector) -> Vector:
        """Return what its values do to output quantities; see ``Source.factors``."""
        del matrix
        return self.by_direct


def _standard(distribution: str, shape: tuple[int, int], rng: np.random.Generator) -> Vector:
    """Draw from a distribution scaled to a root mean square of one."""
    if distribution == NORMAL:
        return rng.standard_normal(shape)
    if distribution == RECTANGULAR:
        return rng.uniform(-np.sqrt(3.0), np.sqrt(3.0), shape)
    if distribution == TRIANGULAR:
        return rng.triangular(-np.sqrt(6.0), 0.0, np.sqrt(6.0), shape)
    if distribution == ARCSINE:
        turned: Vector = np.sqrt(2.0) * np.sin(rng.uniform(-np.pi, np.pi, shape))
        return turned
    if distribution == SQUARED_ANGLE:
        # (a² + b²)/2 of two standard normal components has mean 1 and mean square 2.
        squared: Vector = rng.standard_exponential(shape) / np.sqrt(2.0)
        return squared
    if distribution == PRODUCT:
        product: Vector = rng.standard_normal(shape) * rng.standard_normal(shape)
        return product
    raise ValueError(f"'{distribution}' is not a distribution that can be drawn from")


def common(
    name: str, group: str, spread: Spread, unit: str, slope: Vector, note: str = ""
) -> Source:
    """Return a type B source that is one value for all readings; see ``Source``."""
    member = np.zeros(len(slope), dtype=np.int64)
    return _made(name, group, spread, unit, COMMON, [slope], member, note)


def each_reading(
    name: str, group: str, spread: Spread, unit: str, slope: Vector, note: str = ""
) -> Source:
    """Return a type B source that has another value at each reading; see ``Source``."""
    return _made(name, group, spread, unit, PER_READING, [slope], np.arange(len(slope)), note)


def each_setup(
    name: str,
    group: str,
    spread: Spread,
    unit: str,
    slopes: list[Vector],
    setup: Integers,
    note: str = "",
) -> Source:
    """Return a type B source that has another value in each setup; see ``Source``.

    Args:
        name: of the input.
        group: of sources.
        spread: what is known of it.
        unit: of the input.
        slopes: of each component, m per unit, each shape (n,).
        setup: of each reading, shape (n,).
        note: what the reader should know.
    """
    return _made(name, group, spread, unit, PER_SETUP, slopes, setup, note)


def _made(
    name: str,
    group: str,
    spread: Spread,
    unit: str,
    correlation: str,
    slopes: list[Vector],
    member: Integers,
    note: str,
) -> Source:
    return Source(
        name,
        group,
        spread.standard_uncertainty,
        unit,
        "B",
        spread.distribution,
        spread.degrees_of_freedom,
        correlation,
        np.array(slopes),
        member,
        note,
    )
