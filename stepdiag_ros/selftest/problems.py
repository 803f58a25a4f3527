"""Random reference problems of step-diagonal measurement: a machine, its setups, its readings."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from stepdiag_ros.metrology.geometry import (
    AXES,
    BODY_DIAGONALS,
    CHAINS,
    LINEAR_LINES,
    ROTATIONS,
    TRANSLATIONS,
    Vector,
)
from stepdiag_ros.metrology.units import MILLI
from stepdiag_ros.selftest.bodies import beam_length, mirror_pose

ALIGNED = "aligned"
TILTED = "tilted"
MISALIGNED = "misaligned"
NOISY = "noisy"
UNKNOWN_NOISE = "noise not told"
DIAGONALS = "diagonals alone"
ANGULAR = "angular errors"
KINDS: dict[str, str] = {
    ALIGNED: "no noise, beam and mirror exactly along the diagonals",
    TILTED: "no noise, beam and mirror of each diagonal turned together",
    MISALIGNED: "no noise, beams and mirrors of all lines turned each for itself",
    NOISY: "noise of a stated size, both directions, repeats",
    UNKNOWN_NOISE: "noise that the case file does not state, both directions, repeats",
    DIAGONALS: "noise, four diagonals without linear lines",
    ANGULAR: "no noise, all 21 errors, three move orders, linear lines at all edges",
}
"""Kind of problem → what it is, in the order in which they are drawn."""

_TILTS = {
    ALIGNED: 0.0,
    TILTED: 5e-4,
    MISALIGNED: 3e-5,
    NOISY: 1e-5,
    UNKNOWN_NOISE: 2e-4,
    DIAGONALS: 1e-6,
    ANGULAR: 1e-8,
}
"""Spread of the setups' angles, rad: large where the method has them exactly; where it neglects
their second order, so small that this is below the noise (10 nm) or well below the errors."""
_SIZES = (1e-9, 1e-8)
"""Translations (m) and rotations (rad) where both are there: so small that products vanish."""
_FRAMED = ("E_YX", "E_ZX", "E_YZ")


@dataclass(frozen=True)
class KnownPass:
    """One pass along a line.

    Attributes:
        name: x, y, z or a body diagonal.
        order: of a block's three moves; empty for a linear line.
        repeat: from 0.
        direction: ``forward`` or ``backward``.
        edge: 1 for each axis that stands at the far end of the box instead of the first corner.
    """

    name: str
    order: str
    repeat: int
    direction: str
    edge: tuple[int, int, int] = (0, 0, 0)

    @property
    def setup(self) -> str:
        """Return which alignment and zero the pass shares with others."""
        edge = "".join(str(far) for far in self.edge) if any(self.edge) else ""
        return f"{self.name} {self.order or edge}".strip()

    def nodes(self, blocks: int) -> list[tuple[int, int, int]]:
        """Return the nodes of X, Y, Z at each stop, in the order of measurement."""
        moves = self.order or self.name.upper()
        senses = dict.fromkeys(AXES, 1)
        if self.order:
            senses = {
                axis: 1 if sign == "p" else -1 for axis, sign in zip(AXES, self.name, strict=True)
            }
        here = {axis: 0 if sense > 0 else blocks for axis, sense in senses.items()}
        for axis, far in zip(AXES, self.edge, strict=True):
            here[axis] += far * blocks
        stops = [(here["X"], here["Y"], here["Z"])]
        for _ in range(blocks):
            for axis in moves:
                here[axis] += senses[axis]
                stops.append((here["X"], here["Y"], here["Z"]))
        return stops if self.direction == "forward" else stops[::-1]


@dataclass(frozen=True)
class Problem:
    """A machine with known errors, and how it is measured.

    Attributes:
        kind: one of ``KINDS``.
        chain: axes from workpiece to tool.
        origin: first corner of the box, m.
        step: of a block, m.
        blocks: number of blocks.
        passes: in the order of measurement.
        curves: true errors at the nodes under their ISO 230-1 names, in the frame of the results,
            m and rad, each shape (blocks + 1,).
        angles: setup → two angles of the beam and two of the mirror's normal against the nominal
            direction, along the perpendiculars of ``tilts``, rad.
        noise: standard deviation of a reading, m.
        dead_path: m.
        readings: of each pass, m, zeroed at the first stop of its setup.
    """

    kind: str
    chain: str
    origin: tuple[float, float, float]
    step: tuple[float, float, float]
    blocks: int
    passes: tuple[KnownPass, ...]
    curves: Mapping[str, Vector]
    angles: Mapping[str, tuple[float, float, float, float]]
    noise: float
    dead_path: float
    readings: tuple[Vector, ...] = field(default=(), repr=False)

    @property
    def diagonal(self) -> float:
        """Return the length of the body diagonal, m."""
        return float(np.linalg.norm(self.step)) * self.blocks

    @property
    def gain(self) -> float:
        """Return the largest ‖a‖/2a: curve error for one of a displacement (IH eqs. 6-14)."""
        return float(np.linalg.norm(self.step)) / (2.0 * min(self.step))

    @property
    def largest_error(self) -> float:
        """Return a bound of the length of the translational error vector at any stop, m."""
        squares = [
            sum(float(np.max(np.abs(self.curves[f"E_{e}{axis}"]))) ** 2 for e in AXES)
            for axis in AXES
        ]
        return float(np.sum(np.sqrt(squares)))

    @property
    def repeats(self) -> bool:
        """Say whether any stop was measured more than once."""
        return len(self.passes) > len(self.angles)

    def position(self, nodes: tuple[int, int, int]) -> Vector:
        """Return machine coordinates of nodes, m, shape (3,)."""
        place: Vector = np.asarray(self.origin) + np.asarray(nodes) * np.asarray(self.step)
        return place

    def __str__(self) -> str:
        steps = " x ".join(f"{size / MILLI:g}" for size in self.step)
        noise = f", noise {self.noise * 1e6:.2g} µm" if self.noise else ""
        return (
            f"chain {self.chain}, {self.blocks} blocks of {steps} mm, {len(self.passes)} passes"
            f"{noise}"
        )


def draw(kind: str, rng: np.random.Generator) -> Problem:
    """Draw a problem of a kind and measure it.

    Args:
        kind: one of ``KINDS``.
        rng: everything random comes from it, in a fixed order.
    """
    angular = kind == ANGULAR
    chain = str(rng.choice(CHAINS))
    # Where chance is tested, so many values that uncertainties wrong by a factor of two show.
    fewest, most = (3, 4) if angular else (8, 12) if kind in (NOISY, UNKNOWN_NOISE) else (3, 8)
    blocks = int(rng.integers(fewest, most + 1))
    # Steps of 10 to 60 mm and corners up to 1 m from the machine's zero, in whole half millimetres.
    x, y, z = (float(value) * 0.5 * MILLI for value in rng.integers(20, 121, 3))
    corner = rng.integers(-1000, 1001, 3) * (not angular)
    size = float(10.0 ** rng.uniform(-6.0, -5.0))
    noise = float(10.0 ** rng.uniform(-8.0, -6.3))
    problem = Problem(
        kind=kind,
        chain=chain,
        origin=(
            float(corner[0]) * MILLI,
            float(corner[1]) * MILLI,
            float(corner[2]) * MILLI,
        ),
        step=(x, y, z),
        blocks=blocks,
        passes=_passes(kind),
        curves=_curves(rng, blocks, *(_SIZES if angular else (size, 0.0))),
        angles={},
        noise=noise if kind in (NOISY, UNKNOWN_NOISE, DIAGONALS) else 0.0,
        dead_path=float(rng.uniform(0.05, 0.5)),
    )
    angles = _angles(kind, problem.passes, rng)
    readings = _measure(problem, angles, rng)
    return replace(problem, angles=angles, readings=readings)


def tilts(line: str, step: tuple[float, float, float]) -> tuple[Vector, Vector, Vector]:
    """Return the nominal beam of a line and the two directions its angles are counted along.

    The first lies in the XY plane (along +Y for a beam along Z), the second makes a right-handed
    triple (first, second, beam).
    """
    signs = [{"p": 1.0, "n": -1.0}.get(letter, 0.0) for letter in line]
    if line in LINEAR_LINES:
        signs = [float(line == letter) for letter in LINEAR_LINES]
    beam = np.asarray(signs) * np.asarray(step)
    beam = beam / np.linalg.norm(beam)
    flat = np.array([-beam[1], beam[0], 0.0])
    length = float(np.linalg.norm(flat))
    first = flat / length if length > 0.0 else np.array([0.0, 1.0, 0.0])
    return beam, first, np.cross(beam, first)


def _turned(nominal: Vector, first: Vector, second: Vector, one: float, two: float) -> Vector:
    turned: Vector = np.sqrt(1.0 - one**2 - two**2) * nominal + one * first + two * second
    return turned


def _passes(kind: str) -> tuple[KnownPass, ...]:
    orders = ("XYZ", "YZX", "ZXY") if kind == ANGULAR else ("XYZ",)
    repeated = kind in (NOISY, UNKNOWN_NOISE)
    lines = [] if kind == DIAGONALS else [(name, "") for name in LINEAR_LINES]
    lines += [(name, order) for name in BODY_DIAGONALS for order in orders]
    both = ("forward", "backward") if repeated or kind == DIAGONALS else ("forward",)
    box = tuple(
        KnownPass(name, order, repeat, direction)
        for name, order in lines
        for repeat in range(2 if repeated else 1)
        for direction in both
    )
    return (*_edges(), *box) if kind == ANGULAR else box


def _edges() -> tuple[KnownPass, ...]:
    """Return linear lines along the edges that do not pass the first corner.

    X, Y and Z take turns: two lines with the same name one after the other would be repeats.
    """
    far = {
        "x": ((0, 1, 0), (0, 0, 1), (0, 1, 1)),
        "y": ((1, 0, 0), (0, 0, 1), (1, 0, 1)),
        "z": ((1, 0, 0), (0, 1, 0), (1, 1, 0)),
    }
    return tuple(
        KnownPass(name, "", 0, "forward", far[name][turn])
        for turn in range(3)
        for name in LINEAR_LINES
    )


def _curves(rng: np.random.Generator, blocks: int, size: float, angle: float) -> dict[str, Vector]:
    """Return curves from zero at the first node; those that fix the frame end at zero, too."""
    share = np.arange(blocks + 1) / blocks
    curves = {}
    for name in (*TRANSLATIONS, *ROTATIONS):
        slope, rough = rng.standard_normal(), rng.standard_normal(blocks + 1)
        values = slope * share + 0.3 * (rough - rough[0])
        if name in _FRAMED:
            values = values - values[-1] * share
        curves[name] = (angle if name in ROTATIONS else size) * values
    return curves


def _angles(
    kind: str, passes: tuple[KnownPass, ...], rng: np.random.Generator
) -> dict[str, tuple[float, float, float, float]]:
    spread = _TILTS[kind]
    made = {}
    for line in passes:
        if line.setup in made:
            continue
        one, two, three, four = (float(value) for value in spread * rng.standard_normal(4))
        if kind != MISALIGNED:
            three, four = one, two
        if kind != MISALIGNED and not line.order:
            one = two = three = four = 0.0
        made[line.setup] = (one, two, three, four)
    return made


def _measure(
    problem: Problem,
    angles: Mapping[str, tuple[float, float, float, float]],
    rng: np.random.Generator,
) -> tuple[Vector, ...]:
    zeros: dict[str, float] = {}
    starts: dict[str, Vector] = {}
    made = []
    for line in problem.passes:
        nodes = line.nodes(problem.blocks)
        one, two, three, four = angles[line.setup]
        nominal, first, second = tilts(line.name, problem.step)
        beam = _turned(nominal, first, second, one, two)
        normal = _turned(nominal, first, second, three, four)
        start = starts.setdefault(line.setup, problem.position(nodes[0]))
        laser = start - problem.dead_path * beam
        lengths = []
        for node in nodes:
            errors = {
                axis: np.array([problem.curves[f"E_{e}{axis}"][at] for e in (*AXES, *"ABC")])
                for axis, at in zip(AXES, node, strict=True)
            }
            pose = mirror_pose(problem.chain, problem.position(node), errors, np.zeros(3))
            lengths.append(beam_length(pose, beam, normal, laser))
        readings = np.array(lengths) + problem.noise * rng.standard_normal(len(lengths))
        zero = zeros.setdefault(line.setup, float(readings[0]))
        made.append(readings - zero)
    return tuple(made)
