"""How uncertain the nodes of a pass on the fly will be, before anything moves.

The covariance of a regression does not depend on what is read, only on when and where. A pass that
is driven and read perfectly therefore has the covariance of the real one, if the noise of its
readings and the jitter of its time stamps are those of the laser and the controller.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import sqrt

import numpy as np

from stepdiag_ros.metrology.cell import DriveModel
from stepdiag_ros.metrology.drive import AxisMotion, Trajectory
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.on_the_fly.motion import Motion, motion_of
from stepdiag_ros.metrology.on_the_fly.record import PassRecord
from stepdiag_ros.metrology.on_the_fly.regression import Intervals, covariance_of_nodes
from stepdiag_ros.metrology.refusal import Refusal

_STAY = 0.3
"""At the first and the last node, s."""


@dataclass(frozen=True)
class Streams:
    """What laser and controller give while the axes move.

    Attributes:
        reading_rate: readings in a second, Hz.
        position_rate: actual positions in a second, Hz.
        reading_noise: standard uncertainty of the mean of one second of readings, m √s.
        stamp_jitter: standard deviation of a reading's time stamp, s.
    """

    reading_rate: float = 1000.0
    position_rate: float = 500.0
    reading_noise: float = 0.0
    stamp_jitter: float = 20e-6


@dataclass(frozen=True)
class Pace:
    """How a pass is driven.

    Attributes:
        feed: m/s.
        acceleration: of an axis, m/s².
        corner_time: from the end of one commanded move to the start of the next, s.
        lag: of the axes behind their command, of first order, s. Until it has died away the
            corner's time is not one of rest.
    """

    feed: float
    acceleration: float
    corner_time: float
    lag: float = 0.0


def expected_covariance(targets: Vector, direction: Vector, pace: Pace, streams: Streams) -> Vector:
    """Return the covariance of the nodes of a pass that is measured without a fault.

    Args:
        targets: nodes, m, shape (n, 3).
        direction: of the beam, unit vector, shape (3,).
        pace: of the moves.
        streams: of laser and controller.

    Returns:
        m², shape (n, n).

    Raises:
        ValueError: positions or readings come too seldom for these moves.
    """
    steps = np.diff(targets, axis=0)
    # Axes in the order in which they move: passes that differ in their names alone are the same.
    axes = list(dict.fromkeys(int(axis) for step in steps for axis in np.flatnonzero(step)))
    axes += [axis for axis in range(3) if axis not in axes]
    moves = tuple(tuple(round(abs(float(step[axis])), 9) for axis in axes) for step in steps)
    along = tuple(round(abs(float(direction[axis])), 9) for axis in axes)
    return _covariance(moves, along, pace, streams)


@lru_cache(maxsize=256)
def _covariance(
    moves: tuple[tuple[float, ...], ...],
    direction: tuple[float, ...],
    pace: Pace,
    streams: Streams,
) -> Vector:
    targets = np.concatenate((np.zeros((1, 3)), np.cumsum(np.array(moves), axis=0)))
    record = _driven(targets, np.array(direction), pace, streams)
    motion = motion_of(record)
    if not isinstance(motion, Motion):
        raise Refusal(
            f"a pass at {pace.feed:g} m/s cannot be measured on the fly: {motion.text}",
            fault="out_of_range",
        )
    onsets = np.round(motion.onsets * 1e9).astype(np.int64) + motion.origin
    number = np.searchsorted(onsets, record.reading_times, side="right")
    return covariance_of_nodes(
        record,
        motion,
        Intervals(number, frozenset()),
        noise=streams.reading_noise * sqrt(streams.reading_rate),
        jitter=streams.stamp_jitter,
    )


def _driven(targets: Vector, direction: Vector, pace: Pace, streams: Streams) -> PassRecord:
    """Return the record of a perfect pass: from stay to stay, with a pause in each corner."""
    paths, begins, begin = [], [], _STAY
    for step in np.diff(targets, axis=0):
        length = float(np.linalg.norm(step))
        most = float(np.max(np.abs(step))) / length
        path = Trajectory.trapezoid(0.0, length, pace.feed, pace.acceleration / most)
        paths.append(AxisMotion(path, DriveModel(lag_s=pace.lag)))
        begins.append(begin)
        begin += path.duration + pace.corner_time
    end = begin - pace.corner_time + _STAY
    at = np.arange(0.0, end, 1.0 / streams.position_rate)
    positions = np.tile(targets[0], (len(at), 1))
    units = np.diff(targets, axis=0)
    units = units / np.linalg.norm(units, axis=1)[:, np.newaxis]
    for motion, start, unit in zip(paths, begins, units, strict=True):
        moved = at > start
        positions[moved] += np.outer(motion.position(at[moved] - start), unit)
    times = np.arange(0.0, end, 1.0 / streams.reading_rate)
    return PassRecord(
        targets=targets,
        direction=direction,
        position_times=np.round(at * 1e9).astype(np.int64),
        positions=positions,
        reading_times=np.round(times * 1e9).astype(np.int64),
        sequences=np.arange(len(times), dtype=np.int64),
        displacements=np.zeros(len(times)),
        statuses=np.zeros(len(times), dtype=np.uint8),
    )
