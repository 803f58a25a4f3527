"""Node of the command line: what an operator does and sees; lives in ``stepdiag run``."""

from collections.abc import Callable
from typing import Any

import rclpy
from std_srvs.srv import Trigger

from stepdiag_ros import topics
from stepdiag_ros.nodes.base import StepdiagNode

SERVICE_LIMIT = 5.0
"""Real seconds that a service may take to answer."""


class OperatorNode(StepdiagNode):
    """Starts, aborts and follows a run.

    Attributes:
        state: last RunState of the run that this operator started; None before.
        started_run: its identity.
    """

    role = "operator"

    def __init__(self) -> None:
        super().__init__("stepdiag_operator")
        self.state: Any = None
        self.started_run = ""
        self.listen(topics.RUN_STATE, self._on_state)

    def spin_until(self, done: Callable[[], bool], limit: float) -> bool:
        """Handle messages until a condition holds; say whether it did within ``limit`` real s."""
        deadline = self.real_time() + limit
        while not done():
            if self.real_time() > deadline:
                return False
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
                raise ValueError(f"nobody offers the service {service}")
            future = client.call_async(Trigger.Request())
            if not self.spin_until(future.done, SERVICE_LIMIT):
                raise ValueError(f"the service {service} does not answer")
            response = future.result()
        finally:
            self.destroy_client(client)
        if not response.success:
            raise ValueError(response.message)
        return str(response.message)

    def start(self) -> str:
        """Start a run and return its identity.

        Raises:
            ValueError: the sequencer refuses, and says why.
        """
        answer = self.call("sequencer/start")
        self.started_run = answer.split()[1]
        return self.started_run

    def _on_state(self, message: Any) -> None:
        if self.started_run and message.run_id == self.started_run:
            self.state = message
