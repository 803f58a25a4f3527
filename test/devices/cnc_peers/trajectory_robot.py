"""A robot behind a joint trajectory controller, without ROS: what ros2_control does with goals.

It follows the controller of ros2_controllers (Jazzy): cubic polynomials between the points, a new
goal ends the one before, a cancelled goal brakes, tolerances are judged, and a controller that is
deactivated aborts its goal. Codes and words are the real ones.
"""

from dataclasses import dataclass

import numpy as np

SUCCEEDED, CANCELED, ABORTED = "succeeded", "canceled", "aborted"
PREEMPTED = "Current goal preempted by new incoming action."
DEACTIVATED = "Current goal cancelled during deactivate transition."
OFF_PATH = "Aborted due to path tolerance violation"
REACHED = "Goal successfully reached!"


@dataclass
class Goal:
    """A goal at work: its key, its tolerances, and s after its last point."""

    key: object
    path_tolerance: np.ndarray
    goal_tolerance: np.ndarray
    time_tolerance: float


class TrajectoryRobot:
    """Joints that a controller moves; times are in s.

    Attributes:
        controller: state of the controller.
        hardware: state of the hardware.
        lag: s by which actual positions follow the desired ones.
        offsets: joint → what its actual position is off, in its unit.
        deceleration: with which a cancelled goal brakes, units/s².
        override: part of the speed at which trajectories run.
        ended: key, outcome, code and words of each goal that has ended and was not fetched.
        done: key and last point of each goal that was reached, in their order.
        accepted: how many goals were.
    """

    def __init__(self, joints, deceleration=1.0):
        self.names = list(joints)
        self.controller = self.hardware = "active"
        self.lag, self.offsets, self.override = 0.0, {}, 1.0
        self.deceleration = deceleration
        self.ended, self.done, self.accepted = [], [], 0
        self._goal = None
        here = np.array([float(joints[name]) for name in self.names])
        self._path = [(0.0, here, np.zeros_like(here))]
        self._begun = self._now = self._at = 0.0

    def positions(self):
        """Return joint → actual position."""
        desired, velocity = self._desired()
        actual = desired - self.lag * velocity
        return {
            name: float(value + self.offsets.get(name, 0.0))
            for name, value in zip(self.names, actual, strict=True)
        }

    @property
    def moving(self):
        return bool(np.any(self._desired()[1]))

    @property
    def share(self):
        """Which part of the time of the goal at work has passed; 0 if there is none."""
        return 0.0 if self._goal is None else min(self._at / self._path[-1][0], 1.0)

    def accept(self, key, names, points, tolerances, now):
        """Take a goal of points (s, positions, velocities); return whether it is accepted.

        ``tolerances``: of the path and of the goal, in the order of the names, and s.
        """
        self.step(now)
        if self.controller != "active" or sorted(names) != sorted(self.names) or not points:
            return False
        order = [names.index(name) for name in self.names]
        path, goal, seconds = tolerances
        self._end(ABORTED, -1, PREEMPTED)
        self._follow([(t, np.array(p)[order], np.array(v)[order]) for t, p, v in points])
        self._goal = Goal(key, np.array(path)[order], np.array(goal)[order], seconds)
        self.accepted += 1
        return True

    def cancel(self, now, key=None):
        """Cancel a goal, or whichever there is."""
        self.step(now)
        if self._goal is not None and key in (None, self._goal.key):
            self._end(CANCELED, 0, "")
            self.hold()

    def deactivate(self, now):
        """Do what a switch of controllers does."""
        self.step(now)
        self.controller = "inactive"
        self._end(ABORTED, -1, DEACTIVATED)
        self.hold()

    def hold(self):
        """Brake to rest, with the deceleration of the controller."""
        here, velocity = self._desired()
        takes = float(np.max(np.abs(velocity))) / self.deceleration
        stop = (takes, here + velocity * takes / 2.0, np.zeros_like(here))
        self._follow([stop] if takes else [])

    def step(self, now):
        """Let time pass, and judge the goal."""
        self._at += max(now - self._now, 0.0) * self.override
        self._now = max(now, self._now)
        goal = self._goal
        if goal is None:
            return
        desired = self._desired()[0]
        off = np.abs(desired - np.array(list(self.positions().values())))
        left = self._at - self._path[-1][0]
        if left <= 0.0:
            if np.any(off > goal.path_tolerance):
                self._end(ABORTED, -4, OFF_PATH)
                self.hold()
        elif np.all(off <= goal.goal_tolerance):
            self.done.append((goal.key, tuple(self._path[-1][1])))
            self._end(SUCCEEDED, 0, REACHED)
        elif left > goal.time_tolerance:
            over = left - goal.time_tolerance
            self._end(ABORTED, -5, f"Aborted due to goal_time_tolerance exceeding by {over:f} s")
            self.hold()

    def _follow(self, points):
        here, velocity = self._desired()
        self._path, self._at = [(0.0, here, velocity if points else 0.0 * velocity), *points], 0.0

    def _end(self, outcome, code, words):
        if self._goal is not None:
            self.ended.append((self._goal.key, outcome, code, words))
            self._goal = None

    def _desired(self):
        at = self._at
        for (t0, p0, v0), (t1, p1, v1) in zip(self._path, self._path[1:], strict=False):
            if at < t1:
                span, share = t1 - t0, (at - t0) / (t1 - t0)
                a, b = span * v0 - (p1 - p0), (p1 - p0) - span * v1
                place = p0 + share * (p1 - p0) + share * (1 - share) * (a * (1 - share) + b * share)
                slope = (p1 - p0) / span
                bend = (1 - 2 * share) * (a * (1 - share) + b * share) + share * (1 - share) * (
                    b - a
                )
                return place, slope + bend / span
        end = self._path[-1][1]
        return end, np.zeros_like(end)
