"""A goal at its server: the states it goes through, and the handle that callbacks get."""

from __future__ import annotations

import threading
from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, Any

from action_msgs.msg import GoalStatus

from rclpy.exceptions import RCLError

if TYPE_CHECKING:
    from rclpy.action.server import ActionServer


class GoalEvent(Enum):
    """What can happen to a goal."""

    EXECUTE = 0
    CANCEL_GOAL = 1
    SUCCEED = 2
    ABORT = 3
    CANCELED = 4


_NAMES = {
    GoalStatus.STATUS_ACCEPTED: "ACCEPTED",
    GoalStatus.STATUS_EXECUTING: "EXECUTING",
    GoalStatus.STATUS_CANCELING: "CANCELING",
    GoalStatus.STATUS_SUCCEEDED: "SUCCEEDED",
    GoalStatus.STATUS_CANCELED: "CANCELED",
    GoalStatus.STATUS_ABORTED: "ABORTED",
}
_RULES: dict[tuple[int, GoalEvent], int] = {
    (GoalStatus.STATUS_ACCEPTED, GoalEvent.EXECUTE): GoalStatus.STATUS_EXECUTING,
    (GoalStatus.STATUS_ACCEPTED, GoalEvent.CANCEL_GOAL): GoalStatus.STATUS_CANCELING,
    (GoalStatus.STATUS_EXECUTING, GoalEvent.CANCEL_GOAL): GoalStatus.STATUS_CANCELING,
    (GoalStatus.STATUS_EXECUTING, GoalEvent.SUCCEED): GoalStatus.STATUS_SUCCEEDED,
    (GoalStatus.STATUS_EXECUTING, GoalEvent.ABORT): GoalStatus.STATUS_ABORTED,
    (GoalStatus.STATUS_CANCELING, GoalEvent.SUCCEED): GoalStatus.STATUS_SUCCEEDED,
    (GoalStatus.STATUS_CANCELING, GoalEvent.ABORT): GoalStatus.STATUS_ABORTED,
    (GoalStatus.STATUS_CANCELING, GoalEvent.CANCELED): GoalStatus.STATUS_CANCELED,
}
_ACTIVE = (
    GoalStatus.STATUS_ACCEPTED,
    GoalStatus.STATUS_EXECUTING,
    GoalStatus.STATUS_CANCELING,
)


class ServerGoalHandle:
    """An accepted goal; made by the action server and given to its callbacks."""

    def __init__(self, action_server: ActionServer, goal_info: Any, goal_request: Any) -> None:
        self._action_server = action_server
        self._goal_info = goal_info
        self._goal_request = goal_request
        self._status: int = GoalStatus.STATUS_ACCEPTED
        #: When it ended, in nanoseconds of the node's clock, and with which status.
        self._ended_at = 0
        self._outcome: int = GoalStatus.STATUS_UNKNOWN
        #: Taken before the server's lock where both are needed.
        self._lock = threading.RLock()
        #: Who has asked for the result before it was there, and the result.
        self._waiting: list[Any] = []
        self._response: Any = None

    def __eq__(self, other: object) -> bool:
        return bool(self.goal_id == getattr(other, "goal_id", None))

    __hash__ = None  # type: ignore[assignment]

    @property
    def request(self) -> Any:
        """The goal message."""
        return self._goal_request

    @property
    def goal_id(self) -> Any:
        """The goal's identity (``unique_identifier_msgs/msg/UUID``)."""
        return self._goal_info.goal_id

    @property
    def is_active(self) -> bool:
        """Whether it has not ended."""
        return self._status in _ACTIVE

    @property
    def is_cancel_requested(self) -> bool:
        """Whether its cancellation was asked for and accepted."""
        return bool(self._status == GoalStatus.STATUS_CANCELING)

    @property
    def status(self) -> int:
        """One of the constants of ``action_msgs/msg/GoalStatus``; unknown once forgotten."""
        return self._status

    def execute(self, execute_callback: Callable[[Any], Any] | None = None) -> None:
        """Have the goal executed by a function, by the server's own one if ``None``.

        Raises:
            rclpy.exceptions.RCLError: The goal is executed already or has ended.
        """
        # A goal may be cancelled before; then the function is called to end it.
        if not self.is_cancel_requested:
            self._update_state(GoalEvent.EXECUTE)
        self._action_server.notify_execute(self, execute_callback)

    def publish_feedback(self, feedback: Any) -> None:
        """Report the progress to the clients.

        Raises:
            TypeError: It is another message than the action's feedback.
        """
        wanted = self._action_server.action_type.Feedback
        if not isinstance(feedback, wanted):
            raise TypeError(f"Expected {wanted}, got {type(feedback)}")
        with self._lock:
            if self._status != GoalStatus.STATUS_UNKNOWN:
                self._action_server._publish_feedback(self.goal_id, feedback)

    def succeed(self) -> None:
        """End it as reached.

        Raises:
            rclpy.exceptions.RCLError: It is not being executed.
        """
        self._update_state(GoalEvent.SUCCEED)

    def abort(self) -> None:
        """End it as failed.

        Raises:
            rclpy.exceptions.RCLError: It is not being executed.
        """
        self._update_state(GoalEvent.ABORT)

    def canceled(self) -> None:
        """End it as cancelled.

        Raises:
            rclpy.exceptions.RCLError: Nobody has asked for that.
        """
        self._update_state(GoalEvent.CANCELED)

    def destroy(self) -> None:
        """Forget it: its status is unknown from now on, and changes are ignored."""
        with self._lock:
            self._status = GoalStatus.STATUS_UNKNOWN

    def _update_state(self, event: GoalEvent) -> None:
        with self._lock:
            if self._status == GoalStatus.STATUS_UNKNOWN:
                return
            state = _RULES.get((self._status, event))
            if state is None:
                raise RCLError(
                    "Failed to update goal state: goal_handle attempted invalid transition from"
                    f" state {_NAMES[self._status]} with event {event.name}"
                )
            ends = state not in _ACTIVE
            if ends:
                # Set before the state, which others read without the lock.
                self._ended_at, self._outcome = self._action_server._now(), state
            self._status = state
            self._action_server._publish_status()
            if ends:
                self._action_server.notify_goal_done()

    def _is_cancelable(self) -> bool:
        """Return whether it may still be cancelled."""
        return (self._status, GoalEvent.CANCEL_GOAL) in _RULES
