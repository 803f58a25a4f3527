#!/usr/bin/env python3
"""Node: the bridge to the machine's controller. It alone makes the machine move."""

import sys
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.configuration import load_cell, load_machine, plan_from_text
from stepdiag_ros.conversion import (
    FRAME_MACHINE,
    from_command_status,
    new_message,
    set_header,
)
from stepdiag_ros.devices import Surroundings, create
from stepdiag_ros.devices.cnc import CncDevice, CncState, MoveRefused, PositionSample, StateChange
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.run.permission import refusal_of_plan
from stepdiag_ros.run.sequence import Answer

POLL_PERIOD = 0.002
STATE_PERIOD = 0.5


class BridgeNode(StepdiagNode):
    """Executes step commands, each once, and says what became of it.

    Services: ``~/stop``, ``~/reset`` (std_srvs/Trigger). The machine is stopped when the sequencer
    of the run falls silent.
    """

    role = "cnc_bridge"

    def __init__(self) -> None:
        super().__init__("cnc_bridge")
        self._driver = self.parameter("device", "simulated", "driver of the controller")
        machine = self.parameter("machine", "demo", "machine: YAML file or name, config/machines")
        cell = self.parameter("cell", "demo", "simulated cell: YAML file or name, config/cells")
        self._rate = self.parameter("position_rate", 50.0, "positions in a second", 1.0, 10000.0)
        self._machine = load_machine(machine)[0]
        self._cell = load_cell(cell)[0] if self._driver == "simulated" else None
        self._opened = False
        self._plan: Plan | None = None
        self._command: Any = None
        self._last_command = 0
        self._reason = ""
        self._position = (0.0, 0.0, 0.0)
        self._joints = self.announce(topics.JOINT_STATES)
        self._status = self.announce(topics.COMMAND_STATUS)
        self._state = self.announce(topics.MACHINE_STATE)
        self.follow_run()
        self.listen(topics.MACHINE_COMMAND, self._on_command)
        self._device: CncDevice
        self.await_clock(self._open)

    def _open(self) -> None:
        surroundings = Surroundings(self.now(), self._machine, self._cell)
        settings = {"position_rate_hz": self._rate}
        self._device = create("cnc", self._driver, settings, surroundings)
        self._opened = True
        self.offer("~/stop", self.stop)
        self.offer("~/reset", self.reset)
        self.every(POLL_PERIOD, self._poll, real=True)
        self.every(STATE_PERIOD, self._publish_state, real=True)
        self._publish_state()

    def stop(self) -> str:
        """Stop the machine at once."""
        self._stop("stopped on request")
        return "stopping"

    def reset(self) -> str:
        """Accept commands again after a stop.

        Raises:
            ValueError: the machine still moves.
        """
        self._device.reset(self.now())
        self._poll()
        return "ready"

    def on_run(self, description: Any) -> None:
        """Accept the commands of a new run, from its first one, as far as its plan allows them."""
        self._plan = plan_from_text(description.plan, "plan of the run")
        self._last_command = 0
        self._command = None

    def on_peer_lost(self, text: str) -> None:
        """Stop the machine when nobody is left who would."""
        super().on_peer_lost(text)
        if self._opened and not self.watch.present("sequencer"):
            self._stop(text)

    def close(self) -> None:
        """Leave no machine in motion behind."""
        if not self._opened:
            return
        self._device.stop(self.now(), "the bridge shuts down")
        self._device.close()

    def _on_command(self, command: Any) -> None:
        refusal = self._refusal(command)
        if not refusal:
            self._last_command = command.command_id
            try:
                self._device.start_move(
                    self.now(), tuple(command.target), command.feed, command.axis
                )
            except MoveRefused as error:
                refusal = str(error)
        if refusal:
            self.get_logger().error(f"command {command.command_id} rejected: {refusal}")
            self._answer(command, Answer.REJECTED, self.now(), refusal)
            return
        self._command = command
        self._answer(command, Answer.ACCEPTED, self.now())
        self._poll()

    def _refusal(self, command: Any) -> str:
        if not self._opened:
            return "the controller is not open yet"
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

    def _stop(self, reason: str) -> None:
        self._device.stop(self.now(), reason)
        self._poll()

    def _poll(self) -> None:
        for event in self._device.poll(self.now()):
            self._position = event.position
            if isinstance(event, PositionSample):
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
            self._publish_state()

    def _answer(self, command: Any, answer: Answer, time: int, reason: str = "") -> None:
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
        set_header(message, sample.time, FRAME_MACHINE)
        message.name = list(AXES)
        message.position = list(sample.position)
        self._joints.publish(message)

    def _publish_state(self) -> None:
        message = new_message(topics.MACHINE_STATE.type_name)
        set_header(message, self.now(), FRAME_MACHINE)
        message.state = int(self._device.state)
        message.position = list(self._position)
        low, high = self._device.soft_limits
        message.soft_limits_low, message.soft_limits_high = list(low), list(high)
        message.reason = self._reason
        self._state.publish(message)


def main() -> int:
    """Run the node."""
    return spin(BridgeNode)


if __name__ == "__main__":
    sys.exit(main())
