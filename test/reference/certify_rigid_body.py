"""Certify the determined values of a rigid-body adjustment, in 50 digits.

Run as ``python test/reference/certify_rigid_body.py``; writes ``rigid_body_*.json``. Model, to the
first order of the rotations: s = g·(w + Σ t_i(q_i) + Σ (w - A_i) × ε_i(q_i)) + c with w the way
from the line's first stop and A_i the part of the position that the axes after i in the chain make
up (``forward``: (ε × n)·(q - L - L0), the reference being the first corner of the box).

Not all of it is determined. Two solutions hold different unknowns at zero; a value that is the same
in both, to five digits of the errors' size, is certified. (Beyond the first order, what is held
times the setup angles is left, which noise makes some 1e-8 rad.)
"""

import json
import random
from pathlib import Path

from exact import cholesky, cross, digits, dot, exactly, solve_factored
from mpmath import mp, mpf
from posed import LETTERS, SENSE, beam, perpendiculars, stops

TARGET = Path(__file__).parents[1] / "data" / "reference"
STEP, BLOCKS, NOISE, SIZE = (0.04, 0.03, 0.05), 2, 1e-9, 1e-6
EDGES = {
    "x": ((0, 0, 0), (0, 1, 0), (0, 0, 1), (0, 1, 1)),
    "y": ((0, 0, 0), (1, 0, 0), (0, 0, 1), (1, 0, 1)),
    "z": ((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)),
}
FIXED_ENDS = ("E_YX", "E_ZX", "E_YZ")


def lines():
    made = []
    for name, corners in EDGES.items():
        for corner in corners:
            nodes = [
                tuple(a + b * BLOCKS for a, b in zip(at, corner, strict=True))
                for at in stops(name, "", BLOCKS, "forward")
            ]
            made.append((name, "", corner, nodes, f"{name} {corner}"))
    for name in ("ppp", "npp", "pnp", "ppn"):
        for order in ("XYZ", "YZX", "ZXY"):
            made.append((name, order, (0, 0, 0), stops(name, order, BLOCKS, "forward"), name))
    return made


def entries(chain, column, line, unknowns):
    """Return for each stop: derivatives by column, and the model's value."""
    name, order, corner, nodes, setup = line
    zero = column["zero", name, order, str(corner)]
    step = [exactly(v) for v in STEP]
    n = beam(name, STEP)
    u1, u2 = perpendiculars(n)
    one, two = (unknowns[column["tilt", setup, w]] if order else mpf(0) for w in (1, 2))
    along = mp.sqrt(1 - one**2 - two**2)
    g = [along * n[i] + one * u1[i] + two * u2[i] for i in range(3)]
    moving = [axis for axis in range(3) if (order and name[axis] in SENSE) or (name == "xyz"[axis])]
    for node in nodes:
        u = [a * k for a, k in zip(step, node, strict=True)]
        w = [a * (k - first) for a, k, first in zip(step, node, nodes[0], strict=True)]
        point, row = list(w), {zero: mpf(1)}
        for axis in moving:
            later = chain[chain.index(LETTERS[axis]) + 1 :]
            lever = [u[i] if LETTERS[i] in later else mpf(0) for i in range(3)]
            arm = [a - b for a, b in zip(w, lever, strict=True)]
            for place in range(6):
                key = (f"E_{'XYZABC'[place]}{LETTERS[axis]}", node[axis])
                if key not in column:
                    continue
                unit = [mpf(int(i == place % 3)) for i in range(3)]
                motion = unit if place < 3 else cross(arm, unit)
                value = unknowns[column[key]]
                row[column[key]] = dot(g, motion)
                point = [p + value * m for p, m in zip(point, motion, strict=True)]
        if order:
            row[column["tilt", setup, 1]] = dot(
                [a - one / along * b for a, b in zip(u1, n, strict=True)], point
            )
            row[column["tilt", setup, 2]] = dot(
                [a - two / along * b for a, b in zip(u2, n, strict=True)], point
            )
        yield row, dot(g, point) + unknowns[zero]


def columns(measured):
    column = {}
    for axis in LETTERS:
        for error in "XYZABC":
            name = f"E_{error}{axis}"
            for node in range(1, BLOCKS + (name not in FIXED_ENDS)):
                column[name, node] = len(column)
    for name, order, corner, _, setup in measured:
        for key in [("zero", name, order, str(corner))] + [
            ("tilt", setup, w) for w in (1, 2) if order
        ]:
            column.setdefault(key, len(column))
    return column


def normal_equations(chain, measured, readings, column, unknowns):
    size = len(column)
    normal = [[mpf(0)] * size for _ in range(size)]
    gradient = [mpf(0)] * size
    for line, values in zip(measured, readings, strict=True):
        modelled = entries(chain, column, line, unknowns)
        for (row, model), value in zip(modelled, values, strict=True):
            for i, a in row.items():
                gradient[i] += a * (mpf(value) - model)
                for j, b in row.items():
                    normal[i][j] += a * b
    return normal, gradient


def independent(normal, order):
    """Return the unknowns, taken in this order, that are no combination of those before."""
    kept, rows = [], []
    for place in order:
        row = []
        for k, other in enumerate(kept):
            row.append((normal[place][other] - dot(row, rows[k][:k])) / rows[k][k])
        left = normal[place][place] - dot(row, row)
        if left > mpf(10) ** -25 * normal[place][place]:
            kept.append(place)
            rows.append([*row, mp.sqrt(left)])
    return kept


def adjust(chain, measured, readings, column, order):
    """Minimise with those unknowns held at zero that depend on the ones before in the order."""
    unknowns = [mpf(0)] * len(column)
    kept = independent(normal_equations(chain, measured, readings, column, unknowns)[0], order)
    for _ in range(40):
        normal, gradient = normal_equations(chain, measured, readings, column, unknowns)
        part = [[normal[i][j] for j in kept] for i in kept]
        change = solve_factored(cholesky(part), [gradient[i] for i in kept])
        for place, value in zip(kept, change, strict=True):
            unknowns[place] += value
        if max(abs(v) for v in change) < mpf(10) ** -30:
            return unknowns
    raise ValueError(f"{chain}: no convergence")


def problem(chain, seed):
    rng = random.Random(seed)
    measured = lines()
    column = columns(measured)
    truth = [mpf(0)] * len(column)
    for key, place in column.items():
        truth[place] = mpf(SIZE * rng.uniform(-1, 1)) if key[0].startswith("E_") else mpf(0)
    readings = [
        [float(v) + rng.gauss(0, NOISE) for _, v in entries(chain, column, line, truth)]
        for line in measured
    ]
    places = list(range(len(column)))
    one = adjust(chain, measured, readings, column, places)
    other = adjust(chain, measured, readings, column, places[::-1])
    certified = {}
    for axis in LETTERS:
        for error in "XYZABC":
            name = f"E_{error}{axis}"
            values = []
            for node in range(BLOCKS + 1):
                place = column.get((name, node))
                if place is None:
                    values.append("0.0")
                elif (
                    one[place] and abs(one[place] - other[place]) < SIZE * mpf(10) ** -5
                ):  # held at zero by both it would agree, too
                    values.append(digits((one[place] + other[place]) / 2))
                else:
                    values.append(None)
            certified[name] = values
    return {
        "chain": chain,
        "step_m": STEP,
        "blocks": BLOCKS,
        "noise_m": NOISE,
        "size": SIZE,
        "lines": [
            {"name": n, "order": o, "corner": c, "setup": s, "reading_m": r}
            for (n, o, c, _, s), r in zip(measured, readings, strict=True)
        ],
        "certified": certified,
    }


if __name__ == "__main__":
    for number, order in enumerate(("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")):
        path = TARGET / f"rigid_body_{order}.json"
        path.write_text(json.dumps(problem(order, number), indent=1) + "\n")
        print(path.name)
