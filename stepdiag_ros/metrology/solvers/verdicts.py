"""What a design determines of its errors, and which errors act alike where it does not.

Null directions of the design are changes of the unknowns that no reading shows. An error that is in
none of them is determined. Where it is in one, every other error in it can do the same. Setups
(angles and zeros) are free always and are named only where they can do it alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from operator import add

import numpy as np
from scipy.linalg import lapack, solve_triangular

from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES
from stepdiag_ros.metrology.geometry import TRANSLATIONS, Vector, curve_unit, moving_axis
from stepdiag_ros.metrology.solvers.design import Design
from stepdiag_ros.metrology.solvers.observations import Integers
from stepdiag_ros.metrology.solvers.positive import is_positive
from stepdiag_ros.metrology.solvers.summary import deviations_from_line, slope_weights

DETERMINED = "determined"
PARTLY = "partly determined"
CONFOUNDED = "confounded"
INVISIBLE = "invisible"
SETUP = "the setup"
SHAPE = "the shape, not the slope"
"""The part of a curve that is determined where its mean slope is not."""

_NOTHING = 1e-6
"""Part of a unit vector in undetermined directions, or of a partner in it, that counts as none."""
_RANK_LIMIT = 1e-9
"""Eigenvalues below this share of the largest count as zero."""
_SHARE = 1e-3
"""Part of the error in a null direction that others are looked for by."""


@dataclass(frozen=True)
class VerdictRow:
    """What can be determined of one error.

    Attributes:
        name: ISO 230-1 name of a curve, or C0Y, B0Z, A0Z.
        unit: m or rad.
        status: ``determined``, ``partly determined``, ``confounded`` or ``invisible``.
        part: what of it is determined, in words; empty unless partly.
        confounded_with: names of the errors that can do what is not determined of it.
        end: expected standard uncertainty at the last node (of the value itself where it is one
            number), in the unit; NaN if not determined.
        largest: the largest over the nodes that are determined, or of the deviations from the
            least-squares line where only the shape is; NaN if nothing is.
        condition: by which factor the largest uncertainty exceeds that with all else known (square
            root of the variance inflation); NaN if nothing is determined.
    """

    name: str
    unit: str
    status: str
    part: str = ""
    confounded_with: tuple[str, ...] = ()
    end: float = float("nan")
    largest: float = float("nan")
    condition: float = float("nan")

    @property
    def words(self) -> str:
        """Return the verdict in one phrase, such as ``confounded with E_AY, E_CY``."""
        others = ", ".join(self.confounded_with)
        if self.status == PARTLY:
            return f"{PARTLY}: {self.part}" + (f"; the rest with {others}" if others else "")
        if self.status == CONFOUNDED:
            return (
                f"confounded with {others}"
                if others
                else "confounded: another shape of it gives the same readings"
            )
        if self.status == INVISIBLE:
            return (
                f"invisible: {others} can do the same" if others else "invisible: no line sees it"
            )
        return self.status


class Verdicts:
    """The rows of a design.

    Args:
        design: of a measurement.
    """

    def __init__(self, design: Design) -> None:
        self._design = design
        self._noise = 1.0 if design.observations.noise_known else float("nan")
        self._groups: dict[str, Integers] = {
            name: columns[columns < design.count]
            for name, columns in zip(design.names, design.curve_column, strict=True)
        }
        self._setup = np.concatenate([design.tilt_column.reshape(-1), design.zero_column])
        self._normal: Vector = design.normal / np.max(design.weight)
        self._information = np.diag(self._normal) * np.max(design.weight)
        self._largest = float(np.max(np.diag(self._normal)))
        self._moves = np.concatenate([self._groups[name] for name in TRANSLATIONS])
        self._spaces: dict[frozenset[str], Vector] = {}
        if design.unseen.shape[1]:
            self._grams = {
                name: design.unseen[columns].T @ design.unseen[columns]
                for name, columns in self._groups.items()
            }
            self._setup_gram = design.unseen[self._setup].T @ design.unseen[self._setup]

    @cached_property
    def condition_number(self) -> float:
        """Return the ratio of the singular values of the determined part of the problem.

        Infinite where rounding leaves nothing of the smallest.
        """
        values = np.linalg.eigvalsh(self._normal)
        smallest = float(values[self._design.unseen.shape[1]])
        return float(np.sqrt(values[-1] / smallest)) if smallest > 0.0 else float("inf")

    def rows(self) -> tuple[VerdictRow, ...]:
        """Return the verdict on each curve and each squareness error."""
        rows = [self._curve(name) for name in self._design.names]
        rows += [self._squareness(name) for name in SQUARENESS_SLOPES]
        return tuple(rows)

    @cached_property
    def _beside_setups(self) -> Vector:
        return self._beside(self._setup, self._moves)

    @cached_property
    def _beside_base(self) -> Vector:
        turns = [self._groups[name] for name in self._design.names[len(TRANSLATIONS) :]]
        return self._beside(np.concatenate([self._moves, self._setup]), np.concatenate(turns))

    def _beside(self, base: Integers, asked: Integers) -> Vector:
        """Return what readings determine of some unknowns with others left free, shape (p,).

        The diagonal of the normal matrix with these eliminated (Schur).

        Args:
            base: unknowns that are left free.
            asked: unknowns whose values are wanted; NaN for the others.
        """
        block, across = self._normal[np.ix_(base, base)], self._normal[np.ix_(base, asked)]
        lower, failed = lapack.dpotrf(block, lower=1)
        pivots = np.diag(lower) ** 2
        if failed or np.min(pivots) <= _RANK_LIMIT * np.max(pivots):
            values, vectors = np.linalg.eigh(block)
            good = values > _RANK_LIMIT * values[-1]
            taken = (vectors[:, good].T @ across) / np.sqrt(values[good, None])
        else:
            taken = solve_triangular(lower, across, lower=True, check_finite=False)
        left: Vector = np.full(len(self._normal), np.nan)
        left[asked] = np.diag(self._normal)[asked] - np.sum(taken**2, axis=0)
        return left

    def _shows(self, name: str) -> bool:
        """Say whether an error shows where only setups (and translations) are free beside it."""
        left = self._beside_setups if name in TRANSLATIONS else self._beside_base
        own = np.max(left[self._groups[name]], initial=0.0)
        return bool(own > _RANK_LIMIT * self._largest)

    def _partners(self, own: Sequence[str], part: Vector) -> tuple[str, ...]:
        """Return who else can do what is not determined of an error.

        Args:
            own: names of the error's curves.
            part: the error's part in each null direction, shape (k, r).

        Returns:
            everyone who can do it alone; else the fewest together that were found.
        """
        design = self._design
        moved = np.any(np.abs(part @ design.unseen.T) > _NOTHING, axis=0)
        coupled = [
            name
            for name, columns in self._groups.items()
            if name not in own and np.any(moved[columns])
        ]
        if _reaches(part, _held_by(reduce(add, (self._grams[name] for name in own)))):
            return ()  # Nobody is needed: no reading speaks of it.
        if _reaches(part, self._space(own)):
            return (SETUP,)
        alone = [name for name in coupled if _reaches(part, self._space((*own, name)))]
        if alone:
            return tuple(alone)
        needed = list(coupled)
        within = self._space((*own, *needed))
        # Rotations are dropped first: what translations do is the plainest answer.
        # Many are dropped at once, so that few questions are asked.
        chunk = len(needed)
        while chunk:
            end = len(needed)
            while end > 0:
                fewer = needed[: max(0, end - chunk)] + needed[end:]
                end -= chunk
                space = self._space((*own, *fewer), within)
                if _reaches(part, space):
                    needed, within = fewer, space
            chunk //= 2
        return tuple(needed)

    def _space(self, names: Sequence[str], within: Vector | None = None) -> Vector:
        """Return the null directions that hold these errors and setups only.

        Args:
            names: of the errors.
            within: those that hold these and further errors, shape (r, m), where they are known:
                a search among few is quick.

        Returns:
            as combinations of the null directions of the design, shape (r, k).
        """
        key = frozenset(names)
        if key not in self._spaces:
            inside = self._setup_gram + reduce(add, (self._grams[name] for name in names))
            self._spaces[key] = _held_by(inside, within)
        return self._spaces[key]

    def _curve(self, name: str) -> VerdictRow:
        design = self._design
        columns = self._groups[name]
        unit = curve_unit(name)
        scale = design.arm if unit == "rad" else 1.0
        unseen = design.unseen[columns]
        variance = np.maximum(np.diag(design.covariance)[columns], 0.0)
        hidden = np.linalg.norm(unseen, axis=1) > _NOTHING
        spread = np.where(hidden, np.nan, self._noise * np.sqrt(variance) / scale)
        inflation = np.sqrt(variance * self._information[columns])
        place = design.names.index(name)
        ends_at_zero = design.curve_column[place, -1] == design.count
        row = VerdictRow(
            name,
            unit,
            DETERMINED,
            end=0.0 if ends_at_zero else float(spread[-1]),
            largest=float(np.max(spread[~hidden], initial=0.0)),
            condition=float(np.max(inflation[~hidden], initial=1.0)),
        )
        if not np.any(hidden):
            return row
        row = replace(row, confounded_with=self._partners((name,), unseen))
        nothing = replace(row, end=np.nan, largest=np.nan, condition=np.nan)
        if not self._shows(name):
            return replace(nothing, status=INVISIBLE)
        shape = self._shape(name)
        if shape is not None:
            return replace(row, status=PARTLY, part=SHAPE, largest=shape, condition=np.nan)
        if not np.all(hidden):
            nodes = np.flatnonzero(design.curve_column[place] < design.count)[~hidden]
            return replace(row, status=PARTLY, part=f"the nodes {_ranges(nodes)}")
        sums = len(columns) - int(np.linalg.matrix_rank(unseen, tol=_NOTHING))
        if sums:
            part = f"{sums} of {len(columns)} independent sums of its values"
            return replace(nothing, status=PARTLY, part=part)
        return replace(nothing, status=CONFOUNDED)

    def _shape(self, name: str) -> float | None:
        """Return the largest uncertainty of the deviations from a line; None if not determined."""
        design = self._design
        columns = design.curve_column[design.names.index(name)]
        nodes = design.observations.volume.nodes(moving_axis(name))
        if len(nodes) < 3:
            return None
        free = columns[columns < design.count]
        matrix = deviations_from_line(nodes)[:, columns < design.count]
        if np.max(np.abs(matrix @ design.unseen[free])) > _NOTHING:
            return None
        variance = np.diag(matrix @ design.covariance[np.ix_(free, free)] @ matrix.T)
        scale = design.arm if curve_unit(name) == "rad" else 1.0
        return self._noise * float(np.sqrt(np.max(variance))) / scale

    def _squareness(self, name: str) -> VerdictRow:
        design = self._design
        pair = SQUARENESS_SLOPES[name][1]
        weights = np.zeros(design.count + 1)
        for curve in pair:
            nodes = design.observations.volume.nodes(moving_axis(curve))
            weights[design.curve_column[design.names.index(curve)]] += slope_weights(nodes)
        weights = weights[:-1]
        left = weights @ design.unseen / np.linalg.norm(weights)
        if np.linalg.norm(left) <= _NOTHING:
            variance = max(float(weights @ design.covariance @ weights), 0.0)
            spread = self._noise * float(np.sqrt(variance))
            alone = float(np.sum(weights**2 / np.maximum(self._information, 1e-300)))
            condition = float(np.sqrt(variance / alone))
            return VerdictRow(
                name, "rad", DETERMINED, end=spread, largest=spread, condition=condition
            )
        seen = any(self._shows(curve) for curve in pair)
        partners = self._partners(pair, left[None, :])
        return VerdictRow(name, "rad", CONFOUNDED if seen else INVISIBLE, confounded_with=partners)


def _held_by(gram: Vector, within: Vector | None = None) -> Vector:
    """Return the directions that some unknowns hold whole.

    Args:
        gram: of the parts of all directions in these unknowns, shape (r, r).
        within: directions to search among, shape (r, m); None: all.

    Returns:
        orthonormal, shape (r, k).
    """
    inner = gram if within is None else within.T @ gram @ within
    # Cholesky is much faster than eigenvectors, and mostly there is no such direction.
    beyond = -inner
    beyond.flat[:: len(inner) + 1] += 1.0 - _NOTHING
    if not len(inner) or is_positive(beyond):
        return np.empty((len(gram), 0))
    values, vectors = np.linalg.eigh(inner)
    held: Vector = vectors[:, values > 1.0 - _NOTHING]
    return held if within is None else within @ held


def _reaches(part: Vector, directions: Vector) -> bool:
    """Say whether an error, with its part in each direction, is in one of some directions."""
    return bool(directions.size) and bool(np.any(np.abs(part @ directions) > _SHARE))


def _ranges(numbers: Integers) -> str:
    """Write whole numbers as ranges: 1-4, 7."""
    parts: list[str] = []
    start = previous = int(numbers[0])
    for number in [*(int(value) for value in numbers[1:]), -1]:
        if number != previous + 1:
            parts.append(f"{start}-{previous}" if previous > start else str(start))
            start = number
        previous = number
    return ", ".join(parts)
