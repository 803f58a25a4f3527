"""Motion of one axis as closed functions of time: what is commanded, and where the axis really is.

Times are seconds since the start of the motion; the axis stands still before. Everything is
vectorised.
"""

from dataclasses import dataclass
from math import exp, log, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.cell import DriveModel
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal


@dataclass(frozen=True)
class Trajectory:
    """A commanded motion in pieces of constant acceleration, at rest before and after.

    Attributes:
        times: at which the pieces begin, s, rising from 0, shape (pieces,); the last piece is the
            rest.
        positions: at those times, m, shape (pieces,).
        velocities: at those times, m/s, shape (pieces,).
        accelerations: from those times on, m/s², shape (pieces,); 0 in the last piece.
    """

    times: Vector
    positions: Vector
    velocities: Vector
    accelerations: Vector

    @classmethod
    def trapezoid(
        cls, start: float, target: float, feed: float, acceleration: float
    ) -> "Trajectory":
        """Return the fastest motion between two positions within a feed and an acceleration.

        Args:
            start: m.
            target: m.
            feed: largest speed, m/s, > 0; not reached on a short way.
            acceleration: m/s², > 0.

        Raises:
            ValueError: feed or acceleration is not positive.
        """
        if not feed > 0.0 or not acceleration > 0.0:
            raise Refusal(
                f"feed is {feed:g} m/s and acceleration {acceleration:g} m/s²; "
                "both must be positive",
                fault="out_of_range",
            )
        way = abs(target - start)
        if way == 0.0:
            return _trajectory([0.0], [start], [0.0], [0.0])
        sign = 1.0 if target > start else -1.0
        peak = min(feed, sqrt(way * acceleration))
        ramp = peak / acceleration
        ramp_way = 0.5 * peak * ramp
        cruise = (way - 2.0 * ramp_way) / peak if peak == feed else 0.0
        return _trajectory(
            [0.0, ramp, ramp + cruise, 2.0 * ramp + cruise],
            [start, start + sign * ramp_way, target - sign * ramp_way, target],
            [0.0, sign * peak, sign * peak, 0.0],
            [sign * acceleration, 0.0, -sign * acceleration, 0.0],
        )

    @property
    def duration(self) -> float:
        """Return the time after which the command stands still, s."""
        return float(self.times[-1])

    @property
    def end(self) -> float:
        """Return the position in which the motion ends, m."""
        return float(self.positions[-1])

    def position(self, time: float | Vector) -> Vector:
        """Return the commanded position, m, of the shape of ``time``."""
        piece, since = self._piece(time)
        position: Vector = self.positions[piece] + since * (
            self.velocities[piece] + 0.5 * since * self.accelerations[piece]
        )
        return position

    def velocity(self, time: float | Vector) -> Vector:
        """Return the commanded velocity, m/s, of the shape of ``time``."""
        piece, since = self._piece(time)
        velocity: Vector = self.velocities[piece] + since * self.accelerations[piece]
        return velocity

    def stopped(self, time: float, acceleration: float) -> "Trajectory":
        """Return the motion that is the same up to a time and is then braked to rest.

        Args:
            time: s.
            acceleration: of the braking, m/s², > 0.

        Raises:
            ValueError: the acceleration is not positive.
        """
        if not acceleration > 0.0:
            raise ValueError(f"acceleration is {acceleration:g} m/s²; it must be positive")
        time = max(time, 0.0)
        if time >= self.duration:
            return self
        position, velocity = float(self.position(time)), float(self.velocity(time))
        braking = abs(velocity) / acceleration
        kept = self.times < time
        return _trajectory(
            [*self.times[kept], time, time + braking],
            [*self.positions[kept], position, position + 0.5 * velocity * braking],
            [*self.velocities[kept], velocity, 0.0],
            [*self.accelerations[kept], -acceleration if velocity > 0.0 else acceleration, 0.0],
        )

    def _piece(self, time: float | Vector) -> tuple[NDArray[np.intp], Vector]:
        moment = np.maximum(np.asarray(time, dtype=np.float64), 0.0)
        piece = np.searchsorted(self.times, moment, side="right") - 1
        return piece, moment - self.times[piece]


@dataclass(frozen=True)
class StraightMove:
    """A linearly interpolated move: its axes share one profile, so that the path is straight.

    Attributes:
        trajectories: of each axis that moves.
        accelerations: with which each of them brakes so that the path stays straight, m/s².
    """

    trajectories: dict[int, Trajectory]
    accelerations: dict[int, float]

    @classmethod
    def between(
        cls, start: Vector, target: Vector, feed: float, acceleration: float
    ) -> "StraightMove":
        """Return the fastest straight move within a feed along the path.

        No axis exceeds the acceleration; none exceeds the feed, since none is faster than the path.

        Args:
            start: m, shape (axes,).
            target: m, shape (axes,).
            feed: along the path, m/s, > 0.
            acceleration: of an axis, m/s², > 0.

        Raises:
            ValueError: feed or acceleration is not positive.
        """
        start, target = np.asarray(start, dtype=np.float64), np.asarray(target, dtype=np.float64)
        way = target - start
        length = float(np.linalg.norm(way))
        if length == 0.0:
            return cls({}, {})
        share = way / length
        path = Trajectory.trapezoid(0.0, length, feed, acceleration / float(np.max(np.abs(share))))
        trajectories, accelerations = {}, {}
        for axis in np.flatnonzero(way).tolist():
            positions = start[axis] + share[axis] * path.positions
            # Where the move ends is no matter of rounding: the same place is the same number.
            positions[-1] = target[axis]
            trajectories[axis] = Trajectory(
                path.times,
                positions,
                share[axis] * path.velocities,
                share[axis] * path.accelerations,
            )
            accelerations[axis] = float(np.max(np.abs(trajectories[axis].accelerations)))
        return cls(trajectories, accelerations)


class AxisMotion:
    """Where an axis really is while it follows a trajectory with a lag and comes to rest.

    The first-order lag obeys τ·y' + y = c. In a piece in which the command is c(t) = c₀ + v·t +
    a·t²/2 it has the exact solution y(t) = c(t) - τ·c'(t) + τ²·a + (y₀ - c₀ + τ·v -
    τ²·a)·exp(-t/τ). When the command has come to rest, a decaying vibration A·exp(-t/T)·sin(2π·f·t)
    is added in the sense of the last movement.

    Args:
        trajectory: that is commanded.
        drive: lag and vibration.
        start: actual position at time 0, m; where the trajectory starts if not given.
    """

    def __init__(
        self, trajectory: Trajectory, drive: DriveModel, start: float | None = None
    ) -> None:
        self.trajectory = trajectory
        self._drive = drive
        # Below the resolution of time, a nanosecond, a lag is none.
        self._lag = drive.lag_s if drive.lag_s > 1e-9 else 0.0
        self._decay = drive.settling_time_s
        self._circular_frequency = 2.0 * pi * drive.settling_frequency_hz
        # The sense of the last movement; nothing vibrates where nothing has moved.
        moves = np.diff(trajectory.positions)
        last = moves[np.nonzero(moves)[0][-1:]]
        self._amplitude = drive.settling_amplitude_m * float(np.sign(last[0])) if last.size else 0.0
        self._starts = self._actual_at_pieces(
            float(trajectory.positions[0]) if start is None else start
        )

    def position(self, time: float | Vector) -> Vector:
        """Return the actual position, m, of the shape of ``time`` (s)."""
        moment = np.maximum(np.asarray(time, dtype=np.float64), 0.0)
        path = self.trajectory
        actual = path.position(moment)
        if self._lag > 0.0:
            piece = np.searchsorted(path.times, moment, side="right") - 1
            lag = self._lag
            acceleration = path.accelerations[piece]
            behind = lag * (path.velocity(moment) - lag * acceleration)
            begin = self._starts[piece] - path.positions[piece]
            begin = begin + lag * (path.velocities[piece] - lag * acceleration)
            actual = actual - behind + begin * np.exp(-(moment - path.times[piece]) / lag)
        if self._amplitude:
            rest = np.maximum(moment - path.duration, 0.0)
            actual = actual + self._amplitude * np.exp(-rest / self._decay) * np.sin(
                self._circular_frequency * rest
            )
        return actual

    def braked(self, time: float, acceleration: float) -> "AxisMotion":
        """Return the motion whose command is braked to rest from a time (s) on; the past stays.

        Args:
            time: s.
            acceleration: of the braking, m/s², > 0.

        Raises:
            ValueError: the acceleration is not positive.
        """
        path = self.trajectory.stopped(time, acceleration)
        return AxisMotion(path, self._drive, start=float(self._starts[0]))

    def time_within(self, distance: float) -> float:
        """Return a time from which on the axis surely stays within a distance of its end, s.

        It is the time at which the envelope of lag and vibration falls to the distance: exact for a
        lag alone unless the axis gets there before the command has come to rest, never too early.

        Args:
            distance: m, > 0.
        """
        path = self.trajectory
        remaining = abs(float(self._starts[-1]) - path.end) if self._lag > 0.0 else 0.0
        after = 0.0
        # Each part within its share; the slower of the two decides.
        share = distance if not (remaining and self._amplitude) else 0.5 * distance
        if remaining > share:
            after = self._lag * log(remaining / share)
        if abs(self._amplitude) > share:
            after = max(after, self._decay * log(abs(self._amplitude) / share))
        return path.duration + after

    def _actual_at_pieces(self, start: float) -> Vector:
        path = self.trajectory
        starts = [start]
        lag = self._lag
        for piece in range(len(path.times) - 1):
            length = float(path.times[piece + 1] - path.times[piece])
            acceleration = float(path.accelerations[piece])
            velocity = float(path.velocities[piece])
            if lag == 0.0:
                starts.append(float(path.positions[piece + 1]))
                continue
            end_velocity = velocity + acceleration * length
            begin = (
                starts[-1] - float(path.positions[piece]) + lag * (velocity - lag * acceleration)
            )
            starts.append(
                float(path.positions[piece + 1])
                - lag * (end_velocity - lag * acceleration)
                + begin * exp(-length / lag)
            )
        return np.array(starts)


def _trajectory(
    times: list[float], positions: list[float], velocities: list[float], accelerations: list[float]
) -> Trajectory:
    return Trajectory(
        np.array(times), np.array(positions), np.array(velocities), np.array(accelerations)
    )
