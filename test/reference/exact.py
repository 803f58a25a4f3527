"""Linear algebra in 50 digits for the certified values: written out, so that nothing is shared.

Vectors are lists of mpmath numbers, matrices are lists of rows.
"""

from mpmath import mp, mpf

DIGITS = 50
mp.dps = DIGITS


def exactly(value):
    """Return a double as the number it is in binary, with no further rounding."""
    return mpf(float(value))


def dot(one, other):
    return mp.fsum(a * b for a, b in zip(one, other, strict=True))


def cross(a, b):
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def unit(vector):
    length = mp.sqrt(dot(vector, vector))
    return [value / length for value in vector]


def solve(matrix, right):
    """Solve a square system by Gaussian elimination with the largest pivot."""
    size = len(matrix)
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for column in range(size):
        best = max(range(column, size), key=lambda row: abs(rows[row][column]))
        if abs(rows[best][column]) < mpf(10) ** (-DIGITS // 2):
            raise ValueError(f"the system is singular in unknown {column}")
        rows[column], rows[best] = rows[best], rows[column]
        pivot = rows[column]
        for row in rows[column + 1 :]:
            factor = row[column] / pivot[column]
            if factor:
                for place in range(column, size + 1):
                    row[place] -= factor * pivot[place]
    found = [mpf(0)] * size
    for column in reversed(range(size)):
        known = mp.fsum(rows[column][place] * found[place] for place in range(column + 1, size))
        found[column] = (rows[column][size] - known) / rows[column][column]
    return found


def cholesky(matrix):
    """Return the lower factor of a symmetric positive definite matrix."""
    size = len(matrix)
    lower = [[mpf(0)] * size for _ in range(size)]
    for row in range(size):
        for column in range(row + 1):
            left = matrix[row][column] - mp.fsum(
                lower[row][k] * lower[column][k] for k in range(column) if lower[column][k]
            )
            if row == column:
                if left <= 0:
                    raise ValueError(f"unknown {row} is not determined by the data")
                lower[row][row] = mp.sqrt(left)
            else:
                lower[row][column] = left / lower[column][column]
    return lower


def solve_factored(lower, right):
    """Solve L Lᵀ x = right."""
    size = len(lower)
    forward = []
    for row in range(size):
        known = mp.fsum(lower[row][k] * forward[k] for k in range(row) if lower[row][k])
        forward.append((right[row] - known) / lower[row][row])
    found = [mpf(0)] * size
    for row in reversed(range(size)):
        known = mp.fsum(lower[k][row] * found[k] for k in range(row + 1, size) if lower[k][row])
        found[row] = (forward[row] - known) / lower[row][row]
    return found


def variance(lower, functional):
    """Return fᵀ (L Lᵀ)⁻¹ f of a linear functional f: the squared length of L⁻¹ f."""
    forward = []
    for row in range(len(lower)):
        known = mp.fsum(lower[row][k] * forward[k] for k in range(row) if lower[row][k])
        forward.append((functional[row] - known) / lower[row][row])
    return dot(forward, forward)


def line_through(nodes, values):
    """Return slope and intercept of the least-squares line."""
    count = len(nodes)
    middle, mean = mp.fsum(nodes) / count, mp.fsum(values) / count
    way = [node - middle for node in nodes]
    slope = dot(way, [value - mean for value in values]) / dot(way, way)
    return slope, mean - slope * middle


def digits(value, count=25):
    """Return a number as text, to so many significant digits."""
    return mp.nstr(value, count, min_fixed=0, max_fixed=0)
