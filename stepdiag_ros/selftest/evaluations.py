"""Reference problems of single functions: air, evaluations by standards, tracker.

What is expected is computed here in a different way, or was published.
"""

from collections.abc import Callable
from fractions import Fraction
from math import sqrt

import numpy as np

from stepdiag_ros.metrology.air import ciddor_index, edlen_index
from stepdiag_ros.metrology.geometry import BODY_DIAGONALS, FACE_DIAGONALS, Vector, line_signs
from stepdiag_ros.metrology.plan import LINEAR
from stepdiag_ros.metrology.standards.axis_test import BidirectionalRuns
from stepdiag_ros.metrology.standards.diagonal_squareness import DiagonalLength, squareness_from
from stepdiag_ros.metrology.standards.iso230_2 import evaluate
from stepdiag_ros.metrology.tracker.location import locate
from stepdiag_ros.selftest.judging import chance_check
from stepdiag_ros.selftest.record import Check

_EPSILON = 2.0**-52
_PRINTED = 0.6e-9
"""Half of the last of nine printed decimals, and a tenth more for its own rounding."""

PUBLISHED_INDEX = (
    (20.0, 0.0, 101325.0, 633e-9, 1.000271799, 1.000271800),
    (20.0, 0.0, 60e3, 633e-9, 1.000160920, 1.000160924),
    (20.0, 0.0, 120e3, 633e-9, 1.000321918, 1.000321916),
    (50.0, 0.0, 100e3, 633e-9, 1.000243270, 1.000243285),
    (5.0, 0.0, 100e3, 633e-9, 1.000282750, 1.000282756),
    (50.0, 1.0, 120e3, 633e-9, 1.000287864, 1.000287924),
    (40.0, 0.75, 120e3, 633e-9, 1.000299406, 1.000299418),
    (20.0, 1.0, 100e3, 633e-9, 1.000267394, 1.000267394),
)
"""Stone & Zimmerman, "Index of refraction of air", NIST Engineering Metrology Toolbox, table 1.

degC, relative humidity, Pa, m in vacuum, n by modified Edlén, n by Ciddor.
"""

Evaluation = Callable[[np.random.Generator], tuple[str, list[Check]]]


def air(rng: np.random.Generator) -> tuple[str, list[Check]]:
    """Compare the refractive index of air with published values, by both equations."""
    del rng
    checks = []
    for place, name, function in ((4, "modified Edlén", edlen_index), (5, "Ciddor", ciddor_index)):
        deviation = max(
            abs(float(function(row[0], row[2], row[1], row[3])) - row[place])
            for row in PUBLISHED_INDEX
        )
        checks.append(
            Check(
                f"refractive index by {name}, {len(PUBLISHED_INDEX)} published values",
                deviation,
                _PRINTED,
                "1",
                "published with nine decimals",
            )
        )
    return "air from 5 to 50 degC, 60 to 120 kPa, dry and moist", checks


def iso230_2(rng: np.random.Generator) -> tuple[str, list[Check]]:
    """Evaluate random bidirectional runs; expected values in whole numbers and fractions."""
    runs, targets = int(rng.integers(2, 8)), int(rng.integers(5, 15))
    # Deviations in whole nanometres, so that means and squares are exact fractions.
    systematic = rng.integers(-20_000, 20_001, targets)
    reversal = int(rng.integers(-5_000, 5_001))
    up = systematic + rng.integers(-2_000, 2_001, (runs, targets))
    down = systematic + reversal + rng.integers(-2_000, 2_001, (runs, targets))
    length = float(rng.uniform(0.2, 3.0))
    found = evaluate(
        BidirectionalRuns(
            name="X",
            kind=LINEAR,
            target=np.linspace(0.0, length, targets),
            forward=1e-9 * up.astype(np.float64),
            backward=1e-9 * down.astype(np.float64),
        )
    ).parameters
    expected = _iso230_2_in_fractions(up.T.tolist(), down.T.tolist())
    largest = float(max(np.max(np.abs(up)), np.max(np.abs(down)))) * 1e-9
    # A variance loses the digits that the squares of the deviations share: half of them in s.
    limit = 64.0 * runs * _EPSILON * largest
    checks = [
        Check(
            f"ISO 230-2: {name}",
            abs(found[name] - value * 1e-9),
            limit,
            "m",
            "rounding of sums",
        )
        for name, value in expected.items()
    ]
    return f"{runs} runs up and down at {targets} targets over {length:.3g} m", checks


def _iso230_2_in_fractions(up: list[list[int]], down: list[list[int]]) -> dict[str, float]:
    """Return the parameters of ISO 230-2, nm, from the deviations of each target's runs, nm."""

    def mean(values: list[int]) -> Fraction:
        return Fraction(sum(values), len(values))

    def s(values: list[int]) -> float:
        squares = sum((value - mean(values)) ** 2 for value in values)
        return sqrt(squares / (len(values) - 1))

    places = range(len(up))
    means_up, means_down = [mean(v) for v in up], [mean(v) for v in down]
    both = [(a + b) / 2 for a, b in zip(means_up, means_down, strict=True)]
    s_up, s_down = [s(v) for v in up], [s(v) for v in down]
    reversal = [a - b for a, b in zip(means_up, means_down, strict=True)]

    def span(high: list[float], low: list[float]) -> float:
        return max(high) - min(low)

    high_up = [float(means_up[i]) + 2 * s_up[i] for i in places]
    low_up = [float(means_up[i]) - 2 * s_up[i] for i in places]
    high_down = [float(means_down[i]) + 2 * s_down[i] for i in places]
    low_down = [float(means_down[i]) - 2 * s_down[i] for i in places]
    wide = [
        max(2 * s_up[i] + 2 * s_down[i] + float(abs(reversal[i])), 4 * s_up[i], 4 * s_down[i])
        for i in places
    ]
    return {
        "A": span(high_up + high_down, low_up + low_down),
        "A↑": span(high_up, low_up),
        "A↓": span(high_down, low_down),
        "R": max(wide),
        "R↑": 4 * max(s_up),
        "R↓": 4 * max(s_down),
        "E": float(max(means_up + means_down) - min(means_up + means_down)),
        "E↑": float(max(means_up) - min(means_up)),
        "E↓": float(max(means_down) - min(means_down)),
        "M": float(max(both) - min(both)),
        "B": float(max(abs(b) for b in reversal)),
        "mean B": float(sum(reversal) / len(reversal)),
    }


def squareness(rng: np.random.Generator) -> tuple[str, list[Check]]:
    """Find squareness from the lengths of face and body diagonals of a skew box."""
    travel = rng.uniform(0.3, 1.5, 3)
    errors = 1e-6 * rng.standard_normal(3)
    c, b, a = (float(angle) for angle in 2e-6 * rng.standard_normal(3))
    # Right-handed: Y turned by +C leans to -X; Z turned by +B leans to +X, by +A to -Y.
    lines = np.array([[1.0, 0.0, 0.0], [-np.sin(c), np.cos(c), 0.0], [np.sin(b), -np.sin(a), 1.0]])
    edges = (travel + errors)[:, None] * lines / np.linalg.norm(lines, axis=1)[:, None]
    lengths = []
    for name in (*BODY_DIAGONALS, *FACE_DIAGONALS):
        signs = line_signs(name)
        length = float(np.linalg.norm(signs @ edges) - np.linalg.norm(signs * travel))
        start = np.where(signs < 0, travel, 0.0)
        lengths.append(
            DiagonalLength(
                line=name,
                start=_place(start),
                finish=_place(start + signs * travel),
                error=length,
                standard_uncertainty=1e-7,
            )
        )
    found = squareness_from(lengths).values
    expected = {"C0Y": c, "B0Z": b, "A0Z": a}
    # What is of second order: products of angles and relative errors, as seen by the shortest edge.
    small = max(abs(c), abs(b), abs(a), float(np.max(np.abs(errors) / travel)))
    limit = 16.0 * small**2 * float(np.max(travel) / np.min(travel)) ** 2
    checks = [
        Check(
            f"{one.name} from {', '.join(one.diagonals)}",
            abs(one.value - expected[one.name]),
            limit,
            "rad",
            "second order of angles and relative errors",
        )
        for one in found
    ]
    sides = " x ".join(f"{side:.3g}" for side in travel)
    return f"box of {sides} m, {len(found)} angles", checks


def _place(point: Vector) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point)
    return x, y, z


def tracker(rng: np.random.Generator) -> tuple[str, list[Check]]:
    """Find where a tracker stands from lengths to places, without noise and with it."""
    count = int(rng.integers(8, 20))
    points = rng.uniform(0.0, 1.0, (count, 3))
    station = np.array([0.5, 0.5, 0.5]) + rng.uniform(0.8, 1.5) * np.array(
        [1.0, 0.3, -0.2]
    ) * rng.choice([-1.0, 1.0], 3)
    ways = points - station
    distance = np.linalg.norm(ways, axis=1)
    start = float(rng.uniform(0.5, 2.0))
    spread = 1e-6
    rows = np.column_stack([ways / distance[:, None], np.ones(count)])
    dilution = float(np.sqrt(np.trace(np.linalg.inv(rows.T @ rows))))
    exact = locate(points, distance - start, spread)
    # Each length and place is rounded; an iteration ends where no double is nearer.
    limit = 1000.0 * _EPSILON * float(np.max(distance)) * dilution
    noisy = locate(points, distance - start + spread * rng.standard_normal(count), spread)
    away = noisy.position - station
    squares = float(away @ np.linalg.solve(noisy.covariance[:3, :3], away))
    return f"{count} places within 1 m, tracker {np.min(distance):.2g} m away", [
        Check(
            "tracker: position, exact lengths",
            float(np.max(np.abs(exact.position - station))),
            limit,
            "m",
            f"rounding, times the dilution {dilution:.2g} of the geometry",
        ),
        Check("tracker: length at zero", abs(exact.start_length - start), limit, "m", "the same"),
        chance_check("tracker: position and uncertainty", squares, 3),
    ]


EVALUATIONS: dict[str, Evaluation] = {
    "refractive index": air,
    "ISO 230-2": iso230_2,
    "squareness from diagonals": squareness,
    "tracker position": tracker,
}
"""Kind of problem → draws one and compares."""
