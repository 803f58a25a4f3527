"""The weighted least-squares estimate over all readings, in 50 digits.

Each reading is one observation; nothing is averaged beforehand. Model: s = g·(q + Σ t_i(q_i)) + c
with one unit vector g for each diagonal setup (two angles along the perpendiculars of its nominal
beam), the nominal direction for a linear line, and one zero c for each pass. Curves are zero at
the first node; E_YX, E_ZX and E_YZ are zero at the last (IH eq. 17).
"""

from exact import cholesky, dot, solve_factored, variance
from mpmath import mp, mpf
from posed import LETTERS, beam, perpendiculars

FIXED_ENDS = ("E_YX", "E_ZX", "E_YZ")


class Adjustment:
    """The problem's observations, its unknowns and its minimum."""

    def __init__(self, problem, held=()):
        """Number the unknowns; those named in ``held`` (curve, node) are kept at zero."""
        self.problem = problem
        self.column = {}
        for axis in LETTERS:
            for error in LETTERS:
                name = f"E_{error}{axis}"
                last = problem.blocks if name in FIXED_ENDS else problem.blocks + 1
                for node in range(1, last):
                    if (name, node) not in held:
                        self.column[name, node] = len(self.column)
        self.nominal = {}
        for line in problem.passes:
            if any(value is not None for value in line.reading):
                self.column["zero", id(line)] = len(self.column)
            if line.setup in self.nominal:
                continue
            self.nominal[line.setup] = beam(line.name, problem.step)
            if len(line.name) == 3:
                for which in (1, 2):
                    self.column["tilt", line.setup, which] = len(self.column)
        self.entries = [
            (line, nodes, mpf(value))
            for line in problem.passes
            for nodes, value in zip(line.at, line.reading, strict=True)
            if value is not None
        ]
        self.known = all(line.uncertainty for line in problem.passes)
        self.weight = [
            1 / mpf(line.uncertainty) ** 2 if self.known else mpf(1) for line, _, _ in self.entries
        ]
        self.unknowns = [mpf(0)] * len(self.column)

    def angles(self, setup):
        if ("tilt", setup, 1) not in self.column:
            return mpf(0), mpf(0)
        return tuple(self.unknowns[self.column["tilt", setup, which]] for which in (1, 2))

    def rows(self):
        """Return derivatives (sparse, by column) and values of the model for each observation."""
        derivatives, values = [], []
        a = [mpf(value) for value in self.problem.step]
        directions = {}
        for setup, n in self.nominal.items():
            one, two = self.angles(setup)
            u1, u2 = perpendiculars(n)
            along = mp.sqrt(1 - one**2 - two**2)
            g = [along * n[i] + one * u1[i] + two * u2[i] for i in range(3)]
            by_one = [u1[i] - one / along * n[i] for i in range(3)]
            by_two = [u2[i] - two / along * n[i] for i in range(3)]
            directions[setup] = g, by_one, by_two
        for line, nodes, _ in self.entries:
            g, by_one, by_two = directions[line.setup]
            point = [size * node for size, node in zip(a, nodes, strict=True)]
            row = {self.column["zero", id(line)]: mpf(1)}
            for axis, sign in enumerate(line.signs):
                for error in range(3):
                    key = (f"E_{LETTERS[error]}{LETTERS[axis]}", nodes[axis])
                    if sign and key in self.column:
                        place = self.column[key]
                        row[place] = g[error]
                        point[error] += self.unknowns[place]
            if len(line.name) == 3:
                row[self.column["tilt", line.setup, 1]] = dot(by_one, point)
                row[self.column["tilt", line.setup, 2]] = dot(by_two, point)
            derivatives.append(row)
            values.append(dot(g, point) + self.unknowns[self.column["zero", id(line)]])
        return derivatives, values

    def factor(self, derivatives):
        size = len(self.column)
        normal = [[mpf(0)] * size for _ in range(size)]
        for row, weight in zip(derivatives, self.weight, strict=True):
            places = sorted(row)
            for i in places:
                for j in places:
                    if j <= i:
                        normal[i][j] += weight * row[i] * row[j]
        for i in range(size):
            for j in range(i):
                normal[j][i] = normal[i][j]
        return cholesky(normal)

    def minimise(self):
        """Iterate Gauss-Newton with the derivatives at the solution, down to 40 digits."""
        self.at_nominal = self.factor(self.rows()[0])
        lower = None
        for turn in range(40):
            derivatives, values = self.rows()
            if turn < 3:  # later the factor is as good as exact; the gradient is what counts
                lower = self.factor(derivatives)
            gradient = [mpf(0)] * len(self.column)
            for row, value, (_, _, reading), weight in zip(
                derivatives, values, self.entries, self.weight, strict=True
            ):
                for place, derivative in row.items():
                    gradient[place] += weight * derivative * (reading - value)
            change = solve_factored(lower, gradient)
            self.unknowns = [old + new for old, new in zip(self.unknowns, change, strict=True)]
            if max(abs(value) for value in change) < mpf(10) ** -40:
                break
        else:
            raise ValueError(f"{self.problem.name}: no convergence")
        _, values = self.rows()
        self.squares = mp.fsum(
            weight * (reading - value) ** 2
            for value, (_, _, reading), weight in zip(
                values, self.entries, self.weight, strict=True
            )
        )
        self.at_minimum = self.factor(self.rows()[0])
        return self

    def curve(self, name):
        return [
            self.unknowns[self.column[name, node]] if (name, node) in self.column else mpf(0)
            for node in range(self.problem.blocks + 1)
        ]

    def curve_uncertainty(self, name, lower):
        found = []
        for node in range(self.problem.blocks + 1):
            if (name, node) not in self.column:
                found.append(mpf(0))
                continue
            pick = [mpf(0)] * len(self.column)
            pick[self.column[name, node]] = mpf(1)
            found.append(mp.sqrt(variance(lower, pick)))
        return found
