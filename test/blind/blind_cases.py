"""Cases of the blind test: a machine, a run on it, what is hidden, and the files that tell of it.

A case is drawn wholly from its seed and class. What the workflow gets is a folder with ``run.csv``
and ``case.yaml``; the truth goes to a sealed file elsewhere, and the hash of the seal is known
before the first verdict.
"""

import hashlib
import json
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from blind_effects import (
    ANGLES,
    FINE_NOISE,
    INSIDE,
    OUTSIDE,
    PAIRS,
    STRONG,
    UNSEEN,
    Hidden,
    draw_hidden,
)
from blind_gross import draw_gross, gross_table
from blind_kinematics import Action
from blind_machine import Machine
from blind_plans import Plan, draw_plan, plan_of_file
from blind_tables import case_text, table_text
from blind_yardstick import SEEN, Yardstick

CLASSES = ("none", "one", "two", "outside", "pair", "unseen", "gross")
LEVELS = (0.5, 1.0, 2.0, 5.0)
OUTSIDE_LEVEL = 3.0
"""Of what is outside the catalogue, where the issue asks."""
LARGEST = 2000
"""Readings of a run at most, if not told otherwise."""
LARGEST_OF_MANY = 5000
"""Likewise of a run of many repeats."""
LEAST_VISIBLE = 0.02
"""An effect that shows less than this part of itself is hidden from everybody, and not drawn."""
ALIKE = 0.995
"""Signatures with this cosine cannot be told apart at the sizes of the test."""
UNSEEN_SIZE = 5e-6
"""Of what an effect that nobody can see moves the readings, m: far above any noise."""
UNSEEN_LIGHT = 8e-9
"""Likewise of the light's swing within a fringe, m; no interferometer swings by more than 40 nm."""
WANDER = (0.1e-6, 0.2e-6)
"""Of the zero from pass to pass on half of the machines that lack nothing, m."""
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
        gross: for a gross error, its name and where.
        wander: of the laser's zero from pass to pass, m, standard deviation.
        repeats: that the plan was asked to have at least; 0 if it was not asked.
    """

    seed: int
    kind: str
    level: float
    plan: Plan
    hidden: tuple = ()
    twin: Hidden | None = None
    signs: tuple = ()
    gross: dict | None = None
    wander: float = 0.0
    repeats: int = 0

    @property
    def name(self):
        return f"{self.kind}-{self.seed}" + (f"-x{self.repeats}" if self.repeats else "")


def draw_case(kind, seed, level=None, largest=LARGEST, repeats=0):
    """Draw a case of a class.

    Args:
        kind: one of CLASSES.
        seed: anything but the class.
        level: times the detection limit; drawn if not given.
        largest: number of readings that the run may have.
        repeats: that the plan has at least, in one move order then; 0: a few, as drawn.
    """
    rng = np.random.default_rng([seed, CLASSES.index(kind)])
    drawn_level = float(rng.choice(LEVELS))
    usual = {"two": 5.0, "outside": OUTSIDE_LEVEL}
    level = usual.get(kind, drawn_level) if level is None else level
    for _ in range(_TRIES):
        plan = draw_plan(rng, rich=kind != "none" or rng.random() < 0.7)
        if repeats:
            plan = plan.repeated(repeats + int(rng.integers(0, 4)))
        if plan.stops > largest:
            continue
        hidden, twin, gross = (), None, None
        if kind == "gross":
            gross = draw_gross(rng, plan)
        elif kind != "none":
            hidden, twin = _draw_effects(rng, kind, plan, seed)
            if not hidden:
                continue
        signs = tuple(float(sign) for sign in rng.choice([-1.0, 1.0], len(hidden)))
        # Every other machine that lacks nothing is of an ordinary workshop.
        wander = float(rng.uniform(*WANDER)) if kind == "none" and seed % 2 else 0.0
        return Case(seed, kind, level, plan, hidden, twin, signs, gross, wander, repeats)
    raise RuntimeError(f"no {kind} case found from seed {seed}")


def _draw_effects(rng, kind, plan, seed):
    machine = Machine(seed, plan)
    run = machine.run()
    yardstick = Yardstick(run)

    def seen(hidden):
        if hidden is None or (hidden.kind == "nonlinearity" and plan.noise > FINE_NOISE):
            return False
        change = machine.signature(run, hidden)
        if hidden.kind == "interpolation":
            size = OUTSIDE_LEVEL * SEEN * plan.noise / np.linalg.norm(yardstick.signature(change))
            # An interpolation that is off by more does not go forward any more as the axis does.
            if size > hidden.setting["period"] / (2.0 * np.pi):
                return False
        return yardstick.visible(change) > LEAST_VISIBLE

    if kind == "pair":
        return _draw_pair(rng, machine, run, yardstick)
    if kind == "two":
        some = [draw_hidden(rng, str(name), run) for name in rng.permutation(STRONG)[:2]]
        if not all(seen(hidden) for hidden in some):
            return (), None
        changes = [machine.signature(run, hidden) for hidden in some]
        # Two that nearly cancel are a question of their own; here both can be told apart.
        return (tuple(some), None) if yardstick.alike(*changes) < 0.7 else ((), None)
    # Outside the catalogue each kind has its turn: few runs show them all.
    in_turn = (OUTSIDE[seed % len(OUTSIDE)],)
    kinds = {"one": INSIDE, "outside": in_turn, "unseen": UNSEEN}[kind]
    hidden = draw_hidden(rng, str(rng.choice(kinds)), run)
    if kind == "unseen":
        return ((hidden,), None) if _is_there(hidden, run, machine) else ((), None)
    return ((hidden,), None) if seen(hidden) else ((), None)


def _is_there(hidden, run, machine):
    """Tell whether an effect that nobody can see is at work at all."""
    if hidden.kind == "nonlinearity":
        return run.plan.noise > 4.0 * FINE_NOISE
    if hidden.kind == "pitch":
        travel = run.travel["XYZ".index(hidden.setting["axis"])]
        swing = np.ptp(machine.signature(run, hidden))
        # Nothing of it is left where every stop is a whole turn on.
        return travel > 2.5 * hidden.setting["period"] and swing > 0.2
    return True


def _draw_pair(rng, machine, run, yardstick):
    """Find two effects of the catalogue's kinds that this very run cannot tell apart."""
    known = [Hidden("angular", {"error": error}) for error in ANGLES]
    known += [Hidden("sag", {"component": one, "pair": pair}) for one in "xyz" for pair in PAIRS]
    known += [Hidden("cosine", {"setup": number}) for number in range(len(run.plan.setups))]
    for kind in ("backlash", "settling", "growth", "growth_in_time"):
        known += [Hidden(kind, {"axis": axis}) for axis in "XYZ"]
    known += [Hidden("drift", {"direction": one}) for one in "xyz"]
    plain = ("reading_drift", "dead_path", "air", "expansion", "servo_lag", "trigger", "beam_walk")
    known += [Hidden(kind) for kind in plain]
    changes = [machine.signature(run, one) for one in known]
    signatures = [yardstick.signature(change) for change in changes]
    seen = [yardstick.visible(change) > LEAST_VISIBLE for change in changes]
    lengths = np.array([np.linalg.norm(one) for one in signatures])
    units = np.stack(signatures) / np.maximum(lengths, 1e-300)[:, None]
    cosines = np.abs(units @ units.T)
    whole = np.abs(np.corrcoef(np.stack(changes)))
    pairs = [
        (one, two)
        for one in range(len(known))
        for two in range(len(known))
        # The very same readings are one effect under two names: no plan tells them apart. Nor does
        # any other run tell of what belonged to an alignment of this one: that is not hidden here.
        if one != two and known[one].stays and seen[one] and seen[two] and cosines[one, two] > ALIKE
        if whole[one, two] < 1.0 - 1e-6
    ]
    if not pairs:
        return (), None
    # Angles and sags make most pairs: what kinds meet is drawn first.
    kinds = sorted({(known[one].kind, known[two].kind) for one, two in pairs})
    wanted = kinds[rng.integers(len(kinds))]
    pairs = [pair for pair in pairs if tuple(known[one].kind for one in pair) == wanted]
    one, two = pairs[rng.integers(len(pairs))]
    return (known[one],), known[two]


def own_limits(case):
    """Detection limits by the yardstick, in the unit of each effect's size."""
    machine = Machine(case.seed, case.plan)
    run = machine.run()
    if case.kind == "unseen":
        (hidden,) = case.hidden
        whole = UNSEEN_LIGHT if hidden.kind == "nonlinearity" else UNSEEN_SIZE
        return (whole / float(np.ptp(machine.signature(run, hidden))),)
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
    machine = Machine(case.seed, case.plan)
    run = machine.run()
    action = _action(run, zip(case.hidden, sizes, strict=True))
    rng = np.random.default_rng([case.seed, 2, noise_stream])
    return run, machine.measured(run, action, rng, case.wander)


def _action(run, acting):
    action = Action.none(len(run.time))
    for hidden, size in acting:
        action = action + hidden.act(run, size)
    return action


def write_case(folder, case, sizes, noise_stream=0):
    """Write run.csv and case.yaml as a workflow gets them."""
    run, readings = readings_of(case, sizes, noise_stream)
    return _write(folder, case.plan, table_text(run, readings))


def write_gross(folder, case):
    """Write a run with a gross error; beside it, as nominal.csv, the table that nobody measured."""
    machine = Machine(case.seed, case.plan)
    rng = np.random.default_rng([case.seed, 2, 0])
    wrong, nominal = gross_table(machine, case.gross, rng)
    _write(folder, case.plan, wrong)
    if nominal:
        (Path(folder) / "nominal.csv").write_text(nominal)
    return folder


def write_further(folder, case, sizes, plan_text, day=1, conditions=()):
    """Measure what a plan file says on the machine of a case, on another day.

    What belongs to one alignment or one pass of the first run is over; all else is still at work.
    The day has weather that suits the ``conditions`` that were stated with the plan.
    """
    rng = np.random.default_rng([case.seed, 3, day])
    plan = plan_of_file(plan_text, case.plan, rng, conditions)
    machine = Machine(case.seed, plan, day)
    run = machine.run()
    acting = [(one, size) for one, size in zip(case.hidden, sizes, strict=True) if one.stays]
    rng = np.random.default_rng([case.seed, 2, 100 + day])
    return _write(folder, plan, table_text(run, machine.measured(run, _action(run, acting), rng)))


def _write(folder, plan, table):
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "run.csv").write_text(table)
    (folder / "case.yaml").write_text(case_text(plan))
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
        "gross": case.gross,
        "wander": case.wander,
        "repeats": case.repeats,
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
