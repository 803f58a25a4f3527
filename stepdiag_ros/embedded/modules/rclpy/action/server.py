"""Action servers."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, Any

from action_msgs.msg import GoalInfo, GoalStatus
from action_msgs.srv import CancelGoal

from rclpy._service_wire import RequestId, ServerEnd
from rclpy._source import Source
from rclpy.action._goal import GoalEvent, ServerGoalHandle
from rclpy.callback_groups import CallbackGroup
from rclpy.duration import NS_PER_S
from rclpy.exceptions import NameValidationException, RCLError
from rclpy.executors import await_or_execute
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_action_status_default, qos_profile_services_default
from rclpy.timer import Timer
from stepdiag_ros.embedded import registry

if TYPE_CHECKING:
    from rclpy.node import Node

_Callback = Callable[[Any], Any]


_TOPICS = ("feedback", "status")


class GoalResponse(Enum):
    """What a goal callback answers."""

    REJECT = 1
    ACCEPT = 2


class CancelResponse(Enum):
    """What a cancel callback answers."""

    REJECT = 1
    ACCEPT = 2


def default_handle_accepted_callback(goal_handle: ServerGoalHandle) -> None:
    """Execute the goal."""
    goal_handle.execute()


def default_goal_callback(goal_request: Any) -> GoalResponse:  # noqa: ARG001
    """Accept every goal."""
    return GoalResponse.ACCEPT


def default_cancel_callback(cancel_request: Any) -> CancelResponse:  # noqa: ARG001
    """Reject every wish to cancel."""
    return CancelResponse.REJECT


class _ExpiryTimer(Timer):
    """Forgets old goals; not among the node's own timers."""


class ActionServer(Source):
    """Executes goals with a function, in the executor and outside all callback groups.

    A function that waits therefore needs a :class:`rclpy.executors.MultiThreadedExecutor`, or has
    to be a coroutine function, to receive requests to cancel in the meantime.

    Args:
        node: The node.
        action_type: Class of the action.
        action_name: The action; relative names get the node's namespace.
        execute_callback: Called with the :class:`ServerGoalHandle` of a goal to execute; ends the
            goal and returns the result message. A goal it does not end is aborted.
        callback_group: The group of all other callbacks; the node's own if ``None``.
        goal_callback: Called with a goal message; returns whether to accept it.
        handle_accepted_callback: Called with the handle of an accepted goal; executes it at once
            by default.
        cancel_callback: Called with the handle of a goal to cancel; returns whether to do so.
        goal_service_qos_profile: Quality of the service for goals.
        result_service_qos_profile: Quality of the service for results.
        cancel_service_qos_profile: Quality of the service to cancel.
        feedback_pub_qos_profile: Quality of the feedback topic.
        status_pub_qos_profile: Quality of the status topic.
        result_timeout: How long a result is kept after the goal's end, in seconds.

    Raises:
        TypeError: ``action_type`` is not an action class or ``execute_callback`` no function.
        ValueError: The action's name breaks the rules, or ``result_timeout`` is negative.
    """

    def __init__(
        self,
        node: Node,
        action_type: Any,
        action_name: str,
        execute_callback: _Callback,
        *,
        callback_group: CallbackGroup | None = None,
        goal_callback: _Callback | None = default_goal_callback,
        handle_accepted_callback: _Callback | None = default_handle_accepted_callback,
        cancel_callback: _Callback | None = default_cancel_callback,
        goal_service_qos_profile: QoSProfile = qos_profile_services_default,
        result_service_qos_profile: QoSProfile = qos_profile_services_default,
        cancel_service_qos_profile: QoSProfile = qos_profile_services_default,
        feedback_pub_qos_profile: QoSProfile | None = None,
        status_pub_qos_profile: QoSProfile = qos_profile_action_status_default,
        result_timeout: float = 900,
    ) -> None:
        group = callback_group or node.default_callback_group
        self.register_handle_accepted_callback(handle_accepted_callback)
        self.register_goal_callback(goal_callback)
        self.register_cancel_callback(cancel_callback)
        self.register_execute_callback(execute_callback)
        registry.check_action(action_type)
        if result_timeout < 0:
            raise ValueError(
                f"Failed to create action server: result_timeout is {result_timeout} s; it must"
                " not be negative."
            )
        base = f"{action_name}/_action"
        try:
            names = {
                part: node.resolve_service_name(f"{base}/{part}")
                for part in ("send_goal", "cancel_goal", "get_result")
            }
            topics = {part: node.resolve_topic_name(f"{base}/{part}") for part in _TOPICS}
        except NameValidationException as error:
            raise ValueError(f"Failed to create action server: {error}") from error
        super().__init__(group)
        self._node = node
        self._action_type = action_type
        self._logger = node.get_logger().get_child("action_server")
        self._timeout = int(result_timeout * NS_PER_S)
        self._lock = threading.RLock()
        self._goal_handles: dict[bytes, ServerGoalHandle] = {}
        wire = action_type.Impl
        self._goal_end = ServerEnd(
            node, wire.SendGoalService, names["send_goal"], goal_service_qos_profile
        )
        self._cancel_end = ServerEnd(
            node, CancelGoal, names["cancel_goal"], cancel_service_qos_profile
        )
        self._result_end = ServerEnd(
            node, wire.GetResultService, names["get_result"], result_service_qos_profile
        )
        self._ends = (self._goal_end, self._cancel_end, self._result_end)
        self._feedback = Publisher(
            node,
            wire.FeedbackMessage,
            topics["feedback"],
            feedback_pub_qos_profile or QoSProfile(depth=10),
        )
        self._status = Publisher(
            node, wire.GoalStatusMessage, topics["status"], status_pub_qos_profile
        )
        self._publishers = (self._feedback, self._status)
        self._timer = _ExpiryTimer(self._expire, group, 0, node.get_clock(), autostart=False)
        for source in (self, self._timer, *(publisher._watch for publisher in self._publishers)):
            node._add(source)
        readers, writers = self._guids()
        node._ros_graph.add_endpoints(node._graph_number, readers, writers)

    @property
    def action_type(self) -> Any:
        """Class of the action."""
        return self._action_type

    def register_handle_accepted_callback(self, handle_accepted_callback: _Callback | None) -> None:
        """Call a function with the handle of each accepted goal; ``None`` executes it at once."""
        self._handle_accepted_callback = (
            handle_accepted_callback or default_handle_accepted_callback
        )

    def register_goal_callback(self, goal_callback: _Callback | None) -> None:
        """Ask a function whether to accept a goal; ``None`` accepts every one."""
        self._goal_callback = goal_callback or default_goal_callback

    def register_cancel_callback(self, cancel_callback: _Callback | None) -> None:
        """Ask a function whether to cancel a goal; ``None`` rejects every wish."""
        self._cancel_callback = cancel_callback or default_cancel_callback

    def register_execute_callback(self, execute_callback: _Callback) -> None:
        """Execute goals with a function.

        Raises:
            TypeError: It cannot be called.
        """
        if not callable(execute_callback):
            raise TypeError("Failed to register goal execution callback: not callable")
        self._execute_callback = execute_callback

    def notify_execute(
        self, goal_handle: ServerGoalHandle, execute_callback: _Callback | None
    ) -> None:
        """Have a goal executed; :meth:`ServerGoalHandle.execute` calls this."""
        callback = execute_callback or self._execute_callback
        executor = self._node.executor
        if executor is None:
            # Nobody spins the node now; whoever does next starts the work.
            self._pending.append((self._start, (callback, goal_handle)))
        else:
            executor.create_task(self._execute_goal, callback, goal_handle)

    def notify_goal_done(self) -> None:
        """Plan when to forget the goals that have ended."""
        with self._lock:
            ends = [goal._ended_at for goal in self._goal_handles.values() if not goal.is_active]
            if not ends:
                self._timer.cancel()
                return
            self._timer.timer_period_ns = max(0, min(ends) + self._timeout - self._now())
            self._timer.reset()

    def destroy(self) -> None:
        """End the server; clients get no more results."""
        if not self._node._drop(self):
            return
        for goal in list(self._goal_handles.values()):
            goal.destroy()
        super().destroy()
        node, (readers, writers) = self._node, self._guids()
        node._ros_graph.remove_endpoints(node._graph_number, readers + writers)
        node._drop(self._timer)
        self._timer.destroy()
        for publisher in self._publishers:
            node._drop(publisher._watch)
            publisher.destroy()
        for end in self._ends:
            end.close()

    # What the executor and the goals call.

    def _conditions(self) -> list[int]:
        return [end.condition for end in self._ends]

    def _fetch(self) -> None:
        for end, handler in zip(
            self._ends, (self._on_goal, self._on_cancel, self._on_result), strict=True
        ):
            self._pending.extend((handler, sample) for sample in end.take())

    def _run(self, item: Any) -> Any:
        handler, content = item
        return handler(content)

    def _now(self) -> int:
        return self._node.get_clock().now().nanoseconds

    def _guids(self) -> tuple[list[bytes], list[bytes]]:
        readers = [guid for end in self._ends for guid in end.guids[0]]
        writers = [guid for end in self._ends for guid in end.guids[1]]
        return readers, writers + [publisher._guid for publisher in self._publishers]

    def _publish_feedback(self, goal_id: Any, feedback: Any) -> None:
        self._feedback.publish(
            self._action_type.Impl.FeedbackMessage(goal_id=goal_id, feedback=feedback)
        )

    def _publish_status(self) -> None:
        # The lock keeps two threads from publishing their pictures in the wrong order.
        with self._lock:
            message = self._action_type.Impl.GoalStatusMessage()
            message.status_list = [
                GoalStatus(goal_info=goal._goal_info, status=goal.status)
                for goal in self._goal_handles.values()
            ]
            self._status.publish(message)

    def _start(self, content: Any) -> None:
        callback, goal_handle = content
        self.notify_execute(goal_handle, callback)

    # Requests.

    async def _on_goal(self, sample: Any) -> None:
        found = self._goal_end.decode(sample)
        if found is None:
            return
        request_id, request = found
        key = bytes(request.goal_id.uuid)
        response = self._action_type.Impl.SendGoalService.Response()
        goal: ServerGoalHandle | None = None
        if key not in self._goal_handles:
            answer = await await_or_execute(self._goal_callback, request.goal)
            if not isinstance(answer, GoalResponse):
                self._logger.warning(
                    "Goal request callback did not return a GoalResponse type. Rejecting goal."
                )
            elif answer == GoalResponse.ACCEPT:
                goal = self._accept(key, request)
        if goal is not None:
            response.accepted = True
            response.stamp = goal._goal_info.stamp
        self._goal_end.reply(request_id, response)
        if goal is not None:
            await await_or_execute(self._handle_accepted_callback, goal)

    def _accept(self, key: bytes, request: Any) -> ServerGoalHandle | None:
        stamp = self._node.get_clock().now().to_msg()
        info = GoalInfo(goal_id=request.goal_id, stamp=stamp)
        with self._lock:
            if key in self._goal_handles:
                self._logger.error(
                    f"Failed to accept new goal with ID {list(key)}: goal ID already exists"
                )
                return None
            self._goal_handles[key] = goal = ServerGoalHandle(self, info, request.goal)
            return goal

    async def _execute_goal(self, callback: _Callback, goal: ServerGoalHandle) -> None:
        try:
            result = await await_or_execute(callback, goal)
        except Exception as error:
            result = self._action_type.Result()
            self._logger.error(f"Error raised in execute callback: {error}")
            traceback.print_exc()
        if goal.is_active:
            self._logger.warning(
                f"Goal state not set, assuming aborted. Goal ID: {goal.goal_id.uuid}"
            )
            goal.abort()
        response = self._action_type.Impl.GetResultService.Response()
        response.status = goal._outcome
        response.result = result
        with goal._lock:
            goal._response = response
            waiting, goal._waiting = goal._waiting, []
        for request_id in waiting:
            self._send_result(request_id, response)

    async def _on_cancel(self, sample: Any) -> None:
        found = self._cancel_end.decode(sample)
        if found is None:
            return
        request_id, request = found
        code, goals = self._select(request.goal_info)
        response = CancelGoal.Response(return_code=code)
        for goal in goals:
            answer = await await_or_execute(self._cancel_callback, goal)
            if answer != CancelResponse.ACCEPT:
                continue
            try:
                goal._update_state(GoalEvent.CANCEL_GOAL)
            except RCLError as error:
                # It has ended while the callback decided.
                self._logger.debug(f"Failed to cancel goal in cancel callback: {error}")
                continue
            response.goals_canceling.append(goal._goal_info)
        self._cancel_end.reply(request_id, response)

    def _select(self, wanted: Any) -> tuple[int, list[ServerGoalHandle]]:
        """Return the code for a wish to cancel and the goals it means.

        An identity alone means that goal, a time all goals accepted until then, both mean both, and
        neither means all goals.
        """
        key, until = bytes(wanted.goal_id.uuid), _nanoseconds(wanted.stamp)
        with self._lock:
            if any(key) and not until:
                goal = self._goal_handles.get(key)
                if goal is None:
                    return CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID, []
                if not goal._is_cancelable():
                    return CancelGoal.Response.ERROR_GOAL_TERMINATED, []
                return CancelGoal.Response.ERROR_NONE, [goal]
            everything = not any(key) and not until
            return CancelGoal.Response.ERROR_NONE, [
                goal
                for number, goal in self._goal_handles.items()
                if goal._is_cancelable()
                and (everything or number == key or _nanoseconds(goal._goal_info.stamp) <= until)
            ]

    def _on_result(self, sample: Any) -> None:
        found = self._result_end.decode(sample)
        if found is None:
            return
        request_id, request = found
        goal = self._goal_handles.get(bytes(request.goal_id.uuid))
        if goal is None:
            unknown = self._action_type.Impl.GetResultService.Response()
            unknown.status = GoalStatus.STATUS_UNKNOWN
            self._send_result(request_id, unknown)
            return
        with goal._lock:
            if goal._response is None:
                goal._waiting.append(request_id)
                return
        self._send_result(request_id, goal._response)

    def _send_result(self, request_id: RequestId, response: Any) -> None:
        self._result_end.reply(request_id, response)

    def _expire(self) -> None:
        with self._lock:
            now = self._now()
            old = {
                key: goal
                for key, goal in self._goal_handles.items()
                if not goal.is_active and now - goal._ended_at >= self._timeout
            }
            for key in old:
                del self._goal_handles[key]
        for goal in old.values():
            goal.destroy()
        self.notify_goal_done()


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)
