"""The hidden machine with its laser: on every day the same but for alignment, noise, weather."""

import numpy as np
from blind_kinematics import Action, displacements
from blind_plans import make_run
from blind_shapes import draw_curves, draw_noise, quantised


class Machine:
    """A machine and its laser on one day.

    Args:
        seed: of the case.
        plan: that is measured on this day.
        day: 0 is that of the first run; on others everything is aligned anew, and the room has
            another temperature.
    """

    def __init__(self, seed, plan, day=0):
        rng = np.random.default_rng([seed, 1])
        self.plan = plan
        self.curves = draw_curves(rng, plan.blocks)
        self.resolution = float(rng.choice([1e-9, 2e-9, 5e-9, 10e-9])) if plan.memory else 1e-10
        senseless = rng.random() < 0.5 or not plan.memory
        rng = np.random.default_rng([seed, 5, day])
        setups = len(plan.setups)
        # How the axes came to a setup no table tells; half the machines come without a sense.
        self.approach = rng.choice([-1.0, 0.0, 1.0], (setups, 3)) * float(not senseless)
        turns = rng.standard_normal((setups, 3))
        turns *= rng.uniform(0.1e-3, 0.3e-3) / np.linalg.norm(turns, axis=1, keepdims=True)
        self.beam_tilt = turns
        # A mirror is set to return the beam: it follows the beam's tilt but for a little.
        self.mirror_tilt = self.beam_tilt + rng.normal(0.0, 0.02e-3, (setups, 3))
        self.lengths = rng.normal(0.0, 2e-6, 3) if day else np.zeros(3)

    def run(self):
        return make_run(self.plan, self.approach)

    def alignment(self, run):
        """Beam, mirror normal and source of each stop."""

        def unit(vectors):
            return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

        beam = unit(run.beam + np.cross(self.beam_tilt[run.setup], run.beam))
        normal = unit(run.beam + np.cross(self.mirror_tilt[run.setup], run.beam))
        return beam, normal, run.start - run.dead_path * beam

    def translations(self, run):
        """Error motions of the axes at each stop, straight between the nodes, m, (3, n, 3)."""
        nodes = np.arange(self.plan.blocks + 1)
        moved = np.zeros((3, len(run.time), 3))
        for axis in range(3):
            place = run.position[:, axis] / self.plan.step[axis]
            for component in range(3):
                curve = self.curves[axis, :, component]
                moved[axis, :, component] = np.interp(place, nodes, curve)
            moved[axis, :, axis] += self.lengths[axis] * run.position[:, axis]
        return moved

    def shown(self, run, action):
        """What the interferometer shows without noise, zeroed at each setup's first stop, m."""
        values = displacements(
            self.plan.chain, run, self.translations(run), action, self.alignment(run)
        )
        return zeroed(values, run.setup)

    def signature(self, run, hidden, unit=1e-6):
        """Change of the readings by a unit of an effect, (n,)."""
        if hidden.kind == "nonlinearity":
            unit = 1e-9
        without = self.shown(run, Action.none(len(run.time)))
        return (self.shown(run, hidden.act(run, unit)) - without) / unit

    def measured(self, run, action, rng, wander=0.0):
        """Readings: what is shown, with noise, resolution and zero, m, (n,).

        Args:
            run: its stops.
            action: of the effects.
            rng: of the noise.
            wander: standard deviation of the laser's zero from pass to pass, m.
        """
        noise = draw_noise(rng, len(run.time), self.plan.noise, self.plan.memory)
        if wander:
            noise = noise + wander * rng.standard_normal(int(run.passes.max()) + 1)[run.passes]
        return zeroed(quantised(self.shown(run, action) + noise, self.resolution), run.setup)


def zeroed(values, setup):
    first = np.concatenate([[0], np.flatnonzero(np.diff(setup)) + 1])
    return values - values[first][np.cumsum(np.isin(np.arange(len(setup)), first)) - 1]
