"""Squareness of the axes from the lengths of face and body diagonals.

Let Δ_ij be the error along j that axis i gains over its travel L_i (E_ji at the end less at the
start). A diagonal with the signs s runs by s_i L_i, and its error of length is, to first order,
with D_0 = √ΣL²,

    D_s - D_0 = Σ_ij s_i s_j L_j Δ_ij / D_0
              = Σ_i L_i Δ_ii / D_0  +  Σ_i<j s_i s_j (L_i L_j / D_0) θ_ij,
    θ_ij = Δ_ij/L_i + Δ_ji/L_j

so that linear positioning errors lengthen all diagonals of a box alike, and θ_ij, the sum of the
two end-to-end slopes, is the cosine of the angle between axes i and j: positive where the angle
between the positive axes is *smaller* than 90°. Hence

* of a face, D_1 (pp) and D_2 (np): θ = D_0 (D_1 - D_2) / (2 X Y), as RL (ISO 230-1:2012,
  10.3.2.6) prints it; exact is (D_1² - D_2²)/(4XY), which differs by ppm of θ;
* of the four body diagonals: the signs (1; s_x s_y; s_x s_z; s_y s_z) of ppp, npp, pnp, ppn are the
  rows of an orthogonal matrix, so θ_ij = D_0/(4 L_i L_j) · Σ_s s_i s_j D_s, and their mean gives
  Σ L_i Δ_ii / D_0. Four lengths, four unknowns: nothing is left over to check. One check there is
  when the axes' positioning was measured too: that mean must be Σ L_i Δ_ii / D_0 of the linear
  tests. Then even three diagonals are enough. Both are one weighted least-squares problem here.

Rotations of the axes and shifts of the laser's scale change the lengths as well, also those of the
linear tests where their lines run off the edges of the corner at which rotations are zero; no
diagonal determines them, so they are in the uncertainties (``length_effects``).

All of this holds only if the diagonals are those of one box: they start and finish at identical
coordinates, and each end is read after a move in the same direction (RL, "Squareness analysis").

The slopes are end to end, not those of least-squares lines: with curved axes the two differ. Turned
by right-handed rotation (``forward.SQUARENESS_SLOPES``): C0Y = -θ_XY, B0Z = +θ_XZ, A0Z = -θ_YZ.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import isfinite, nan, sqrt
from typing import NamedTuple

import numpy as np

from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES
from stepdiag_ros.metrology.geometry import (
    AXES,
    BODY_DIAGONALS,
    FACE_DIAGONALS,
    LINEAR_LINES,
    Vector,
    beam_direction,
    line_signs,
)
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import FORWARD
from stepdiag_ros.metrology.plausible import ORDINARY, Plausible
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.standards.axis_test import is_diagonal
from stepdiag_ros.metrology.standards.length_effects import added_variances, remark

SAME_PLACE = 1e-6
"""Ends of diagonals that are further apart than this, m, are not the same corner."""

PAIRS = {"C0Y": (0, 1), "B0Z": (0, 2), "A0Z": (1, 2)}
"""Squareness → the two axes (0, 1, 2)."""
_NOT_THE_SAME = (
    "diagonals must start and finish at identical coordinates, or other errors of the machine"
    " count as squareness"
)


@dataclass(frozen=True)
class DiagonalLength:
    """A measured diagonal.

    Attributes:
        line: its name, such as pp0 or npp.
        start: machine coordinates of its start, m.
        finish: of its end, m.
        error: D - D_0, measured less nominal length, m.
        standard_uncertainty: of the error, m; NaN if not known.
        same_approach: both ends were read after a move in the same direction; None if not known.
    """

    line: str
    start: tuple[float, float, float]
    finish: tuple[float, float, float]
    error: float
    standard_uncertainty: float = nan
    same_approach: bool | None = None

    @property
    def travel(self) -> Vector:
        """Return the signed travel of the axes, m, shape (3,)."""
        return np.subtract(self.finish, self.start)

    @property
    def ends(self) -> tuple[Vector, Vector]:
        """Return start and finish, m."""
        return np.asarray(self.start), np.asarray(self.finish)

    @property
    def nominal(self) -> float:
        """Return D_0, m."""
        return float(np.linalg.norm(self.travel))


class LinearLine(NamedTuple):
    """Where the linear test of an axis ran in one setup.

    Attributes:
        start: machine coordinates of its start, m, shape (3,).
        finish: of its end, m, shape (3,).
        share: of this setup in the mean over all passes, 0 to 1.
    """

    start: Vector
    finish: Vector
    share: float = 1.0


class LinearError(NamedTuple):
    """The positioning error of an axis over the travel, by its linear tests.

    Attributes:
        error: mean over all passes, m.
        standard_uncertainty: of the error, m; NaN if not known.
        lines: one for each setup; empty if their places are not known.
    """

    error: float
    standard_uncertainty: float
    lines: tuple[LinearLine, ...] = ()


@dataclass(frozen=True)
class DiagonalSquareness:
    """One squareness from diagonals.

    Attributes:
        name: C0Y, B0Z or A0Z.
        theta: as RL has it: positive where the angle is smaller than 90°, rad.
        standard_uncertainty: of theta and value, rad; NaN if not known.
        diagonals: that it was made from.
    """

    name: str
    theta: float
    standard_uncertainty: float
    diagonals: tuple[str, ...]

    @property
    def value(self) -> float:
        """Return the squareness by right-handed rotation (ISO 230-1), rad."""
        return SQUARENESS_SLOPES[self.name][0] * self.theta


@dataclass(frozen=True)
class SquarenessResult:
    """What the diagonals say of squareness.

    Attributes:
        values: one for each pair of axes and source.
        mean_length_error: of the body diagonals, Σ L_i Δ_ii / D_0, m; NaN without them.
        mean_length_uncertainty: its standard uncertainty, m.
        closure: body diagonals' mean length error less that of the linear tests, m: the one
            redundancy check; NaN if nothing is left over.
        closure_uncertainty: its standard uncertainty, m; NaN if not known.
        remarks: what the reader must know, in words.
    """

    values: tuple[DiagonalSquareness, ...]
    mean_length_error: float = nan
    mean_length_uncertainty: float = nan
    closure: float = nan
    closure_uncertainty: float = nan
    remarks: tuple[str, ...] = ()


def lengths_of(measurement: Measurement) -> tuple[DiagonalLength, ...]:
    """Return the lengths of the diagonals in a measurement, one for each setup.

    The error is the mean over the passes; its standard uncertainty that of the readings at the two
    ends, or, if larger, that of the mean of the passes.
    """
    groups: dict[tuple[str, str, str], list[MeasuredLine]] = {}
    for line in measurement.lines:
        if is_diagonal(line.line.kind):
            groups.setdefault((line.setup, line.line.name, line.line.order), []).append(line)
    made = []
    for lines in groups.values():
        direction = beam_direction(lines[0].line.name, np.asarray(measurement.volume.step))
        errors, variances = [], []
        for line in lines:
            order = (0, -1) if line.line.direction == FORWARD else (-1, 0)
            start, finish = (line.displacement[place] for place in order)
            nominal = float((line.target[order[1]] - line.target[order[0]]) @ direction)
            ends = line.standard_uncertainty[list(order)]
            if isfinite(start) and isfinite(finish):
                errors.append(float(finish - start - nominal))
                variances.append(float(np.sum(ends**2)))
        if not errors:
            continue
        forward = lines[0].line.direction == FORWARD
        first, last = (lines[0].target[place] for place in ((0, -1) if forward else (-1, 0)))
        made.append(
            DiagonalLength(
                line=lines[0].line.name,
                start=(float(first[0]), float(first[1]), float(first[2])),
                finish=(float(last[0]), float(last[1]), float(last[2])),
                error=float(np.mean(errors)),
                standard_uncertainty=_uncertainty_of_mean(errors, variances),
                same_approach=True if all(line.overrun > 0.0 for line in lines) else None,
            )
        )
    return tuple(made)


def _uncertainty_of_mean(errors: Sequence[float], variances: Sequence[float]) -> float:
    readings = sqrt(sum(variances)) / len(errors)
    if len(errors) < 2:
        return readings
    passes = float(np.std(errors, ddof=1)) / sqrt(len(errors))
    return passes if not isfinite(readings) else max(readings, passes)


def linear_errors_of(measurement: Measurement) -> dict[str, LinearError]:
    """Return E_XX, E_YY, E_ZZ over the travel from the linear lines, by axis."""
    found = {}
    for axis, name in zip(AXES, LINEAR_LINES, strict=True):
        errors, variances = [], []
        passes: dict[str, list[MeasuredLine]] = {}
        for line in measurement.lines:
            if line.line.name == name and line.complete:
                passes.setdefault(line.setup, []).append(line)
                way = line.target[-1] - line.target[0]
                nominal = float(way[AXES.index(axis)])
                sense = np.sign(nominal)
                errors.append(float(sense * (line.displacement[-1] - line.displacement[0])))
                errors[-1] -= abs(nominal)
                variances.append(float(np.sum(line.standard_uncertainty[[0, -1]] ** 2)))
        if errors:
            found[axis] = LinearError(
                float(np.mean(errors)),
                _uncertainty_of_mean(errors, variances),
                tuple(
                    LinearLine(lines[0].target[0], lines[0].target[-1], len(lines) / len(errors))
                    for lines in passes.values()
                ),
            )
    return found


def check_ends(diagonals: Sequence[DiagonalLength]) -> tuple[str, ...]:
    """Check that diagonals are those of one box, each read after the same approach at both ends.

    Args:
        diagonals: of one face, or body diagonals.

    Returns:
        Warnings in words: an approach that is not known.

    Raises:
        ValueError: names and signs disagree, the ends are not at identical coordinates, or the ends
            of a diagonal were approached in different directions.
    """
    warnings = []
    low = np.minimum(diagonals[0].start, diagonals[0].finish)
    high = np.maximum(diagonals[0].start, diagonals[0].finish)
    for one in diagonals:
        signs = line_signs(one.line)
        if not np.array_equal(np.sign(np.round(one.travel, 9)), signs):
            raise Refusal(
                f"diagonal {one.line}: its axes do not run as its name says from"
                f" {_place(one.start)} to {_place(one.finish)}",
                fault="mismatch",
                aspect="name",
            )
        corner = np.where(signs < 0, high, low), np.where(signs < 0, low, high)
        for name, end, wanted in zip(
            ("starts", "finishes"), (one.start, one.finish), corner, strict=True
        ):
            if np.max(np.abs(np.subtract(end, wanted))) > SAME_PLACE:
                raise Refusal(
                    f"diagonal {one.line} {name} at {_place(end)}, but {diagonals[0].line} needs"
                    f" it at {_place(wanted)}: {_NOT_THE_SAME}",
                    fault="mismatch",
                    aspect="ends",
                )
        if one.same_approach is False:
            raise Refusal(
                f"diagonal {one.line}: its ends were approached in different directions, so the"
                " reversal error is in its length; move in the same direction before each reading",
                fault="mismatch",
                aspect="approach",
            )
        if one.same_approach is None:
            warnings.append(
                f"diagonal {one.line}: it is not known that both ends were approached in the same"
                " direction, so the reversal error may be in its length. A step diagonal always"
                " begins at its end; a line of kind diagonal begins beyond it by overrun_m"
            )
    return tuple(warnings)


def _place(point: Sequence[float] | Vector) -> str:
    return "(" + ", ".join(f"{1e3 * value:.3f}" for value in point) + ") mm"


def from_face(
    first: DiagonalLength,
    second: DiagonalLength,
    chain: str = "",
    plausible: Plausible = ORDINARY,
) -> DiagonalSquareness:
    """Return the squareness of a face's axes, θ = D_0 (D_1 - D_2)/(2 X Y) (RL); see the module.

    Args:
        first: the diagonal whose axes both run forward (pp0, p0p, 0pp).
        second: the other one (np0, n0p, 0np).
        chain: order of the axes from workpiece to tool; empty if not known.
        plausible: what may act although no length shows it.

    Raises:
        ValueError: they are not the two diagonals of one face, or ``check_ends`` refuses.
    """
    moved = [axis for axis, sign in enumerate(line_signs(first.line)) if sign]
    if len(moved) != 2 or second.line != first.line.replace("p", "n", 1) or "n" in first.line:
        raise Refusal(
            f"{first.line} and {second.line} are not the two diagonals of a face",
            fault="mismatch",
            aspect="face",
        )
    check_ends((first, second))
    name = next(name for name, pair in PAIRS.items() if pair == tuple(moved))
    one, other = np.abs(first.travel)[moved]
    factor = first.nominal / (2.0 * one * other)
    variance = first.standard_uncertainty**2 + second.standard_uncertainty**2
    both = (first, second)
    ends, lengths = [one.ends for one in both], np.array([one.nominal for one in both])
    others = added_variances(np.array([[1.0, -1.0]]), ends, lengths, chain, plausible)
    return DiagonalSquareness(
        name=name,
        theta=float(factor * (first.error - second.error)),
        standard_uncertainty=float(factor * sqrt(variance + float(others[0]))),
        diagonals=(first.line, second.line),
    )


def from_body(
    diagonals: Sequence[DiagonalLength],
    linear: Mapping[str, LinearError] | None = None,
    chain: str = "",
    plausible: Plausible = ORDINARY,
) -> SquarenessResult:
    """Return the three squareness errors from body diagonals; see the module.

    Args:
        diagonals: the four body diagonals, or three with the linear tests of all axes.
        linear: axis X, Y, Z → its positioning error over the travel. A linear test whose place is
            not known counts as one along the edge of the box where rotations do most.
        chain: order of the axes from workpiece to tool; empty if not known.
        plausible: what may act although no length shows it.

    Raises:
        ValueError: too few diagonals, one of them twice, or ``check_ends`` refuses.
    """
    names = [one.line for one in diagonals]
    if len(set(names)) < len(names) or not set(names) <= set(BODY_DIAGONALS):
        raise ValueError(f"expected different body diagonals, found {', '.join(names)}")
    linear = linear or {}
    with_linear = all(axis in linear for axis in AXES)
    if len(names) < (3 if with_linear else 4):
        raise Refusal(
            f"{len(names)} body diagonals: squareness needs all four, or three and the linear tests"
            " of X, Y and Z",
            fault="too_few",
            aspect="body diagonals",
        )
    warnings = check_ends(diagonals)
    travel, nominal = np.abs(diagonals[0].travel), diagonals[0].nominal
    rows = []
    for one in diagonals:
        signs = line_signs(one.line)
        rows.append(
            [1.0]
            + [signs[i] * signs[j] * travel[i] * travel[j] / nominal for i, j in PAIRS.values()]
        )
    values = [one.error for one in diagonals]
    spreads = [one.standard_uncertainty for one in diagonals]
    if with_linear:
        shares = travel / nominal
        rows.append([1.0, 0.0, 0.0, 0.0])
        values.append(float(sum(shares[k] * linear[a].error for k, a in enumerate(AXES))))
        squares = sum((shares[k] * linear[a].standard_uncertainty) ** 2 for k, a in enumerate(AXES))
        spreads.append(sqrt(float(squares)))
    places = list(_places_of_linear(diagonals, linear if with_linear else {}))

    def others(weights: Vector) -> Vector:
        worst: Vector = np.max(
            [_others(weights, diagonals, lines, chain, plausible) for lines in places], axis=0
        )
        return worst

    solution = _solution(np.array(rows), np.array(spreads))
    estimate = solution @ values
    deviations = np.sqrt(solution**2 @ np.square(spreads) + others(solution))
    closure = closure_uncertainty = nan
    if with_linear and len(names) == 4:
        check = np.array([[0.25, 0.25, 0.25, 0.25, -1.0]])
        closure = float(check[0] @ values)
        variance = check**2 @ np.square(spreads) + others(check)
        closure_uncertainty = sqrt(float(variance[0]))
    return SquarenessResult(
        values=tuple(
            DiagonalSquareness(name, float(estimate[k + 1]), float(deviations[k + 1]), tuple(names))
            for k, name in enumerate(PAIRS)
        ),
        mean_length_error=float(estimate[0]),
        mean_length_uncertainty=float(deviations[0]),
        closure=closure,
        closure_uncertainty=closure_uncertainty,
        remarks=warnings,
    )


def _places_of_linear(
    diagonals: Sequence[DiagonalLength], linear: Mapping[str, LinearError]
) -> Iterator[tuple[LinearLine, ...]]:
    """Yield the lines of all linear tests: once, or for every edge of the box if not known."""
    travel = np.abs(diagonals[0].travel)
    low = np.minimum(diagonals[0].start, diagonals[0].finish)
    of_axes: list[Sequence[tuple[LinearLine, ...]]] = []
    for number, axis in enumerate(AXES if linear else ()):
        way = np.where(np.arange(3) == number, travel, 0.0)
        corners = [low + travel * at for at in product((0.0, 1.0), repeat=3) if not at[number]]
        edges = [(LinearLine(corner, corner + way),) for corner in corners]
        of_axes.append([linear[axis].lines] if linear[axis].lines else edges)
    for chosen in product(*of_axes):
        yield tuple(line for lines in chosen for line in lines)


def _others(
    weights: Vector,
    diagonals: Sequence[DiagonalLength],
    lines: Sequence[LinearLine],
    chain: str,
    plausible: Plausible,
) -> Vector:
    """Return what rotations and air add to the variances of sums of lengths, shape (q,).

    A rotation of axis i moves the line at the offset o by ε_i × L_i(o): nothing along the edges
    through the corner where the rotation is zero, and most at the opposite edge.

    Args:
        weights: of each diagonal, and of all linear tests together if there are any, shape (q, d).
        diagonals: whose lengths are summed.
        lines: the linear tests; each counts in their sum Σ L_i Δ_ii / D_0 by L_i / D_0.
        chain: order of the axes from workpiece to tool; empty if not known.
        plausible: what may act.
    """
    of_diagonals, of_linear = np.split(weights, [len(diagonals)], axis=1)
    ends = [*(one.ends for one in diagonals), *((one.start, one.finish) for one in lines)]
    lengths = np.array([np.linalg.norm(finish - start) for start, finish in ends])
    shares = np.array([one.share for one in lines]) * lengths[len(diagonals) :] / lengths[0]
    each = np.hstack([of_diagonals, np.sum(of_linear, axis=1, keepdims=True) * shares])
    return added_variances(each, ends, lengths, chain, plausible)


def _solution(design: Vector, spreads: Vector) -> Vector:
    """Return the matrix of weighted least squares from lengths to unknowns."""
    known = bool(np.all(np.isfinite(spreads)) and np.all(spreads > 0))
    weights = 1.0 / spreads if known else np.ones(len(spreads))
    # Lengths and angles differ in size: columns are scaled before they are solved.
    scale = np.linalg.norm(design, axis=0)
    pseudo_inverse = np.linalg.pinv(weights[:, None] * design / scale) / scale[:, None]
    solution: Vector = pseudo_inverse * weights
    return solution


def squareness_of(measurement: Measurement) -> SquarenessResult:
    """Return the squareness of the axes from all diagonals of a measurement.

    Faces need both diagonals; body diagonals all four, or three with linear tests. Pairs that are
    not of one box are left out, and the reason is among the remarks.

    Raises:
        ValueError: nothing is determined; names what is missing.
    """
    lengths, linear = lengths_of(measurement), linear_errors_of(measurement)
    return squareness_from(lengths, linear, measurement.chain, measurement.plausible)


def squareness_from(
    lengths: Sequence[DiagonalLength],
    linear: Mapping[str, LinearError] | None = None,
    chain: str = "",
    plausible: Plausible = ORDINARY,
) -> SquarenessResult:
    """Return squareness from the lengths of diagonals; see ``squareness_of``.

    Args:
        lengths: of face and body diagonals in any order; of several of one name the first counts.
        linear: see ``from_body``.
        chain: order of the axes from workpiece to tool; empty if not known.
        plausible: what may act although no length shows it.

    Raises:
        ValueError: nothing is determined; names what is missing.
    """
    by_name: dict[str, DiagonalLength] = {}
    remarks: list[str] = []
    for one in lengths:
        if one.line in by_name:
            remarks.append(f"diagonal {one.line} is there more than once; its first setup is used")
        by_name.setdefault(one.line, one)
    values: list[DiagonalSquareness] = []
    body = SquarenessResult(())
    for first, second in zip(FACE_DIAGONALS[::2], FACE_DIAGONALS[1::2], strict=True):
        if first in by_name and second in by_name:
            pair = (by_name[first], by_name[second])
            try:
                values.append(from_face(*pair, chain, plausible))
            except ValueError as error:
                remarks.append(f"left out: {error}")
            else:
                remarks.extend(check_ends(pair))
        elif first in by_name or second in by_name:
            there, other = (first, second) if first in by_name else (second, first)
            remarks.append(f"diagonal {there} alone says nothing of squareness; {other} is missing")
    bodies = [by_name[name] for name in BODY_DIAGONALS if name in by_name]
    if bodies:
        try:
            body = from_body(bodies, linear, chain, plausible)
        except ValueError as error:
            remarks.append(f"left out: {error}")
    values.extend(body.values)
    if not values:
        reasons = "; ".join(remarks) or "there is no face or body diagonal"
        raise Refusal(
            f"no squareness can be found from these diagonals: {reasons}",
            fault="too_few",
            aspect="diagonals",
        )
    return SquarenessResult(
        values=tuple(values),
        mean_length_error=body.mean_length_error,
        mean_length_uncertainty=body.mean_length_uncertainty,
        closure=body.closure,
        closure_uncertainty=body.closure_uncertainty,
        remarks=(*remarks, *body.remarks, remark(chain, plausible)),
    )


def squareness_error_of_shift(shift: float, aspect_ratio: Vector | float) -> Vector:
    """Return how far a shift of the laser's scale between the two diagonals falsifies squareness.

    One diagonal longer by the relative shift δ changes θ by D_0 · δ D_0 / (2XY) = δ (r + 1/r) / 2
    with r = X/Y: least for a square, where 1 ppm is 1 µrad (0.2"), and the same for r and 1/r (RL,
    graph "Squareness uncertainty versus measurement uncertainty and machine aspect ratio").

    Args:
        shift: relative change of the reading between the two diagonals, for example 1e-6.
        aspect_ratio: r = X/Y, > 0, any shape.

    Returns:
        in rad, the shape of ``aspect_ratio``.

    Raises:
        ValueError: a ratio that is not positive.
    """
    ratio = np.asarray(aspect_ratio, dtype=np.float64)
    if not np.all(ratio > 0):
        raise Refusal("an aspect ratio must be more than 0", fault="out_of_range")
    made: Vector = shift * 0.5 * (ratio + 1.0 / ratio)
    return made


SHIFTS_OF_RL = (1e-6, 5e-6)
"""Relative shifts of the laser's reading in the graph of RL."""
