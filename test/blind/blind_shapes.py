"""Harmless shapes of the blind test: error curves of the axes, and noise as instruments make it."""

import numpy as np


def two_waves(rng, share):
    """Two waves of random whole numbers and phases over the travel."""
    first, second = rng.choice(np.arange(1, 5), 2, replace=False)
    phases = rng.uniform(0.0, 2.0 * np.pi, 2)
    weight = rng.uniform(0.3, 1.0)
    curve = np.sin(2.0 * np.pi * first * share + phases[0])
    return curve + weight * np.sin(2.0 * np.pi * second * share + phases[1])


def spline(rng, share):
    """A natural cubic spline through five to seven random knots."""
    from scipy.interpolate import CubicSpline

    knots = np.linspace(0.0, 1.0, int(rng.integers(5, 8)))
    return CubicSpline(knots, rng.standard_normal(len(knots)), bc_type="natural")(share)


def saw_tooth(rng, share):
    """A saw-tooth, as a scale in pieces makes it, on a random slope."""
    teeth = rng.uniform(1.5, 5.0)
    return 2.0 * ((teeth * share + rng.random()) % 1.0) - 1.0 + rng.standard_normal() * share


SHAPES = (two_waves, spline, saw_tooth)


def draw_curves(rng, blocks):
    """Draw the nine translational curves at the nodes, m, (3 axes, nodes, 3 components).

    Straightness always has two waves, and a further shape on top of them. All begin at zero; slopes
    are left in, as squareness and scale of the axes.
    """
    share = np.linspace(0.0, 1.0, blocks + 1)
    curves = np.zeros((3, blocks + 1, 3))
    for axis in range(3):
        for component in range(3):
            shape = SHAPES[rng.integers(len(SHAPES))]
            curve = rng.uniform(0.3e-6, 2e-6) * shape(rng, share)
            if axis != component:
                curve += rng.uniform(0.3e-6, 2e-6) * two_waves(rng, share)
            curve += rng.normal(0.0, 3e-6) * share
            curves[axis, :, component] = curve - curve[0]
    return curves


def draw_noise(rng, n, sigma, memory=True):
    """Noise with standard deviation ``sigma`` and, if wished, a slight memory of the last stop."""
    remembered = rng.uniform(0.0, 0.2) * float(memory)
    fresh = rng.normal(0.0, sigma * np.sqrt(1.0 - remembered**2), n)
    noise = np.empty(n)
    last = rng.normal(0.0, sigma)
    for place in range(n):
        last = remembered * last + fresh[place]
        noise[place] = last
    return noise


def quantised(values, step):
    return np.round(values / step) * step
