"""The other side of the interoperability check: asks the server, and prints what it found.

One line of JSON a check: ``[subject, check, passed, detail]``. Public rclpy interface only.
"""

from __future__ import annotations

import json
import random
import sys
import time
from collections.abc import Callable
from typing import Any

import random_content
from echo_server import (
    ACTION,
    ANSWER,
    DEEP,
    FEEDBACK_SEED,
    GOAL_SEED,
    LATCHED,
    LATCHED_SENT,
    MANAGED,
    RESULT_SEED,
    SERVER,
    SPACE,
    topic,
)
from random_content import content

# isort: split
import rclpy
from action_msgs.msg import GoalStatus
from lifecycle_msgs.msg import Transition, TransitionEvent
from lifecycle_msgs.srv import (
    ChangeState,
    GetAvailableStates,
    GetAvailableTransitions,
    GetState,
)
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.action import ActionClient
from rclpy.serialization import serialize_message
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

LIMIT = 15.0
"""Real seconds that anything may take."""


class Asker:
    """A node that asks, and what it found."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("interop_asker")

    def until(self, condition: Callable[[], bool], limit: float = LIMIT) -> bool:
        """Spin until a condition holds; return whether it does."""
        end = time.monotonic() + limit
        while not condition():
            if time.monotonic() > end:
                return False
            rclpy.spin_once(self.node, timeout_sec=0.05)
        return True

    def pause(self, seconds: float) -> None:
        """Spin for a while."""
        self.until(lambda: False, seconds)

    def check(self, subject: str, name: str, passed: object, detail: object = "") -> None:
        """Print what was found."""
        print(json.dumps([subject, name, bool(passed), str(detail)]), flush=True)

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Return what a service answers.

        Raises:
            TimeoutError: nothing.
        """
        client = self.node.create_client(kind, name)
        try:
            if not self.until(client.service_is_ready):
                raise TimeoutError(f"{name} is not there")
            future = client.call_async(request)
            if not self.until(future.done):
                raise TimeoutError(f"{name} does not answer")
            return future.result()
        finally:
            self.node.destroy_client(client)

    # Subjects ------------------------------------------------------------------------------------

    def latched(self) -> None:
        """A late subscriber receives what was said last, unless it does not ask for it."""
        got: list[str] = []
        volatile: list[str] = []
        name = f"{SPACE}/latched"
        self.node.create_subscription(String, name, lambda m: volatile.append(m.data), DEEP)
        self.until(lambda: self.node.count_publishers(name) > 0)
        self.pause(0.5)
        # On Fast DDS it takes from a writer on Cyclone DDS what it did not ask for, as between real
        # nodes.
        foreign = "fastrtps" in rclpy.get_rmw_implementation_identifier()
        none = volatile == [] or foreign
        self.check("latched", "a volatile subscriber gets none", none, volatile)
        self.node.create_subscription(String, name, lambda m: got.append(m.data), LATCHED)
        self.until(lambda: len(got) >= LATCHED.depth)
        self.pause(0.3)
        wanted = [f"latched {n}" for n in range(LATCHED_SENT - LATCHED.depth, LATCHED_SENT)]
        self.check("latched", "a late subscriber gets the last ones", got == wanted, got)

    def messages(self) -> None:
        """Every message comes back as it was sent; the graph tells types, hashes and QoS."""
        publishers: dict[str, Any] = {}
        came: dict[str, list[Any]] = {}
        subscriptions = []
        for type_name in random_content.message_types():
            try:
                cls = random_content.load(type_name)
            except ImportError as error:
                self.check("messages", type_name, False, error)
                continue
            back = came.setdefault(type_name, [])
            subscriptions.append(
                self.node.create_subscription(cls, topic("back", type_name), back.append, DEEP)
            )
            publishers[type_name] = self.node.create_publisher(cls, topic("there", type_name), DEEP)

        def matched() -> bool:
            back = (topic("back", type_name) for type_name in publishers)
            return all(p.get_subscription_count() for p in publishers.values()) and all(
                self.node.count_publishers(name) for name in back
            )

        self.until(matched)
        # What this side knows, the other side may learn a moment later.
        self.pause(1.0)
        for type_name, publisher in publishers.items():
            sent = random_content.samples(random_content.load(type_name), len(type_name))
            for number, message in enumerate(sent):
                # As objects and as bytes in turn: Fast DDS does not make the same of the two.
                publisher.publish(serialize_message(message) if number % 2 else message)
            back = came[type_name]
            self.until(lambda back=back, sent=sent: len(back) >= len(sent))  # type: ignore[misc]
            same = [content(a) == content(b) for a, b in zip(sent, back, strict=False)]
            detail = f"{len(back)} of {len(sent)} came back, {same.count(True)} the same"
            self.check("messages", type_name, len(back) == len(sent) and all(same), detail)
            self._endpoints(type_name)

    def _endpoints(self, type_name: str) -> None:
        ends = [
            *self.node.get_publishers_info_by_topic(topic("back", type_name)),
            *self.node.get_publishers_info_by_topic(topic("there", type_name)),
        ]
        names = sorted(end.node_name for end in ends)
        types = {end.topic_type for end in ends}
        # Humble knows no type hashes; then both ends say nothing.
        hashes = {str(getattr(end, "topic_type_hash", None)) for end in ends}
        qos = {(end.qos_profile.reliability.name, end.qos_profile.durability.name) for end in ends}
        told = names == ["interop_asker", SERVER] and types == {type_name}
        detail = f"{names} {types} {hashes} {qos}"
        told = told and len(hashes) == 1 and qos == {("RELIABLE", "VOLATILE")}
        self.check("endpoints", type_name, told, detail)

    def services(self) -> None:
        """Services answer, also many calls at once."""
        answer = self.call(Trigger, f"{SPACE}/trigger", Trigger.Request())
        right = answer.success and answer.message == ANSWER
        self.check("services", "an answer", right, answer)
        answer = self.call(SetBool, f"{SPACE}/set_bool", SetBool.Request(data=True))
        right = not answer.success and answer.message == "got True"
        self.check("services", "a refusal", right, answer)
        client = self.node.create_client(Trigger, f"{SPACE}/trigger")
        self.until(client.service_is_ready)
        futures = [client.call_async(Trigger.Request()) for _ in range(10)]
        self.until(lambda: all(future.done() for future in futures))
        done = sum(future.done() and future.result().success for future in futures)
        self.check("services", "ten calls at once", done == 10, f"{done} answered")

    def parameters(self) -> None:
        """All standard services of parameters, and the event that tells of a change."""
        subject, own = "parameters", f"/{SERVER}"
        events: list[Any] = []
        self.node.create_subscription(ParameterEvent, "/parameter_events", events.append, DEEP)
        answer = self.call(ListParameters, f"{own}/list_parameters", ListParameters.Request())
        names = set(answer.result.names)
        wanted = {"speed", "count", "fixed", "on", "use_sim_time", "axis.steps", "axis.limits"}
        self.check(subject, "list", wanted <= names, names)
        self.check(subject, "prefixes", list(answer.result.prefixes) == ["axis"], answer.result)
        asked = ["speed", "count", "fixed", "axis.steps", "axis.names", "axis.limits", "on"]
        got = self.call(GetParameters, f"{own}/get_parameters", GetParameters.Request(names=asked))
        values = (
            got.values[0].double_value,
            got.values[1].integer_value,
            got.values[2].string_value,
            list(got.values[3].integer_array_value),
            list(got.values[4].string_array_value),
            list(got.values[5].double_array_value),
            got.values[6].bool_value,
        )
        right = values == (1.0, 3, "text ↑", [1, 2, 3], ["X", "Y"], [0.5, -0.5], True)
        self.check(subject, "get", right, values)
        request = GetParameterTypes.Request(names=asked)
        types = list(self.call(GetParameterTypes, f"{own}/get_parameter_types", request).types)
        self.check(subject, "types", types == [3, 2, 4, 7, 9, 8, 1], types)
        request = DescribeParameters.Request(names=["speed", "count", "fixed"])
        told = self.call(DescribeParameters, f"{own}/describe_parameters", request).descriptors
        right = (
            told[0].description == "a speed, m/s"
            and told[0].additional_constraints == "never faster than the machine"
            and told[0].floating_point_range[0].to_value == 2.0
            and (told[1].integer_range[0].from_value, told[1].integer_range[0].step) == (1, 1)
            and (told[0].read_only, told[2].read_only) == (False, True)
        )
        self.check(subject, "describe", right, told)
        self._set_parameters(own)

        def changed() -> bool:
            return any(e.node == own and e.changed_parameters for e in events)

        self.check(subject, "an event tells of a change", self.until(changed, 3.0), len(events))

    def _set_parameters(self, own: str) -> None:
        speed = _double("speed", 1.5)
        text = Parameter(
            name="fixed",
            value=ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="x"),
        )
        for what, parameter, right in (
            ("in range", speed, True),
            ("out of range", _double("speed", 9.0), False),
            ("read only", text, False),
            ("wrong type", _double("count", 2.0), False),
            ("unknown", _double("nobody_declared_it", 1.0), False),
        ):
            request = SetParameters.Request(parameters=[parameter])
            result = self.call(SetParameters, f"{own}/set_parameters", request).results[0]
            said = result.successful == right and (right or result.reason)
            self.check("parameters", f"set, {what}", said, result.reason)
        request = SetParametersAtomically.Request(parameters=[_double("speed", 0.5), text])
        name = f"{own}/set_parameters_atomically"
        result = self.call(SetParametersAtomically, name, request).result
        request = GetParameters.Request(names=["speed"])
        left = self.call(GetParameters, f"{own}/get_parameters", request).values[0].double_value
        right = not result.successful and left == 1.5
        self.check("parameters", "all or none", right, f"{result.reason}; speed {left}")

    def actions(self) -> None:
        """Goals are refused, executed with feedback, and cancelled."""
        subject = "actions"
        cls = random_content.load(ACTION)
        unknown, known, endless = random_content.three_different(cls.Goal, GOAL_SEED)
        result = content(random_content.filled(cls.Result, random.Random(RESULT_SEED)))
        feedback = [content(one) for one in random_content.samples(cls.Feedback, FEEDBACK_SEED)]
        client = ActionClient(self.node, cls, f"{SPACE}/measure")
        self.check(subject, "a server is there", self.until(client.server_is_ready))
        refused = self._sent(client, unknown)
        self.check(subject, "a refusal", refused is not None and not refused.accepted)
        heard: list[Any] = []
        handle = self._sent(client, known, lambda m: heard.append(content(m.feedback)))
        future = handle.get_result_async()
        done = self.until(future.done)
        end = future.result() if done else None
        right = end is not None and end.status == GoalStatus.STATUS_SUCCEEDED
        self.check(subject, "it succeeds", right, end and end.status)
        right = end is not None and content(end.result) == result
        self.check(subject, "its result", right, end and end.result)
        # Feedback is a topic: what was published before the result may come after it.
        self.until(lambda: len(heard) >= len(feedback))
        self.check(subject, "its feedback", heard == feedback, f"{len(heard)} messages")
        handle = self._sent(client, endless)
        self.pause(0.2)
        cancelled = handle.cancel_goal_async()
        agreed = self.until(cancelled.done) and len(cancelled.result().goals_canceling) == 1
        self.check(subject, "a cancel is agreed to", agreed)
        future = handle.get_result_async()
        done = self.until(future.done)
        status = future.result().status if done else None
        self.check(subject, "it is cancelled", status == GoalStatus.STATUS_CANCELED, status)
        client.destroy()

    def _sent(self, client: Any, goal: Any, listen: Any = None) -> Any:
        future = client.send_goal_async(goal, feedback_callback=listen)
        if not self.until(future.done):
            raise TimeoutError("no answer to a goal")
        return future.result()

    def lifecycle(self) -> None:
        """A managed node is led through its states; its publisher speaks in one of them."""
        subject, own = "lifecycle", f"/{MANAGED}"
        events: list[tuple[str, str]] = []
        heard: list[str] = []
        self.node.create_subscription(
            TransitionEvent,
            f"{own}/transition_event",
            lambda m: events.append((m.start_state.label, m.goal_state.label)),
            DEEP,
        )
        name = f"{SPACE}/managed_chat"
        self.node.create_subscription(String, name, lambda m: heard.append(m.data), DEEP)
        self.until(lambda: self.node.count_publishers(f"{own}/transition_event") > 0)
        self.pause(0.5)
        self.check(subject, "silent at first", heard == [] and self._state(own) == "unconfigured")
        for transition, state in (
            (Transition.TRANSITION_CONFIGURE, "inactive"),
            (Transition.TRANSITION_ACTIVATE, "active"),
        ):
            self._lead(own, transition, state)
        self.check(subject, "it speaks when active", self.until(lambda: len(heard) > 2))
        for transition, state in (
            (Transition.TRANSITION_DEACTIVATE, "inactive"),
            (Transition.TRANSITION_CLEANUP, "unconfigured"),
        ):
            self._lead(own, transition, state)
        self.pause(0.1)
        before = len(heard)
        self.pause(0.3)
        self.check(subject, "and is silent again", len(heard) == before)
        wanted = [("activating", "active"), ("deactivating", "inactive")]
        told = self.until(lambda: all(event in events for event in wanted), 3.0)
        self.check(subject, "events tell of it", told, events)
        states = self.call(
            GetAvailableStates, f"{own}/get_available_states", GetAvailableStates.Request()
        ).available_states
        self.check(subject, "all states", len(states) == 11, [one.label for one in states])
        for what, count in (("get_available_transitions", 2), ("get_transition_graph", 25)):
            request = GetAvailableTransitions.Request()
            found = self.call(GetAvailableTransitions, f"{own}/{what}", request)
            labels = [one.transition.label for one in found.available_transitions]
            self.check(subject, what, len(labels) >= count and "configure" in labels, labels)

    def _state(self, own: str) -> str:
        answer = self.call(GetState, f"{own}/get_state", GetState.Request())
        return str(answer.current_state.label)

    def _lead(self, own: str, transition: int, state: str) -> None:
        request = ChangeState.Request()
        request.transition.id = transition
        agreed = self.call(ChangeState, f"{own}/change_state", request).success
        now = self._state(own)
        self.check("lifecycle", f"becomes {state} by {transition}", agreed and now == state, now)

    def graph(self) -> None:
        """Nodes, topics and services are seen with their types."""
        node, subject = self.node, "graph"
        nodes = set(node.get_node_names_and_namespaces())
        self.check(subject, "nodes", {(SERVER, "/"), (MANAGED, "/")} <= nodes, nodes)
        services = dict(node.get_service_names_and_types_by_node(SERVER, "/"))
        wanted = {
            f"{SPACE}/trigger": ["std_srvs/srv/Trigger"],
            f"/{SERVER}/set_parameters": ["rcl_interfaces/srv/SetParameters"],
        }
        self.check(subject, "services", wanted.items() <= services.items(), sorted(services))
        topics = dict(node.get_topic_names_and_types())
        told = topics.get(f"{SPACE}/latched") == ["std_msgs/msg/String"]
        told = told and {"/rosout", "/parameter_events"} <= topics.keys()
        self.check(subject, "topics", told, sorted(topics))
        (end,) = node.get_publishers_info_by_topic(f"{SPACE}/latched")
        told = end.node_name == SERVER and end.qos_profile.durability.name == "TRANSIENT_LOCAL"
        self.check(subject, "a latched publisher", told, end)


def _double(name: str, value: float) -> Any:
    kind = ParameterType.PARAMETER_DOUBLE
    return Parameter(name=name, value=ParameterValue(type=kind, double_value=value))


def main() -> int:
    """Ask about the subjects given as arguments."""
    rclpy.init(args=[])
    asker = Asker()
    named = (SERVER, "/")
    if not asker.until(lambda: named in asker.node.get_node_names_and_namespaces()):
        print("the server was never seen", file=sys.stderr)
        return 1
    for subject in sys.argv[1:]:
        try:
            getattr(asker, subject)()
        except Exception as error:
            asker.check(subject, "finished", False, f"{type(error).__name__}: {error}")
        else:
            asker.check(subject, "finished", True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
