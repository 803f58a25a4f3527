"""The effects of the blind test, each written from its physics: run and size → what acts.

The words of METROLOGY's cases fix sign and size: a lost motion stands short by its half in the
sense of the axis's last move, growth is counted from 20 degC, and so on.
"""

import numpy as np
from blind_kinematics import Action

HOUR = 3600.0
HALF_WAVE = 632.8e-9 / 2.0
"""Way of the mirror for one fringe of a helium-neon laser, m."""
MOUNT = 0.1
"""Of a mirror that is mounted elsewhere: its distance from where it stands in other setups, m."""


def along_axis(run, axis, amounts):
    """An axis stands elsewhere along itself."""
    action = Action.none(len(run.time))
    place = "XYZ".index(axis)
    action.shift[place, :, place] = amounts
    return action


def of_structure(run, direction, amounts):
    """What stands next to the workpiece moves: nothing turns before it."""
    action = Action.none(len(run.time))
    action.shift["XYZ".index(run.plan.chain[0]), :, "xyz".index(direction)] = amounts
    return action


def on_reading(run, amounts):
    action = Action.none(len(run.time))
    action.reading[:] = amounts
    return action


def on_scale(run, parts):
    action = Action.none(len(run.time))
    action.scale[:] = parts
    return action


def turned(run, error, angles):
    """An axis turns, rad."""
    action = Action.none(len(run.time))
    action.turn["XYZ".index(error[3]), :, "ABC".index(error[2])] = angles
    return action


def share_of(run):
    """Way over travel of each axis, (n, 3)."""
    return run.position / run.travel


def place_of(run, setup, repeat, direction, stop):
    """Row of a stop."""
    return next(
        place
        for place, row in enumerate(run.rows)
        if run.setup[place] == setup and row[3:] == (repeat, direction, stop)
    )


def backlash(run, size, axis):
    """Lost motion, m."""
    return along_axis(run, axis, -0.5 * size * run.came[:, "XYZ".index(axis)])


def settling(run, size, axis):
    """The axis that has just moved stands short of its target, m."""
    return along_axis(run, axis, -size * run.moved[:, "XYZ".index(axis)])


def servo_lag(run, size):
    """All axes stand short of the target alike, along the path of their move, m."""
    length = np.linalg.norm(run.way, axis=1)
    unit = run.way / np.where(length > 0.0, length, 1.0)[:, None]
    action = Action.none(len(run.time))
    for axis in range(3):
        action.shift[axis, :, axis] = -size * unit[:, axis]
    return action


def trigger(run, size):
    """Readings are taken so much later than the mean motion to the stop says, s."""
    pause = np.diff(run.time, prepend=run.time[0])
    moves = (run.number > 0) & (pause > 0.0)
    speed = np.sum(run.way * run.beam, axis=1) / np.where(moves, pause, 1.0)
    return on_reading(run, size * np.where(moves, speed, 0.0))


def growth(run, size, axis):
    """Thermal growth of an axis's scale with the material, per K."""
    place = "XYZ".index(axis)
    return along_axis(run, axis, size * run.position[:, place] * (run.material - 20.0))


def growth_in_time(run, size, axis):
    """Growth of an axis's scale in proportion to time, per hour."""
    place = "XYZ".index(axis)
    return along_axis(run, axis, size * run.position[:, place] * run.time / HOUR)


def warming_growth(run, size, axis, constant):
    """Growth of an axis's scale that comes to rest exponentially, its final value."""
    place = "XYZ".index(axis)
    warm = 1.0 - np.exp(-run.time / constant)
    return along_axis(run, axis, size * run.position[:, place] * warm)


def angular(run, size, error):
    """Rotation in proportion to the way, rad at the end of the travel."""
    return turned(run, error, size * share_of(run)[:, "XYZ".index(error[3])])


def curved_angular(run, size, error, bend):
    """Rotation that grows faster or slower with the way: size·(u + bend·u²), rad."""
    share = share_of(run)[:, "XYZ".index(error[3])]
    return turned(run, error, size * (share + bend * share**2))


def wavy_angular(run, size, error, waves, phase):
    """Rotation to and fro along the way, rad (amplitude)."""
    share = share_of(run)[:, "XYZ".index(error[3])]
    wave = np.sin(2.0 * np.pi * waves * share + phase) - np.sin(phase)
    return turned(run, error, size * wave)


def dead_path(run, size):
    """Dead path that is not compensated, m per K of the air."""
    return on_reading(run, size * (run.air - 20.0))


def air(run, size):
    """Part by which the compensation follows the air's temperature too little, per kelvin."""
    return on_scale(run, size * (run.air - 20.0))


def air_pressure(run, size):
    """Part by which the compensation follows the air's pressure too little, per pascal."""
    return on_scale(run, size * (run.pressure - 101325.0))


def expansion(run, size):
    """Readings are brought to 20 degC with a coefficient that is off by so much, per kelvin."""
    return on_scale(run, size * (run.material - 20.0))


def cosine(run, size, setup):
    """Scale of all readings of one setup."""
    return on_scale(run, np.where(run.setup == setup, size, 0.0))


def slip(run, size, setup, repeat, direction, stop):
    """The counter of the interferometer is off from a stop on until the next zero, m."""
    place = place_of(run, setup, repeat, direction, stop)
    later = (np.arange(len(run.time)) >= place) & (run.setup == setup)
    return on_reading(run, size * later)


def beam_break(run, size, setup, repeat, direction, stop):
    """The beam is broken and the counter set anew with a wrong value, for the rest of a pass, m."""
    place = place_of(run, setup, repeat, direction, stop)
    later = (np.arange(len(run.time)) >= place) & (run.passes == run.passes[place])
    return on_reading(run, size * later)


def nonlinearity(run, size, setup, part):
    """The reading swings with the phase of the light, m (amplitude)."""
    action = Action.none(len(run.time))
    action.fringe[run.setup == setup] = size
    action.fringe_period = HALF_WAVE / part
    return action


def beam_walk(run, size):
    """The mirror is hollow, its middle stands back: curvature, 1/m."""
    return on_reading(run, 0.5 * size * np.sum(run.sideways**2, axis=1))


def mirror_tilt(run, size, setup, angle):
    """The mirror of a setup turns on its mount in proportion to the way, rad at the line's end."""
    action = Action.none(len(run.time))
    here = run.setup == setup
    beam = run.beam[here][0]
    across = np.linalg.svd(beam[None, :])[2][1:]
    about = np.cos(angle) * across[0] + np.sin(angle) * across[1]
    share = run.along[here] / np.abs(run.along[here]).max()
    action.mirror[here] = size * share[:, None] * about
    return action


def abbe(run, size, setup, axis):
    """The mirror of a setup is mounted elsewhere, and the axis next to the workpiece rolls.

    Nobody else sees that roll: it moves all mirrors at one place alike, as straightness does. The
    size is the length that roll and mount add up to along the beam at the travel's end, m.
    """
    place = "XYZ".index(axis)
    here = run.setup == setup
    arm = np.cross(np.eye(3)[place], run.beam[here][0])
    length = np.linalg.norm(arm)
    angle = size / (MOUNT * length) * share_of(run)[:, place]
    action = turned(run, f"E_{'ABC'[place]}{axis}", angle)
    action.mount[here] = -MOUNT * arm / length
    return action


def sag(run, size, component, pair):
    """The tool sinks with the product of two axes' ways, m at their far ends."""
    share = share_of(run)
    product = share[:, "xyz".index(pair[0])] * share[:, "xyz".index(pair[1])]
    return of_structure(run, component, size * product)


def drift(run, size, direction):
    """The structure moves steadily along an axis, m per hour."""
    return of_structure(run, direction, size * run.time / HOUR)


def warming_drift(run, size, direction, constant):
    """The structure moves along an axis and comes to rest exponentially, m in the end."""
    return of_structure(run, direction, size * (1.0 - np.exp(-run.time / constant)))


def reading_drift(run, size):
    """The interferometer drifts steadily, m per hour."""
    return on_reading(run, size * run.time / HOUR)


def warming_laser(run, size, constant):
    """The interferometer drifts and comes to rest exponentially, m in the end."""
    return on_reading(run, size * (1.0 - np.exp(-run.time / constant)))


def pitch(run, size, axis, period):
    """The axis swings once a turn of its ball screw, m (amplitude)."""
    place = "XYZ".index(axis)
    return along_axis(run, axis, size * np.sin(2.0 * np.pi * run.position[:, place] / period))


def scale(run, size, axis):
    """The axis's scale is too long, part of its way."""
    return along_axis(run, axis, size * run.position[:, "XYZ".index(axis)])


def squareness(run, size, axis, component):
    """The line of an axis leans towards another axis, rad."""
    place = "XYZ".index(axis)
    action = Action.none(len(run.time))
    action.shift[place, :, "XYZ".index(component)] = size * run.position[:, place]
    return action


def wavelength(run, size):
    """All readings are too long, part of them."""
    return on_scale(run, size)


def roll(run, size, error):
    """The axis next to the workpiece turns about itself, rad at the end of its travel."""
    return angular(run, size, error)
