"""Axes that ros2_control moves: straight moves by a joint trajectory controller.

A move is one goal of ``FollowJointTrajectory``, whose trajectory has the feed and the acceleration
of the move. Whether it has arrived is judged by the actual positions of ``joint_states`` alone. The
controller manager is asked twice a second for the states of the controller and of the hardware.

The driver does not import ROS: the node gives it a ``JointController``. A controller has no
watchdog for the goals of its clients: when the process of the driver ends in a move, the move goes
on to its target.

Source: ``control_msgs/action/FollowJointTrajectory`` and the joint trajectory controller of
ros2_controllers, as in ROS 2 Jazzy; what it does in each case is in ``docs/ros2_control.md``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from math import isfinite
from typing import Any

from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.cnc import (
    UNKNOWN_POINT,
    CncEvent,
    CncState,
    MoveRefused,
    Point,
    PositionSample,
    StateChange,
    Traits,
    not_ready,
    still_moves,
)
from stepdiag_ros.devices.cnc.joint_axes import (
    JointAxes,
    JointLimits,
    limits_from_urdf,
    straight_move,
)
from stepdiag_ros.devices.cnc.joint_controller import (
    ControllerNames,
    GoalAnswer,
    GoalEnd,
    JointController,
    JointSample,
    ManagerReport,
    News,
    OtherGoals,
    Outcome,
    RobotDescription,
    Trajectory,
)
from stepdiag_ros.devices.cnc.move_check import check_target, far_axes
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.refusal import Refusal, Silent
from stepdiag_ros.metrology.units import NANOSECONDS

ARRIVED_IN = NANOSECONDS
"""ns in which the axes are at the target when the controller reports success."""
ASK_PERIOD = NANOSECONDS // 2
"""ns between two questions to the controller manager."""
CLOCK_LIMIT = NANOSECONDS
"""ns by which the time of a position may differ from ours, if it may not be late by more."""
HEALED_IN = NANOSECONDS
"""ns without trouble after which axes at rest, whose controller could not be used, are ready."""
STRAYED = 1e-4
"""m: an axis that stands moves no farther, whatever its servo does."""
CODES = {
    -1: "the goal was not valid any more",
    -2: "the joints are not those of the controller",
    -3: "the time of the goal is in the past",
    -4: "a joint left its path tolerance",
    -5: "a joint did not reach its goal tolerance in time",
}
"""Error code of ``FollowJointTrajectory`` → meaning."""
OTHER_CLIENT = "another node moves the joints: it has sent the controller a goal"


@dataclass(frozen=True)
class Ros2ControlSettings:
    """Settings of the driver.

    Attributes:
        names: of the controller and what belongs to it, in ROS.
        axes: which joints move X, Y and Z.
        acceleration: of moves, of X, Y and Z, m/s²; a URDF does not have it.
        path_tolerance: by which a joint may lag behind its path, m at its axis.
        gantry_tolerance: by which the two joints of one axis may disagree, m.
        resolution: step of the positions, m.
        measured: the positions come from encoders or scales.
        rate: positions in a second that are passed on.
        silence: s without a position after which the joints count as lost.
        answer_limit: s in which the controller answers to a goal, and its manager to a question.
        stop_limit: s in which the axes stand after a stop.
    """

    names: ControllerNames
    axes: JointAxes
    acceleration: Point
    path_tolerance: float = 2e-3
    gantry_tolerance: float = 0.5e-3
    resolution: float = 0.0
    measured: bool = True
    rate: float = 50.0
    silence: float = 0.5
    answer_limit: float = 2.0
    stop_limit: float = 3.0

    @classmethod
    def from_mapping(cls, settings: Mapping[str, Any]) -> "Ros2ControlSettings":
        """Take the settings from the parsed YAML of a device file.

        Raises:
            ValueError: a setting is wrong, missing or not known.
        """
        section = Section(settings, "settings of the ros2_control driver")
        made = cls(
            names=ControllerNames(
                controller=_absolute(section, "controller"),
                manager=_absolute(section, "controller_manager", "/controller_manager"),
                joint_states=_absolute(section, "joint_states", "/joint_states"),
                description=_absolute(section, "robot_description", "/robot_description", True),
            ),
            axes=JointAxes.from_section(section.section("joints")),
            acceleration=section.vector("acceleration_m_per_s2", low=1e-4, high=100.0),
            path_tolerance=section.number("path_tolerance_m", 1e-6, 0.1, default=2e-3),
            gantry_tolerance=section.number("gantry_tolerance_m", 1e-6, 0.1, default=0.5e-3),
            resolution=section.number("resolution_m", 0.0, 1e-3, default=0.0),
            measured=section.flag("measured", default=True),
            rate=section.number("position_rate_hz", 1.0, 10_000.0, default=50.0),
            silence=section.number("silence_s", 0.05, 10.0, default=0.5),
            answer_limit=section.number("answer_limit_s", 0.5, 60.0, default=2.0),
            stop_limit=section.number("stop_limit_s", 0.1, 60.0, default=3.0),
        )
        section.finish()
        return made


def _absolute(section: Section, key: str, default: str = "", empty: bool = False) -> str:
    name = section.text(key, default) if default else section.text(key)
    if not name.startswith("/") and not (empty and not name):
        raise Refusal(
            f"{section.source}: '{key}' is '{name}'; expected the whole name, with its namespace,"
            " such as /cell/gantry_controller",
            fault="malformed",
            about=key,
        )
    return name


class _Doing(Enum):
    CONNECTING = "is being connected"
    NOTHING = "does nothing"
    MOVING = "moves"
    STOPPING = "brakes"


class Ros2ControlCnc:
    """Three axes behind a joint trajectory controller (protocol: ``CncDevice``).

    It is FAULT, and refuses moves, until controller, hardware and positions are there.

    Args:
        machine: travel, feed limit, window and hold time.
        settings: of the driver.
        controller: the ROS side.
        start: now, ns.
    """

    def __init__(
        self,
        machine: Machine,
        settings: Ros2ControlSettings,
        controller: JointController,
        start: int,
    ) -> None:
        self._machine, self._settings, self._controller = machine, settings, controller
        self._axes = settings.axes
        self._now = self._told = start
        self._limits: dict[str, JointLimits] | None = None
        if not settings.names.description:
            self._limits = dict.fromkeys(self._axes.names, JointLimits())
        self._position: Point = UNKNOWN_POINT
        self._heard, self._sampled = start, 0
        self._unusable = ""
        self._report: ManagerReport | None = None
        self._asked = self._reported = start
        self._others = 0
        self._goal, self._answered, self._ended = 0, True, True
        self._commanded: Point = UNKNOWN_POINT
        self._target: Point = UNKNOWN_POINT
        self._within: int | None = None
        self._rest: tuple[int, Point] = (start, UNKNOWN_POINT)
        self._why = ""
        self._events: list[CncEvent] = []
        # Since when nothing is wrong any more with a controller that failed while the axes stood;
        # None: the fault is one that only a reset ends.
        self._heals: int | None = None
        self._state, self._reason = CncState.FAULT, ""
        self._doing, self._since = _Doing.CONNECTING, start
        self._change(start, CncState.FAULT, f"the controller {_Doing.CONNECTING.value}")
        controller.ask_manager()

    @property
    def state(self) -> CncState:
        """State at the last time passed to the device."""
        return self._state

    @property
    def soft_limits(self) -> tuple[Point, Point]:
        """Lower and upper limits of X, Y, Z, m: the tighter of the machine file and the URDF."""
        machine = self._machine
        if self._limits is None:
            return machine.travel_low_m, machine.travel_high_m
        lows, highs = self._axes.travel(self._limits)
        low_x, low_y, low_z = map(max, lows, machine.travel_low_m)
        high_x, high_y, high_z = map(min, highs, machine.travel_high_m)
        return (low_x, low_y, low_z), (high_x, high_y, high_z)

    @property
    def traits(self) -> Traits:
        """What the device file and the URDF say of the axes."""
        settings, step = self._settings, self._settings.resolution
        return Traits(
            resolution=(step, step, step),
            acceleration=settings.acceleration,
            feed_limit=UNKNOWN_POINT if self._limits is None else self._axes.speeds(self._limits),
            measured=settings.measured,
        )

    def start_move(self, time_ns: int, target: Point, feed: float, axes: str) -> None:
        """Begin a straight move of the named axes (see ``CncDevice.start_move``)."""
        now = self._tick(time_ns)
        if self._doing is _Doing.CONNECTING:
            raise MoveRefused(self._reason)
        if self._state is not CncState.READY:
            raise not_ready(self._state)
        check_target(
            self._position,
            target,
            feed,
            axes,
            limits=self.soft_limits,
            feed_limit=self._machine.feed_limit_m_per_s,
            near=self._near,
        )
        self._target, self._within, self._ended = target, None, True
        if axes:
            self._send(target, feed, axes)
        self._begin(_Doing.MOVING)
        self._change(now, CncState.MOVING, "")

    def _send(self, target: Point, feed: float, axes: str) -> None:
        """Send a goal; axes that do not move keep the place that they were last sent to."""
        x, y, z = (
            new if axis in axes else old
            for axis, new, old in zip(AXES, target, self._commanded, strict=True)
        )
        end, settings, mapping = (x, y, z), self._settings, self._axes
        if end == self._commanded:
            return
        self._goal += 1
        self._answered = self._ended = False
        trajectory = Trajectory(
            joints=mapping.names,
            points=straight_move(mapping, self._commanded, end, feed, settings.acceleration),
            path_tolerance=mapping.tolerances(settings.path_tolerance),
            goal_tolerance=mapping.tolerances(
                self._machine.position_window_m + settings.resolution
            ),
            goal_time_tolerance=ARRIVED_IN / NANOSECONDS,
        )
        self._commanded = end
        self._controller.send(self._goal, trajectory)

    def stop(self, time_ns: int, reason: str) -> None:
        """Brake to rest at once; STOPPED, with the reason, is reported when the axes stand."""
        now = self._tick(time_ns)
        if self._doing is _Doing.CONNECTING or self._state is CncState.STOPPED:
            return
        if not self._ended:
            self._controller.cancel()
        if self._state is CncState.READY:
            self._change(now, CncState.STOPPED, reason)
        elif self._doing is _Doing.MOVING:
            self._why = reason
            self._rest = (now, UNKNOWN_POINT)
            self._begin(_Doing.STOPPING)

    def reset(self, time_ns: int) -> None:
        """Become READY again after a stop or a fault whose cause is gone.

        Raises:
            MoveRefused: the axes still move, or the controller cannot be used; the text says why.
        """
        now = self._tick(time_ns)
        if self._state is CncState.READY:
            return
        if self._doing is _Doing.CONNECTING:
            raise MoveRefused(self._reason)
        if self._state is CncState.MOVING or not self._stands(now):
            raise still_moves()
        # A controller that was restarted does not know the goal any more, and never ends it.
        if not self._ended and now - self._since < self._answered_in:
            raise still_moves()
        if trouble := self._trouble():
            raise MoveRefused(trouble)
        self._take_up(now)

    def poll(self, time_ns: int) -> list[CncEvent]:
        """Return what has happened since the last poll, in order of time."""
        now = self._tick(time_ns)
        for one in self._controller.news():
            self._take(one)
        if now - self._asked >= ASK_PERIOD:
            self._asked = now
            self._controller.ask_manager()
        self._judge(now)
        events, self._events = self._events, []
        return events

    def close(self) -> None:
        """Let the controller go; a move that is left behind is cancelled."""
        self._controller.close()

    # What it says ---------------------------------------------------------------------------------

    def _take(self, news: News) -> None:
        match news:
            case JointSample(time, positions):
                self._locate(time, positions)
            case ManagerReport():
                self._report, self._reported = news, self._now
            case RobotDescription(text):
                self._limit(limits_from_urdf(text, self._axes.names))
            case OtherGoals(active):
                self._others = active
            case GoalAnswer(number, accepted):
                self._on_answer(number, accepted)
            case GoalEnd():
                self._on_end(news)

    def _limit(self, limits: dict[str, JointLimits]) -> None:
        self._limits = limits
        for axis, low, high in zip(AXES, *self.soft_limits, strict=True):
            if not low < high:
                raise Refusal(
                    f"the travel of {axis} in the machine file does not overlap with the limits of"
                    " the robot description",
                    fault="mismatch",
                    about=axis,
                )

    def _locate(self, stamp: int, positions: Mapping[str, float]) -> None:
        """Take actual positions; those that cannot be used count as none."""
        names = self._axes.names
        if missing := [name for name in names if name not in positions]:
            # Other joints may have a publisher of their own.
            if len(missing) < len(names) or not self._told_once:
                self._unusable = f"{self._source} lacks {', '.join(missing)}"
            return
        if strange := [name for name in names if not isfinite(positions[name])]:
            self._unusable = f"{self._source}: the position of {', '.join(strange)} is not a number"
            return
        limit = max(CLOCK_LIMIT, self._settings.silence * NANOSECONDS)
        if abs(self._now - stamp) > limit:
            self._unusable = _off_time(self._source, stamp > self._now, limit / NANOSECONDS)
            return
        self._unusable, self._heard = "", self._now
        self._told = max(self._told, min(stamp, self._now))
        self._position = self._axes.point(positions)
        if far_axes(self._rest[1], self._position, self._near):
            self._rest = (self._told, self._position)
        period = NANOSECONDS / self._settings.rate
        if self._told - self._sampled >= 0.999 * period:
            self._sampled = self._told
            self._events.append(PositionSample(self._told, self._position))
        self._watch_gantry(positions)
        if self._doing is _Doing.MOVING:
            self._watch_move(self._told)
        elif self._doing is _Doing.STOPPING:
            self._watch_stop(self._told)
        elif self._state is CncState.READY and self._strayed:
            self._fault("an axis moves without a command of this node")

    def _on_answer(self, number: int, accepted: bool) -> None:
        if number != self._goal:
            return
        self._answered = True
        if not accepted:
            self._ended = True
            self._fault(
                "the controller rejected the goal: its log has the reason; it must be active, and"
                f" its joints must be {', '.join(self._axes.names)}, or it must allow goals for"
                " some of its joints (allow_partial_joints_goal)"
            )

    def _on_end(self, end: GoalEnd) -> None:
        if end.number != self._goal:
            return
        self._answered = self._ended = True
        if self._doing is not _Doing.MOVING:
            return
        self._since = self._now
        if end.outcome is Outcome.SUCCEEDED:
            return
        meaning = CODES.get(end.code, f"error code {end.code}") if end.code else ""
        words = "; ".join(filter(None, (meaning, end.text.strip())))
        self._fault(
            f"the goal {end.outcome.value} by the controller" + (f": {words}" * bool(words))
        )

    # Watching -------------------------------------------------------------------------------------

    def _trouble(self) -> str:
        """Say why no goal would be carried out; empty if it would."""
        names = self._settings.names
        if self._limits is None:
            return (
                f"no robot description has come on {names.description}: start"
                " robot_state_publisher, or set robot_description to '' to use the limits of the"
                " machine file alone"
            )
        if self._now - self._reported > self._answered_in or self._report is None:
            there = ", ".join(self._controller.managers()) or "none"
            return (
                f"the controller manager {names.manager} does not answer; managers that are there:"
                f" {there}"
            )
        if trouble := self._idle(self._report):
            return trouble
        if not self._controller.reachable:
            there = ", ".join(self._controller.alternatives()) or "none"
            return (
                f"there is no action {names.controller}/follow_joint_trajectory; controllers with"
                f" such an action: {there}"
            )
        if self._unusable:
            return self._unusable
        if self._now - self._heard > self._settings.silence * NANOSECONDS or not self._told_once:
            return f"no position has come on {self._source} for {self._settings.silence:g} s"
        return OTHER_CLIENT if self._others else ""

    def _idle(self, report: ManagerReport) -> str:
        """Say which controller or hardware is not active; empty if all are."""
        name = self._settings.names.controller.rpartition("/")[2]
        state = report.controllers.get(name)
        if state is None:
            there = ", ".join(sorted(report.controllers)) or "none"
            return f"the controller manager has not loaded '{name}'; it has: {there}"
        if state != "active":
            return f"the controller '{name}' is {state}, not active"
        for part in report.hardware:
            if part.state != "active" and part.joints & set(self._axes.names):
                return f"the hardware '{part.name}' is {part.state}, not active"
        return ""

    def _judge(self, now: int) -> None:
        """Notice what does not happen, or has changed."""
        trouble = self._trouble()
        waited = now - self._since
        if self._doing is _Doing.CONNECTING:
            if not trouble:
                self._take_up(now)
            elif trouble != self._reason and waited > ASK_PERIOD:
                self._change(now, CncState.FAULT, trouble)
        elif self._doing is _Doing.STOPPING:
            if waited > self._settings.stop_limit * NANOSECONDS:
                raise TimeoutError(
                    f"the axes do not stand {self._settings.stop_limit:g} s after the stop: use the"
                    " emergency stop"
                )
        elif self._doing is _Doing.MOVING and not self._answered and waited > self._answered_in:
            raise Silent(
                "the controller has not answered to a goal: whether it executes it is unknown",
                fault="undetermined",
            )
        elif trouble and self._state in (CncState.READY, CncState.MOVING):
            at_rest = self._state is CncState.READY
            self._fault(trouble)
            self._heals = now if at_rest else None
        elif self._state is CncState.FAULT and self._heals is not None:
            self._heal(now, trouble, self._heals)

    def _heal(self, now: int, trouble: str, since: int) -> None:
        """Be ready again after a fault at rest whose cause is gone; a run it held stays held."""
        if trouble or not self._stands(now):
            self._heals = now
        elif now - since >= HEALED_IN:
            self._take_up(now)

    def _watch_gantry(self, positions: Mapping[str, float]) -> None:
        apart = self._axes.apart(positions)
        worst = max(range(len(AXES)), key=lambda number: apart[number])
        if apart[worst] > self._settings.gantry_tolerance and self._doing is not _Doing.CONNECTING:
            self._fault(f"the joints of {AXES[worst]} are {apart[worst] * 1e3:.3f} mm apart")

    def _watch_move(self, instant: int) -> None:
        if not self._ended:
            self._within = None
        elif far_axes(self._position, self._target, self._near):
            self._within = None
            # By the time of the positions: they may come later than the controller's word.
            if instant - self._since > ARRIVED_IN and self._stands(instant):
                where = ", ".join(f"{value * 1e3:.4f}" for value in self._position)
                self._fault(
                    f"the controller has ended the move at {where} mm, away from the target"
                )
        elif self._within is None:
            self._within = instant
        elif instant - self._within >= self._machine.position_hold_s * NANOSECONDS:
            self._begin(_Doing.NOTHING)
            self._change(instant, CncState.READY, "")

    def _watch_stop(self, instant: int) -> None:
        if self._stands(instant) and (self._ended or self._is_forgotten):
            self._ended = True
            self._begin(_Doing.NOTHING)
            self._change(instant, CncState.STOPPED, self._why)

    def _stands(self, instant: int) -> bool:
        """Say whether the axes have stood for the hold time."""
        return instant - self._rest[0] >= self._machine.position_hold_s * NANOSECONDS

    @property
    def _is_forgotten(self) -> bool:
        """Whether the controller would have ended a cancelled goal by now, if it ever did.

        The controller of Jazzy reports that a goal was reached up to 50 ms later. It accepts a
        cancel in between, and then ends the goal only as it accepts the next one.
        """
        limit = min(self._answered_in, self._settings.stop_limit * NANOSECONDS)
        return self._now - self._since >= limit

    # Doing ----------------------------------------------------------------------------------------

    @property
    def _source(self) -> str:
        return self._settings.names.joint_states

    @property
    def _answered_in(self) -> float:
        return self._settings.answer_limit * NANOSECONDS

    @property
    def _told_once(self) -> bool:
        return isfinite(self._position[0])

    @property
    def _near(self) -> Point:
        near = self._machine.position_window_m + self._settings.resolution
        return near, near, near

    @property
    def _strayed(self) -> bool:
        near = max(STRAYED, *self._near)
        return bool(far_axes(self._position, self._commanded, (near, near, near)))

    def _take_up(self, now: int) -> None:
        """Accept moves from where the axes stand."""
        self._commanded, self._heals = self._position, None
        self._begin(_Doing.NOTHING)
        self._change(now, CncState.READY, "")

    def _fault(self, reason: str) -> None:
        """Be faulty, once, for the first reason; what moves is braked."""
        if self._state is CncState.FAULT:
            return
        if not self._ended:
            self._controller.cancel()
        self._heals = None
        self._begin(_Doing.NOTHING)
        self._change(self._now, CncState.FAULT, reason)

    def _begin(self, doing: _Doing) -> None:
        self._doing, self._since = doing, self._now

    def _tick(self, time_ns: int) -> int:
        self._now = max(time_ns, self._now)
        return self._now

    def _change(self, instant: int, state: CncState, reason: str) -> None:
        self._told = max(instant, self._told)
        self._state, self._reason = state, reason
        self._events.append(StateChange(self._told, state, self._position, reason))


def _off_time(source: str, ahead: bool, limit: float) -> str:
    """Say what it may mean that a message is stamped more than ``limit`` s off our time.

    How much is left out: it changes with each message, and each change is reported.
    """
    if ahead:
        return (
            f"{source} is stamped more than {limit:g} s ahead of our time: synchronise the clocks"
        )
    return (
        f"{source} comes more than {limit:g} s after its stamp: this computer is too busy to read"
        " it, or the clocks differ; silence_s sets the limit, which is at least"
        f" {CLOCK_LIMIT / NANOSECONDS:g} s"
    )


def from_settings(
    settings: Mapping[str, Any], surroundings: Surroundings
) -> Callable[[int], Ros2ControlCnc]:
    """Return what connects to a joint trajectory controller at a time, ns.

    Settings: those of ``Ros2ControlSettings``, explained in config/devices/ros2_control.yaml.

    Raises:
        ValueError: a setting is wrong, or there is no machine or no ROS.
    """
    machine = surroundings.machine_for("ros2_control driver")
    prepared = Ros2ControlSettings.from_mapping(settings)
    connect = surroundings.joint_controller
    if connect is None:
        raise Refusal("the ros2_control driver needs a ROS node", fault="missing", about="node")
    return lambda start: Ros2ControlCnc(machine, prepared, connect(prepared.names), start)
