"""Effects that are real and that no catalogue of step-diagonal work is asked to hold."""

import numpy as np
from blind_kinematics import Action
from blind_physics import HOUR, along_axis, of_structure, on_reading, share_of, turned


def cubic_sag(run, size, component):
    """Sag with the product of all three ways, m at the far corner."""
    return of_structure(run, component, size * np.prod(share_of(run), axis=1))


def bent_sag(run, size, component, axis, other):
    """Sag with the square of one way and another one, m at their far ends."""
    share = share_of(run)
    product = share[:, "XYZ".index(axis)] ** 2 * share[:, "XYZ".index(other)]
    return of_structure(run, component, size * product)


def thermal_turn(run, size, error):
    """An axis turns along its way the more, the warmer it is, rad per kelvin at the end."""
    share = share_of(run)[:, "XYZ".index(error[3])]
    return turned(run, error, size * share * (run.material - 20.0))


def chiller(run, size, period, phase, direction):
    """A cooler switches on and off and bends the column, unseen by the sensors, m."""
    cycle = np.sign(np.sin(2.0 * np.pi * run.time / period + phase))
    return of_structure(run, direction, size * cycle)


def random_walk(run, size, seed):
    """Structure that wanders, m over an hour (standard deviation)."""
    rng = np.random.default_rng(seed)
    pace = np.sqrt(np.diff(run.time, prepend=run.time[0]) / HOUR)
    return on_reading(run, size * np.cumsum(rng.standard_normal(len(pace)) * pace))


def cross_talk(run, size, axis, other):
    """Lost motion of an axis that grows with the place of another, m at its far end."""
    place = "XYZ".index(axis)
    return along_axis(
        run, axis, -0.5 * size * run.came[:, place] * share_of(run)[:, "XYZ".index(other)]
    )


def stick_slip(run, size, axis, seed):
    """At each reversal the axis catches elsewhere, m (standard deviation)."""
    rng = np.random.default_rng(seed)
    came = run.came[:, "XYZ".index(axis)]
    reversals = np.cumsum(np.diff(came, prepend=came[0]) != 0.0)
    return along_axis(run, axis, size * rng.standard_normal(reversals[-1] + 1)[reversals])


def worn_spot(run, size, axis, other, width, centre_1, centre_2):
    """A guide worn where two axes meet: a bump of straightness in their plane, m."""
    share = share_of(run)
    one = share[:, "XYZ".index(axis)] - centre_1
    two = share[:, "XYZ".index(other)] - centre_2
    component = next(letter for letter in "ZXY" if letter not in (axis, other))
    action = Action.none(len(run.time))
    action.shift["XYZ".index(axis), :, "XYZ".index(component)] = size * np.exp(
        -(one**2 + two**2) / (2.0 * width**2)
    )
    return action


def quadrant_bend(run, size, component, axis, other):
    """A frame bends only where two carriages are both beyond the middle, m at their far ends."""
    beyond = np.maximum(share_of(run) - 0.5, 0.0) * 2.0
    return of_structure(
        run, component, size * beyond[:, "XYZ".index(axis)] * beyond[:, "XYZ".index(other)]
    )


def creep(run, size, axis, constant):
    """An axis stands short after a reversal, and creeps to where it should be, m at first."""
    came = run.came[:, "XYZ".index(axis)]
    order = np.argsort(run.time, kind="stable")
    turned_at = np.zeros(len(run.time))
    since = run.time[order[0]]
    for before, row in zip(np.append(order[0], order[:-1]), order, strict=True):
        if came[row] != came[before] or run.setup[row] != run.setup[before]:
            since = run.time[row]
        turned_at[row] = since
    return along_axis(run, axis, -0.5 * size * came * np.exp((turned_at - run.time) / constant))


def load_hysteresis(run, size, component, axis, other):
    """A carriage tips over as its drive pulls or pushes, the more the farther another one is, m."""
    came = run.came[:, "XYZ".index(axis)]
    return of_structure(run, component, 0.5 * size * came * share_of(run)[:, "XYZ".index(other)])


def loose_mirror(run, size, setup, begin, end):
    """A mirror jumps, and jumps back, m."""
    there = (run.setup == setup) & (run.time >= begin) & (run.time < end)
    return on_reading(run, size * there)


def vibration(run, size, component, axis, other):
    """A pump shakes the bridge, and contacts that give one way more than the other shift its mean.

    A contact that yields by c·x² beside what it yields in proportion stands off by c·a²/2 in the
    mean of a swing of amplitude a. The bridge swings as a beam on two bearings, most in the middle
    of one axis, and a ram beneath it in proportion to how far it stands out; m at the largest.
    """
    share = share_of(run)
    bridge = np.sin(np.pi * share[:, "XYZ".index(axis)])
    amplitude = bridge * share[:, "XYZ".index(other)]
    return of_structure(run, component, size * amplitude**2)


def warm_spot(run, size, centre, radius):
    """A ball of warm air, above a motor, through which the beam passes: m along its diameter.

    Air that is warmer is thinner, so each metre of path in it reads less by the same part. The beam
    of a setup stands still; it crosses the ball on a chord, of which the path up to the mirror
    holds none, some or all.

    Args:
        run: its stops.
        size: of the reading, m.
        centre: of the ball, parts of the travels.
        radius: of the ball, part of the shortest travel.
    """
    middle = np.asarray(centre) * run.travel - run.start
    along = np.sum(middle * run.beam, axis=1)
    reach = radius * run.travel.min()
    off = np.linalg.norm(middle - along[:, None] * run.beam, axis=1)
    half = np.sqrt(np.maximum(reach**2 - off**2, 0.0))
    begin = np.maximum(along - half, -run.dead_path)
    inside = np.clip(run.along, begin, np.maximum(along + half, begin)) - begin
    return on_reading(run, -size * inside / (2.0 * reach))


def interpolation(run, size, axis, other, period, phase, stretch):
    """A scale's two signals are no perfect sine and cosine: a swing within their period, m.

    Alike everywhere it would be a part of the axis's own curve. Here another axis tips the head off
    its scale the farther it is out, and the distortion grows in proportion; m at its far end.
    Steps are whole or half periods but for the stretch of the scale, which the control compensates:
    stop by stop the swing is seen a little later in its period.
    """
    on_scale = run.position[:, "XYZ".index(axis)] * (1.0 + stretch)
    swing = np.sin(2.0 * np.pi * on_scale / period + phase)
    return along_axis(run, axis, size * swing * share_of(run)[:, "XYZ".index(other)])
