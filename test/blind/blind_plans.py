"""Plans of the blind test: drawn at random or read from a plan file, and the stops of their runs.

A plan file is read here by its documented keys (``config/plans/demo.yaml`` of the project explains
them), not by the project's own reader: the machine of the blind test measures what the file says.
"""

from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
import yaml
from blind_weather import another_day, draw_weather, plain_weather, weather

ORDERS = ("XYZ", "YZX", "ZXY", "XZY", "ZYX", "YXZ")
CHAINS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")
DIAGONALS = ("ppp", "npp", "pnp", "ppn")
BOTH = ("forward", "backward")
SENSES = {"p": 1, "n": -1, "0": 0}
RUN_UP = "diagonal", "linear"
"""Kinds of lines whose passes are begun beyond their first stop, if the plan says so."""
_SETTLE = 0.5
"""Seconds that a stop takes at least, if a plan file does not tell."""


@dataclass(frozen=True)
class Setup:
    """Passes along one line that share alignment and zero.

    Attributes:
        kind: linear, step_diagonal or diagonal.
        line: x, y, z, or the signs of a diagonal, 0 for an axis that stands.
        order: of the three moves of a block; empty where all axes move at once.
        repeats: of each direction.
        directions: of the passes, in order.
        offset: of the line from its usual place, m.
        mirror: place of the mirror on the tool, from its usual one, m.
    """

    kind: str
    line: str
    order: str
    repeats: int = 1
    directions: tuple = ("forward",)
    offset: tuple = (0.0, 0.0, 0.0)
    mirror: tuple = (0.0, 0.0, 0.0)

    @property
    def words(self):
        return self.kind, self.line, self.order

    @property
    def senses(self):
        """Sense in which each axis runs, (3,)."""
        if self.kind == "linear":
            return np.array([int(self.line == name) for name in "xyz"])
        return np.array([SENSES[sign] for sign in self.line])


@dataclass(frozen=True)
class Plan:
    """What is measured, in which order; overrun in m, feed in m/s (0: of no account).

    With one alignment, the setups of one diagonal that follow each other share alignment and zero.
    """

    chain: str
    step: tuple
    blocks: int
    setups: tuple
    stop_time: float
    setup_time: float
    dead_path: float
    noise: float
    warming: dict
    memory: bool = True
    told_noise: bool = False
    one_alignment: bool = False
    overrun: float = 0.0
    feed: float = 0.0

    @property
    def stops(self):
        """Number of stops of a run."""
        return sum(
            (max(len(setup.order), 1) * self.blocks + 1) * setup.repeats * len(setup.directions)
            for setup in self.setups
        )

    def repeated(self, repeats):
        """The plan with so many repeats of every line, of each diagonal in one move order."""
        first = {}
        for setup in self.setups:
            first.setdefault((setup.kind, setup.line), replace(setup, repeats=repeats))
        return replace(self, setups=tuple(first.values()))

    @property
    def repeats(self):
        return max(setup.repeats for setup in self.setups)

    @property
    def name(self):
        orders = {setup.order for setup in self.setups if setup.order}
        diagonals = {setup.line for setup in self.setups if setup.order}
        directions = {way for setup in self.setups for way in setup.directions}
        return (
            f"{self.chain}, {self.blocks} blocks, {len(diagonals)} diagonals x {len(orders)} "
            f"orders, {self.repeats} repeats, {'/'.join(sorted(directions, reverse=True))}"
        )


@dataclass(frozen=True)
class Run:
    """Every stop of a run in order of time, one row each; positions count from the box's corner.

    ``moved`` is the sense of each axis in the move that led to a stop (0 at a pass's first stop),
    ``came`` the sense of its last move so far in the setup or in the approach to it, ``way`` the
    move itself, m, ``mirror`` the place of the mirror on the tool from its usual one, m, (n, 3).
    ``rows`` holds kind, line, order, repeat, direction, stop.
    """

    plan: Plan
    rows: tuple
    position: np.ndarray
    time: np.ndarray
    setup: np.ndarray
    passes: np.ndarray
    moved: np.ndarray
    came: np.ndarray
    way: np.ndarray
    beam: np.ndarray
    start: np.ndarray
    mirror: np.ndarray
    air: np.ndarray
    pressure: np.ndarray
    humidity: np.ndarray
    material: np.ndarray

    @property
    def travel(self):
        return np.asarray(self.plan.step) * self.plan.blocks

    @property
    def dead_path(self):
        return self.plan.dead_path

    @property
    def number(self):
        """Number of each stop in its pass."""
        return np.array([row[-1] for row in self.rows])

    @property
    def along(self):
        """Way along the beam from the line's start, m."""
        return np.sum(self.beam * (self.position - self.start), axis=1)

    @property
    def sideways(self):
        """Way across the beam from the line's start, m, (n, 3)."""
        return self.position - self.start - self.along[:, None] * self.beam


def draw_plan(rng, rich=False):
    """Draw a plan; a rich one can tell effects apart: both directions, two repeats or more."""
    if rng.random() < 0.3:
        return _draw_plain_plan(rng, rich)
    blocks = int(rng.integers(6, 15))
    orders = list(rng.permutation(ORDERS)[: rng.integers(1 + rich, 4)])
    diagonals = list(DIAGONALS) if rich or rng.random() < 0.7 else list(DIAGONALS[:3])
    both = rich or rng.random() < 0.75
    repeats = int(rng.integers(2, 4) if rich else rng.choice([1, 2, 2, 2, 3]))
    setups = _setups(diagonals, orders, repeats, BOTH if both else BOTH[:1])
    if rng.random() < 0.3:
        setups = tuple(setups[place] for place in rng.permutation(len(setups)))
    cubic = rng.random() < 0.4
    step = rng.integers(16, 60, 1 if cubic else 3) * 0.5e-3
    return Plan(
        chain=str(rng.choice(CHAINS)),
        step=tuple(float(value) for value in np.broadcast_to(step, 3)),
        blocks=blocks,
        setups=setups,
        stop_time=float(rng.integers(2, 7)),
        setup_time=float(rng.integers(3, 13) * 60),
        dead_path=float(rng.integers(5, 60) * 0.01),
        noise=float(np.exp(rng.uniform(np.log(0.015e-6), np.log(0.25e-6)))),
        warming=draw_weather(rng),
    )


def _draw_plain_plan(rng, rich):
    """Draw a plan of the kind of the printed cases: cubes, white noise that the case file tells."""
    orders = list(rng.permutation(ORDERS)[: rng.integers(1 + rich, 4)])
    both = rich or rng.random() < 0.75
    repeats = int(rng.integers(2, 4) if rich else rng.integers(1, 6))
    return Plan(
        chain=str(rng.choice(CHAINS)),
        step=(float(rng.choice([0.01, 0.01, 0.02, 0.025, 0.04])),) * 3,
        blocks=int(rng.choice([8, 10, 12, 12])),
        setups=_setups(DIAGONALS, orders, repeats, BOTH if both else BOTH[:1]),
        stop_time=3.0,
        setup_time=float(rng.choice([300.0, 600.0])),
        dead_path=float(rng.choice([0.1, 0.3, 0.5])),
        noise=float(rng.choice([0.05e-6, 0.1e-6, 0.1e-6, 0.2e-6])),
        warming=plain_weather(rng),
        memory=False,
        told_noise=True,
    )


def _setups(diagonals, orders, repeats, directions):
    linear = [Setup("linear", axis, "", repeats, directions) for axis in "xyz"]
    steps = [
        Setup("step_diagonal", line, str(order), repeats, directions)
        for line in diagonals
        for order in orders
    ]
    return (*linear, *steps)


def plan_of_file(text, before, rng, conditions=()):
    """Read the plan of a plan file, to be measured on a machine on another day.

    What the file does not say (alignment, dead path, noise) is as in
    the plan ``before`` of the same machine, the weather another day's.

    Args:
        text: of the plan file, YAML.
        before: the plan that the machine was measured by before.
        rng: of the weather.
        conditions: sentences that say in which weather the plan is to be measured.

    Raises:
        ValueError: it measures another box than the plan before.
    """
    told = yaml.safe_load(text)
    box = tuple(float(one) for one in told["step_m"]), int(told["blocks"])
    if not np.allclose(box[0], before.step, atol=1e-9) or box[1] != before.blocks:
        raise ValueError(f"the plan's box {box} is not that of the run before")
    setups = []
    for group in told["lines"]:
        repeats = int(group.get("repeats", told.get("repeats", 1)))
        directions = tuple(group.get("directions", told.get("directions", BOTH[:1])))
        stepped = group["kind"] == "step_diagonal"
        offset, mirror = (
            tuple(float(one) for one in group.get(key, (0.0, 0.0, 0.0)))
            for key in ("offset_m", "mirror_offset_m")
        )
        setups += [
            Setup(group["kind"], line, order, repeats, directions, offset, mirror)
            for line in group["names"]
            for order in (group.get("orders", ["XYZ"]) if stepped else [""])
        ]
    sampling = told.get("sampling", {})
    feed = told.get("feed_m_per_s")
    known = isinstance(feed, int | float)
    stay = float(sampling.get("settle_s", 0.1)) + float(sampling.get("window_s", 0.3))
    made = replace(
        before,
        setups=tuple(_joined(setups)),
        stop_time=max(float(sampling.get("dwell_s", _SETTLE)), stay) if known else before.stop_time,
        one_alignment=bool(told.get("one_alignment_per_diagonal", False)),
        overrun=float(told.get("overrun_m", 0.0)),
        feed=float(feed) if known else 0.0,
    )
    length = float(make_run(made).time[-1])
    return replace(made, warming=another_day(before.warming, length, conditions, rng))


def _joined(setups):
    """Passes of the same line one after another are one setup."""
    for (kind, line, order, offset, mirror), group in groupby(
        setups, key=lambda one: (one.kind, one.line, one.order, one.offset, one.mirror)
    ):
        some = list(group)
        directions = some[0].directions
        repeats = sum(one.repeats for one in some)
        if any(one.directions != directions for one in some):
            # A file may have the way there at the end of one group and the way back in the next.
            directions, repeats = tuple(way for one in some for way in one.directions), 1
            if len(set(directions)) < len(directions) or any(one.repeats > 1 for one in some):
                raise ValueError(f"{line} {order} stands twice in a row with other directions")
        yield Setup(kind, line, order, repeats, directions, offset, mirror)


def nodes_of(setup, blocks):
    """Node numbers of the forward pass of a setup, (stops, 3)."""
    senses = setup.senses
    node = np.where(senses < 0, blocks, 0)
    nodes = [node.copy()]
    for _ in range(blocks):
        for letter in setup.order or "*":
            axes = slice(None) if letter == "*" else "XYZ".index(letter)
            node[axes] += senses[axes]
            nodes.append(node.copy())
    return np.array(nodes)


def beam_of(setup, step):
    """Nominal unit vector of a setup's beam."""
    way = setup.senses * np.asarray(step)
    return way / np.linalg.norm(way)


def box_places(step, blocks, count):
    """Places all over the measured box, at its nodes, m, (count, 3); always the same ones."""
    return np.random.default_rng(count).integers(0, blocks + 1, (count, 3)) * np.asarray(step)


def make_run(plan, approach=None):
    """Lay out every stop of a plan.

    Args:
        plan: to be run.
        approach: sense in which each axis moved last before each setup, (setups, 3); zeros if not
            told: while the laser is aligned, axes are moved to and fro, and no table tells how.
    """
    names = ("place", "time", "setup", "pass", "beam", "start", "mirror", "came")
    columns = {name: [] for name in names}
    rows, ways, clock, passes, number = [], [], 0.0, 0, -1
    step = np.asarray(plan.step)
    approach = np.zeros((len(plan.setups), 3)) if approach is None else approach
    before, counted = None, 0
    for setup in plan.setups:
        forward = nodes_of(setup, plan.blocks) * step + np.asarray(setup.offset)
        # A table tells passes apart by their words; lines at other places count their repeats on.
        counted = counted + before.repeats if before and before.words == setup.words else 0
        same = before and (before.line, before.mirror) == (setup.line, setup.mirror)
        if not (plan.one_alignment and setup.order and same):
            clock += plan.setup_time if number >= 0 else 0.0
            number += 1
            begin = forward[0]
            latest, at = np.array(approach[number], dtype=float), None
        before = setup
        for repeat in range(setup.repeats):
            for direction in setup.directions:
                stops = forward if direction == "forward" else forward[::-1]
                run_up = plan.overrun > 0.0 and setup.kind in RUN_UP
                for stop, place in enumerate(stops):
                    way = np.zeros(3) if at is None else place - at
                    senses = np.sign(np.where(np.abs(way) > 1e-9, way, 0.0))
                    if stop == 0 and run_up:
                        senses = np.sign(stops[1] - stops[0])
                    latest = np.where(senses, senses, latest)
                    clock += float(np.linalg.norm(way)) / plan.feed if plan.feed else 0.0
                    rows.append((*setup.words, counted + repeat, direction, stop))
                    ways.append(way if stop else np.zeros(3))
                    for name, value in zip(
                        columns,
                        (
                            place,
                            clock,
                            number,
                            passes,
                            beam_of(setup, step),
                            begin,
                            setup.mirror,
                            latest,
                        ),
                        strict=True,
                    ):
                        columns[name].append(value)
                    clock += plan.stop_time
                    at = place
                passes += 1
    told = {name: np.array(values) for name, values in columns.items()}
    ways = np.array(ways)
    air, pressure, humidity, material = weather(plan.warming, told["time"])
    return Run(
        plan=plan,
        rows=tuple(rows),
        position=told["place"],
        time=told["time"],
        setup=told["setup"],
        passes=told["pass"],
        moved=np.sign(np.where(np.abs(ways) > 1e-9, ways, 0.0)),
        came=told["came"],
        way=ways,
        beam=told["beam"],
        start=told["start"],
        mirror=told["mirror"],
        air=air,
        pressure=pressure,
        humidity=humidity,
        material=material,
    )
