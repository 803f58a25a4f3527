"""Random test plans of the blind test: lines, passes, stops, times and weather."""

from dataclasses import dataclass

import numpy as np

ORDERS = ("XYZ", "YZX", "ZXY", "XZY", "ZYX", "YXZ")
CHAINS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")
DIAGONALS = ("ppp", "npp", "pnp", "ppn")
NOTHING = np.zeros(3)


@dataclass(frozen=True)
class Setup:
    """Passes along one line that share alignment and zero."""

    kind: str
    line: str
    order: str


@dataclass(frozen=True)
class Plan:
    """What is measured, in which order."""

    chain: str
    step: tuple
    blocks: int
    setups: tuple
    repeats: int
    directions: tuple
    stop_time: float
    setup_time: float
    dead_path: float
    noise: float
    warming: dict

    @property
    def name(self):
        orders = {setup.order for setup in self.setups if setup.order}
        diagonals = {setup.line for setup in self.setups if setup.order}
        return (
            f"{self.chain}, {self.blocks} blocks, {len(diagonals)} diagonals x {len(orders)} "
            f"orders, {self.repeats} repeats, {'/'.join(self.directions)}"
        )


@dataclass(frozen=True)
class Run:
    """Every stop of a run in order of time, one row each; positions count from the box's corner.

    ``moved`` is the sense of each axis in the move that led to a stop (0 at a pass's first stop),
    ``came`` the sense of its last move so far in the setup or in the approach to it.
    """

    plan: Plan
    rows: tuple
    position: np.ndarray
    time: np.ndarray
    setup: np.ndarray
    passes: np.ndarray
    moved: np.ndarray
    came: np.ndarray
    beam: np.ndarray
    start: np.ndarray
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
    def index(self):
        """Node of each axis at each stop, (n, 3)."""
        return np.rint(self.position / np.asarray(self.plan.step)).astype(int)


def draw_plan(rng, rich=False):
    """Draw a plan; a rich one can tell effects apart: both directions, two repeats or more."""
    blocks = int(rng.integers(6, 15))
    orders = list(rng.permutation(ORDERS)[: rng.integers(1 + rich, 4)])
    diagonals = list(DIAGONALS) if rich or rng.random() < 0.7 else list(DIAGONALS[:3])
    linear = [Setup("linear", axis, "") for axis in "xyz"]
    steps = [Setup("step_diagonal", line, str(order)) for line in diagonals for order in orders]
    setups = linear + steps
    if rng.random() < 0.3:
        setups = [setups[place] for place in rng.permutation(len(setups))]
    both = rich or rng.random() < 0.75
    cubic = rng.random() < 0.4
    step = rng.integers(16, 60, 1 if cubic else 3) * 0.5e-3
    return Plan(
        chain=str(rng.choice(CHAINS)),
        step=tuple(float(value) for value in np.broadcast_to(step, 3)),
        blocks=blocks,
        setups=tuple(setups),
        repeats=int(rng.integers(2, 4) if rich else rng.choice([1, 2, 2, 2, 3])),
        directions=("forward", "backward") if both else ("forward",),
        stop_time=float(rng.integers(2, 7)),
        setup_time=float(rng.integers(3, 13) * 60),
        dead_path=float(rng.integers(5, 60) * 0.01),
        noise=float(np.exp(rng.uniform(np.log(0.05e-6), np.log(0.2e-6)))),
        warming=draw_weather(rng),
    )


def draw_weather(rng):
    """Draw histories of air and material: drift, warm-up and slow wave, not the same for both."""
    return {
        "start": float(rng.uniform(-1.0, 1.0)),
        "drift": float(rng.uniform(-0.4, 0.4)) / 3600.0,
        "wave": float(rng.uniform(0.1, 0.6)),
        "period": float(rng.uniform(1200.0, 7000.0)),
        "warm": float(rng.uniform(0.3, 1.5)),
        "warm_time": float(rng.uniform(1500.0, 6000.0)),
        "lag": float(rng.uniform(600.0, 2500.0)),
        "pressure": float(rng.uniform(-40.0, 40.0)) / 3600.0,
        "humidity": float(rng.uniform(0.3, 0.6)),
        "same": bool(rng.random() < 0.25),
    }


def weather(told, time):
    """Air temperature, pressure, humidity and material temperature at times."""

    def air(at):
        wave = told["wave"] * np.sin(2.0 * np.pi * at / told["period"])
        return 20.0 + told["start"] + told["drift"] * at + wave

    pressure = 101325.0 + told["pressure"] * time
    humidity = told["humidity"] + 0.02 * np.sin(2.0 * np.pi * time / (2.3 * told["period"]))
    if told["same"]:
        return air(time), pressure, humidity, air(time)
    # The material follows the air late and weakly, and warms up with the machine.
    warmed = told["warm"] * (1.0 - np.exp(-time / told["warm_time"]))
    material = 20.0 + 0.4 * (air(time - told["lag"]) - 20.0) + warmed
    return air(time), pressure, humidity, material


def nodes_of(setup, blocks):
    """Node numbers of the forward pass of a setup, (stops, 3)."""
    if setup.kind == "linear":
        nodes = np.zeros((blocks + 1, 3), dtype=int)
        nodes[:, "xyz".index(setup.line)] = np.arange(blocks + 1)
        return nodes
    node = np.array([0 if sign == "p" else blocks for sign in setup.line])
    nodes = [node.copy()]
    for _ in range(blocks):
        for letter in setup.order:
            axis = "XYZ".index(letter)
            node[axis] += 1 if setup.line[axis] == "p" else -1
            nodes.append(node.copy())
    return np.array(nodes)


def beam_of(setup, step):
    """Nominal unit vector of a setup's beam."""
    if setup.kind == "linear":
        return np.eye(3)["xyz".index(setup.line)]
    way = np.array([1.0 if sign == "p" else -1.0 for sign in setup.line]) * np.asarray(step)
    return way / np.linalg.norm(way)


def make_run(plan, approach=None):
    """Lay out every stop of a plan.

    Args:
        plan: to be run.
        approach: sense in which each axis moved last before each setup, (setups, 3); zeros if not
            told: while the laser is aligned, axes are moved to and fro, and no table tells how.
    """
    rows, nodes, time, setup_of, pass_of, beams, starts, firsts = [], [], [], [], [], [], [], []
    clock, passes = 0.0, 0
    for number, setup in enumerate(plan.setups):
        forward = nodes_of(setup, plan.blocks)
        clock += plan.setup_time if number else 0.0
        for repeat in range(plan.repeats):
            for direction in plan.directions:
                way = forward if direction == "forward" else forward[::-1]
                for stop, node in enumerate(way):
                    rows.append((setup.kind, setup.line, setup.order, repeat, direction, stop))
                    nodes.append(node)
                    time.append(clock)
                    setup_of.append(number)
                    pass_of.append(passes)
                    beams.append(beam_of(setup, plan.step))
                    starts.append(forward[0] * np.asarray(plan.step))
                    firsts.append(stop == 0)
                    clock += plan.stop_time
                passes += 1
    nodes = np.array(nodes)
    change = np.sign(np.diff(nodes, axis=0, prepend=nodes[:1])).astype(float)
    moved = np.where(np.array(firsts)[:, None], 0.0, change)
    came, latest = np.empty_like(change), np.zeros(3)
    approach = np.zeros((len(plan.setups), 3)) if approach is None else approach
    for place, senses in enumerate(change):
        begins = place == 0 or setup_of[place] != setup_of[place - 1]
        latest = approach[setup_of[place]] if begins else np.where(senses, senses, latest)
        came[place] = latest
    time = np.array(time)
    air, pressure, humidity, material = weather(plan.warming, time)
    return Run(
        plan=plan,
        rows=tuple(rows),
        position=nodes * np.asarray(plan.step),
        time=time,
        setup=np.array(setup_of),
        passes=np.array(pass_of),
        moved=moved,
        came=came,
        beam=np.array(beams),
        start=np.array(starts),
        air=air,
        pressure=pressure,
        humidity=humidity,
        material=material,
    )
