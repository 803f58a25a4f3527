"""Action clients."""

from __future__ import annotations

import threading
import time
import uuid
import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from unique_identifier_msgs.msg import UUID

from rclpy._endpoint import Decoder, QosWatch, type_user_data
from rclpy._service_wire import ClientEnd
from rclpy._source import Source
from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import NameValidationException
from rclpy.qos import QoSProfile, qos_profile_action_status_default, qos_profile_services_default
from rclpy.task import Future
from stepdiag_ros.embedded import dds, naming, registry

if TYPE_CHECKING:
    from rclpy.node import Node

_ENDED = (
    GoalStatus.STATUS_SUCCEEDED,
    GoalStatus.STATUS_CANCELED,
    GoalStatus.STATUS_ABORTED,
)
#: How often a waiting client looks for its server, in seconds.
_LOOK = 0.005


class ClientGoalHandle:
    """A goal that was sent; the result of the future of :meth:`ActionClient.send_goal_async`."""

    def __init__(self, action_client: ActionClient, goal_id: Any, goal_response: Any) -> None:
        self._action_client = action_client
        self._goal_id = goal_id
        self._goal_response = goal_response
        self._status: int = GoalStatus.STATUS_UNKNOWN

    def __eq__(self, other: object) -> bool:
        return bool(self._goal_id == getattr(other, "goal_id", None))

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return (
            f"ClientGoalHandle <id={self.goal_id.uuid}, accepted={self.accepted},"
            f" status={self.status}>"
        )

    @property
    def goal_id(self) -> Any:
        """The goal's identity (``unique_identifier_msgs/msg/UUID``)."""
        return self._goal_id

    @property
    def stamp(self) -> Any:
        """When it was accepted (``builtin_interfaces/msg/Time``)."""
        return self._goal_response.stamp

    @property
    def accepted(self) -> bool:
        """Whether the server accepted it."""
        return bool(self._goal_response.accepted)

    @property
    def status(self) -> int:
        """The last status received, one of the constants of ``action_msgs/msg/GoalStatus``."""
        return self._status

    def cancel_goal(self) -> Any:
        """Ask to cancel it and return the answer; another thread must spin the node."""
        return _wait(self._action_client._cancel_goal_async(self))

    def cancel_goal_async(self) -> Future:
        """Ask to cancel it; return the future of the answer."""
        return self._action_client._cancel_goal_async(self)

    def get_result(self) -> Any:
        """Wait for its end and return status and result; another thread must spin the node."""
        return _wait(self._action_client._get_result_async(self))

    def get_result_async(self) -> Future:
        """Ask for status and result; return their future, which is done when the goal has ended."""
        return self._action_client._get_result_async(self)


class _Requests:
    """The requests on one of the action's services that wait for their replies."""

    def __init__(self, client: ActionClient, end: ClientEnd, what: str) -> None:
        self.end = end
        self._client = client
        self._what = what
        self._waiting: dict[int, tuple[Future, Any]] = {}
        self._lock = threading.Lock()

    def send(self, request: Any, note: Any = None) -> Future:
        """Send a request; return the future of its response. The note comes back with the reply."""
        self.end.check()
        data = self.end.encode(request)
        future = _ReplyFuture(self, self._client._executor() or self._client._node.executor)
        with self._lock:
            number = self.end.next_number()
            self._waiting[number] = future, note
        self.end.send(number, data)
        return future

    def take(self) -> list[tuple[int, bytes]]:
        """Return the replies that have arrived."""
        return self.end.take()

    def match(self, reply: tuple[int, bytes]) -> tuple[Future, Any, Any] | None:
        """Return future, note and response of a reply, ``None`` if nobody waits for it."""
        number, data = reply
        response = self.end.decode(data)
        if response is None:
            return None
        with self._lock:
            found = self._waiting.pop(number, None)
        if found is None:
            self._client._logger.warning(
                f"Ignoring unexpected {self._what} response. There may be more than one action"
                f" server for the action '{self._client._action_name}'"
            )
            return None
        return *found, response

    def forget(self, future: Future) -> None:
        """Ignore the reply to a request."""
        with self._lock:
            for number, (known, _) in list(self._waiting.items()):
                if known is future:
                    del self._waiting[number]


class _ReplyFuture(Future):
    """Future of a response, which the client forgets when it is cancelled."""

    def __init__(self, requests: _Requests, executor: Any) -> None:
        super().__init__(executor=executor)
        self._requests = requests

    def cancel(self) -> None:
        """Cancel the request; its response will be ignored."""
        self._requests.forget(self)
        super().cancel()


class ActionClient(Source):
    """Sends goals to an action server.

    Of what has arrived together, the answer to a goal comes first, then feedback, and the result
    last, so that a callback for feedback is not overtaken by the end.

    Args:
        node: The node.
        action_type: Class of the action.
        action_name: The action; relative names get the node's namespace.
        callback_group: The callback group; the node's own if ``None``.
        goal_service_qos_profile: Quality of the service for goals.
        result_service_qos_profile: Quality of the service for results.
        cancel_service_qos_profile: Quality of the service to cancel.
        feedback_sub_qos_profile: Quality of the feedback topic.
        status_sub_qos_profile: Quality of the status topic.

    Raises:
        TypeError: ``action_type`` is not an action class.
        ValueError: The action's name breaks the rules.
    """

    def __init__(
        self,
        node: Node,
        action_type: Any,
        action_name: str,
        *,
        callback_group: CallbackGroup | None = None,
        goal_service_qos_profile: QoSProfile = qos_profile_services_default,
        result_service_qos_profile: QoSProfile = qos_profile_services_default,
        cancel_service_qos_profile: QoSProfile = qos_profile_services_default,
        feedback_sub_qos_profile: QoSProfile | None = None,
        status_sub_qos_profile: QoSProfile = qos_profile_action_status_default,
    ) -> None:
        registry.check_action(action_type)
        base = f"{action_name}/_action"
        try:
            names = {
                part: node.resolve_service_name(f"{base}/{part}")
                for part in ("send_goal", "cancel_goal", "get_result")
            }
            feedback_topic = node.resolve_topic_name(f"{base}/feedback")
            status_topic = node.resolve_topic_name(f"{base}/status")
        except NameValidationException as error:
            raise ValueError(f"Failed to create action client: {error}") from error
        super().__init__(callback_group or node.default_callback_group)
        self._node = node
        self._action_type = action_type
        self._action_name = action_name
        self._logger = node.get_logger().get_child("action_client")
        #: By the goals' identities.
        self._goal_handles: dict[bytes, weakref.ref[ClientGoalHandle]] = {}
        self._feedback_callbacks: dict[bytes, Callable[[Any], Any]] = {}
        wire = action_type.Impl

        def requests(srv_type: Any, part: str, qos: QoSProfile, what: str) -> _Requests:
            return _Requests(self, ClientEnd(node, srv_type, names[part], qos), what)

        self._goals = requests(wire.SendGoalService, "send_goal", goal_service_qos_profile, "goal")
        self._cancels = requests(CancelGoal, "cancel_goal", cancel_service_qos_profile, "cancel")
        self._results = requests(
            wire.GetResultService, "get_result", result_service_qos_profile, "result"
        )
        self._ends = (self._goals.end, self._cancels.end, self._results.end)
        self._feedback = _Topic(
            node, wire.FeedbackMessage, feedback_topic, feedback_sub_qos_profile
        )
        self._status = _Topic(node, wire.GoalStatusMessage, status_topic, status_sub_qos_profile)
        self._topics = (self._feedback, self._status)
        for source in (self, *(topic.watch for topic in self._topics)):
            node._add(source)
        node._ros_graph.add_endpoints(node._graph_number, *self._guids())

    def send_goal(self, goal: Any, **kwargs: Any) -> Any:
        """Send a goal, wait for its end, and return status and result.

        Another thread must spin the node. See :meth:`send_goal_async` for the arguments.

        Raises:
            TypeError: It is another message than the action's goal.
        """
        handle = _wait(self.send_goal_async(goal, **kwargs))
        return _wait(self._get_result_async(handle))

    def send_goal_async(
        self,
        goal: Any,
        feedback_callback: Callable[[Any], Any] | None = None,
        goal_uuid: Any = None,
    ) -> Future:
        """Send a goal; return the future of its :class:`ClientGoalHandle`.

        Args:
            goal: The goal message.
            feedback_callback: Called with each feedback message of the goal until its result is
                there; ``feedback`` is its content.
            goal_uuid: The goal's identity; a random one if ``None``.

        Raises:
            TypeError: It is another message than the action's goal.
            rclpy.exceptions.InvalidHandle: The client is destroyed.
            rclpy.exceptions.RCLError: The context is shut down.
        """
        if not isinstance(goal, self._action_type.Goal):
            raise TypeError(f"Expected {self._action_type.Goal}, got {type(goal)}")
        request = self._action_type.Impl.SendGoalService.Request(goal=goal)
        request.goal_id = self._generate_random_uuid() if goal_uuid is None else goal_uuid
        key = bytes(request.goal_id.uuid)
        if feedback_callback is not None:
            # Noted before the goal is sent, or its first feedback may find nobody.
            self._feedback_callbacks[key] = feedback_callback
        try:
            return self._goals.send(request, request.goal_id)
        except Exception:
            self._feedback_callbacks.pop(key, None)
            raise

    def server_is_ready(self) -> bool:
        """Return whether a server is there that can be sent goals.

        Raises:
            rclpy.exceptions.InvalidHandle: The client is destroyed.
        """
        return all(end.is_ready() for end in self._ends) and all(
            topic.reader.matched() > 0 for topic in self._topics
        )

    def wait_for_server(self, timeout_sec: float | None = None) -> bool:
        """Wait until a server is there; return whether it is, after the given time at most."""
        end = None if timeout_sec is None else time.monotonic() + timeout_sec
        while self._node.context.ok() and not self.server_is_ready():
            left = _LOOK if end is None else min(_LOOK, end - time.monotonic())
            if left <= 0:
                break
            time.sleep(left)
        return self.server_is_ready()

    def destroy(self) -> None:
        """End the client."""
        if not self._node._drop(self):
            return
        super().destroy()
        node, (readers, writers) = self._node, self._guids()
        node._ros_graph.remove_endpoints(node._graph_number, readers + writers)
        for topic in self._topics:
            node._drop(topic.watch)
            topic.watch.destroy()
            topic.reader.close()
        for end in self._ends:
            end.close()

    def _generate_random_uuid(self) -> Any:
        return UUID(uuid=list(uuid.uuid4().bytes))

    def _cancel_goal_async(self, goal_handle: ClientGoalHandle) -> Future:
        _check_handle(goal_handle)
        request = CancelGoal.Request()
        request.goal_info.goal_id = goal_handle.goal_id
        return self._cancels.send(request)

    def _get_result_async(self, goal_handle: ClientGoalHandle) -> Future:
        _check_handle(goal_handle)
        request = self._action_type.Impl.GetResultService.Request(goal_id=goal_handle.goal_id)
        return self._results.send(request, bytes(goal_handle.goal_id.uuid))

    def _guids(self) -> tuple[list[bytes], list[bytes]]:
        readers = [guid for end in self._ends for guid in end.guids[0]]
        writers = [guid for end in self._ends for guid in end.guids[1]]
        return readers + [topic.guid for topic in self._topics], writers

    # What the executor calls.

    def _conditions(self) -> list[int]:
        return [end.condition for end in self._ends] + [
            topic.reader.condition for topic in self._topics
        ]

    def _fetch(self) -> None:
        # Taken in the order opposite to the one of serving, because a server answers a goal before
        # it tells of it, and tells all before it gives the result: what comes meanwhile is not
        # taken without what came before it.
        results, cancels = self._results.take(), self._cancels.take()
        status, feedback = self._status.take(), self._feedback.take()
        goals = self._goals.take()
        for handler, items in (
            (self._on_goal, goals),
            (self._on_feedback, feedback),
            (self._on_status, status),
            (self._on_cancel, cancels),
            (self._on_result, results),
        ):
            self._pending.extend((handler, item) for item in items)

    def _run(self, item: Any) -> Any:
        handler, content = item
        return handler(content)

    def _on_goal(self, reply: Any) -> None:
        found = self._goals.match(reply)
        if found is None:
            return
        future, goal_id, response = found
        handle, key = ClientGoalHandle(self, goal_id, response), bytes(goal_id.uuid)
        if handle.accepted:
            if key in self._goal_handles:
                raise RuntimeError(f"Two goals were accepted with the same ID ({handle})")
            self._goal_handles[key] = weakref.ref(handle)
        else:
            self._feedback_callbacks.pop(key, None)
        future.set_result(handle)

    def _on_feedback(self, sample: Any) -> Any:
        message = self._feedback.decode(sample.data)
        if message is None:
            return None
        callback = self._feedback_callbacks.get(bytes(message.goal_id.uuid))
        return callback(message) if callback is not None else None

    def _on_status(self, sample: Any) -> None:
        message = self._status.decode(sample.data)
        if message is None:
            return
        for entry in message.status_list:
            key = bytes(entry.goal_info.goal_id.uuid)
            known = self._goal_handles.get(key)
            if known is None:
                continue
            handle = known()
            if handle is not None:
                handle._status = entry.status
            if handle is None or entry.status in _ENDED:
                del self._goal_handles[key]

    def _on_cancel(self, reply: Any) -> None:
        found = self._cancels.match(reply)
        if found is not None:
            found[0].set_result(found[2])

    def _on_result(self, reply: Any) -> None:
        found = self._results.match(reply)
        if found is not None:
            future, key, response = found
            self._feedback_callbacks.pop(key, None)
            future.set_result(response)


class _Topic:
    """Reader of one of the action's topics."""

    def __init__(self, node: Node, cls: type, name: str, qos_profile: QoSProfile | None) -> None:
        participant, _ = node.context._require()
        self.reader: dds.Reader = participant.create_reader(
            naming.dds_topic(name),
            naming.dds_type(registry.type_name(cls)),
            (qos_profile or QoSProfile(depth=10))._to_dds(),
            type_user_data(cls),
        )
        self.guid = self.reader.guid
        self.watch = QosWatch(node, self.reader, name)
        #: Gives the message of a sample's bytes, ``None`` if they are none.
        self.decode = Decoder(node, cls, f"topic {name}")

    def take(self) -> list[dds.Sample]:
        """Return all that has arrived."""
        found: list[dds.Sample] = []
        while samples := self.reader.take():
            found += samples
        return found


def _check_handle(goal_handle: object) -> None:
    if not isinstance(goal_handle, ClientGoalHandle):
        raise TypeError(f"Expected type ClientGoalHandle but received {type(goal_handle)}")


def _wait(future: Future) -> Any:
    """Wait for a future without spinning, and return its result."""
    event = threading.Event()
    future._set_executor(None)
    future.add_done_callback(lambda _: event.set())
    event.wait()
    return future.result()
