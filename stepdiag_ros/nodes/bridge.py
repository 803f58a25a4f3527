#!/usr/bin/env python3
"""Node: the bridge to the machine's controller. It alone makes the machine move."""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import inf, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepdiag_ros import topics
from stepdiag_ros.configuration import load_cell, load_machine, plan_from_text
from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.cnc import (
    CncDevice,
    CncState,
    MoveRefused,
    Point,
    PositionSample,
    StateChange,
    Traits,
    traits_of,
)
from stepdiag_ros.devices.cnc.joint_controller import ControllerNames, JointController
from stepdiag_ros.messages.conversion import MOTORS, from_command_status
from stepdiag_ros.messages.fields import set_header, to_nanoseconds
from stepdiag_ros.messages.types import new_message
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.nodes.base import spin
from stepdiag_ros.nodes.managed import DeviceNode
from stepdiag_ros.run.accord import MACHINE, SIMULATED, machine_fact
from stepdiag_ros.run.device_health import Axes
from stepdiag_ros.run.entitlement import Entitlement
from stepdiag_ros.run.health import HealthFinding, Level
from stepdiag_ros.run.motion_watch import Ending, MotionWatch
from stepdiag_ros.run.permission import CommandedMove, MotionPermission, shortcomings, too_brisk
from stepdiag_ros.run.sequence import ANSWER_LIMIT, Answer, Purpose
from stepdiag_ros.run.sole_sender import SoleSender
from stepdiag_ros.run.work_health import Commands
from stepdiag_ros.text.sentence import sentence

if TYPE_CHECKING:
    from stepdiag_ros.run.target_correction import TargetCorrection

STATE_PERIOD = 0.5
WATCH_PERIOD = 0.2
"""Real seconds between two looks at who commands the machine; each command is looked at, too."""
NOWHERE = (nan, nan, nan)
"""m: of a machine whose controller does not answer."""


class BridgeNode(DeviceNode[CncDevice]):
    """Executes step commands, each once, and says what became of it.

    Services: ``~/stop``, ``~/reset`` (std_srvs/Trigger). A command moves the machine only if plan,
    machine and controller allow it (``run.permission``), and if the sequencer, which alone may
    publish commands (``run.sole_sender``), wants it and goes on wanting it (``run.entitlement``);
    it has ended in position when the actual positions say so (``run.motion_watch``). The machine is
    stopped when sequencer or controller fall silent, and before the node leaves the state active.
    No transition moves it.
    """

    role = "cnc_bridge"
    thing = "controller"
    poll_period = 0.002

    def __init__(self) -> None:
        super().__init__("cnc_bridge")
        simulated = self.parameter("device") == SIMULATED
        cell = load_cell(self.parameter("cell"))[0] if simulated else None
        self._machine, text = load_machine(self.parameter("machine"))
        self.facts[MACHINE] = machine_fact(self._machine.name, text)
        self._surroundings = Surroundings(self._machine, cell, self._joint_controller)
        self.opener()
        self._axes = Axes(self.parameter("position_timeout"))
        self.on_change("position_timeout", partial(setattr, self._axes, "stale_after"))
        self._commands = Commands()
        self.add_device_task("axes", self._judge_axes)
        self.add_device_task(
            "commands", lambda: self._commands.judge(moving=self._command is not None)
        )
        self._correction: TargetCorrection | None = self._load_correction(
            self.parameter("correction")
        )
        self.on_change("correction", self._set_correction, self._load_correction)
        self.on_change("correction_limit", self._limit_correction)
        self._set_correction(self._correction)
        self.add_device_task("target correction", self._judge_correction)
        self._plan: Plan | None = None
        self._permission: MotionPermission | None = None
        # A recorded command is old by the computer's clock; simulated time would make it young.
        age_limit = inf if self._is_simulated() else ANSWER_LIMIT
        self._entitlement = Entitlement(self.parameter("silence_limit"), age_limit)
        self.on_change("silence_limit", partial(setattr, self._entitlement, "silence_limit"))
        self._sequencer = SoleSender([topic.name for topic in topics.COMMANDING])
        self._sender = HealthFinding(Level.OK, "nobody was looked for yet")
        self.add_device_task("sequencer", lambda: self._sender)
        # The command at work; it has begun once the sequencer has confirmed it.
        self._command: Any = None
        self._begun = False
        self._stopping = False
        self._traits = Traits()
        self._motion = MotionWatch(self._machine, self._traits.resolution)
        self._reason = ""
        self._position = NOWHERE
        self._soft_limits = (NOWHERE, NOWHERE)
        self._joints = self.stream(topics.JOINT_STATES)
        self._status = self.announce(topics.COMMAND_STATUS)
        self._state = self.announce(topics.MACHINE_STATE)
        self.follow_run()
        self.listen(topics.MOTION_PERMIT, self._on_permit)
        self.listen(topics.MACHINE_COMMAND, self._on_command)
        self.offer("~/stop", self.stop)
        self.offer("~/reset", self.reset)
        if self._is_simulated():
            # At each tick of /clock, and only then, the machine has gone on.
            self.every(self.poll_period, self.look_at_device)
        self.every(STATE_PERIOD, self._repeat_state, real=True)
        self.every(WATCH_PERIOD, self._watch_sequencer, real=True)

    def opener(self, **changed: Any) -> Callable[[int], CncDevice]:
        """Return what opens the controller (see ``DeviceNode.opener``)."""
        settings = self.device_settings(changed, {})
        settings["position_rate_hz"] = changed.get("position_rate", self.parameter("position_rate"))
        with self.naming_file(changed):
            return prepare("cnc", self.parameter("device"), settings, self._surroundings)

    def _joint_controller(self, names: ControllerNames) -> JointController:
        # Its messages are installed only where ros2_control is.
        from stepdiag_ros.nodes.joint_controller import RosJointController

        return RosJointController(self, names)

    def on_open(self, device: CncDevice) -> None:
        """Say where the machine stands, and what its controller is like.

        Raises:
            ValueError: it must not be used as it is.
        """
        self._reason = ""
        if self._is_simulated() and not traits_of(device).simulated:
            raise ValueError(
                "use_sim_time is true: a replay could drive a real machine; set it to false"
            )
        self._entitlement.withdraw()
        self._learn(device)
        self.poll(device)
        self._publish_state(device.state)

    def _learn(self, device: CncDevice) -> None:
        """Take what the controller reports about itself; some report it only a while after opening.

        Raises:
            ValueError: it must not be used as it is.
        """
        before, self._traits = self._traits, traits_of(device)
        if brisk := too_brisk(self._machine, self._traits):
            raise ValueError(brisk)
        if self._traits != before:
            for weakness in shortcomings(self._traits):
                self.get_logger().warning(weakness)
        self._soft_limits = device.soft_limits
        self._axes.limit(*device.soft_limits)
        self._motion = MotionWatch(self._machine, self._traits.resolution)
        self._set_permission()

    def on_begin(self, device: CncDevice) -> None:  # noqa: ARG002
        """Expect positions from now on."""
        self._axes.begin(self.real_time())

    def on_end(self, device: CncDevice, reason: str) -> None:
        """Stop the machine; it is watched until it stands."""
        self._entitlement.withdraw()
        try:
            device.stop(self.now(), reason)
        except Exception as error:
            raise OSError(
                f"the machine could not be stopped ({sentence(error)}): use the emergency stop"
            ) from error

    def on_closed(self, reason: str, failed: bool) -> None:
        """Say what has become of the command at work, and that nobody knows where the machine is.

        This node is not notified of moves by others in the meantime.
        """
        self._reason, self._position = reason, NOWHERE
        self._entitlement.withdraw()
        self._conclude(Answer.FAULT, self.now(), reason)
        self._publish_state(CncState.FAULT if failed else None)

    def busy(self, device: CncDevice) -> str:
        """Say that a machine in motion is not left alone."""
        return "the axes still move" if device.state is CncState.MOVING else ""

    def stop(self) -> str:
        """Stop the machine at once.

        Raises:
            ValueError: the controller is not open, or has failed.
        """
        if self.device is None:
            raise ValueError("the controller is not open: the machine cannot be stopped through it")
        self._entitlement.withdraw()
        if not self._stop("stopped on request"):
            raise ValueError("the controller has failed: use the emergency stop")
        return "stopping"

    def reset(self) -> str:
        """Accept commands of the present run, at its begin and after a stop or a fault.

        Raises:
            ValueError: the machine moves, the node is not active, or not one node alone commands.
        """
        if self.device is None or not self.active:
            raise ValueError("the bridge is not active: activate it first")
        self._sequencer.bind(self.senders(*topics.COMMANDING), self.real_time())
        try:
            self.device.reset(self.now())
        except MoveRefused:
            raise
        except (OSError, ValueError) as error:
            self.fail(f"cannot reset the controller: {sentence(error)}")
            raise ValueError("the controller has failed") from error
        self.look_at_device()
        self._entitlement.release()
        return "ready"

    def on_run(self, description: Any) -> None:
        """Take up a new run with its first command; nothing moves before the next reset."""
        self._plan = plan_from_text(description.plan, "plan of the run")
        if self._command is not None:
            self._stop(f"another run begins: {description.run_id}")
            self._conclude(Answer.STOPPED, self.now(), "another run begins")
        self._entitlement.begin_run(description.run_id)
        self._sequencer.begin_run()
        self._set_permission()
        self._set_correction(self._correction)

    def _set_permission(self) -> None:
        if self._plan is not None:
            self._permission = MotionPermission(
                self._plan, self._machine, self._soft_limits, self._traits
            )

    def on_peer_lost(self, text: str) -> None:
        """Stop the machine when nobody is left who would."""
        super().on_peer_lost(text)
        if not self.watch.present("sequencer"):
            self._sequencer.lost(self.real_time())
            self._stop_because(text)

    def _watch_sequencer(self) -> None:
        """Stop the machine when another node than the sequencer publishes commands."""
        before = self._sender
        self._sender = self._sequencer.judge(self.senders(*topics.COMMANDING), self.real_time())
        if self._sender.level and not self._sender.says(before) and not self.run_over:
            self._stop_because(self._sender.message)

    def _on_permit(self, permit: Any) -> None:
        self._entitlement.permit(permit.run_id, permit.command_id, self.real_time())
        self._begin_confirmed()

    def _on_command(self, command: Any) -> None:
        if self._entitlement.is_repetition(command.run_id, command.command_id):
            return
        self._watch_sequencer()
        refusal = self._sender.message if self._sender.level else self._refusal(command)
        if refusal:
            self._reject(command, refusal)
            return
        self._entitlement.take_up(command.command_id, self.real_time())
        self._command, self._begun, self._stopping = command, False, False
        self._begin_confirmed()

    def _begin_confirmed(self) -> None:
        """Begin the move of the command at work once the sequencer has confirmed it."""
        command = self._command
        if command is None or self._begun or not self._entitlement.confirmed:
            return
        refusal = "" if self.active else "the bridge is not active"
        if self.device is not None and not refusal:
            self._begun = True
            try:
                target, axes = self._sent(command)
                self.device.start_move(self.now(), target, command.feed, axes)
            except MoveRefused as error:
                refusal = str(error)
            except (OSError, ValueError) as error:
                # It may move all the same: this command has failed, it was not rejected.
                self.fail(f"cannot start a move: {sentence(error)}")
                return
            else:
                self._motion.begin(self._position, target)
                self._axes.moves(self.real_time())
        if refusal:
            self._command = None
            self._reject(command, refusal)
            return
        self._answer(command, Answer.ACCEPTED, self.now())
        self.look_at_device()

    def _sent(self, command: Any) -> tuple[Point, str]:
        """Return where a command sends the machine, and which axes may move on the way.

        Raises:
            MoveRefused: the target cannot be corrected, or is beyond a soft limit then.
        """
        target: Point = tuple(command.target)
        if self._correction is None or self._permission is None:
            return target, command.axis
        try:
            target = self._correction.sent(target)
        except ValueError as error:
            raise MoveRefused(str(error)) from error
        if refusal := self._permission.refusal_of_place(target):
            raise MoveRefused(f"corrected, {refusal}")
        # To move one axis straight, a correction moves the others a little.
        return target, "".join(AXES)

    def _nominal_position(self) -> Point:
        """Return the place that the present position is meant for, m."""
        if self._correction is None:
            return self._position
        return self._correction.nominal(self._position)

    def _load_correction(self, file: str) -> "TargetCorrection | None":
        if not file:
            return None
        # Slow to import, and needed only here.
        from stepdiag_ros.compensation.generic import correction_from_file

        limit = self.parameter("correction_limit")
        return correction_from_file(Path(file), limit, self._machine)

    def _set_correction(self, correction: "TargetCorrection | None") -> None:
        if correction is not None:
            self.get_logger().warning(correction.words)
        elif self._correction is not None:
            self.get_logger().warning("targets are not corrected any more")
        self._correction = correction

    def _limit_correction(self, limit: float) -> None:
        if self._correction is not None:
            self._correction = replace(self._correction, limit=limit)

    def _judge_correction(self) -> HealthFinding:
        if self._correction is None:
            return HealthFinding(Level.OK, "targets are not corrected")
        return HealthFinding(Level.WARN, self._correction.words)

    def _reject(self, command: Any, refusal: str) -> None:
        self.get_logger().error(f"command {command.command_id} rejected: {refusal}")
        self._answer(command, Answer.REJECTED, self.now(), refusal)

    def _refusal(self, command: Any) -> str:
        if self.device is None or not self.active:
            return "the bridge is not active"
        if self.run_over:
            return f"it belongs to run {command.run_id}, not to the present one"
        age = (self.now() - to_nanoseconds(command.header.stamp)) * 1e-9
        refusal = self._entitlement.refusal(command.run_id, command.command_id, age)
        if refusal:
            return refusal
        if self._command is not None:
            return "the move before has not ended"
        if self._permission is None:
            return "the plan of the run is not known yet"
        return self._permission.refusal(
            CommandedMove(
                line_index=command.line_index,
                at_stop=command.purpose == Purpose.STOP,
                stop=command.stop,
                axes=command.axis,
                position=self._nominal_position(),
                target=tuple(command.target),
                feed=command.feed,
                uncorrected=self._position,
            )
        )

    def _stop(self, reason: str) -> bool:
        """Stop the machine if the controller is open; return whether it received that."""
        self._stopping = True
        if self.device is not None:
            with self.failing("stop the machine"):
                self.device.stop(self.now(), reason)
        self.look_at_device()
        return self.device is not None

    def poll(self, device: CncDevice) -> None:
        """Publish positions, and what has become of the command at work."""
        samples: list[PositionSample] = []
        for event in device.poll(self.now()):
            if isinstance(event, PositionSample):
                samples.append(event)
                continue
            self._take_positions(samples)
            samples = []
            if self._command is None and event.state is CncState.READY:
                self._learn(device)
            self._position = event.position
            self._on_change(event)
        self._take_positions(samples)
        self._watch_over()

    def _take_positions(self, samples: list[PositionSample]) -> None:
        self._joints.publish_all(map(_joint_states, samples))
        for sample in samples:
            self._position = sample.position
            self._axes.take(sample.position, sample.time, self.real_time())
            self._end(self._motion.take(sample.time, sample.position))

    def _watch_over(self) -> None:
        """Stop a move that is no longer requested, or about which no message arrives."""
        command, real = self._command, self.real_time()
        if command is None or self._stopping:
            return
        lapsed = self._entitlement.lapsed(real)
        if lapsed and not self._begun:
            self._command = None
            self._reject(command, lapsed)
            return
        limit = self._entitlement.silence_limit
        rate = self.parameter("position_rate")
        lapsed = lapsed or self._axes.silent(limit, rate, self.now(), real)
        if lapsed:
            self._stop_because(lapsed)

    def _stop_because(self, reason: str) -> None:
        """Stop the machine by the bridge's own decision; only an operator's resume goes on."""
        self.get_logger().error(f"the machine is stopped: {reason}")
        self._entitlement.withdraw(reason)
        self._stop(reason)

    def _end(self, ending: Ending | None) -> None:
        """Take what the actual positions say of the end of the move."""
        if ending is None:
            return
        if not ending.trouble:
            self._conclude(Answer.IN_POSITION, ending.time)
            return
        self._conclude(Answer.FAULT, ending.time, ending.trouble)
        self._stop_because(ending.trouble)

    def _on_change(self, event: StateChange) -> None:
        self._reason = event.reason
        if event.state is CncState.MOVING:
            if self._command is not None:
                self._answer(self._command, Answer.MOVING, event.time)
            return
        if event.state is CncState.READY:
            self._end(self._motion.done(event.time))
        else:
            self._entitlement.withdraw()
            stopped = event.state is CncState.STOPPED
            answer = Answer.STOPPED if stopped else Answer.FAULT
            self._conclude(answer, event.time, event.reason)
        self._publish_state(event.state)

    def _conclude(self, answer: Answer, time: int, reason: str = "") -> None:
        """Say how the command at work has ended, if there is one."""
        command, self._command = self._command, None
        self._motion.end()
        if command is not None:
            self._answer(command, answer, time, reason)

    def _judge_axes(self) -> HealthFinding:
        state = CncState.FAULT if self.device is None else self.device.state
        return self._axes.judge(state, self._reason, self.now(), self.real_time())

    def _answer(self, command: Any, answer: Answer, time: int, reason: str = "") -> None:
        self._commands.take(command.command_id, answer, reason)
        self._status.publish(
            from_command_status(
                command.command_id,
                command.run_id,
                time,
                int(answer),
                command.target,
                self._position,
                reason,
            )
        )

    def _repeat_state(self) -> None:
        if self.device is not None and self.active:
            self._publish_state(self.device.state)

    def _publish_state(self, state: CncState | None) -> None:
        message = new_message(topics.MACHINE_STATE.type_name)
        set_header(message, self.now())
        message.state = message.STATE_UNKNOWN if state is None else int(state)
        message.position = list(self._position)
        low, high = self._soft_limits
        message.soft_limits_low, message.soft_limits_high = list(low), list(high)
        message.reason = self._reason
        self._state.publish(message)


def _joint_states(sample: PositionSample) -> Any:
    message = new_message(topics.JOINT_STATES.type_name)
    set_header(message, sample.time)
    message.name = list(AXES)
    message.position = list(sample.position)
    if sample.motors is not None:
        message.name = [*AXES, *MOTORS]
        message.position = [*sample.position, *sample.motors]
    return message


def main() -> int:
    """Run the node."""
    return spin(BridgeNode)


if __name__ == "__main__":
    sys.exit(main())
