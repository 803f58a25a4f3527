"""The posed problems: lines over a box, and readings by a rigid-body simulation in 50 digits.

What is posed is the doubles in the file, not what they were drawn from: the certified values solve
exactly these readings. Positions, directions and error curves are written down here again from the
documents, and nothing of the package is used.
"""

import random
from dataclasses import dataclass, field

from exact import cross, dot, exactly, unit
from mpmath import mp, mpf

SENSE = {"p": 1, "n": -1}
LETTERS = "XYZ"


@dataclass
class Pass:
    """One pass along a line; ``at`` holds the node of X, Y, Z at every stop (0 if it stands)."""

    name: str
    order: str
    repeat: int
    direction: str
    uncertainty: float | None
    at: list
    reading: list = field(default_factory=list)

    @property
    def setup(self):
        return f"{self.name} {self.order}".strip()

    @property
    def signs(self):
        if len(self.name) == 1:
            return [int(self.name == letter) for letter in "xyz"]
        return [SENSE[letter] for letter in self.name]


def stops(name, order, blocks, direction):
    """Return the nodes along a line: in each block the axes move one after the other."""
    signs = [1 if name == letter else 0 for letter in "xyz"]
    moves = [name.upper()]
    if len(name) == 3:
        signs, moves = [SENSE[letter] for letter in name], list(order)
    here = [blocks if sign < 0 else 0 for sign in signs]
    found = [tuple(here)]
    for _ in range(blocks):
        for letter in moves:
            axis = LETTERS.index(letter)
            here[axis] += signs[axis]
            found.append(tuple(here))
    return found if direction == "forward" else found[::-1]


def beam(name, step):
    signs = [int(name == letter) for letter in "xyz"]
    if len(name) == 3:
        signs = [SENSE[letter] for letter in name]
    return unit([sign * exactly(size) for sign, size in zip(signs, step, strict=True)])


def perpendiculars(n):
    """Return u1 in the XY plane (along +Y for a beam along Z) and u2 = n × u1."""
    flat = [-n[1], n[0], mpf(0)]
    first = unit(flat) if any(flat) else [mpf(0), mpf(1), mpf(0)]
    return first, cross(n, first)


def tilted(n, one, two):
    u1, u2 = perpendiculars(n)
    along = mp.sqrt(1 - one * one - two * two)
    return [along * a + one * b + two * c for a, b, c in zip(n, u1, u2, strict=True)]


def smooth_curves(rng, blocks, size):
    """Return nine curves from zero, in the frame of IH eq. (17), 1 µm times ``size``.

    Axis by axis and error by error: {"E_XX": [...], ...} as mpmath numbers.
    """
    curves = {}
    for axis in LETTERS:
        for error in LETTERS:
            slope, phase, wave = (rng.uniform(-1, 1) for _ in range(3))
            values = [
                size * (slope * k / blocks + 0.3 * wave * mp.sin(4 * k / mpf(blocks) + 3 * phase))
                for k in range(blocks + 1)
            ]
            curves[f"E_{error}{axis}"] = [value - values[0] for value in values]
    for name in ("E_YX", "E_ZX", "E_YZ"):
        end = curves[name][-1]
        curves[name] = [value - end * k / blocks for k, value in enumerate(curves[name])]
    return curves


@dataclass
class Problem:
    """A box, its lines and what is true of the machine that was measured.

    ``noise`` is that of lines whose uncertainty is not told; 0: no reading has any.
    """

    name: str
    description: str
    step: tuple
    blocks: int
    origin: tuple
    passes: list
    tilt: float
    size: float
    noise: float
    seed: int
    missing: tuple = ()

    def measure(self):
        """Simulate the readings: s = g·(q + Σ t_i(q_i)), beam and mirror turned together to g."""
        rng = random.Random(self.seed)
        curves = smooth_curves(rng, self.blocks, mpf(self.size))
        setups = {}
        zeros = {}
        for number, line in enumerate(self.passes):
            if line.setup not in setups:
                n = beam(line.name, self.step)
                # A linear line's tilt is of the second order and not in anybody's model.
                angles = [rng.gauss(0, self.tilt) * (len(line.name) == 3) for _ in range(2)]
                setups[line.setup] = tilted(n, mpf(angles[0]), mpf(angles[1]))
            g = setups[line.setup]
            for stop, nodes in enumerate(line.at):
                point = [exactly(a) * k for a, k in zip(self.step, nodes, strict=True)]
                for axis, sign in enumerate(line.signs):
                    if sign:
                        for error in range(3):
                            name = f"E_{LETTERS[error]}{LETTERS[axis]}"
                            point[error] += curves[name][nodes[axis]]
                value = dot(g, point)
                zero = zeros.setdefault(line.setup, value)
                spread = (line.uncertainty or self.noise) if self.noise else 0.0
                reading = float(value - zero + rng.gauss(0, spread))
                line.reading.append(None if (number, stop) in self.missing else reading)
        return self


def passes(lines, blocks, uncertainty=1e-7, repeats=1, directions=("forward",)):
    """Return passes along lines named ``x`` or ``ppp XYZ``; a dict gives each its uncertainty."""
    made = []
    for line in lines:
        name, _, order = line.partition(" ")
        own = uncertainty[line] if isinstance(uncertainty, dict) else uncertainty
        for repeat in range(repeats):
            for direction in directions:
                made.append(
                    Pass(
                        name,
                        order,
                        repeat,
                        direction,
                        own,
                        stops(name, order, blocks, direction),
                    )
                )
    return made
