"""Node of the command line: what an operator does and sees; lives in ``stepdiag run``."""

import os
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.action import ActionClient
from std_srvs.srv import Trigger

from stepdiag_ros import topics
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.nodes import interrupts
from stepdiag_ros.nodes.base import StepdiagNode
from stepdiag_ros.nodes.measure_action import measure_type
from stepdiag_ros.run.supervision import OPERATOR_ROLE, START_PATIENCE

SERVICE_LIMIT = 20.0
"""Real seconds that a service, or the action for a new goal, may take to answer: a busy computer
takes several, and who has asked to abort needs the answer."""


class OperatorNode(StepdiagNode):
    """Starts, cancels and follows a run.

    It starts by the action, so that the result of the run comes back to the client that started it;
    a pause or a setup, which anyone may end, goes by the services.

    Attributes:
        state: last RunState of the run that this operator started; None before.
        started_run: its identity.
        last_state: last RunState of any run; None before.
    """

    role = OPERATOR_ROLE

    def __init__(self) -> None:
        # Several may look on at the same time, and nodes of one name are an error.
        super().__init__(f"stepdiag_operator_{os.getpid()}")
        self.state: Any = None
        self.started_run = ""
        self.last_state: Any = None
        action = measure_type()
        self._new_goal = action.Goal
        self._action = ActionClient(self, action, "sequencer/measure")
        self._handle: Any = None
        self._answer: Any = None
        # Goal → its last feedback.
        self._feedback: dict[bytes, Any] = {}
        self._description: Any = None
        self._verdict: Any = None
        self.listen(topics.RUN_VERDICT, self._on_verdict)
        self.listen(topics.RUN_STATE, self._on_state)
        self.listen(topics.RUN_DESCRIPTION, self._on_description)

    @property
    def result(self) -> Any:
        """The result of the run (as in Measure.action) once it is known; None before."""
        return self._answer.result().result if self._answer and self._answer.done() else None

    @property
    def verdict(self) -> Any:
        """Last RunVerdict of the run that this operator started; None before."""
        told = self._verdict
        return told if told is not None and told.run_id == self.started_run else None

    @property
    def sequencer(self) -> str:
        """Which process the sequencer of this namespace is; empty if none is there."""
        name = f"{self.get_namespace().rstrip('/')}/sequencer"
        peer = self.watch.peers.get(name)
        return "" if peer is None or name in self.watch.lost else peer.session

    @property
    def text(self) -> str:
        """What is going on, as the run itself says it; empty before it has said anything."""
        told = self._handle and self._feedback.get(bytes(self._handle.goal_id.uuid))
        return str(told.text) if told else ""

    @property
    def plan(self) -> str:
        """The plan of the run that this operator started, YAML; empty before it is known."""
        told = self._description
        return str(told.plan) if told is not None and told.run_id == self.started_run else ""

    def spin_until(self, done: Callable[[], bool], limit: float) -> bool:
        """Handle messages until a condition holds; say whether it did within ``limit`` real s."""
        deadline = self.real_time() + limit
        while not done():
            if self.real_time() > deadline:
                return False
            with interrupts.held():
                rclpy.spin_once(self, timeout_sec=0.1)
        return True

    def call(self, service: str) -> str:
        """Call a Trigger service and return its answer.

        Raises:
            ValueError: it was refused, or nobody answers.
        """
        client = self.create_client(Trigger, service)
        try:
            if not self.spin_until(client.service_is_ready, SERVICE_LIMIT):
                raise ValueError(f"there is no server for the service {service}")
            future = client.call_async(Trigger.Request())
            if not self.spin_until(future.done, SERVICE_LIMIT):
                raise ValueError(
                    f"the service {service} does not answer: it is unknown whether the command was"
                    " executed. 'stepdiag watch --once' shows the state of the run"
                )
            response = future.result()
        finally:
            self.destroy_client(client)
        if not response.success:
            raise Refusal(response.message, fault="rejected")
        return str(response.message)

    def start(self, plan: str = "", until: str = "") -> str:
        """Start a run and return its identity.

        Args:
            plan: as the sequencer knows it, or the YAML text; empty for the sequencer's own.
            until: uncertainty to be reached, as in Measure.action; empty for the sequencer's own.

        Raises:
            ValueError: the sequencer refuses, and says why, or nobody answers.
            KeyboardInterrupt: as asked; the goal is cancelled.
        """
        if not self.spin_until(self._action.server_is_ready, SERVICE_LIMIT):
            namespace = self.get_namespace().rstrip("/")
            raise ValueError(f"there is no server for the action {namespace}/sequencer/measure")
        goal = self._new_goal(plan=plan, until=until)
        sent = self._action.send_goal_async(goal, self._on_feedback)
        try:
            return self._begun(sent)
        except KeyboardInterrupt:
            self._withdraw(sent)
            raise

    def _begun(self, sent: Any) -> str:
        if not self.spin_until(sent.done, SERVICE_LIMIT):
            # Whoever is told that nothing was started must not see a machine move later.
            sent.add_done_callback(lambda late: late.result().cancel_goal_async())
            raise ValueError("the action sequencer/measure does not answer")
        handle = sent.result()
        if not handle.accepted:
            raise ValueError("the action sequencer/measure does not accept the goal")
        key = bytes(handle.goal_id.uuid)
        answer = handle.get_result_async()

        def said() -> bool:
            # While the goal waits for nodes that are starting, its feedback names no run.
            told = self._feedback.get(key)
            return answer.done() or (told is not None and bool(told.run_id))

        if not self.spin_until(said, START_PATIENCE + SERVICE_LIMIT):
            handle.cancel_goal_async()
            raise ValueError("the sequencer does not say which run it has begun")
        if answer.done():
            raise Refusal(str(answer.result().result.text), fault="rejected")
        self._handle, self._answer = handle, answer
        self.started_run = str(self._feedback[key].run_id)
        self.state = None
        if self.last_state is not None:
            self._on_state(self.last_state)
        return self.started_run

    def _withdraw(self, sent: Any) -> None:
        if self.spin_until(sent.done, SERVICE_LIMIT) and sent.result().accepted:
            cancelled = sent.result().cancel_goal_async()
            self.spin_until(cancelled.done, SERVICE_LIMIT)

    def cancel(self) -> None:
        """Have the machine stopped at once and the run ended that this operator has started.

        Raises:
            ValueError: it has ended, or nobody answers.
        """
        if self._handle is None:
            raise ValueError("no run was started")
        future = self._handle.cancel_goal_async()
        if not self.spin_until(future.done, SERVICE_LIMIT):
            raise ValueError("the action sequencer/measure does not answer")
        if not future.result().goals_canceling:
            raise Refusal("the run has ended already", fault="stopped")

    def _on_feedback(self, message: Any) -> None:
        self._feedback[bytes(message.goal_id.uuid)] = message.feedback

    def _on_description(self, message: Any) -> None:
        self._description = message

    def _on_verdict(self, message: Any) -> None:
        self._verdict = message

    def _on_state(self, message: Any) -> None:
        self.last_state = message
        if self.started_run and message.run_id == self.started_run:
            self.state = message
