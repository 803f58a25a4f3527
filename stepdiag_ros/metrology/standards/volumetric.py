"""Volumetric accuracy: the longest error vector anywhere in the machine's volume.

After RL: "the length of the worst case error vector between the target and the actual machine
position anywhere within the machine volume". The error vector at q is the tool point less q; it is
zero at the corner of the first nodes, from where positions count, and it depends on the frame of
the error curves, which is therefore always named with it. Reversal and drift are not in it.

Between nodes the curves are straight, so the error vector is to first order linear in each
coordinate alone, and its length convex in each: the longest one is at a node, and a search over the
nodes misses nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import fsum, nan, sqrt

import numpy as np

from stepdiag_ros.metrology.forward import ErrorCurves, tool_point
from stepdiag_ros.metrology.geometry import (
    AXES,
    BODY_DIAGONALS,
    ROTATIONS,
    TRANSLATIONS,
    Vector,
    places_of,
)
from stepdiag_ros.metrology.plausible import ORDINARY, Plausible
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.uncertainty.longest_vector import spread_of_longest
from stepdiag_ros.metrology.volumetric_map import VolumetricMap

MOST_POINTS = 50_000
"""Nodes that are looked at in one go; more are done plane by plane, to bound the memory."""
_PLACES = 500
"""Nodes at which the limit of the uncertainty is looked for."""


@dataclass(frozen=True)
class VolumetricAccuracy:
    """The longest error vector and where it is.

    Attributes:
        value: its length, m; NaN if not determined.
        position: machine coordinates of the place, m.
        vector: the error vector there, m, X Y Z.
        standard_uncertainty: of the largest error, wherever it is, from the covariance of the error
            curves (``longest_vector``), m; NaN if not known.
        at_the_place: of the length of this vector alone, to first order, m; NaN if not known.
        frame: of the error curves, in words.
        remarks: what the reader must know, in words.
        rms: of the error vectors' lengths over all nodes of the volume, m; NaN if not determined.
        uncertainty_limit: what the uncertainty at any place and in any direction cannot exceed,
            however the errors of the curves are correlated, m; NaN if not known.
    """

    value: float
    position: tuple[float, float, float]
    vector: tuple[float, float, float]
    standard_uncertainty: float = nan
    frame: str = ""
    remarks: tuple[str, ...] = field(default=())
    rms: float = nan
    uncertainty_limit: float = nan
    at_the_place: float = nan

    def upper_bound(self, expanded_uncertainty: float) -> float:
        """Return what the error is below, with 95 %, at every place of the volume, m."""
        return self.value + expanded_uncertainty


def volumetric_accuracy(
    errors: ErrorCurves, chain: str = "XYZ", frame: str = ""
) -> VolumetricAccuracy:
    """Return the volumetric accuracy of a machine with known errors, over the box of their nodes.

    Args:
        errors: all error motions; rotations act through the chain, exactly (``forward``).
        chain: order of the axes from workpiece to tool; without rotations any gives the same.
        frame: of the curves, in words.

    Raises:
        ValueError: no such chain.
    """
    x, y, z = errors.nodes
    origin = np.array([[x[0], y[0], z[0]]])
    first, _ = tool_point(origin, errors, chain)
    zero = first[0] - origin[0]
    best = (-1.0, origin[0], np.zeros(3))
    squares: list[float] = []
    planes = max(1, MOST_POINTS // (len(x) * len(y)))
    for begin in range(0, len(z), planes):
        some = z[begin : begin + planes]
        points, vectors = _error_vectors((x, y, some), errors, chain)
        vectors -= zero
        lengths = np.einsum("ij,ij->i", vectors, vectors)
        # Summed plane by plane, so that the sum is the same however many are done in one go.
        squares.extend(float(np.sum(row)) for row in lengths.reshape(len(x) * len(y), -1).T.copy())
        place = int(np.argmax(lengths))
        if lengths[place] > best[0]:
            best = (float(lengths[place]), points[place], vectors[place])
    squared, position, vector = best
    return VolumetricAccuracy(
        value=float(np.sqrt(squared)),
        position=_triple(position),
        vector=_triple(vector),
        frame=frame,
        rms=sqrt(fsum(squares) / (len(x) * len(y) * len(z))),
    )


def _error_vectors(
    nodes: tuple[Vector, Vector, Vector], errors: ErrorCurves, chain: str
) -> tuple[Vector, Vector]:
    """Return all points of a grid and what the machine misses each of them by, m, shape (n, 3)."""
    points = places_of(nodes)
    if errors.turns:
        actual, _ = tool_point(points, errors, chain)
        return points, actual - points
    # Where no axis turns, the errors of the three axes add up.
    x, y, z = (errors.at(axis, own)[:, :3] for axis, own in enumerate(nodes))
    vectors: Vector = x[:, None, None] + y[:, None] + z
    return points, vectors.reshape(-1, 3)


def of_result(
    result: VolumetricErrors, chain: str = "", plausible: Plausible = ORDINARY
) -> VolumetricAccuracy:
    """Return the volumetric accuracy of a solved error map, with its uncertainty.

    The uncertainty is that of the largest error: with the covariance of the curves, with what
    rotations do that were not solved for (``volumetric_map``), and with the chance that the largest
    error is at another place or points another way (``longest_vector``). Where the
    covariance is not at hand (a recorded result), the standard uncertainties of the curves still
    give a limit: u(Σ w_i x_i) <= Σ |w_i| u(x_i).

    Args:
        result: curves that were not solved for (rotations) count as not known and are named.
        chain: order of the axes from workpiece to tool; needed where the result has rotations.
        plausible: size of rotations that the result does not determine.

    Raises:
        ValueError: the result has rotations and no chain is given.
    """
    rotations = [name for name in ROTATIONS if name in result.curves]
    remarks = []
    unknown = [name for name, values in result.curves.items() if not np.all(np.isfinite(values))]
    missing = [name for name in TRANSLATIONS if name not in result.curves]
    if unknown or missing:
        return VolumetricAccuracy(
            value=nan,
            position=(nan, nan, nan),
            vector=(nan, nan, nan),
            frame=result.frame,
            remarks=(
                "volumetric accuracy is unknown: not determined are"
                f" {', '.join((*missing, *unknown))}",
            ),
        )
    if not rotations:
        remarks.append(
            "angular errors were not solved for; they are not in it, but in its uncertainty"
        )
    elif not chain:
        raise Refusal(
            "the error map has angular errors: name the machine's chain, such as YXZ",
            fault="missing",
        )
    elif len(rotations) < len(ROTATIONS):
        absent = [name for name in ROTATIONS if name not in rotations]
        remarks.append(f"not in it, because not solved for: {', '.join(absent)}")
    # The curves are those of the mirror's point with the other axes at the first corner, so the
    # levers of rotations begin there.
    corner = np.array([nodes[0] for nodes in result.nodes])
    shifted = [nodes - nodes[0] for nodes in result.nodes]
    found = volumetric_accuracy(
        ErrorCurves.from_curves(shifted, result.curves), chain or "XYZ", result.frame
    )
    place = np.asarray(found.position) + corner
    error_map = VolumetricMap.of_result(result, chain, plausible)
    spread = spread_of_longest(error_map, found.value, place)
    limits = error_map.uncertainty_limit_at(np.vstack([error_map.some_nodes(_PLACES), place]))
    at_the_place = nan
    if found.value > 0:
        along = np.asarray(found.vector) / found.value
        variance = along @ error_map.covariance_at(place[None, :])[0] @ along
        at_the_place = float(np.sqrt(np.maximum(variance, 0.0)))
    return VolumetricAccuracy(
        value=found.value,
        position=_triple(place),
        vector=found.vector,
        standard_uncertainty=float(np.fmax(spread, at_the_place)),
        at_the_place=at_the_place,
        frame=result.frame,
        remarks=tuple(remarks),
        rms=found.rms,
        uncertainty_limit=float(np.max(np.linalg.norm(limits, axis=1))),
    )


def _triple(values: Vector) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


@dataclass(frozen=True)
class LinearMachine:
    """A machine whose only errors are proportional to its positions (RL, 2D and 3D examples).

    Attributes:
        name: in words.
        travel: of the axes, m.
        linear_error: of the axes, m/m.
    """

    name: str
    travel: tuple[float, float, float]
    linear_error: tuple[float, float, float]

    @property
    def errors(self) -> ErrorCurves:
        """Return the error motions over the travel."""
        curves = {
            f"E_{axis}{axis}": np.array([0.0, share * length])
            for axis, share, length in zip(AXES, self.linear_error, self.travel, strict=True)
        }
        nodes = [np.array([0.0, length]) for length in self.travel]
        return ErrorCurves.from_curves(nodes, curves)

    def length_errors(self, diagonals: Sequence[str] = BODY_DIAGONALS) -> dict[str, float]:
        """Return by how much each diagonal is longer than nominal, exactly, m.

        Args:
            diagonals: names of body or face diagonals.
        """
        made = {}
        for name in diagonals:
            runs = np.array([letter != "0" for letter in name])
            nominal = np.asarray(self.travel) * runs
            actual = nominal * (1.0 + np.asarray(self.linear_error))
            # Difference of two nearly equal roots without loss of digits.
            total = np.linalg.norm(actual) + np.linalg.norm(nominal)
            made[name] = float((actual - nominal) @ (actual + nominal) / total)
        return made

    @property
    def diagonal_result(self) -> float:
        """Return E_d of the body diagonals, m: the error grows evenly, so E is its end value."""
        return max(abs(error) for error in self.length_errors().values())


MACHINES_OF_RL = (
    LinearMachine("Machine A", (1.0, 1.0, 1.0), (50e-6, 50e-6, -100e-6)),
    LinearMachine("Machine B", (1.0, 1.0, 1.0), (50e-6, 0.0, 0.0)),
    LinearMachine("Machine C", (1.0, 1.0, 1.0), (100e-6, -50e-6, -25e-6)),
)
"""RL, "3D example": E_d 0, 29, 14 µm; volumetric accuracy 122, 50, 115 µm."""

PLANAR_MACHINE_OF_RL = LinearMachine("2D example", (1.0, 1.0, 1.0), (25e-6, -25e-6, 0.0))
"""RL, "Laser diagonal tests - 2D example"; its diagonals are pp0 and np0."""
