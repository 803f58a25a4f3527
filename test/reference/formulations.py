"""The estimators of Ibaraki & Hata 2010, as the paper writes them, in 50 digits.

Every function takes the averaged displacements R[line][axis][k] of ``displacements`` (axis 0, 1, 2;
interval k from 0, counted along the axis, so that the paper's block N-k+1 of an axis that runs
backwards is its interval k) and returns increments Δe[error + axis][k], for example Δe["yx"].
"""

from exact import solve
from mpmath import mp, mpf
from posed import LETTERS, beam


def displacements(problem, excess=None):
    """Average the displacement of every single-axis move over passes, along the forward sense.

    Args:
        problem: with readings.
        excess: other values in place of the readings, one list a pass.
    """
    readings = excess or [
        [None if v is None else mpf(v) for v in p.reading] for p in problem.passes
    ]
    sums = {}
    for line, values in zip(problem.passes, readings, strict=True):
        table = sums.setdefault(line.name, [[[] for _ in range(problem.blocks)] for _ in range(3)])
        for before in range(len(values) - 1):
            here, there = line.at[before], line.at[before + 1]
            if values[before] is None or values[before + 1] is None:
                continue
            (axis,) = (i for i in range(3) if here[i] != there[i])
            along = (there[axis] - here[axis]) * line.signs[axis]
            difference = along * (values[before + 1] - values[before])
            table[axis][min(here[axis], there[axis])].append(difference)
    return {
        name: [[mp.fsum(c) / len(c) if c else None for c in axis] for axis in table]
        for name, table in sums.items()
    }


def conventional(problem, r):
    """Solve eq. (2), nine equations a block, with the nominal beams of eq. (3)."""
    a = [mpf(value) for value in problem.step]
    increments = {e + m: [] for m in "xyz" for e in "xyz"}
    for k in range(problem.blocks):
        matrix, right = [], []
        for line in ("ppp", "npp", "pnp"):
            direction = beam(line, problem.step)
            for axis in range(3):
                sense = -1 if line[axis] == "n" else 1
                row = [mpf(0)] * 9
                row[3 * axis : 3 * axis + 3] = [sense * value for value in direction]
                matrix.append(row)
                right.append(r[line][axis][k])
        found = solve(matrix, right)
        for axis, moving in enumerate("xyz"):
            for error, letter in enumerate("xyz"):
                nominal = a[axis] if axis == error else mpf(0)
                increments[letter + moving].append(found[3 * axis + error] - nominal)
    return increments, {}


def setup_robust(problem, r):
    """Evaluate eqs. (16), (18), (19), then (6)-(14); (19) in the order xz, xy, zy."""
    a = [mpf(value) for value in problem.step]
    norm = mp.sqrt(sum(value * value for value in a))
    blocks = range(problem.blocks)
    ppp, npp, pnp = r["ppp"], r["npp"], r["pnp"]
    x, y, z = 0, 1, 2
    exx = [r["x"][x][k] - a[x] for k in blocks]
    eyy = [r["y"][y][k] - a[y] for k in blocks]
    ezz = [r["z"][z][k] - a[z] for k in blocks]

    def mean(function):
        return mp.fsum(function(k) for k in blocks) / problem.blocks

    lam = {}
    lam["xx"] = mean(lambda k: -2 * a[x] / norm * (exx[k] + a[x]) + ppp[x][k] + npp[x][k])
    lam["yy"] = mean(lambda k: -2 * a[y] / norm * (eyy[k] + a[y]) + ppp[y][k] + pnp[y][k])
    lam["zz"] = mean(lambda k: -2 * a[z] / norm * (ezz[k] + a[z]) + npp[z][k] + pnp[z][k])
    lam["yx"] = mean(lambda k: ppp[x][k] - pnp[x][k])
    lam["zx"] = mean(lambda k: pnp[x][k] - npp[x][k])
    lam["yz"] = mean(lambda k: ppp[z][k] - pnp[z][k])
    lam["xz"] = -lam["zx"] - lam["xx"] - lam["yy"] - lam["zz"]
    lam["xy"] = -lam["yx"] - lam["zx"] - lam["xz"]
    lam["zy"] = -lam["yx"] - lam["yz"] - lam["xy"]
    gain = [norm / (2 * value) for value in a]
    increments = {
        "xx": exx,
        "yx": [gain[y] * (ppp[x][k] - pnp[x][k] - lam["yx"]) for k in blocks],
        "zx": [gain[z] * (pnp[x][k] - npp[x][k] - lam["zx"]) for k in blocks],
        "xy": [gain[x] * (ppp[y][k] - npp[y][k] - lam["xy"]) for k in blocks],
        "yy": eyy,
        "zy": [gain[z] * (npp[y][k] - pnp[y][k] - lam["zy"]) for k in blocks],
        "xz": [gain[x] * (ppp[z][k] - npp[z][k] - lam["xz"]) for k in blocks],
        "yz": [gain[y] * (ppp[z][k] - pnp[z][k] - lam["yz"]) for k in blocks],
        "zz": ezz,
    }
    return increments, {f"lambda {name}": value for name, value in lam.items()}


def alternative(problem, r):
    """Solve eq. (20) with the direction cosines it lacks in print, then remove the setup by (17).

    The first three rows are sums over a block, in which misalignment cancels (5); the last three
    hold δR of x in pnp, of y in ppp and of z in ppp, constants over the blocks. The solution is
    linear in these three; they are such that the means of Δe_y(x), Δe_z(x) and Δe_y(z) vanish.
    """
    a = [mpf(value) for value in problem.step]
    lines = {name: beam(name, problem.step) for name in ("ppp", "npp", "pnp")}
    linear = [[r[name][i][k] - a[i] for k in range(problem.blocks)] for i, name in enumerate("xyz")]
    # Unknowns y(x) z(x) x(y) z(y) x(z) y(z); which axis moves and which error each is:
    unknowns = [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)]

    def row(line, moving):
        sense = [-1 if letter == "n" else 1 for letter in line]
        return [
            sense[axis] * lines[line][error] if axis in moving else mpf(0)
            for axis, error in unknowns
        ]

    def right(line, moving, k):
        sense = [-1 if letter == "n" else 1 for letter in line]
        return mp.fsum(
            r[line][i][k] - sense[i] * lines[line][i] * (a[i] + linear[i][k]) for i in moving
        )

    rows = [(line, (0, 1, 2)) for line in lines] + [("pnp", (0,)), ("ppp", (1,)), ("ppp", (2,))]
    matrix = [row(*which) for which in rows]
    found = [solve(matrix, [right(*w, k) for w in rows]) for k in range(problem.blocks)]
    effects = [solve(matrix, [mpf(int(i == j)) for i in range(6)]) for j in (3, 4, 5)]
    fixed = (0, 1, 5)
    means = [mp.fsum(f[i] for f in found) / problem.blocks for i in fixed]
    setup = solve([[effect[i] for effect in effects] for i in fixed], means)
    increments = {"xyz"[i] * 2: linear[i] for i in range(3)}
    for place, (axis, error) in enumerate(unknowns):
        shift = mp.fsum(s * effect[place] for s, effect in zip(setup, effects, strict=True))
        increments["xyz"[error] + "xyz"[axis]] = [f[place] - shift for f in found]
    return increments, {}


def curves_of(increments):
    """Sum increments to curves from zero at the first node, under their ISO 230-1 names."""
    curves = {}
    for axis in LETTERS:
        for error in LETTERS:
            values = [mpf(0)]
            for step in increments[error.lower() + axis.lower()]:
                values.append(values[-1] + step)
            curves[f"E_{error}{axis}"] = values
    return curves


def uncertainties(problem, method):
    """Return the curves' standard uncertainties: a formulation is affine in every single reading.

    Each reading in turn is raised by one; what the curves change by is its weight.
    """
    flat = [[mpf(0) for _ in line.reading] for line in problem.passes]
    start = curves_of(method(problem, displacements(problem, flat))[0])
    squares = {name: [mpf(0)] * len(values) for name, values in start.items()}
    for number, line in enumerate(problem.passes):
        for stop in range(len(line.reading)):
            flat[number][stop] = mpf(1)
            moved = curves_of(method(problem, displacements(problem, flat))[0])
            flat[number][stop] = mpf(0)
            for name, values in moved.items():
                for node, value in enumerate(values):
                    weight = (value - start[name][node]) * mpf(line.uncertainty)
                    squares[name][node] += weight * weight
    return {name: [mp.sqrt(value) for value in values] for name, values in squares.items()}
