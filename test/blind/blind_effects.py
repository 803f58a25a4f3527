"""All effects of the blind test by name, and where each is drawn to act."""

from dataclasses import dataclass, field

import blind_physics
import blind_strange
import numpy as np

PAIRS = ("xy", "xz", "yz")
ANGLES = tuple(f"E_{about}{axis}" for axis in "XYZ" for about in "ABC")
LEADS = (4e-3, 5e-3, 10e-3, 16e-3, 20e-3)
SIGNALS = (20e-6, 40e-6)
"""Periods of the signal of a linear scale, m."""
FINE_NOISE = 20e-9
"""Noise below which an error of the interferometer within one fringe can be seen, m."""

INSIDE = (
    "backlash",
    "settling",
    "servo_lag",
    "trigger",
    "growth",
    "growth_in_time",
    "warming_growth",
    "angular",
    "curved_angular",
    "wavy_angular",
    "dead_path",
    "air",
    "air_pressure",
    "expansion",
    "cosine",
    "slip",
    "beam_break",
    "nonlinearity",
    "beam_walk",
    "mirror_tilt",
    "abbe",
    "sag",
    "drift",
    "warming_drift",
    "reading_drift",
    "warming_laser",
)
"""Kinds that the issue asks the catalogue to hold, and that a run can show beyond free curves."""

STRONG = tuple(kind for kind in INSIDE if kind != "nonlinearity")
"""Those that can plausibly be five times their detection limit."""

OUTSIDE = (
    "cubic_sag",
    "bent_sag",
    "thermal_turn",
    "chiller",
    "random_walk",
    "cross_talk",
    "stick_slip",
    "worn_spot",
    "quadrant_bend",
    "creep",
    "load_hysteresis",
    "loose_mirror",
    "vibration",
    "warm_spot",
    "interpolation",
)
"""Real ones that no catalogue is asked to hold."""

UNSEEN = ("scale", "squareness", "pitch", "wavelength", "roll", "nonlinearity")
"""Those that free curves, or the noise, hide from everybody: they must be said not to be testable.

A nonlinearity is one where the noise is above FINE_NOISE.
"""

KINDS = {
    **{name: getattr(blind_physics, name) for name in (*INSIDE, *UNSEEN)},
    **{name: getattr(blind_strange, name) for name in OUTSIDE},
}
RANDOM = ("random_walk", "stick_slip")
_SINGLE_SETUP = ("cosine", "mirror_tilt", "abbe", "nonlinearity")


@dataclass(frozen=True)
class Hidden:
    """An effect without its size: kind, where it acts, and numbers that shape it."""

    kind: str
    setting: dict = field(default_factory=dict)

    def act(self, run, size):
        """What it does at this size (its unit: see the function of its kind)."""
        return KINDS[self.kind](run, size, **self.setting)

    @property
    def stays(self):
        """Whether it acts in another run too: not what belongs to one alignment or one pass."""
        return "setup" not in self.setting

    def __str__(self):
        return f"{self.kind} {' '.join(f'{key}={value}' for key, value in self.setting.items())}"


def roll_of(chain):
    """Name of the rotation about itself of the axis next to the workpiece."""
    return f"E_{'ABC'['XYZ'.index(chain[0])]}{chain[0]}"


def draw_hidden(rng, kind, run):
    """Draw where an effect of a kind acts in a run; None if it cannot act in it."""
    axis, other = (str(letter) for letter in rng.permutation(list("XYZ"))[:2])
    component = str(rng.choice(list("xyz")))
    error = str(rng.choice(ANGLES))
    # From a tenth of the run to the whole of it: shorter is over at once, longer is a steady drift.
    constant = float(run.time[-1] * np.exp(rng.uniform(np.log(0.1), 0.0)))
    seed = int(rng.integers(2**31))
    if kind in _SINGLE_SETUP:
        return _of_one_setup(rng, kind, run)
    if kind == "loose_mirror":
        return _of_some_stops(rng, kind, run)
    if kind in ("slip", "beam_break"):
        return _of_one_stop(rng, kind, run)
    settings = {
        "backlash": {"axis": axis},
        "settling": {"axis": axis},
        "growth": {"axis": axis},
        "growth_in_time": {"axis": axis},
        "warming_growth": {"axis": axis, "constant": constant},
        "angular": {"error": error},
        "curved_angular": {"error": error, "bend": float(rng.uniform(-0.6, 0.6))},
        "wavy_angular": {
            "error": error,
            "waves": int(rng.integers(1, 3)),
            "phase": float(rng.uniform(0.0, 2.0 * np.pi)),
        },
        "sag": {"component": component, "pair": str(rng.choice(PAIRS))},
        "drift": {"direction": component},
        "warming_drift": {"direction": component, "constant": constant},
        "warming_laser": {"constant": constant},
        "roll": {"error": roll_of(run.plan.chain)},
        "scale": {"axis": axis},
        "squareness": {"axis": axis, "component": other},
        "pitch": {"axis": axis, "period": float(rng.choice(LEADS))},
        "cubic_sag": {"component": component},
        "bent_sag": {"component": component, "axis": axis, "other": other},
        "thermal_turn": {"error": error},
        "chiller": {
            "period": float(rng.uniform(150.0, 900.0)),
            "phase": float(rng.uniform(0.0, 2.0 * np.pi)),
            "direction": component,
        },
        "random_walk": {"seed": seed},
        "stick_slip": {"axis": axis, "seed": seed},
        "cross_talk": {"axis": axis, "other": other},
        "quadrant_bend": {"component": component, "axis": axis, "other": other},
        "creep": {"axis": axis, "constant": float(rng.uniform(20.0, 80.0))},
        "load_hysteresis": {
            "component": component,
            "axis": axis,
            "other": str(rng.permutation([one for one in "XYZ" if one != axis])[0]),
        },
        "vibration": {"component": component, "axis": axis, "other": other},
        "warm_spot": {
            "centre": [float(one) for one in rng.uniform(0.3, 0.7, 3)],
            "radius": float(rng.uniform(0.2, 0.4)),
        },
        "interpolation": {
            "axis": axis,
            "other": other,
            "period": float(rng.choice(SIGNALS)),
            "phase": float(rng.uniform(0.0, 2.0 * np.pi)),
            "stretch": float(rng.uniform(20e-6, 120e-6)),
        },
        "worn_spot": {
            "axis": axis,
            "other": other,
            "width": float(rng.uniform(0.1, 0.25)),
            "centre_1": float(rng.uniform(0.2, 0.8)),
            "centre_2": float(rng.uniform(0.2, 0.8)),
        },
    }
    return Hidden(kind, settings.get(kind, {}))


def _of_one_setup(rng, kind, run):
    kinds = np.array([setup.kind for setup in run.plan.setups])
    fitting = np.arange(len(kinds))
    if kind in ("mirror_tilt", "abbe"):
        fitting = np.flatnonzero(kinds == "step_diagonal")
    setup = {"setup": int(rng.choice(fitting))}
    if kind == "mirror_tilt":
        return Hidden(kind, {**setup, "angle": float(rng.uniform(0.0, np.pi))})
    if kind == "nonlinearity":
        # A finer swing than half a wavelength is lost in any noise of this test.
        part = 1 if run.plan.noise <= FINE_NOISE else int(rng.integers(1, 3))
        return Hidden(kind, {**setup, "part": part})
    if kind == "abbe":
        return Hidden(kind, {**setup, "axis": run.plan.chain[0]})
    return Hidden(kind, setup)


def _of_some_stops(rng, kind, run):
    setup = int(rng.choice(run.setup))
    times = np.sort(run.time[run.setup == setup])
    first = int(rng.integers(1, max(len(times) - 4, 2)))
    last = int(rng.integers(min(first + 3, len(times) - 1), len(times)))
    return Hidden(kind, {"setup": setup, "begin": float(times[first]), "end": float(times[last])})


def _of_one_stop(rng, kind, run):
    places = np.arange(len(run.rows))
    if kind == "beam_break":
        # In the last pass of a setup it is a slip; there is none if every setup has one pass.
        last = {int(setup): int(run.passes[run.setup == setup].max()) for setup in set(run.setup)}
        places = [place for place in places if run.passes[place] != last[int(run.setup[place])]]
    if not len(places):
        return None
    place = int(rng.choice(places))
    repeat, direction, stop = run.rows[place][3:]
    # The first stop of a setup is its zero: a slip there shows nothing.
    where = {"repeat": repeat, "direction": direction, "stop": max(int(stop), 1)}
    return Hidden(kind, {"setup": int(run.setup[place]), **where})
