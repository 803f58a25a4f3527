"""Cases of the blind test: a machine, a run on it, what is hidden, and the files that tell of it.

A case is drawn wholly from its seed and class. What the workflow gets is a folder with ``run.csv``
and ``case.yaml``; the truth goes to a sealed file elsewhere, and the hash of the seal is known
before the first verdict.
"""

import csv
import hashlib
import json
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import yaml
from blind_kinematics import Action, displacements
from blind_physics import ANGLES, INSIDE, KINDS, OUTSIDE, Hidden, draw_hidden
from blind_plans import Plan, draw_plan, make_run
from blind_shapes import draw_curves, draw_noise, quantised
from blind_yardstick import SEEN, Yardstick

CLASSES = ("none", "one", "two", "outside", "pair")
LEVELS = (0.5, 1.0, 2.0, 5.0)
LARGEST = 3000
"""Readings of a run at most, if not told otherwise."""
HEADER = (
    "time_s,kind,line,order,repeat,direction,stop,x_m,y_m,z_m,reading_m,"
    "air_temperature_degC,air_pressure_Pa,relative_humidity,material_temperature_degC"
)
LEAST_VISIBLE = 0.02
"""An effect that shows less than this part of itself is hidden from everybody, and not drawn."""
ALIKE = 0.995
"""Signatures with this cosine cannot be told apart at the sizes of the test."""
_TRIES = 300


@dataclass(frozen=True)
class Case:
    """A drawn case, its sizes still without scale.

    Attributes:
        seed: it is drawn from.
        kind: one of CLASSES.
        level: sizes are this times the detection limit.
        plan: of the run.
        hidden: effects at work.
        twin: for a confounded pair, the other effect, which is not at work.
        signs: of the sizes.
    """

    seed: int
    kind: str
    level: float
    plan: Plan
    hidden: tuple
    twin: Hidden | None
    signs: tuple

    @property
    def name(self):
        return f"{self.kind}-{self.seed}"


class Machine:
    """Machine, optics and weather of one case: the same at every run, but for noise."""

    def __init__(self, seed, plan, rich=False):
        rng = np.random.default_rng([seed, 1])
        self.plan = plan
        self.curves = draw_curves(rng, plan.blocks, rich)
        # How the axes came to a setup no table tells; half the machines come without a sense.
        senses = rng.choice([-1.0, 0.0, 1.0], (len(plan.setups), 3))
        self.approach = senses * float(rng.random() < 0.5)
        setups = len(plan.setups)
        turns = rng.standard_normal((setups, 3))
        turns *= rng.uniform(0.1e-3, 0.3e-3) / np.linalg.norm(turns, axis=1, keepdims=True)
        self.beam_tilt = turns
        # A mirror is set to return the beam: it follows the beam's tilt but for a little.
        self.mirror_tilt = self.beam_tilt + rng.normal(0.0, 0.02e-3, (setups, 3))
        self.resolution = float(rng.choice([1e-9, 2e-9, 5e-9, 10e-9]))

    def run(self, plan=None):
        return make_run(plan or self.plan, self.approach)

    def alignment(self, run):
        """Beam, mirror normal and source of each stop."""

        def unit(vectors):
            return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

        beam = unit(run.beam + np.cross(self.beam_tilt[run.setup], run.beam))
        normal = unit(run.beam + np.cross(self.mirror_tilt[run.setup], run.beam))
        return beam, normal, run.start - run.dead_path * beam

    def shown(self, run, action):
        """What the interferometer shows without noise, zeroed at each setup's first stop, m."""
        index = run.index
        curves = np.stack([self.curves[axis][index[:, axis]] for axis in range(3)])
        values = displacements(self.plan.chain, run, curves, action, self.alignment(run))
        return zeroed(values, run.setup)

    def signature(self, run, hidden, unit=1e-6):
        """Change of the readings by a unit of an effect, (n,)."""
        without = self.shown(run, Action.none(len(run.time)))
        return (self.shown(run, hidden.act(run, unit)) - without) / unit


def zeroed(values, setup):
    first = np.concatenate([[0], np.flatnonzero(np.diff(setup)) + 1])
    return values - values[first][np.cumsum(np.isin(np.arange(len(setup)), first)) - 1]


def draw_case(kind, seed, level=None, largest=LARGEST):
    """Draw a case of a class.

    Args:
        kind: one of CLASSES.
        seed: anything but the class.
        level: times the detection limit; drawn if not given.
        largest: number of readings that the run may have.
    """
    rng = np.random.default_rng([seed, CLASSES.index(kind)])
    drawn_level = float(rng.choice(LEVELS))
    level = {"two": 5.0, "outside": 5.0}.get(kind, drawn_level) if level is None else level
    for _ in range(_TRIES):
        plan = draw_plan(rng, rich=kind != "none" or rng.random() < 0.7)
        if len(make_run(plan).time) > largest:
            continue
        hidden, twin = (), None
        if kind != "none":
            hidden, twin = _draw_effects(rng, kind, plan, seed)
            if not hidden:
                continue
        signs = tuple(float(sign) for sign in rng.choice([-1.0, 1.0], len(hidden)))
        return Case(seed, kind, level, plan, hidden, twin, signs)
    raise RuntimeError(f"no {kind} case found from seed {seed}")


def _draw_effects(rng, kind, plan, seed):
    machine = Machine(seed, plan)
    run = machine.run()
    yardstick = Yardstick(run)

    def seen(hidden):
        return yardstick.visible(machine.signature(run, hidden)) > LEAST_VISIBLE

    if kind == "pair":
        return _draw_pair(rng, machine, run, yardstick)
    if kind == "two":
        one, two = (draw_hidden(rng, str(name), run) for name in rng.permutation(INSIDE)[:2])
        changes = [machine.signature(run, hidden) for hidden in (one, two)]
        # Two that nearly cancel are a question of their own; here both can be told apart.
        if seen(one) and seen(two) and yardstick.alike(*changes) < 0.7:
            return (one, two), None
        return (), None
    kinds = INSIDE if kind == "one" else OUTSIDE
    hidden = draw_hidden(rng, str(rng.choice(kinds)), run)
    return ((hidden,), None) if seen(hidden) else ((), None)


def _draw_pair(rng, machine, run, yardstick):
    """Find two effects of the catalogue's kinds that this very run cannot tell apart."""
    known = [Hidden("angular", {"error": error}) for error in ANGLES]
    known += [Hidden("sag", {"component": "z", "pair": pair}) for pair in ("xy", "xz", "yz")]
    known += [Hidden("cosine", {"setup": number}) for number in range(len(run.plan.setups))]
    shown = [
        (hidden, change)
        for hidden, change in ((one, machine.signature(run, one)) for one in known)
        if yardstick.visible(change) > LEAST_VISIBLE
    ]
    pairs = [
        (one, two)
        for one, first in shown
        for two, second in shown
        if one is not two and yardstick.alike(first, second) > ALIKE
    ]
    if not pairs:
        return (), None
    one, two = pairs[rng.integers(len(pairs))]
    return (one,), two


def own_limits(case):
    """Detection limits by the yardstick, in the unit of each effect's size."""
    machine = Machine(case.seed, case.plan)
    run = machine.run()
    yardstick = Yardstick(run)
    return tuple(
        SEEN
        * case.plan.noise
        / float(np.linalg.norm(yardstick.signature(machine.signature(run, hidden))))
        for hidden in case.hidden
    )


def readings_of(case, sizes, noise_stream=0):
    """The run and its readings: exact kinematics, curves, effects, noise, resolution, zero.

    Args:
        case: to be measured.
        sizes: of its effects.
        noise_stream: another number is another run on the same machine.
    """
    machine = Machine(case.seed, case.plan, rich=case.kind == "none")
    run = machine.run()
    action = Action.none(len(run.time))
    for hidden, size in zip(case.hidden, sizes, strict=True):
        action = action + hidden.act(run, size)
    rng = np.random.default_rng([case.seed, 2, noise_stream])
    noisy = machine.shown(run, action) + draw_noise(rng, len(run.time), case.plan.noise)
    return run, zeroed(quantised(noisy, machine.resolution), run.setup)


def write_case(folder, case, sizes, noise_stream=0):
    """Write run.csv and case.yaml as a workflow gets them."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    run, readings = readings_of(case, sizes, noise_stream)
    with (folder / "run.csv").open("w", newline="") as file:
        file.write(HEADER + "\n")
        writer = csv.writer(file, lineterminator="\n")
        for n, row in enumerate(run.rows):
            writer.writerow(
                (
                    f"{run.time[n]:.1f}",
                    *row,
                    *(f"{value:.6f}" for value in run.position[n]),
                    f"{readings[n] + 0.0:.10f}",
                    f"{run.air[n]:.4f}",
                    f"{run.pressure[n]:.1f}",
                    f"{run.humidity[n]:.3f}",
                    f"{run.material[n]:.4f}",
                )
            )
    told = {
        "units": "SI",
        "chain": list(case.plan.chain),
        "mirror_on": "tool",
        "laser_on": "workpiece",
        "origin_m": [0.0, 0.0, 0.0],
        "step_m": list(case.plan.step),
        "blocks": case.plan.blocks,
        "repeats": case.plan.repeats,
        "dead_path_m": case.plan.dead_path,
    }
    (folder / "case.yaml").write_text(yaml.safe_dump(told, sort_keys=False))
    return folder


def seal(path, case, sizes, facts):
    """Write the truth where the workflow is not shown it; return the seal's hash.

    Args:
        path: of the seal.
        case: that is sealed.
        sizes: of its effects.
        facts: further ones to be kept with it.
    """
    truth = {
        "class": case.kind,
        "seed": case.seed,
        "level": case.level,
        "plan": case.plan.name,
        "noise": case.plan.noise,
        "hidden": [asdict(hidden) for hidden in case.hidden],
        "twin": asdict(case.twin) if case.twin else None,
        "sizes": list(sizes),
        **facts,
    }
    closed = zlib.compress(json.dumps(truth).encode())
    Path(path).write_bytes(closed)
    return hashlib.sha256(closed).hexdigest()


def unseal(path, digest):
    """Open a seal.

    Raises:
        ValueError: it is not the one that was laid.
    """
    closed = Path(path).read_bytes()
    if hashlib.sha256(closed).hexdigest() != digest:
        raise ValueError(f"the seal {path} was changed after it was laid")
    return json.loads(zlib.decompress(closed))


assert set(INSIDE) | set(OUTSIDE) <= set(KINDS)
