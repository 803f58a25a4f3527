#!/usr/bin/env python3
"""Node: follows a run that is measured by hand, by the readings alone. It moves nothing."""

import sys
from math import nan
from typing import Any

import stepdiag_ros
from stepdiag_ros import topics
from stepdiag_ros.configuration import load_machine, plan_given
from stepdiag_ros.messages.conversion import (
    STATUS_IN_POSITION,
    from_command_status,
    from_stop_command,
    to_reading,
)
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.messages.types import new_message
from stepdiag_ros.metrology.by_hand import plan_by_hand, require_standing_beam
from stepdiag_ros.metrology.measurement import Arrival, StopCommand
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.nodes.base import StepdiagNode, spin
from stepdiag_ros.nodes.measure_action import write_progress
from stepdiag_ros.planning.plan_text import plan_text
from stepdiag_ros.run.hand_course import HandCourse
from stepdiag_ros.run.health import HealthFinding
from stepdiag_ros.run.identity import new_run_id
from stepdiag_ros.run.sequence import Progress, State
from stepdiag_ros.run.work_health import judge_run

UPDATE_PERIOD = 0.1
STATE_PERIOD = 0.5
FOLLOWER_LIMIT = 5.0
"""Real seconds within which the other nodes must have taken up a new run."""
FOLLOWERS = ("assembler", "solver", "recorder")
"""Roles that say in their heartbeat which run they have taken up."""
REQUIRED = ("interferometer", *FOLLOWERS)
"""Roles without which no run starts, and whose loss stops one."""
MOVERS = ("cnc_bridge", "sequencer")
"""Roles that command a machine; where one of them is, nothing is measured by hand."""


def _plan_given(given: str) -> tuple[Plan, str]:
    chosen = plan_given(given)
    require_standing_beam(chosen[0], "the plan")
    return chosen


class ByHandNode(StepdiagNode):
    """Says which stop the machine stands at, as the readings show it, in place of the sequencer.

    Its commands and their states only report what the machine did: they have no feed, no
    permit to move goes with them, and the node publishes none while a bridge is in the graph.

    Services: ``~/start``, ``~/resume``, ``~/abort`` (std_srvs/Trigger).
    """

    role = "by_hand"

    def __init__(self) -> None:
        super().__init__("by_hand")
        self._machine_text = load_machine(self.parameter("machine"))[1]
        self._set_plan(_plan_given(self.parameter("plan")))
        self.on_change("plan", self._set_plan, _plan_given)
        self._course: HandCourse | None = None
        self._waiting_since: float | None = None
        self._published: Progress | None = None
        self._description = self.announce(topics.RUN_DESCRIPTION)
        self._state = self.announce(topics.RUN_STATE)
        self._commands = self.announce(topics.MACHINE_COMMAND)
        self._words = self.announce(topics.COMMAND_STATUS)
        self.listen(topics.READING, self._on_reading, keep_all=True)
        self.offer("~/start", lambda: f"run {self.start()} begins")
        self.offer("~/resume", self.resume)
        self.offer("~/abort", self.abort)
        self.health.add_task("run", self._judge_run, log=False)
        self.every(UPDATE_PERIOD, self._update, real=True)
        self.every(STATE_PERIOD, self._publish_state, real=True)
        self._publish_state()

    def start(self) -> str:
        """Describe a new run; it waits for the first setup once every node has taken it up.

        Returns:
            the identity of the run.

        Raises:
            ValueError: a run is going on, a node is missing, or one that commands a machine is
                there.
        """
        if self._waiting_since is not None or (self._course and not self.run_over):
            raise Refusal(
                f"run {self.run_id} is going on: wait for its end, or abort it", fault="busy"
            )
        objections = self._movers() + self.watch.missing(REQUIRED)
        if objections:
            raise ValueError(f"cannot start: {'; '.join(objections)}")
        self.run_id = new_run_id()
        self.run_over = False
        self._course = HandCourse(self._plan, self._tell)
        self._published = None
        self._describe()
        self._waiting_since = self.real_time()
        return self.run_id

    def resume(self) -> str:
        """Follow from now on: the machine stands at the first stop of the present line."""
        course = self._running()
        course.check_resumable()
        objections = self._movers() + self.watch.missing(REQUIRED)
        if objections:
            raise ValueError(f"cannot resume: {'; '.join(objections)}")
        course.resume()
        self.healthy(f"run {self.run_id}")
        self._publish_state()
        return course.text

    def abort(self) -> str:
        """End the run. The machine is the operator's to stop."""
        self._waiting_since = None
        self._running().abort("aborted by the operator")
        self._ended()
        return "aborted; the machine goes on until its own controller is stopped"

    def _set_plan(self, chosen: tuple[Plan, str]) -> None:
        self._plan = chosen[0]

    def _movers(self) -> list[str]:
        return [
            f"a {role} node is there, which commands a machine: end it, or measure with it"
            for role in MOVERS
            if self.watch.present(role)
        ]

    def _running(self) -> HandCourse:
        if self._course is None:
            raise ValueError("there is no run: none was started yet")
        return self._course

    def _on_reading(self, message: Any) -> None:
        if self._course is not None and self._course.state is State.RUNNING:
            self._course.take(to_reading(message))
            self._publish_changes()

    def _tell(self, command: StopCommand, arrival: Arrival) -> None:
        self._commands.publish(from_stop_command(command, self.run_id, command.time, nan))
        self._words.publish(
            from_command_status(
                command.command_id,
                self.run_id,
                arrival.time,
                STATUS_IN_POSITION,
                command.target,
                arrival.position,
            )
        )

    def _update(self) -> None:
        course = self._course
        if course is None or self.run_over:
            return
        if self._waiting_since is not None:
            behind = [role for role in FOLLOWERS if not self.watch.present(role, self.run_id)]
            if not behind:
                self._waiting_since = None
                course.start()
                self.healthy(f"run {self.run_id}")
            elif self.real_time() - self._waiting_since > FOLLOWER_LIMIT:
                self._waiting_since = None
                course.abort(f"{', '.join(behind)} did not take up the run")
                self._ended()
        elif course.state is State.RUNNING:
            missing = self._movers() + self.watch.missing(REQUIRED)
            if missing:
                course.fault("; ".join(missing))
        self._publish_changes()

    def _publish_changes(self) -> None:
        progress, before = self._running().progress(), self._published
        told = None if before is None else (before.state, before.line_index, before.stop)
        if told == (progress.state, progress.line_index, progress.stop) and (
            before is not None and before.text == progress.text
        ):
            return
        if progress.state is State.FINISHED and not self.run_over:
            self._ended()
            return
        if progress.state is State.FAULT:
            self.unwell(f"run stopped: {progress.text}")
        self._publish_state()

    def _ended(self) -> None:
        text = self._running().text
        self.get_logger().info(f"run {self.run_id}: {text}")
        self.run_over = True
        self._publish_state()
        self.healthy(f"ready; last run: {text}")

    def _judge_run(self) -> HealthFinding:
        if self._course is None:
            return judge_run(None, "")
        waits = self._course.state in (State.WAITING_FOR_SETUP, State.FAULT)
        return judge_run(self._course.progress(), "~/resume" if waits else "the next stop")

    def _describe(self) -> None:
        message = new_message(topics.RUN_DESCRIPTION.type_name)
        set_header(message, self.now())
        message.schema_version = message.SCHEMA_VERSION
        message.run_id = self.run_id
        message.software_version = stepdiag_ros.__version__
        message.plan = plan_text(plan_by_hand(self._plan), ("measured by hand",))
        message.machine = self._machine_text
        self._description.publish(message)

    def _publish_state(self) -> None:
        message = new_message(topics.RUN_STATE.type_name)
        set_header(message, self.now())
        if self._course is None:
            message.text = "nothing was started"
        else:
            progress = self._published = self._course.progress()
            message.run_id = self.run_id
            message.setup = progress.setup
            write_progress(message, progress)
        self._state.publish(message)


def main() -> int:
    """Run the node."""
    return spin(ByHandNode)


if __name__ == "__main__":
    sys.exit(main())
