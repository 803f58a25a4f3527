"""Directly measured errors as rows of the least-squares problem, beside those of the stops.

Ibaraki & Hata 2010, sections 3.3 and 4.2, name angular errors as what spoils the step diagonal. A
lab that has measured them by an autocollimator or an angular interferometer, or straightness by a
straightedge, gives them here, and they count by their uncertainty. A value at a position between
two nodes speaks of both, on a straight line between them. What is free in each repeat (zero; of a
straightness the slope too) is projected out, so that n positions make n - 1 or n - 2 rows.

A translation that was measured beside the mirror's point, or with other axes elsewhere than at the
first corner, holds the rotations of its own axis by the lever A + r: A, the way of the axes after
it in the chain from the first corner; r, from the mirror's point to the reflector. A squareness
holds besides by what the axes before its own, where they stood, have turned the lines of these.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.direct import (
    EDGE_SHARE,
    DirectCurve,
    DirectMeasurement,
    DirectPlace,
    DirectSquareness,
    between_nodes,
)
from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES, levers
from stepdiag_ros.metrology.geometry import AXES, ROTATIONS, TRANSLATIONS, Vector, moving_axis
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.observations import Integers
from stepdiag_ros.metrology.solvers.summary import slope_weights


@dataclass(frozen=True)
class Rows:
    """Linear equations for the unknowns, independent of each other.

    Attributes:
        matrix: m per unit of the unknowns, shape (rows, unknowns).
        values: what was measured, m, shape (rows,).
        weight: of each row, 1/u², 1/m², shape (rows,).
    """

    matrix: Vector
    values: Vector
    weight: Vector

    def by_unknowns(self, columns: Integers, count: int) -> "Rows":
        """Return rows for stacked curve values as rows for the unknowns of a design.

        Args:
            columns: unknown of each curve value; ``count``, of values that are zero by definition.
            count: number of unknowns.
        """
        matrix = np.zeros((len(self.values), count + 1))
        matrix[:, columns.reshape(-1)] = self.matrix
        return replace(self, matrix=matrix[:, :count])

    def normal(self) -> Vector:
        """Return what the rows add to the normal matrix."""
        added: Vector = (self.matrix * self.weight[:, None]).T @ self.matrix
        return added

    def left(self, unknowns: Vector) -> Vector:
        """Return the residuals, m, shape (..., rows) for unknowns of shape (..., p)."""
        found: Vector = self.values - unknowns @ self.matrix.T
        return found

    def pull(self, unknowns: Vector) -> Vector:
        """Return what the rows add to the right-hand side, shape (..., p)."""
        pulled: Vector = (self.left(unknowns) * self.weight) @ self.matrix
        return pulled

    def squares(self, unknowns: Vector) -> float:
        """Return what the rows add to the weighted sum of squares."""
        return float(np.sum(self.weight * self.left(unknowns) ** 2))


def used_of(direct: DirectMeasurement, volume: Volume) -> dict[str, DirectCurve]:
    """Return the curves that were measured directly, as far as they lie in the measured box.

    Raises:
        ValueError: too few positions of a curve lie in the box, or its uncertainty is not known;
            one sentence.
    """
    used = {}
    for name, curve in direct.curves.items():
        nodes = volume.nodes(moving_axis(name))
        slack = EDGE_SHARE * (nodes[1] - nodes[0])
        inside = curve.between(nodes[0] - slack, nodes[-1] + slack)
        free = curve.nuisance.shape[1]
        if len(inside.positions) <= free:
            raise Refusal(
                f"{direct.origin(name)} was measured directly at {len(inside.positions)} positions"
                f" within the measured travel of {nodes[0]:g} to {nodes[-1]:g} m; {free + 1} are"
                " needed to determine anything. Leave it out",
                fault="too_few",
            )
        if not np.all(np.isfinite(inside.stated_uncertainty)):
            raise _not_weighed(direct, name)
        used[name] = inside
    for name, angle in direct.squareness.items():
        if not np.isfinite(angle.standard_uncertainty):
            raise _not_weighed(direct, name)
    return used


def _not_weighed(direct: DirectMeasurement, name: str) -> Refusal:
    return Refusal(
        f"{direct.origin(name)} was measured directly, but its standard_uncertainty is not known,"
        " so that it cannot be weighed against the readings: give it",
        fault="undetermined",
    )


def told_rotations(direct: DirectMeasurement | None, volume: Volume) -> tuple[str, ...]:
    """Return the rotations that were measured closely enough to be determined at every node."""
    if direct is None:
        return ()
    told = []
    for name, curve in used_of(direct, volume).items():
        if name in ROTATIONS:
            at = curve.interpolation(volume.nodes(moving_axis(name)))
            from_first = at[1:] - at[:1]
            if np.linalg.matrix_rank(from_first) == volume.blocks:
                told.append(name)
    return tuple(name for name in ROTATIONS if name in told)


class RowMaker:
    """Makes rows for the values of curves at the nodes.

    Args:
        volume: the measured box.
        names: of the curves among the unknowns.
        chain: order of the axes from workpiece to tool; empty if there are no rotations.
        arm: distance by which rotations are counted in metres.
    """

    def __init__(self, volume: Volume, names: Sequence[str], chain: str, arm: float) -> None:
        self._volume, self._names, self._chain, self._arm = volume, tuple(names), chain, arm
        self._size = volume.blocks + 1

    def rows(self, direct: DirectMeasurement | None) -> Rows:
        """Return the rows of everything that speaks of these curves, by the stacked curve values.

        Raises:
            ValueError: see ``used_of``.
        """
        made = [Rows(np.zeros((0, len(self._names) * self._size)), np.zeros(0), np.zeros(0))]
        if direct is not None:
            used = used_of(direct, self._volume).values()
            made += [self._of_curve(curve) for curve in used if curve.name in self._names]
            made += [self._of_squareness(angle) for angle in direct.squareness.values()]
        return Rows(
            np.concatenate([rows.matrix for rows in made]),
            np.concatenate([rows.values for rows in made]),
            np.concatenate([rows.weight for rows in made]),
        )

    def _of_curve(self, curve: DirectCurve) -> Rows:
        scale = self._arm if curve.name in ROTATIONS else 1.0
        uncertainty = scale * mean_uncertainty(curve)
        at = curve.interpolation(self._volume.nodes(moving_axis(curve.name)))
        matrix = self._weights(curve.name, at, curve.place)
        typical = float(np.sqrt(np.mean(uncertainty**2)))
        # In units of the uncertainties rows are alike, so that a projection leaves them so.
        share = typical / uncertainty
        free = curve.nuisance
        basis = np.linalg.qr(free * share[:, None], mode="complete")[0][:, free.shape[1] :]
        project = basis.T * share
        return Rows(
            project @ matrix,
            project @ (scale * curve.mean),
            np.full(len(project), typical**-2.0),
        )

    def _of_squareness(self, angle: DirectSquareness) -> Rows:
        factor, pair = SQUARENESS_SLOPES[angle.name]
        matrix = np.zeros((1, len(self._names) * self._size))
        for name in pair:
            slope = slope_weights(self._volume.nodes(moving_axis(name)))
            matrix += factor * self._weights(name, slope[None, :], angle.place)
            matrix += factor * self._turned(name, angle)
        # Times the arm: a row in metres, as the others.
        return Rows(
            self._arm * matrix,
            np.array([self._arm * angle.mean]),
            np.array([(self._arm * angle.standard_uncertainty) ** -2.0]),
        )

    def _turned(self, name: str, angle: DirectSquareness) -> Vector:
        """Return by what the axes before a moving one have turned its line, as in ``_weights``.

        Each stands, and its rotations there turn what comes after it: a slope (ε × ê_j)·ê_e of the
        error along ê_e as the axis j moves. A straightness has its slope free, a square has not.

        Raises:
            ValueError: an axis stood outside the measured box, where its rotations are not known.
        """
        matrix = np.zeros((1, len(self._names), self._size))
        moving = AXES[moving_axis(name)]
        across = np.cross(np.eye(3)[AXES.index(moving)], np.eye(3)[AXES.index(name[2])])
        for letter in self._chain[: self._chain.index(moving)] if self._chain else "":
            nodes = self._volume.nodes(AXES.index(letter))
            stood = angle.place.standing[AXES.index(letter)]
            slack = EDGE_SHARE * (nodes[1] - nodes[0])
            if not np.isfinite(stood):
                stood = nodes[0]
            if not nodes[0] - slack <= stood <= nodes[-1] + slack:
                raise Refusal(
                    f"{angle.name} was measured directly with {letter} at {stood:g} m, outside the"
                    " measured box, where the rotations of that axis are not known: leave it out",
                    fault="out_of_range",
                )
            for which, about in enumerate("ABC"):
                rotation = f"E_{about}{letter}"
                if rotation in self._names:
                    at = between_nodes(nodes, np.array([stood]))
                    # (ε × ê_j)·ê_e = ε·(ê_j × ê_e)
                    matrix[:, self._names.index(rotation)] += at * across[which] / self._arm
        return matrix.reshape(1, -1)

    def _weights(self, name: str, at: Vector, place: DirectPlace) -> Vector:
        """Return functionals of one curve as functionals of all stacked unknowns.

        Args:
            name: of the curve.
            at: weights of its values at the nodes, shape (m, N + 1).
            place: where it was measured.

        Returns:
            shape (m, c(N+1)).
        """
        matrix = np.zeros((len(at), len(self._names), self._size))
        matrix[:, self._names.index(name)] = at
        axis = moving_axis(name)
        if name in TRANSLATIONS and self._chain:
            # (ε × lever)·ê = ε·(lever × ê)
            turn = np.cross(self._lever(axis, place), np.eye(3)[AXES.index(name[2])])
            for which, letter in enumerate("ABC"):
                rotation = f"E_{letter}{AXES[axis]}"
                if rotation in self._names:
                    matrix[:, self._names.index(rotation)] += at * turn[which] / self._arm
        return matrix.reshape(len(at), -1)

    def _lever(self, axis: int, place: DirectPlace) -> Vector:
        """Return the lever of an axis's rotations at a place, m, shape (3,)."""
        standing = np.asarray(place.standing) - np.asarray(self._volume.origin)
        after = levers(np.nan_to_num(standing)[None, :], self._chain)[axis][0]
        lever: Vector = after + np.asarray(place.reflector)
        return lever


def mean_uncertainty(curve: DirectCurve) -> Vector:
    """Return the standard uncertainty of the mean of the repeats at each position, shape (n,).

    What is stated, and the scatter of the repeats about each other after what is free in each was
    taken out, pooled over the positions. With a single repeat the scatter is part of what is
    stated.
    """
    repeats, count = curve.values.shape
    free = curve.nuisance.shape[1]
    if repeats < 2 or count <= free:
        return curve.stated_uncertainty
    basis = np.linalg.qr(curve.nuisance, mode="complete")[0][:, free:]
    apart = (curve.values - curve.mean) @ basis
    scatter = np.sum(apart**2) / ((repeats - 1) * (count - free))
    found: Vector = np.sqrt(curve.stated_uncertainty**2 + scatter / repeats)
    return found


def remarks_of(direct: DirectMeasurement, volume: Volume, names: Sequence[str]) -> list[str]:
    """Say how a method with these curves has used what was measured directly."""
    used = used_of(direct, volume)
    taken = [*(name for name in used if name in names), *direct.squareness]
    left = [name for name in used if name not in names]
    said = [f"Measured directly, and weighed in by their uncertainty: {', '.join(taken)}."]
    if left:
        said = said if taken else []
        said.append(
            f"{', '.join(left)} was measured directly, but at too few positions to determine"
            " every node: this method did not use it; rigid_body does."
        )
    outside = [
        f"{name} at {len(curve.positions) - len(used[name].positions)}"
        for name, curve in direct.curves.items()
        if len(curve.positions) > len(used[name].positions)
    ]
    if outside:
        said.append(f"Positions outside the measured box were left out: {', '.join(outside)}.")
    places = {name: curve.place for name, curve in used.items() if name not in ROTATIONS}
    places |= {name: angle.place for name, angle in direct.squareness.items()}
    untold = [name for name, place in places.items() if np.any(np.isnan(place.standing))]
    if untold:
        said.append(
            f"The positions of the other axes are unknown for {', '.join(untold)}: taken as the"
            " first corner of the box."
        )
    return said
