#!/usr/bin/env python3
"""Node: the bridge to the machine's controller. It alone makes the machine move."""

import sys
from collections.abc import Callable
from functools import partial
from math import nan
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.configuration import load_cell, load_machine, plan_from_text
from stepdiag_ros.conversion import (
    MOTORS,
    from_command_status,
    new_message,
    set_header,
)
from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.cnc import CncDevice, CncState, MoveRefused, PositionSample, StateChange
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.nodes.base import spin
from stepdiag_ros.nodes.managed import SIMULATED, DeviceNode
from stepdiag_ros.refusals import sentence
from stepdiag_ros.run.device_health import Axes
from stepdiag_ros.run.health import Finding
from stepdiag_ros.run.permission import refusal_of_plan
from stepdiag_ros.run.sequence import Answer
from stepdiag_ros.run.work_health import Commands

STATE_PERIOD = 0.5
NOWHERE = (nan, nan, nan)
"""m: of a machine whose controller is not heard."""


class BridgeNode(DeviceNode[CncDevice]):
    """Executes step commands, each once, and says what became of it.

    Services: ``~/stop``, ``~/reset`` (std_srvs/Trigger). The machine is stopped when the sequencer
    of the run falls silent, and before the node leaves the state active. No transition moves it.
    """

    role = "cnc_bridge"
    thing = "controller"
    poll_period = 0.002

    def __init__(self) -> None:
        super().__init__("cnc_bridge")
        simulated = self.parameter("device") == SIMULATED
        cell = load_cell(self.parameter("cell"))[0] if simulated else None
        self._surroundings = Surroundings(load_machine(self.parameter("machine"))[0], cell)
        self.opener()
        self._axes = Axes(self.parameter("position_timeout"))
        self.on_change("position_timeout", partial(setattr, self._axes, "stale_after"))
        self._commands = Commands()
        self.add_device_task("axes", self._judge_axes)
        self.add_device_task("commands", self._judge_commands)
        self._plan: Plan | None = None
        self._command: Any = None
        self._last_command = 0
        self._reason = ""
        self._position = NOWHERE
        self._soft_limits = (NOWHERE, NOWHERE)
        self._joints = self.stream(topics.JOINT_STATES)
        self._status = self.announce(topics.COMMAND_STATUS)
        self._state = self.announce(topics.MACHINE_STATE)
        self.follow_run()
        self.listen(topics.MACHINE_COMMAND, self._on_command)
        self.offer("~/stop", self.stop)
        self.offer("~/reset", self.reset)
        self.every(STATE_PERIOD, self._repeat_state, real=True)

    def opener(self, **changed: Any) -> Callable[[int], CncDevice]:
        """Return what opens the controller (see ``DeviceNode.opener``)."""
        settings = self.device_settings(changed, {})
        settings["position_rate_hz"] = changed.get("position_rate", self.parameter("position_rate"))
        return prepare("cnc", self.parameter("device"), settings, self._surroundings)

    def on_open(self, device: CncDevice) -> None:
        """Say where the machine stands."""
        self._reason = ""
        self._soft_limits = device.soft_limits
        self._axes.limit(*device.soft_limits)
        self.poll(device)
        self._publish_state(device.state)

    def on_begin(self, device: CncDevice) -> None:  # noqa: ARG002
        """Expect positions from now on."""
        self._axes.begin(self.real_time())

    def on_end(self, device: CncDevice, reason: str) -> None:
        """Stop the machine; it is watched until it stands."""
        try:
            device.stop(self.now(), reason)
        except Exception as error:
            raise OSError(
                f"the machine could not be stopped ({sentence(error)}): use the emergency stop"
            ) from error

    def on_closed(self, reason: str, failed: bool) -> None:
        """Say what has become of the command at work, and that nobody knows where the machine is.

        Whoever moves the machine meanwhile does not tell this node.
        """
        self._reason, self._position = reason, NOWHERE
        command, self._command = self._command, None
        if command is not None:
            self._answer(command, Answer.FAULT, self.now(), reason)
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
        if not self._stop("stopped on request"):
            raise ValueError("the controller has failed: use the emergency stop")
        return "stopping"

    def reset(self) -> str:
        """Accept commands again after a stop.

        Raises:
            ValueError: the machine still moves, or the node is not active.
        """
        if self.device is None or not self.active:
            raise ValueError("the bridge is not active: activate it first")
        try:
            self.device.reset(self.now())
        except MoveRefused:
            raise
        except (OSError, ValueError) as error:
            self.fail(f"cannot reset the controller: {sentence(error)}")
            raise ValueError("the controller has failed") from error
        self.look_at_device()
        return "ready"

    def on_run(self, description: Any) -> None:
        """Accept the commands of a new run, from its first one, as far as its plan allows them."""
        self._plan = plan_from_text(description.plan, "plan of the run")
        self._last_command = 0
        self._command = None

    def on_peer_lost(self, text: str) -> None:
        """Stop the machine when nobody is left who would."""
        super().on_peer_lost(text)
        if not self.watch.present("sequencer"):
            self._stop(text)

    def _on_command(self, command: Any) -> None:
        refusal = self._refusal(command)
        if self.device is not None and not refusal:
            self._last_command = command.command_id
            try:
                self.device.start_move(
                    self.now(), tuple(command.target), command.feed, command.axis
                )
            except MoveRefused as error:
                refusal = str(error)
            except (OSError, ValueError) as error:
                # It may move all the same: this command has failed, it was not rejected.
                self._command = command
                self.fail(f"cannot start a move: {sentence(error)}")
                return
        if refusal:
            self.get_logger().error(f"command {command.command_id} rejected: {refusal}")
            self._answer(command, Answer.REJECTED, self.now(), refusal)
            return
        self._command = command
        self._answer(command, Answer.ACCEPTED, self.now())
        self.look_at_device()

    def _refusal(self, command: Any) -> str:
        if self.device is None or not self.active:
            return "the bridge is not active"
        if command.run_id != self.run_id or self.run_over:
            return f"it belongs to run {command.run_id}, not to the present one"
        if command.command_id <= self._last_command:
            return f"command {self._last_command} was executed already"
        if self._command is not None:
            return "the move before has not ended"
        if self._plan is None:
            return "the plan of the run is not known yet"
        target = tuple(command.target)
        return refusal_of_plan(self._plan, command.line_index, command.axis, self._position, target)

    def _stop(self, reason: str) -> bool:
        """Stop the machine if the controller is open; say whether the controller has heard it."""
        if self.device is not None:
            with self.failing("stop the machine"):
                self.device.stop(self.now(), reason)
        self.look_at_device()
        return self.device is not None

    def poll(self, device: CncDevice) -> None:
        """Publish positions, and what has become of the command at work."""
        for event in device.poll(self.now()):
            self._position = event.position
            if isinstance(event, PositionSample):
                self._axes.take(event.position, event.time, self.real_time())
                self._publish_position(event)
            else:
                self._on_change(event)

    def _on_change(self, event: StateChange) -> None:
        self._reason = event.reason
        command = self._command
        if command is not None:
            if event.state is CncState.MOVING:
                self._answer(command, Answer.MOVING, event.time)
            else:
                ends = {
                    CncState.READY: Answer.IN_POSITION,
                    CncState.STOPPED: Answer.STOPPED,
                    CncState.FAULT: Answer.FAULT,
                }
                self._command = None
                self._answer(command, ends[event.state], event.time, event.reason)
        if event.state is not CncState.MOVING:
            self._publish_state(event.state)

    def _judge_axes(self) -> Finding:
        state = CncState.FAULT if self.device is None else self.device.state
        return self._axes.judge(state, self._reason, self.now(), self.real_time())

    def _judge_commands(self) -> Finding:
        return self._commands.judge(moving=self._command is not None)

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

    def _publish_position(self, sample: PositionSample) -> None:
        message = new_message(topics.JOINT_STATES.type_name)
        set_header(message, sample.time)
        message.name = list(AXES)
        message.position = list(sample.position)
        if sample.motors is not None:
            message.name = [*AXES, *MOTORS]
            message.position = [*sample.position, *sample.motors]
        self._joints.publish(message)

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


def main() -> int:
    """Run the node."""
    return spin(BridgeNode)


if __name__ == "__main__":
    sys.exit(main())
