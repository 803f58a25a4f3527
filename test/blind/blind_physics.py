"""The effects of the blind test, each written from its physics: run and size → what acts.

The words of METROLOGY's cases fix sign and size: a lost motion stands short by its half in the
sense of the axis's last move, growth is counted from 20 degC, and so on. ``INSIDE`` are kinds that
a catalogue of step-diagonal work must hold, ``OUTSIDE`` are real ones that none is asked to hold.
"""

from dataclasses import dataclass, field

import numpy as np
from blind_kinematics import Action

HOUR = 3600.0
AIR_PER_KELVIN = 0.93e-6
PAIRS = ("xy", "xz", "yz")


@dataclass(frozen=True)
class Hidden:
    """An effect without its size: kind, where it acts, and numbers that shape it."""

    kind: str
    setting: dict = field(default_factory=dict)

    def act(self, run, size):
        """What it does at this size (its unit: see the function of its kind)."""
        return KINDS[self.kind](run, size, **self.setting)

    def __str__(self):
        return f"{self.kind} {' '.join(f'{key}={value}' for key, value in self.setting.items())}"


def _along(run, axis, amounts):
    action = Action.none(len(run.time))
    place = "XYZ".index(axis)
    action.shift[place, :, place] = amounts
    return action


def _reading(run, amounts):
    action = Action.none(len(run.time))
    action.reading[:] = amounts
    return action


def _share(run):
    return run.position / run.travel


def backlash(run, size, axis):
    """Lost motion, m."""
    return _along(run, axis, -0.5 * size * run.came[:, "XYZ".index(axis)])


def settling(run, size, axis):
    """The axis that has just moved stands short of its target, m."""
    return _along(run, axis, -size * run.moved[:, "XYZ".index(axis)])


def growth(run, size, axis):
    """Thermal growth of an axis's scale with the material, per K."""
    place = "XYZ".index(axis)
    return _along(run, axis, size * run.position[:, place] * (run.material - 20.0))


def growth_in_time(run, size, axis):
    """Growth of an axis's scale in proportion to time, per hour."""
    place = "XYZ".index(axis)
    return _along(run, axis, size * run.position[:, place] * run.time / HOUR)


def angular(run, size, error):
    """Rotation in proportion to the way, rad at the end of the travel."""
    action = Action.none(len(run.time))
    axis = "XYZ".index(error[3])
    action.turn[axis, :, "ABC".index(error[2])] = size * _share(run)[:, axis]
    return action


def dead_path(run, size):
    """Dead path that is not compensated, m per K of the air."""
    return _reading(run, size * (run.air - 20.0))


def air(run, size):
    """Part by which the compensation follows the air's temperature too little, per kelvin."""
    action = Action.none(len(run.time))
    action.scale[:] = size * (run.air - 20.0)
    return action


def cosine(run, size, setup):
    """Scale of all readings of one setup."""
    action = Action.none(len(run.time))
    action.scale[run.setup == setup] = size
    return action


def slip(run, size, setup, repeat, direction, stop):
    """The counter of the interferometer is off from a stop on until the next zero, m."""
    place = next(
        place
        for place, row in enumerate(run.rows)
        if run.setup[place] == setup and row[3:] == (repeat, direction, stop)
    )
    later = (np.arange(len(run.time)) >= place) & (run.setup == setup)
    return _reading(run, size * later)


def sag(run, size, component, pair):
    """The tool sinks with the product of two axes' ways, m at their far ends."""
    share = _share(run)
    product = share[:, "xyz".index(pair[0])] * share[:, "xyz".index(pair[1])]
    action = Action.none(len(run.time))
    # A translation of the carriage next to the workpiece: nothing turns before it.
    first = "XYZ".index(run.plan.chain[0])
    action.shift[first, :, "xyz".index(component)] = size * product
    return action


def drift(run, size, direction):
    """The structure moves steadily along an axis, m per hour."""
    action = Action.none(len(run.time))
    action.shift["XYZ".index(run.plan.chain[0]), :, "xyz".index(direction)] = size * run.time / HOUR
    return action


def reading_drift(run, size):
    """The interferometer drifts steadily, m per hour."""
    return _reading(run, size * run.time / HOUR)


def cubic_sag(run, size, component):
    """Sag with the product of all three ways, m at the far corner."""
    action = Action.none(len(run.time))
    first = "XYZ".index(run.plan.chain[0])
    action.shift[first, :, "xyz".index(component)] = size * np.prod(_share(run), axis=1)
    return action


def chiller(run, size, period, phase, direction):
    """A cooler switches on and off and bends the column, unseen by the sensors, m."""
    cycle = np.sign(np.sin(2.0 * np.pi * run.time / period + phase))
    action = Action.none(len(run.time))
    action.shift["XYZ".index(run.plan.chain[0]), :, "xyz".index(direction)] = size * cycle
    return action


def random_walk(run, size, seed):
    """Structure that wanders, m over an hour (standard deviation)."""
    rng = np.random.default_rng(seed)
    pace = np.sqrt(np.diff(run.time, prepend=run.time[0]) / HOUR)
    return _reading(run, size * np.cumsum(rng.standard_normal(len(pace)) * pace))


def cross_talk(run, size, axis, other):
    """Lost motion of an axis that grows with the place of another, m at its far end."""
    place = "XYZ".index(axis)
    return _along(run, axis, -0.5 * size * run.came[:, place] * _share(run)[:, "XYZ".index(other)])


def stick_slip(run, size, axis, seed):
    """At each reversal the axis catches elsewhere, m (standard deviation)."""
    rng = np.random.default_rng(seed)
    came = run.came[:, "XYZ".index(axis)]
    reversals = np.cumsum(np.diff(came, prepend=came[0]) != 0.0)
    return _along(run, axis, size * rng.standard_normal(reversals[-1] + 1)[reversals])


def worn_spot(run, size, axis, other, width, centre_1, centre_2):
    """A guide worn where two axes meet: a bump of straightness in their plane, m."""
    share = _share(run)
    one = share[:, "XYZ".index(axis)] - centre_1
    two = share[:, "XYZ".index(other)] - centre_2
    component = next(letter for letter in "ZXY" if letter not in (axis, other))
    action = Action.none(len(run.time))
    action.shift["XYZ".index(axis), :, "XYZ".index(component)] = size * np.exp(
        -(one**2 + two**2) / (2.0 * width**2)
    )
    return action


KINDS = {
    function.__name__: function
    for function in (
        backlash,
        settling,
        growth,
        growth_in_time,
        angular,
        dead_path,
        air,
        cosine,
        slip,
        sag,
        drift,
        reading_drift,
        cubic_sag,
        chiller,
        random_walk,
        cross_talk,
        stick_slip,
        worn_spot,
    )
}
INSIDE = (
    "backlash",
    "settling",
    "growth",
    "growth_in_time",
    "angular",
    "dead_path",
    "air",
    "cosine",
    "slip",
    "sag",
    "drift",
    "reading_drift",
)
"""Kinds that the issue asks the catalogue to hold, whose words leave no freedom of definition."""

OUTSIDE = ("cubic_sag", "chiller", "random_walk", "cross_talk", "stick_slip", "worn_spot")
ANGLES = tuple(f"E_{about}{axis}" for axis in "XYZ" for about in "ABC")


def draw_hidden(rng, kind, run):
    """Draw where an effect of a kind acts in a run."""
    axis, other = (str(letter) for letter in rng.permutation(list("XYZ"))[:2])
    lower = str(rng.choice(list("xyz")))
    seed = int(rng.integers(2**31))
    if kind in ("backlash", "settling", "growth", "growth_in_time"):
        return Hidden(kind, {"axis": axis})
    if kind == "angular":
        return Hidden(kind, {"error": str(rng.choice(ANGLES))})
    if kind == "cosine":
        return Hidden(kind, {"setup": int(rng.integers(len(run.plan.setups)))})
    if kind == "slip":
        place = int(rng.integers(len(run.rows)))
        repeat, direction, stop = run.rows[place][3:]
        place_setup = int(run.setup[place])
        # The first stop of a setup is its zero: a slip there shows nothing.
        return Hidden(
            kind,
            {
                "setup": place_setup,
                "repeat": repeat,
                "direction": direction,
                "stop": max(int(stop), 1),
            },
        )
    if kind == "sag":
        return Hidden(kind, {"component": lower, "pair": str(rng.choice(PAIRS))})
    if kind == "drift":
        return Hidden(kind, {"direction": lower})
    if kind == "cubic_sag":
        return Hidden(kind, {"component": lower})
    if kind == "chiller":
        period, phase = float(rng.uniform(150.0, 900.0)), float(rng.uniform(0.0, 2.0 * np.pi))
        return Hidden(kind, {"period": period, "phase": phase, "direction": lower})
    if kind == "random_walk":
        return Hidden(kind, {"seed": seed})
    if kind == "stick_slip":
        return Hidden(kind, {"axis": axis, "seed": seed})
    if kind == "cross_talk":
        return Hidden(kind, {"axis": axis, "other": other})
    if kind == "worn_spot":
        width, one, two = rng.uniform([0.1, 0.2, 0.2], [0.25, 0.8, 0.8])
        shape = {"width": float(width), "centre_1": float(one), "centre_2": float(two)}
        return Hidden(kind, {"axis": axis, "other": other, **shape})
    return Hidden(kind)
