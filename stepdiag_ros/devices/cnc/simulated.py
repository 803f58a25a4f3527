"""A simulated controller: trapezoidal moves, drives with lag, exact in-position times."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.cnc import (
    CncEvent,
    CncState,
    Point,
    PositionSample,
    StateChange,
    Traits,
    not_ready,
    still_moves,
)
from stepdiag_ros.devices.cnc.move_check import ROUNDING, check_target
from stepdiag_ros.devices.grid import SampleGrid
from stepdiag_ros.metrology.cell import DriveModel
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.drive import AxisMotion, StraightMove, Trajectory
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.refusal import Refusal

SERVO_PERIOD = 1_000_000
"""ns: the controller looks at its encoders once in this time."""

STILL = 1e-13
"""m: an axis nearer than this to its end is taken to have reached it."""


class SimulatedCnc:
    """A controller of three axes (protocol: ``CncDevice``).

    Args:
        machine: travel, limits, acceleration and in-position window.
        drive: lag and settling of the axes.
        start: ns; the machine stands at ``position`` then.
        position: X Y Z, m.
        sample_rate: of the position samples, Hz.
    """

    def __init__(
        self,
        machine: Machine,
        drive: DriveModel,
        start: int,
        position: Point = (0.0, 0.0, 0.0),
        sample_rate: float = 200.0,
    ) -> None:
        self._machine = machine
        self._drive = drive
        self._now = start
        self._grid = SampleGrid(start, sample_rate)
        self._started = [start] * 3
        self._motions = [
            AxisMotion(Trajectory.trapezoid(value, value, 1.0, 1.0), drive) for value in position
        ]
        self._still_after = [0] * 3
        # Axes of the present move, and how each brakes without leaving the path, m/s².
        self._moving: dict[int, float] = {}
        self._state = CncState.READY
        self._events: list[CncEvent] = []
        # When the present motion is over (ns), and what the controller says then.
        self._ends: int | None = None
        self._ends_as = CncState.READY
        self._reason = ""
        self._faults: list[tuple[int, str]] = []

    @property
    def state(self) -> CncState:
        """State at the last time passed to the device."""
        return self._state

    @property
    def soft_limits(self) -> tuple[Point, Point]:
        """Lower and upper soft limits of X, Y, Z, m."""
        return self._machine.travel_low_m, self._machine.travel_high_m

    @property
    def traits(self) -> Traits:
        """Encoders without a step, the limits of the machine file, and nothing to be braked."""
        acceleration, feed = self._machine.acceleration_m_per_s2, self._machine.feed_limit_m_per_s
        return Traits(
            resolution=(0.0, 0.0, 0.0),
            acceleration=(acceleration, acceleration, acceleration),
            feed_limit=(feed, feed, feed),
            dead_man=0.0,
            simulated=True,
        )

    def start_move(self, time_ns: int, target: Point, feed: float, axes: str) -> None:
        """Begin a straight move of the named axes (see ``CncDevice.start_move``)."""
        self._advance(time_ns)
        self._check(target, feed, axes)
        ends = np.array([motion.trajectory.end for motion in self._motions])
        acceleration = self._machine.acceleration_m_per_s2
        move = StraightMove.between(ends, np.asarray(target), feed, acceleration)
        self._moving = move.accelerations
        for axis, trajectory in move.trajectories.items():
            # Where the encoder is now: the last move may still be settling within the window.
            since = (self._now - self._started[axis]) * 1e-9
            actual = float(self._motions[axis].position(since))
            self._set_motion(axis, AxisMotion(trajectory, self._drive, start=actual))
            self._started[axis] = self._now
        self._change(self._now, CncState.MOVING, "")
        self._ends = self._in_position_time()
        self._ends_as = CncState.READY
        self._reason = ""

    def stop(self, time_ns: int, reason: str) -> None:
        """Brake to rest at once; STOPPED, with the reason, is reported when the axes stand."""
        self._advance(time_ns)
        if self._state in (CncState.STOPPED, CncState.FAULT):
            return
        if self._state is CncState.READY:
            self._change(self._now, CncState.STOPPED, reason)
            return
        self._brake(self._now)
        self._ends = self._in_position_time()
        self._ends_as = CncState.STOPPED
        self._reason = reason

    def reset(self, time_ns: int) -> None:
        """Become READY again after a stop or a fault whose cause is gone."""
        self._advance(time_ns)
        if self._state is CncState.READY:
            return
        if self._state is CncState.MOVING or self._now < self._command_ends():
            raise still_moves()
        self._change(self._now, CncState.READY, "")

    def inject_fault(self, time_ns: int, reason: str) -> None:
        """Make the controller faulty at a time, for tests: the drives brake."""
        self._faults.append((max(time_ns, self._now), reason))
        self._faults.sort()

    def poll(self, time_ns: int) -> list[CncEvent]:
        """Return what has happened since the last poll, in order of time."""
        self._advance(time_ns)
        events, self._events = self._events, []
        return events

    def close(self) -> None:
        """Let the controller go."""

    def _check(self, target: Point, feed: float, axes: str) -> None:
        """Refuse a move that the controller would not make."""
        if self._state is not CncState.READY:
            raise not_ready(self._state)
        x, y, z = (motion.trajectory.end for motion in self._motions)
        # A target made from encoder values differs from the command by up to the window: no move,
        # but the axis still goes exactly to its target. What is simulated was never rounded.
        check_target(
            (x, y, z),
            target,
            feed,
            axes,
            limits=self.soft_limits,
            feed_limit=self._machine.feed_limit_m_per_s,
            near=[self._machine.position_window_m - ROUNDING] * 3,
        )

    def _advance(self, time_ns: int) -> None:
        """Bring the controller to a time, noting what happens until then in order of time."""
        now = max(time_ns, self._now)
        while True:
            fault = self._faults[0][0] if self._faults else now + 1
            end = self._ends if self._ends is not None else now + 1
            happens = min(fault, end)
            if happens > now:
                break
            self._sample(happens)
            if fault <= end:
                reason = self._faults.pop(0)[1]
                self._brake(happens)
                self._ends = None
                self._change(happens, CncState.FAULT, reason)
            else:
                self._ends = None
                self._change(happens, self._ends_as, self._reason)
        self._sample(now)
        self._now = now

    def _sample(self, until: int) -> None:
        times = self._grid.take(until)
        if times:
            positions = self._positions(np.array(times, dtype=np.int64)).tolist()
            self._events.extend(
                PositionSample(time, (x, y, z))
                for time, (x, y, z) in zip(times, positions, strict=True)
            )

    def _positions(self, times: NDArray[np.int64]) -> Vector:
        positions = np.empty((len(times), 3))
        for axis, (motion, started) in enumerate(zip(self._motions, self._started, strict=True)):
            if times[0] >= started + self._still_after[axis]:
                positions[:, axis] = motion.trajectory.end
            else:
                since = np.asarray((times - started) * 1e-9, dtype=np.float64)
                positions[:, axis] = motion.position(since)
        return positions

    def _set_motion(self, axis: int, motion: AxisMotion) -> None:
        self._motions[axis] = motion
        self._still_after[axis] = round(motion.time_within(STILL) * 1e9)

    def _change(self, time: int, state: CncState, reason: str) -> None:
        x, y, z = self._positions(np.array([time], dtype=np.int64))[0].tolist()
        self._state = state
        self._events.append(StateChange(time, state, (x, y, z), reason))

    def _brake(self, time: int) -> None:
        for axis, braking in self._moving.items():
            since = (time - self._started[axis]) * 1e-9
            self._set_motion(axis, self._motions[axis].braked(since, braking))

    def _command_ends(self) -> int:
        """Return when no axis is commanded to move any more, ns."""
        return max(
            started + round(motion.trajectory.duration * 1e9)
            for motion, started in zip(self._motions, self._started, strict=True)
        )

    def _in_position_time(self) -> int:
        """Return when all axes have been within the window of their ends for the hold time, ns.

        As a controller finds it: looked at once in a servo period, and not before the command
        itself has come to rest.
        """
        window = self._machine.position_window_m
        hold = round(self._machine.position_hold_s * 1e9 / SERVO_PERIOD)
        surely = max(
            started + round(motion.time_within(window) * 1e9)
            for motion, started in zip(self._motions, self._started, strict=True)
        )
        first = max(self._now, self._command_ends())
        count = max(surely - first, 0) // SERVO_PERIOD + hold + 2
        cycles = first + np.arange(count, dtype=np.int64) * SERVO_PERIOD
        targets = np.array([motion.trajectory.end for motion in self._motions])
        within = np.all(np.abs(self._positions(cycles) - targets) <= window, axis=-1)
        run = 0
        for cycle, inside in zip(cycles.tolist(), within.tolist(), strict=True):
            run = run + 1 if inside else 0
            if run > hold:
                return int(cycle)
        raise AssertionError("the axes never come to rest")


def from_settings(
    settings: Mapping[str, Any], surroundings: Surroundings
) -> Callable[[int], SimulatedCnc]:
    """Return what switches a simulated controller on at a time, ns.

    Settings: ``position_rate_hz`` (default 200), ``start_position_m`` (default: 0, 0, 0, moved into
    the travel where that lies outside it).

    Raises:
        ValueError: a setting is wrong, or there is no machine or cell.
    """
    if surroundings.machine is None or surroundings.cell is None:
        raise Refusal(
            "the simulated controller needs a machine and a simulated cell", fault="missing"
        )
    machine, drive = surroundings.machine, surroundings.cell.drive
    section = Section(settings, "settings of the simulated controller")
    inside = np.clip(np.zeros(3), machine.travel_low_m, machine.travel_high_m)
    position = section.vector("start_position_m", default=tuple(inside.tolist()))
    rate = section.number("position_rate_hz", low=1.0, high=10_000.0, default=200.0)
    section.finish()
    for name, value, low, high in zip(
        AXES, position, machine.travel_low_m, machine.travel_high_m, strict=True
    ):
        if not low <= value <= high:
            raise Refusal(
                f"start_position_m: {name} = {value:g} m lies beyond the soft limits "
                f"{low:g} m to {high:g} m",
                fault="out_of_range",
            )
    return lambda start: SimulatedCnc(machine, drive, start, position, rate)
