#!/usr/bin/env python3
"""Node: executes a test plan step by step, once an operator starts it."""

import sys
from collections.abc import Callable
from functools import partial
from math import isfinite
from typing import Any

from std_srvs.srv import Trigger

import stepdiag_ros
from stepdiag_ros import topics
from stepdiag_ros.configuration import (
    load_cell,
    load_machine,
    plan_given,
    target_from_text,
    without_effects,
)
from stepdiag_ros.messages.conversion import from_stop_command
from stepdiag_ros.messages.fields import set_header, to_nanoseconds
from stepdiag_ros.messages.target import target_of
from stepdiag_ros.messages.types import new_message
from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.target import line_ends
from stepdiag_ros.metrology.units import NANOSECONDS
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.nodes.measure_action import (
    MeasureAction,
    NotReadyYet,
    write_progress,
)
from stepdiag_ros.run.accord import discords, machine_fact
from stepdiag_ros.run.feasibility import beyond_machine, out_of_limits
from stepdiag_ros.run.health import AHEAD, HealthFinding
from stepdiag_ros.run.identity import new_run_id
from stepdiag_ros.run.sequence import Answer, Command, Progress, Sequence, State
from stepdiag_ros.run.supervision import (
    GETTING_READY,
    MOST_PEERS,
    START_PATIENCE,
    Peer,
    said_of_run,
)
from stepdiag_ros.run.taking_up import TakingUp
from stepdiag_ros.run.work_health import judge_run

UPDATE_PERIOD = 0.01
STATE_PERIOD = 0.5
PERMIT_PERIOD = 0.1
"""Real seconds between two words to the bridge that a move is wanted still."""
RESET_LIMIT = 1.0
"""Real seconds within which the bridge should answer a reset before it is asked again."""
RESET_TRIES = 5
STOP_LIMIT = 2.0
"""Real seconds within which the bridge must say that it has stopped the machine."""
REQUIRED = ("interferometer", "cnc_bridge", "assembler", "solver", "recorder")
"""Roles without which no run starts, and whose loss stops one. Each says in its heartbeat that it
has taken up the run, before the first move is commanded: it would ignore one before that."""
IRREPLACEABLE = ("cnc_bridge", "interferometer", "assembler")
"""Roles whose node must be the same process all the time: what it knew of run or zero is lost."""
WELCOME = ("clock", "weather")
"""Roles that a run can do without, but not lose once their node is there."""


class SequencerNode(StepdiagNode):
    """Sends step commands one at a time, each only when the stop before has been assembled.

    Services: ``~/start``, ``~/pause``, ``~/resume``, ``~/abort`` (std_srvs/Trigger). Action:
    ``~/measure`` (stepdiag_ros/Measure).
    """

    role = "sequencer"

    def __init__(self) -> None:
        super().__init__("sequencer")
        self._machine, self._machine_text = load_machine(self.parameter("machine"))
        self._set_plan(self._executable(self.parameter("plan")))
        self.on_change("plan", self._set_plan, self._executable)
        self._check_until(self.parameter("until"))
        self.on_change("until", prepare=self._check_until)
        cell = self.parameter("cell")
        self._cell: SimulatedCell | None = None
        self._cell_text = ""
        if cell:
            self._cell, text = load_cell(cell)
            self._cell_text = without_effects(text, cell)
        self._sequence: Sequence | None = None
        self._needed: tuple[str, ...] = REQUIRED
        self._sessions: set[str] = set()
        self._made = self.real_time()
        self._were_ready: set[str] = set()
        self._taking_up: TakingUp | None = None
        self._after_reset: Callable[[], None] | None = None
        self._reset_tries = 0
        self._reset_asked = 0.0
        self._stop_asked: float | None = None
        self._machine_state: Any = None
        self._published: Progress | None = None
        self._not_before = 0

        self._description = self.announce(topics.RUN_DESCRIPTION)
        self._state = self.announce(topics.RUN_STATE)
        self._permits = self.announce(topics.MOTION_PERMIT)
        self._commands = self.announce(topics.MACHINE_COMMAND)
        self.listen(topics.COMMAND_STATUS, self._on_answer)
        self.listen(topics.MACHINE_STATE, self._on_machine_state)
        self.listen(topics.STOP, self._on_stop)
        self.listen(topics.RUN_VERDICT, self._on_verdict)
        self._stop_client = self.create_client(Trigger, "cnc_bridge/stop")
        self._reset_client = self.create_client(Trigger, "cnc_bridge/reset")
        self._measure = MeasureAction(
            self,
            partial(self.start, by="a goal of ~/measure"),
            self._abort,
            self._progress,
            lambda: self._running().incomplete,
        )
        self.offer("~/start", lambda: f"run {self.start()} begins")
        self.offer("~/pause", self.pause)
        self.offer("~/resume", self.resume)
        self.offer("~/abort", self.abort)
        self.health.add_task("run", self._judge_run, log=False)
        self.every(UPDATE_PERIOD, self._update, real=True)
        self.every(PERMIT_PERIOD, self._permit, real=True)
        self.every(STATE_PERIOD, self._publish_state, real=True)
        self._publish_state()

    # What an operator asks for ------------------------------------------------------------------

    def start(self, plan: str = "", until: str = "", by: str = "~/start") -> str:
        """Begin a new run: describe it, and move once every node has taken it up.

        Args:
            plan: file, name or YAML text; empty for the one of the parameter.
            until: uncertainty to be reached, as in Measure.action; empty for that of the parameter.
            by: what has asked for the run, for the log.

        Returns:
            the identity of the run.

        Raises:
            ValueError: a run is going on, a node is missing, the plan is wrong or leaves the
                limits, or the target is wrong; NotReadyYet if that may pass since nodes may be
                starting.
        """
        if not self.run_over:
            held = ", held by a fault" if self._running().state is State.FAULT else ""
            raise Refusal(
                f"run {self.run_id} is going on{held}: wait for its end, or abort it"
                " ('stepdiag abort')",
                fault="busy",
            )
        chosen, text = self._executable(plan) if plan.strip() else (self._plan, self._plan_text)
        until = until.strip() or self.parameter("until").strip()
        ends = self._ends_by(until, chosen)
        present = tuple(role for role in WELCOME if self.watch.present(role))
        missing = self.watch.missing(REQUIRED + present) or self._unknown_of_machine()
        if missing:
            starting = self._may_be_starting(REQUIRED + present)
            refusal = NotReadyYet if starting else Refusal
            raise refusal(f"cannot start: {'; '.join(missing)}", fault="not_ready")
        machine = machine_fact(self._machine.name, self._machine_text)
        if wrong := discords(self.watch, machine, cell=bool(self._cell_text)):
            raise Refusal(f"cannot start: {'; '.join(wrong)}", fault="mismatch")
        state = self._machine_state
        low, high = tuple(state.soft_limits_low), tuple(state.soft_limits_high)
        beyond = out_of_limits(chosen, low, high, "the bridge (machine file and controller)")
        if beyond:
            raise ValueError(f"cannot start: {beyond}")
        if self._cell is not None:
            self._cell.require_stops(chosen)
        self._measure.run_begins()
        self._needed = REQUIRED + present
        self._sessions = self.watch.sessions()
        self.run_id = new_run_id()
        self.run_over = False
        patience = self.watch.patience
        self._sequence = Sequence(
            chosen, tuple(state.position), self._send, self._stop_machine, patience, ends
        )
        self._published = None
        self._not_before = 0
        self._describe(text, until)
        self._taking_up = TakingUp(self.run_id, REQUIRED, self._needed, patience)
        self.get_logger().info(f"run {self.run_id} of plan '{chosen.name}': asked for by {by}")
        return self.run_id

    def pause(self) -> str:
        """Stand still after the present stop."""
        self._running().pause()
        self._publish_state()
        return "pausing after this stop"

    def resume(self) -> str:
        """Go on after a pause, a setup or a fault."""
        sequence = self._running()
        sequence.check_resumable()
        missing = self.watch.missing(self._needed) or self.watch.deaf(self._needed)
        missing = missing or self._unknown_of_machine()
        if missing:
            raise Refusal(f"cannot resume: {'; '.join(missing)}", fault="not_ready")
        self._sessions = self.watch.sessions()
        if sequence.state is State.FAULT:
            self._reset_machine(self._continue)
        else:
            self._continue()
        return "resuming"

    def abort(self) -> str:
        """Stop the machine at once and end the run, or the wish for one that waits for nodes."""
        reason = "aborted by the operator"
        gave_up = self._measure.give_up(reason)
        try:
            self._abort(reason)
        except ValueError:
            if not gave_up:
                raise
        return "aborted"

    def _abort(self, reason: str) -> None:
        self._taking_up = None
        self._after_reset = None
        self._running().abort(reason)
        self._ended()

    def _executable(self, given: str) -> tuple[Plan, str]:
        """Return a plan and its text; refuse one that the machine cannot execute."""
        plan, text = plan_given(given)
        beyond = beyond_machine(plan, self._machine)
        if beyond:
            raise ValueError(
                f"plan '{plan.name}' cannot be executed on the machine '{self._machine.name}', with"
                f" which the sequencer was started (parameter `machine`): {beyond}"
            )
        return plan, text

    def _check_until(self, text: str) -> str:
        """Refuse a target that cannot be read."""
        if text.strip():
            target_from_text(text)
        return text

    def _ends_by(self, until: str, plan: Plan) -> frozenset[int]:
        """Return after how many lines a run may have reached its target; nothing without one.

        Whether the plan determines its quantity is for the solver to say, when it takes up the run.

        Raises:
            ValueError: the target cannot be read.
        """
        if not until:
            return frozenset()
        target = target_from_text(until)
        return frozenset((*line_ends(target, plan), len(plan.lines)))

    def _set_plan(self, chosen: tuple[Plan, str]) -> None:
        self._plan, self._plan_text = chosen

    def on_heartbeat(self, peer: Peer) -> None:
        """Take the recorder's word on what is on the disk, the interferometer's on its beam.

        A run needs every welcome node that it has had.
        """
        if not peer.faulty:
            if len(self._were_ready) > MOST_PEERS:
                self._were_ready &= self.watch.sessions()
            self._were_ready.add(peer.session)
            if peer.role in WELCOME and peer.role not in self._needed:
                # It may have been heard only after the start of the run.
                self._needed += (peer.role,)
        if self._sequence is None:
            return
        if peer.role in IRREPLACEABLE and peer.session not in self._sessions:
            self._sequence.fault(f"the {peer.role} node was started again")
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

    def _unknown_of_machine(self) -> list[str]:
        """Return a sentence if nobody knows where the machine stands."""
        state = self._machine_state
        if state is None or not all(isfinite(value) for value in state.position):
            return ["the bridge has not said where the machine stands"]
        return []

    def _may_be_starting(self, needed: tuple[str, ...]) -> bool:
        """Say whether what a run needs may only be starting still.

        That may be a node that never answered, one that says that it is getting ready, and
        while this node is young itself, one that was never ready.
        """
        young = self.real_time() - self._made < START_PATIENCE
        for role in needed:
            peers = [peer for peer in self.watch.peers.values() if peer.role == role]
            were_ready = any(peer.session in self._were_ready for peer in peers)
            getting_ready = any(GETTING_READY in peer.facts for peer in peers)
            if not peers or getting_ready or (young and not were_ready):
                return True
        return self._machine_state is None

    def _on_stop(self, message: Any) -> None:
        if self._sequence is not None and message.run_id == self.run_id:
            rejection = "" if message.settled else message.reason
            self._not_before = to_nanoseconds(message.window_end)
            self._sequence.settled(message.line_index, message.attempt, message.stop, rejection)
            self._update()

    def _on_verdict(self, message: Any) -> None:
        standing = target_of(message)
        if standing is not None and self._sequence is not None and message.run_id == self.run_id:
            self._sequence.solved(standing)
            self._publish_state()
            self._update()

    # The course of the run ---------------------------------------------------------------------

    def _update(self) -> None:
        self._measure.update()
        set_back = self.clock_set_back()
        if self._sequence is None:
            return
        if set_back and not self.run_over:
            self._abort(f"{set_back}, so that times are not in order any more: start the run again")
            return
        self._insist_on_stop()
        self._insist_on_reset()
        if self._taking_up is not None:
            self._begin_when_taken_up(self._taking_up)
        else:
            if self._sequence.active:
                missing = self.watch.missing(self._needed)
                if missing:
                    self._sequence.fault("; ".join(missing))
            self._sequence.update(self.now(), self.real_time())
        self._publish_changes()

    def _begin_when_taken_up(self, taking_up: TakingUp) -> None:
        sequence, found = self._running(), taking_up.look(self.watch, self.real_time())
        if found.begins:
            self._taking_up = None
            self._reset_machine(self._begin)
        elif found.gives_up:
            self._taking_up = None
            sequence.abort(found.text)
            self._ended()
        elif sequence.text != found.text:
            sequence.text = found.text
            self._publish_state()

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

    def _judge_run(self) -> HealthFinding:
        if self._sequence is None:
            return judge_run(None, "")
        beginning = self._taking_up is not None
        waits_for = self._sequence.text if beginning else self._sequence.waits_for
        return judge_run(self._progress(), waits_for)

    def _progress(self) -> Progress:
        return self._running().progress(self.now())

    def _running(self) -> Sequence:
        if self._sequence is None:
            raise ValueError("there is no run: none was started yet")
        return self._sequence

    def _ended(self) -> None:
        self.get_logger().info(f"run {self.run_id}: {self._progress().text}")
        self.run_over = True
        self._say_how_it_stands()

    # Messages ------------------------------------------------------------------------------------

    def _describe(self, plan: str, until: str) -> None:
        message = new_message(topics.RUN_DESCRIPTION.type_name)
        set_header(message, self.now())
        message.schema_version = message.SCHEMA_VERSION
        message.run_id = self.run_id
        message.software_version = stepdiag_ros.__version__
        message.plan = plan
        message.machine = self._machine_text
        message.simulated_cell = self._cell_text
        message.until = until
        self._description.publish(message)

    def _send(self, command: Command) -> None:
        now = self.now()
        # This node's clock may lag behind the readings of the stop that is left: a simulated one by
        # a tick, that of another computer a little. By more, the stop is not one of this run.
        if self._is_simulated() or self._not_before - now <= AHEAD * NANOSECONDS:
            now = max(now, self._not_before)
        stop = command.given_at(now)
        self._permit()
        purpose = int(command.purpose)
        self._commands.publish(from_stop_command(stop, self.run_id, now, command.feed, purpose))

    def _permit(self) -> None:
        """Confirm the present command to the bridge, which does not move without."""
        wanted = 0 if self._sequence is None else self._sequence.wanted
        if wanted:
            message = new_message(topics.MOTION_PERMIT.type_name)
            set_header(message, self.now())
            message.run_id, message.command_id = self.run_id, wanted
            self._permits.publish(message)

    def _stop_machine(self) -> None:
        if self._stop_client.service_is_ready():
            self._stop_asked = self.real_time()
            self._stop_client.call_async(Trigger.Request()).add_done_callback(self._on_stopped)
        else:
            # Said with the fault or the end that is to follow.
            self._running().not_stopped("the CNC bridge does not offer its stop service")

    def _on_stopped(self, future: Any) -> None:
        self._stop_asked = None
        response = future.result()
        self._say_not_stopped("" if response.success else response.message)

    def _insist_on_stop(self) -> None:
        limit = STOP_LIMIT * self.watch.patience
        if self._stop_asked is not None and self.real_time() - self._stop_asked > limit:
            self._stop_asked = None
            self._say_not_stopped("the CNC bridge does not answer its stop service")

    def _say_not_stopped(self, why: str) -> None:
        # A run that goes on was resumed since, on a machine that was reset.
        sequence = self._running()
        if not sequence.active and sequence.not_stopped(why):
            self._say_how_it_stands()

    def _say_how_it_stands(self) -> None:
        """Say of a run that does not go on how it has ended or why it stands."""
        self._publish_state()
        progress = self._progress()
        if progress.state is State.FAULT:
            self.unwell(f"run stopped: {progress.text}")
        elif self._running().unstopped:
            self.unwell(f"last run: {progress.text}")
        else:
            self.healthy(f"ready; last run: {progress.text}")

    def _reset_machine(self, then: Callable[[], None]) -> None:
        self._after_reset, self._reset_tries = then, 0
        self._ask_for_reset()

    def _ask_for_reset(self) -> None:
        self._reset_tries += 1
        self._reset_asked = self.real_time()
        self._reset_client.call_async(Trigger.Request()).add_done_callback(self._on_reset)

    def _on_reset(self, future: Any) -> None:
        response, then = future.result(), self._after_reset
        if then is None:
            return
        if response.success:
            # A bridge that died before it answered owes no word on a stop any more.
            self._after_reset = self._stop_asked = None
            then()
        elif self._reset_tries >= RESET_TRIES:
            self._say_not_reset(f"the CNC bridge cannot be reset: {response.message}")

    def _insist_on_reset(self) -> None:
        # A machine that was just stopped still brakes, and cannot be reset yet. A bridge that was
        # started again is heard before its services are found; what was asked meanwhile went to the
        # one that is gone.
        if self._after_reset is None or self.real_time() - self._reset_asked < RESET_LIMIT:
            return
        if self._reset_tries < RESET_TRIES:
            self._ask_for_reset()
        else:
            self._say_not_reset(
                "the CNC bridge does not answer its reset service: abort, or restart it"
            )

    def _say_not_reset(self, why: str) -> None:
        self._after_reset = None
        sequence = self._running()
        if sequence.state is State.FAULT:
            # The run stays as it is, for another try.
            sequence.not_resumed(why)
            self._say_how_it_stands()
        else:
            # A run that has not begun yet.
            sequence.abort(why)
            self._ended()

    def _publish_changes(self) -> None:
        """Publish the state when another stop, line or state has been reached."""
        if self._sequence is None:
            return
        progress, before = self._sequence.progress(self.now()), self._published
        if before is None or progress.state is not before.state:
            if progress.state is State.FAULT:
                self._say_how_it_stands()
                return
            if progress.state is State.FINISHED:
                self._ended()
                return
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
            progress = self._published = self._progress()
            message.run_id = self.run_id
            message.setup = progress.setup
            write_progress(message, progress)
        self._state.publish(message)
        self._measure.tell()


def main() -> int:
    """Run the node."""
    return spin(SequencerNode)


if __name__ == "__main__":
    sys.exit(main())
