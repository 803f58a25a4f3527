"""Certify single evaluations in 50 digits: ISO 230-2, squareness from diagonals, tracker position.

Run as ``python test/reference/certify_functions.py``; writes functions.json in test/data/reference.
Written from the definitions in ISO 230-2 and in the documents RL and ATLI, not from the package.
"""

import json
import random
from pathlib import Path

from exact import cholesky, digits, dot, solve, solve_factored
from mpmath import mp, mpf

TARGET = Path(__file__).parents[1] / "data" / "reference" / "functions.json"


def iso230_2(up, down):
    """Evaluate runs of deviations: up[run][target]."""
    up, down = ([[mpf(v) for v in run] for run in runs] for runs in (up, down))
    targets = range(len(up[0]))

    def mean(runs, i):
        return mp.fsum(run[i] for run in runs) / len(runs)

    def s(runs, i):
        middle = mean(runs, i)
        return mp.sqrt(mp.fsum((run[i] - middle) ** 2 for run in runs) / (len(runs) - 1))

    mu, md = [mean(up, i) for i in targets], [mean(down, i) for i in targets]
    su, sd = [s(up, i) for i in targets], [s(down, i) for i in targets]
    reversal = [a - b for a, b in zip(mu, md, strict=True)]
    both = [(a + b) / 2 for a, b in zip(mu, md, strict=True)]
    ru, rd = [4 * v for v in su], [4 * v for v in sd]
    rows = list(zip(su, sd, reversal, ru, rd, strict=True))
    wide = [max(2 * a + 2 * b + abs(c), d, e) for a, b, c, d, e in rows]
    high_up = [m + 2 * v for m, v in zip(mu, su, strict=True)]
    low_up = [m - 2 * v for m, v in zip(mu, su, strict=True)]
    high_down = [m + 2 * v for m, v in zip(md, sd, strict=True)]
    low_down = [m - 2 * v for m, v in zip(md, sd, strict=True)]
    return {
        "A": max(high_up + high_down) - min(low_up + low_down),
        "A↑": max(high_up) - min(low_up),
        "A↓": max(high_down) - min(low_down),
        "R": max(wide),
        "R↑": max(ru),
        "R↓": max(rd),
        "E": max(mu + md) - min(mu + md),
        "E↑": max(mu) - min(mu),
        "E↓": max(md) - min(md),
        "M": max(both) - min(both),
        "B": max(abs(v) for v in reversal),
        "mean B": mp.fsum(reversal) / len(reversal),
    }


def iso_cases(rng):
    for name, size, spread, offset, runs, targets in (
        ("usual", 1e-5, 5e-7, 0.0, 5, 8),
        ("two runs", 1e-5, 5e-7, 0.0, 2, 5),
        ("nanometres on a millimetre", 1e-8, 1e-9, 1e-3, 5, 11),
        ("many runs, no systematic part", 0.0, 1e-6, 0.0, 30, 6),
    ):
        systematic = [offset + size * rng.gauss(0, 1) for _ in range(targets)]
        up, down = (
            [[v + back + spread * rng.gauss(0, 1) for v in systematic] for _ in range(runs)]
            for back in (0.0, -3.0 * spread)
        )
        yield {
            "name": name,
            "size_m": max(size, spread),
            "largest_m": offset + 4.0 * size + 6.0 * spread,
            "forward_m": up,
            "backward_m": down,
            "certified": {key: digits(value) for key, value in iso230_2(up, down).items()},
        }


def squareness_case(rng, name, travel):
    """Four body diagonals and three linear tests by weighted least squares.

    A diagonal longer by D: D = m + Σ_{i<j} s_i s_j L_i L_j θ_ij / D0, θ positive where the angle is
    smaller than 90°; m is common to all four and, from the linear tests, Σ L_i Δ_i / D0.
    """
    a = [mpf(value) for value in travel]
    nominal = mp.sqrt(dot(a, a))
    signs = {"ppp": (1, 1, 1), "npp": (-1, 1, 1), "pnp": (1, -1, 1), "ppn": (1, 1, -1)}
    errors = {line: 2e-5 * rng.gauss(0, 1) for line in signs}
    spreads = {line: rng.choice([1e-7, 3e-7, 1e-6]) for line in signs}
    linear = {axis: (1e-5 * rng.gauss(0, 1), rng.choice([1e-7, 5e-7])) for axis in "XYZ"}
    pairs = {"C0Y": (0, 1), "B0Z": (0, 2), "A0Z": (1, 2)}
    rows, right, weight = [], [], []
    for line, s in signs.items():
        rows.append([mpf(1)] + [s[i] * s[j] * a[i] * a[j] / nominal for i, j in pairs.values()])
        right.append(mpf(errors[line]))
        weight.append(1 / mpf(spreads[line]) ** 2)
    rows.append([mpf(1), mpf(0), mpf(0), mpf(0)])
    right.append(dot([v / nominal for v in a], [mpf(linear[axis][0]) for axis in "XYZ"]))
    weight.append(
        1 / mp.fsum((v / nominal * mpf(linear[x][1])) ** 2 for v, x in zip(a, "XYZ", strict=True))
    )
    count = range(len(rows))
    normal = [
        [mp.fsum(weight[k] * rows[k][i] * rows[k][j] for k in count) for j in range(4)]
        for i in range(4)
    ]
    found = solve(
        normal, [mp.fsum(weight[k] * rows[k][i] * right[k] for k in count) for i in range(4)]
    )
    return {
        "name": name,
        "travel_m": travel,
        "error_m": errors,
        "standard_uncertainty_m": spreads,
        "linear": linear,
        "certified": {
            key: digits(value)
            for key, value in zip(("mean", *(f"theta {p}" for p in pairs)), found, strict=True)
        },
    }


def tracker_case(rng, name, count, extent, away, spread):
    """Minimise Σ (|p_i - t| - L0 - l_i)² by Gauss-Newton from the truth, down to 40 digits."""
    points = [[extent * rng.random() for _ in range(3)] for _ in range(count)]
    station = [extent / 2 + away * value for value in (0.8, 0.5, -0.33)]
    start = 0.7 * away
    changes = [
        float(mp.sqrt(mp.fsum((mpf(p) - mpf(t)) ** 2 for p, t in zip(point, station, strict=True))))
        - start
        + rng.gauss(0, spread)
        for point in points
    ]
    unknowns = [*(mpf(v) for v in station), mpf(start)]
    for _ in range(60):
        rows, left = [], []
        for point, change in zip(points, changes, strict=True):
            way = [mpf(p) - t for p, t in zip(point, unknowns[:3], strict=True)]
            length = mp.sqrt(dot(way, way))
            rows.append([-value / length for value in way] + [mpf(-1)])
            left.append(mpf(change) - (length - unknowns[3]))
        normal = [
            [dot([r[i] for r in rows], [r[j] for r in rows]) for j in range(4)] for i in range(4)
        ]
        step = solve_factored(cholesky(normal), [dot([r[i] for r in rows], left) for i in range(4)])
        unknowns = [old + new for old, new in zip(unknowns, step, strict=True)]
        if max(abs(value) for value in step) < mpf(10) ** -40:
            break
    else:
        raise ValueError(f"{name}: no convergence")
    dilution = mp.sqrt(
        mp.fsum(solve(normal, [mpf(int(i == j)) for i in range(4)])[j] for j in range(4))
    )
    return {
        "name": name,
        "points_m": points,
        "changes_m": changes,
        "spread_m": spread,
        "dilution": float(dilution),
        "certified": [digits(value) for value in unknowns],
    }


def main():
    rng = random.Random(2018)
    made = {
        "digits_carried": mp.dps,
        "iso230_2": list(iso_cases(rng)),
        "squareness": [
            squareness_case(rng, "cube", [1.0, 1.0, 1.0]),
            squareness_case(rng, "unequal", [2.0, 0.5, 0.3]),
            squareness_case(rng, "badly scaled", [10.0, 0.2, 0.05]),
        ],
        "tracker": [
            tracker_case(rng, "usual", 12, 1.0, 1.5, 1e-6),
            tracker_case(rng, "six points", 6, 0.5, 0.8, 1e-6),
            tracker_case(rng, "far away", 40, 0.5, 5.0, 1e-7),
            tracker_case(rng, "large machine", 30, 8.0, 10.0, 5e-6),
        ],
    }
    TARGET.write_text(json.dumps(made, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
