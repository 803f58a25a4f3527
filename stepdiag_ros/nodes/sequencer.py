#!/usr/bin/env python3
"""Node: executes a test plan step by step, once an operator starts it."""

import sys
from collections.abc import Callable
from typing import Any

from std_srvs.srv import Trigger

import stepdiag_ros
from stepdiag_ros import topics
from stepdiag_ros.configuration import load_cell, load_machine, load_plan, without_effects
from stepdiag_ros.conversion import (
    from_stop_command,
    new_message,
    set_header,
    to_nanoseconds,
)
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.run.identity import new_run_id
from stepdiag_ros.run.sequence import (
    Answer,
    Command,
    Progress,
    Sequence,
    State,
    beyond_machine,
    out_of_limits,
)
from stepdiag_ros.run.supervision import Peer, said_of_run

UPDATE_PERIOD = 0.01
STATE_PERIOD = 0.5
FOLLOWER_LIMIT = 5.0
"""Real seconds within which the other nodes must have taken up a new run."""
RESET_LIMIT = 1.0
"""Real seconds within which the bridge should answer a reset before it is asked again."""
RESET_TRIES = 5
FOLLOWERS = ("cnc_bridge", "assembler", "solver", "recorder")
"""Roles that say in their heartbeat which run they have taken up."""
REQUIRED = ("interferometer", *FOLLOWERS)
"""Roles without which no run starts, and whose loss stops one."""
WELCOME = ("clock", "weather")
"""Roles that a run can do without from the start, but not lose."""


class SequencerNode(StepdiagNode):
    """Sends step commands one at a time, each only when the stop before has been assembled.

    Services: ``~/start``, ``~/pause``, ``~/resume``, ``~/abort`` (std_srvs/Trigger).
    """

    role = "sequencer"

    def __init__(self) -> None:
        super().__init__("sequencer")
        plan = self.parameter("plan", "demo", "test plan: YAML file, or a name in config/plans")
        machine = self.parameter("machine", "demo", "machine: YAML file or name, config/machines")
        cell = self.parameter("cell", "", "simulated cell: YAML file or name; empty on a machine")
        self._plan, self._plan_text = load_plan(plan)
        model, self._machine_text = load_machine(machine)
        beyond = beyond_machine(self._plan, model)
        if beyond:
            raise ValueError(f"plan '{plan}' cannot be executed on machine '{machine}': {beyond}")
        self._cell_text = without_effects(load_cell(cell)[1], cell) if cell else ""
        self._sequence: Sequence | None = None
        self._needed: tuple[str, ...] = REQUIRED
        self._waiting_since: float | None = None
        self._after_reset: Callable[[], None] | None = None
        self._reset_tries = 0
        self._reset_asked = 0.0
        self._machine_state: Any = None
        self._published: Progress | None = None
        self._not_before = 0

        self._description = self.announce(topics.RUN_DESCRIPTION)
        self._state = self.announce(topics.RUN_STATE)
        self._commands = self.announce(topics.MACHINE_COMMAND)
        self.listen(topics.COMMAND_STATUS, self._on_answer)
        self.listen(topics.MACHINE_STATE, self._on_machine_state)
        self.listen(topics.STOP, self._on_stop)
        self._stop_client = self.create_client(Trigger, "cnc_bridge/stop")
        self._reset_client = self.create_client(Trigger, "cnc_bridge/reset")
        self.offer("~/start", self.start)
        self.offer("~/pause", self.pause)
        self.offer("~/resume", self.resume)
        self.offer("~/abort", self.abort)
        self.every(UPDATE_PERIOD, self._update, real=True)
        self.every(STATE_PERIOD, self._publish_state, real=True)
        self._publish_state()

    # What an operator asks for ------------------------------------------------------------------

    def start(self) -> str:
        """Begin a new run: describe it, and move once every node has taken it up.

        Raises:
            ValueError: a run is going on, a node is missing, or the plan leaves the soft limits.
        """
        if self._waiting_since is not None or (self._sequence and self._sequence.active):
            raise ValueError("a run is going on: abort it before starting another")
        missing = self.watch.missing(REQUIRED)
        if missing or self._machine_state is None:
            raise ValueError(f"cannot start: {'; '.join(missing) or 'the machine is silent'}")
        state = self._machine_state
        beyond = out_of_limits(
            self._plan, tuple(state.soft_limits_low), tuple(state.soft_limits_high)
        )
        if beyond:
            raise ValueError(f"cannot start: {beyond}")
        present = tuple(role for role in WELCOME if self.watch.present(role))
        self._needed = REQUIRED + present
        self.run_id = new_run_id()
        self.run_over = False
        self._sequence = Sequence(self._plan, tuple(state.position), self._send, self._stop_machine)
        self._published = None
        self._describe()
        self._waiting_since = self.real_time()
        return f"run {self.run_id} begins"

    def pause(self) -> str:
        """Stand still after the present stop."""
        self._running().pause()
        self._publish_state()
        return "pausing after this stop"

    def resume(self) -> str:
        """Go on after a pause, a setup or a fault."""
        sequence = self._running()
        missing = self.watch.missing(self._needed)
        if missing:
            raise ValueError(f"cannot resume: {'; '.join(missing)}")
        if sequence.state is State.FAULT:
            self._reset_machine(self._continue)
        else:
            self._continue()
        return "resuming"

    def abort(self) -> str:
        """Stop the machine at once and end the run."""
        self._waiting_since = None
        self._after_reset = None
        self._running().abort("aborted by the operator")
        self._ended()
        return "aborted"

    def on_heartbeat(self, peer: Peer) -> None:
        """Take the recorder's word on what is on the disk, the interferometer's on its beam."""
        if self._sequence is None:
            return
        if peer.role == "recorder":
            stored = said_of_run(peer, "stored", self.run_id)
            self._sequence.stored(int(stored) if stored else 0)
        elif peer.role == "interferometer":
            self._sequence.beam_ready(said_of_run(peer, "beam", self.run_id))
        else:
            return
        self._update()

    # What the other nodes say ----------------------------------------------------------------

    def _on_answer(self, message: Any) -> None:
        if self._sequence is not None and message.run_id == self.run_id:
            answer = Answer(message.status)
            self._sequence.answered(
                message.command_id, answer, message.reason, self.now(), self.real_time()
            )
            self._publish_changes()

    def _on_machine_state(self, message: Any) -> None:
        self._machine_state = message
        faulty = message.state in (message.STATE_FAULT, message.STATE_STOPPED)
        if faulty and self._sequence is not None and self._sequence.active:
            self._sequence.fault(message.reason)
            self._publish_changes()

    def _on_stop(self, message: Any) -> None:
        if self._sequence is not None and message.run_id == self.run_id:
            rejection = "" if message.settled else message.reason
            self._not_before = to_nanoseconds(message.window_end)
            self._sequence.settled(message.line_index, message.attempt, message.stop, rejection)
            self._update()

    # The course of the run ---------------------------------------------------------------------

    def _update(self) -> None:
        if self._sequence is None:
            return
        self._insist_on_reset()
        if self._waiting_since is not None:
            self._begin_when_taken_up()
        else:
            if self._sequence.active:
                missing = self.watch.missing(self._needed)
                if missing:
                    self._sequence.fault(missing[0])
            self._sequence.update(self.now(), self.real_time())
        self._publish_changes()

    def _begin_when_taken_up(self) -> None:
        assert self._sequence is not None and self._waiting_since is not None
        behind = [role for role in FOLLOWERS if not self.watch.present(role, self.run_id)]
        if not behind:
            self._waiting_since = None
            self._reset_machine(self._begin)
        elif self.real_time() - self._waiting_since > FOLLOWER_LIMIT:
            self._waiting_since = None
            self._sequence.abort(f"{', '.join(behind)} did not take up the run")
            self._ended()

    def _begin(self) -> None:
        if self._sequence is not None and self._sequence.state is State.IDLE:
            self.healthy(f"run {self.run_id}")
            self._sequence.start(self.now(), self.real_time())
            self._publish_state()

    def _continue(self) -> None:
        position = tuple(self._machine_state.position)
        self._running().resume(self.now(), self.real_time(), position)
        self.healthy(f"run {self.run_id}")
        self._publish_state()

    def _running(self) -> Sequence:
        if self._sequence is None:
            raise ValueError("no run was started")
        return self._sequence

    def _ended(self) -> None:
        assert self._sequence is not None
        self.get_logger().info(f"run {self.run_id}: {self._sequence.text}")
        self.run_over = True
        self._publish_state()
        self.healthy(f"ready; last run: {self._sequence.text}")

    # Messages ------------------------------------------------------------------------------------

    def _describe(self) -> None:
        message = new_message(topics.RUN_DESCRIPTION.type_name)
        set_header(message, self.now())
        message.schema_version = message.SCHEMA_VERSION
        message.run_id = self.run_id
        message.software_version = stepdiag_ros.__version__
        message.plan = self._plan_text
        message.machine = self._machine_text
        message.simulated_cell = self._cell_text
        self._description.publish(message)

    def _send(self, command: Command) -> None:
        # This node's simulated clock may lag a tick behind the readings of the stop that is left.
        now = max(self.now(), self._not_before)
        stop = command.given_at(now)
        purpose = int(command.purpose)
        self._commands.publish(from_stop_command(stop, self.run_id, now, command.feed, purpose))

    def _stop_machine(self) -> None:
        if self._stop_client.service_is_ready():
            self._stop_client.call_async(Trigger.Request())
        else:
            self.get_logger().error("the CNC bridge does not offer its stop service")

    def _reset_machine(self, then: Callable[[], None]) -> None:
        self._after_reset, self._reset_tries = then, 0
        self._ask_for_reset()

    def _ask_for_reset(self) -> None:
        self._reset_tries += 1
        self._reset_asked = self.real_time()
        self._reset_client.call_async(Trigger.Request()).add_done_callback(self._on_reset)

    def _on_reset(self, future: Any) -> None:
        response, then = future.result(), self._after_reset
        self._after_reset = None
        if then is None:
            return
        if response.success:
            then()
        else:
            self.unwell(f"the CNC bridge cannot be reset: {response.message}")

    def _insist_on_reset(self) -> None:
        # A bridge that was started again is heard before its services are found; what was asked
        # meanwhile went to the one that is gone.
        if self._after_reset is None or self.real_time() - self._reset_asked < RESET_LIMIT:
            return
        if self._reset_tries < RESET_TRIES:
            self._ask_for_reset()
        else:
            self._after_reset = None
            self.unwell("the CNC bridge does not answer its reset service: abort, or start it anew")

    def _publish_changes(self) -> None:
        """Publish the state when another stop, line or state has been reached."""
        if self._sequence is None:
            return
        progress, before = self._sequence.progress(self.now()), self._published
        if before is None or progress.state is not before.state:
            if progress.state is State.FAULT:
                self.unwell(f"run stopped: {progress.text}")
            if progress.state is State.FINISHED:
                self._ended()
        elif (progress.setup, progress.line_index, progress.stop) == (
            before.setup,
            before.line_index,
            before.stop,
        ):
            return
        self._publish_state()

    def _publish_state(self) -> None:
        message = new_message(topics.RUN_STATE.type_name)
        set_header(message, self.now())
        if self._sequence is None:
            message.text = "nothing was started"
        else:
            progress = self._published = self._sequence.progress(self.now())
            message.run_id = self.run_id
            message.state = int(progress.state)
            message.line_index = progress.line_index
            message.line_count = len(self._plan.lines)
            message.line = progress.line
            message.setup = progress.setup
            message.stop = progress.stop
            message.stop_count = progress.stop_count
            message.stops_done = progress.stops_done
            message.stops_total = progress.stops_total
            message.remaining_time = progress.remaining_time
            message.text = progress.text
        self._state.publish(message)


def main() -> int:
    """Run the node."""
    return spin(SequencerNode)


if __name__ == "__main__":
    sys.exit(main())
