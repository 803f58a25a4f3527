"""Managed nodes: transitions, services, events and publishers, as any rclpy has them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from patience import PATIENCE
from ros_processes import wait_until

PRIMARY = ["unknown", "unconfigured", "inactive", "active", "finalized"]
DURING = [
    "configuring",
    "cleaningup",
    "shuttingdown",
    "activating",
    "deactivating",
    "errorprocessing",
]


@pytest.fixture
def managed(ros: Any) -> Iterator[Any]:
    """Return the class of a managed node that notes its callbacks and answers them as told."""
    assert ros.ok()
    from rclpy.lifecycle import Node, State, TransitionCallbackReturn

    class Managed(Node):
        def __init__(self, name: str = "managed", **kwargs: Any) -> None:
            self.calls: list[tuple[str, str, int]] = []
            self.answers: dict[str, Any] = {}
            super().__init__(name, **kwargs)

        def answer(self, name: str, state: Any) -> Any:
            assert isinstance(state, State)
            self.calls.append((name, state.label, state.state_id))
            answer = self.answers.get(name, TransitionCallbackReturn.SUCCESS)
            if isinstance(answer, Exception):
                raise answer
            getattr(super(), name)(state)
            return answer

        def on_configure(self, state: Any) -> Any:
            return self.answer("on_configure", state)

        def on_activate(self, state: Any) -> Any:
            return self.answer("on_activate", state)

        def on_deactivate(self, state: Any) -> Any:
            return self.answer("on_deactivate", state)

        def on_cleanup(self, state: Any) -> Any:
            return self.answer("on_cleanup", state)

        def on_shutdown(self, state: Any) -> Any:
            return self.answer("on_shutdown", state)

        def on_error(self, state: Any) -> Any:
            return self.answer("on_error", state)

    made: list[Any] = []

    def make(*args: Any, **kwargs: Any) -> Any:
        made.append(Managed(*args, **kwargs))
        return made[-1]

    yield make
    for item in made:
        item.destroy_node()


class Operator:
    """Calls the services of a managed node from another one."""

    def __init__(self, node: Any, name: str = "managed") -> None:
        from lifecycle_msgs.srv import (
            ChangeState,
            GetAvailableStates,
            GetAvailableTransitions,
            GetState,
        )

        self.kinds = {
            "change_state": ChangeState,
            "get_state": GetState,
            "get_available_states": GetAvailableStates,
            "get_available_transitions": GetAvailableTransitions,
            "get_transition_graph": GetAvailableTransitions,
        }
        self.clients = {
            service: node.create_client(kind, f"/{name}/{service}")
            for service, kind in self.kinds.items()
        }
        for client in self.clients.values():
            assert client.wait_for_service(timeout_sec=PATIENCE)

    def call(self, service: str, **fields: Any) -> Any:
        request = self.kinds[service].Request()
        for field, value in fields.items():
            setattr(request.transition, field, value)
        return self.clients[service].call(request, timeout_sec=PATIENCE)

    @property
    def state(self) -> str:
        return str(self.call("get_state").current_state.label)


def test_an_operator_takes_a_node_through_its_states(
    node: Any, managed: Any, spin: Callable[..., None]
) -> None:
    from lifecycle_msgs.msg import State, Transition, TransitionEvent

    item = managed()
    events: list[Any] = []
    node.create_subscription(TransitionEvent, "/managed/transition_event", events.append, 20)
    spin(node, item)
    operator = Operator(node)
    assert wait_until(lambda: node.count_publishers("/managed/transition_event") == 1)
    assert operator.state == "unconfigured"
    expected: list[tuple[str, str]] = []
    for number, before, during, after in (
        (Transition.TRANSITION_CONFIGURE, "unconfigured", "configuring", "inactive"),
        (Transition.TRANSITION_ACTIVATE, "inactive", "activating", "active"),
        (Transition.TRANSITION_DEACTIVATE, "active", "deactivating", "inactive"),
        (Transition.TRANSITION_CLEANUP, "inactive", "cleaningup", "unconfigured"),
        (Transition.TRANSITION_UNCONFIGURED_SHUTDOWN, "unconfigured", "shuttingdown", "finalized"),
    ):
        assert operator.call("change_state", id=number).success
        assert operator.state == after
        expected += [(before, during), (during, after)]
    assert wait_until(lambda: len(events) == len(expected))
    assert [(event.start_state.label, event.goal_state.label) for event in events] == expected
    assert events[0].start_state.id == State.PRIMARY_STATE_UNCONFIGURED
    assert events[0].goal_state.id == State.TRANSITION_STATE_CONFIGURING
    assert item.calls == [
        ("on_configure", "unconfigured", State.PRIMARY_STATE_UNCONFIGURED),
        ("on_activate", "inactive", State.PRIMARY_STATE_INACTIVE),
        ("on_deactivate", "active", State.PRIMARY_STATE_ACTIVE),
        ("on_cleanup", "inactive", State.PRIMARY_STATE_INACTIVE),
        ("on_shutdown", "unconfigured", State.PRIMARY_STATE_UNCONFIGURED),
    ]


def test_transitions_are_found_by_their_labels(
    node: Any, managed: Any, spin: Callable[..., None]
) -> None:
    spin(node, managed())
    operator = Operator(node)
    assert operator.call("change_state", label="configure").success
    assert operator.state == "inactive"
    # One that is not possible now, and one that does not exist.
    for label in ("deactivate", "configure", "jump"):
        assert not operator.call("change_state", label=label).success
        assert operator.state == "inactive"
    assert operator.call("change_state", label="shutdown").success
    assert operator.state == "finalized"


def test_states_and_transitions_are_listed(
    node: Any, managed: Any, spin: Callable[..., None]
) -> None:
    spin(node, managed())
    operator = Operator(node)
    states = operator.call("get_available_states").available_states
    assert [state.label for state in states] == PRIMARY + DURING
    assert [state.id for state in states] == [*range(5), *range(10, 16)]

    def listed(service: str) -> list[tuple[int, str, str, str]]:
        return [
            (
                item.transition.id,
                item.transition.label,
                item.start_state.label,
                item.goal_state.label,
            )
            for item in operator.call(service).available_transitions
        ]

    assert listed("get_available_transitions") == [
        (1, "configure", "unconfigured", "configuring"),
        (5, "shutdown", "unconfigured", "shuttingdown"),
    ]
    assert operator.call("change_state", id=1).success
    assert listed("get_available_transitions") == [
        (2, "cleanup", "inactive", "cleaningup"),
        (3, "activate", "inactive", "activating"),
        (6, "shutdown", "inactive", "shuttingdown"),
    ]
    graph = listed("get_transition_graph")
    assert [row[0] for row in graph] == [
        *(1, 10, 11, 12, 2, 20, 21, 22, 3, 30, 31, 32, 4, 40, 41, 42),
        *(5, 6, 7, 50, 51, 52, 60, 61, 62),
    ]
    outcomes = {row[0]: row[1:] for row in graph}
    assert outcomes[21] == ("transition_failure", "cleaningup", "inactive")
    assert outcomes[41] == ("transition_failure", "deactivating", "active")
    assert outcomes[42] == ("transition_error", "deactivating", "errorprocessing")
    assert outcomes[51] == ("transition_failure", "shuttingdown", "finalized")
    assert outcomes[60] == ("transition_success", "errorprocessing", "unconfigured")
    assert outcomes[61] == ("transition_failure", "errorprocessing", "finalized")
    assert outcomes[62] == ("transition_error", "errorprocessing", "finalized")


def test_a_failure_leaves_the_state_as_it_was(
    node: Any, managed: Any, spin: Callable[..., None]
) -> None:
    from rclpy.lifecycle import TransitionCallbackReturn

    item = managed()
    item.answers = {
        "on_configure": TransitionCallbackReturn.FAILURE,
        "on_deactivate": TransitionCallbackReturn.FAILURE,
    }
    spin(node, item)
    operator = Operator(node)
    assert not operator.call("change_state", label="configure").success
    assert operator.state == "unconfigured"
    item.answers.pop("on_configure")
    for label in ("configure", "activate"):
        assert operator.call("change_state", label=label).success
    assert not operator.call("change_state", label="deactivate").success
    assert operator.state == "active"
    assert "on_error" not in [name for name, _, _ in item.calls]


@pytest.mark.parametrize("how", ["returned", "raised"])
@pytest.mark.parametrize(
    ("answer", "after"),
    [("SUCCESS", "unconfigured"), ("FAILURE", "finalized"), ("ERROR", "finalized")],
)
def test_errors_are_processed(
    node: Any, managed: Any, spin: Callable[..., None], how: str, answer: str, after: str
) -> None:
    from rclpy.lifecycle import TransitionCallbackReturn

    item = managed()
    item.answers = {
        "on_activate": OSError("no laser") if how == "raised" else TransitionCallbackReturn.ERROR,
        "on_error": getattr(TransitionCallbackReturn, answer),
    }
    spin(node, item)
    operator = Operator(node)
    assert operator.call("change_state", label="configure").success
    assert not operator.call("change_state", label="activate").success
    assert operator.state == after
    assert item.calls[-1][:2] == ("on_error", "inactive")


def test_a_node_changes_its_own_state(managed: Any) -> None:
    from rclpy.lifecycle import TransitionCallbackReturn

    item = managed(enable_communication_interface=False)
    success = TransitionCallbackReturn.SUCCESS
    # The embedded client says RCLError too, but rclpy has no public name for it.
    for trigger in (item.trigger_activate, item.trigger_deactivate, item.trigger_cleanup):
        with pytest.raises(RuntimeError):
            trigger()
    for _ in range(3):
        assert item.trigger_configure() == success
        assert item.trigger_activate() == success
        assert item.trigger_deactivate() == success
        assert item.trigger_cleanup() == success
    with pytest.raises(RuntimeError):
        item.trigger_activate()
    item.answers["on_configure"] = TransitionCallbackReturn.FAILURE
    assert item.trigger_configure() == TransitionCallbackReturn.FAILURE
    item.answers["on_configure"] = TransitionCallbackReturn.ERROR
    assert item.trigger_configure() == TransitionCallbackReturn.ERROR
    assert item.trigger_shutdown() == success
    with pytest.raises(RuntimeError):
        item.trigger_shutdown()


@pytest.mark.parametrize("steps", [[], ["configure"], ["configure", "activate"]])
def test_shutdown_from_every_primary_state(managed: Any, steps: list[str]) -> None:
    from rclpy.lifecycle import TransitionCallbackReturn

    item = managed()
    for step in steps:
        getattr(item, f"trigger_{step}")()
    assert item.trigger_shutdown() == TransitionCallbackReturn.SUCCESS
    assert item.calls[-1][:2] == (
        "on_shutdown",
        ["unconfigured", "inactive", "active"][len(steps)],
    )
    with pytest.raises(RuntimeError):
        item.trigger_configure()


def test_publishers_publish_only_while_the_node_is_active(
    node: Any, managed: Any, spin: Callable[..., None]
) -> None:
    from rclpy.lifecycle import LifecyclePublisher
    from std_msgs.msg import String

    item = managed()
    received: list[str] = []
    node.create_subscription(String, "words", lambda message: received.append(message.data), 10)
    publisher = item.create_lifecycle_publisher(String, "words", 10)
    assert isinstance(publisher, LifecyclePublisher)
    spin(node)
    assert wait_until(lambda: publisher.get_subscription_count() == 1)

    def say(word: str) -> None:
        publisher.publish(String(data=word))

    assert not publisher.is_activated
    say("unconfigured")
    item.trigger_configure()
    say("inactive")
    item.trigger_activate()
    assert publisher.is_activated
    say("active")
    item.trigger_deactivate()
    say("inactive again")
    item.trigger_activate()
    say("active again")
    assert wait_until(lambda: len(received) == 2)
    assert received == ["active", "active again"]
    assert item.destroy_lifecycle_publisher(publisher)
    item.trigger_deactivate()
    with pytest.raises(TypeError):
        item.create_lifecycle_publisher(String, "words", 10, publisher_class=LifecyclePublisher)


def test_a_plain_publisher_of_a_managed_node_publishes_always(
    node: Any, managed: Any, spin: Callable[..., None]
) -> None:
    from std_msgs.msg import String

    received: list[str] = []
    node.create_subscription(String, "words", lambda message: received.append(message.data), 10)
    publisher = managed().create_publisher(String, "words", 10)
    spin(node)
    assert wait_until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(String(data="unconfigured"))
    assert wait_until(lambda: received == ["unconfigured"])


@pytest.mark.usefixtures("ros")
def test_managed_entities_share_the_fate_of_their_node() -> None:
    from rclpy.lifecycle import (
        LifecycleNode,
        ManagedEntity,
        SimpleManagedEntity,
        TransitionCallbackReturn,
    )

    class Stubborn(ManagedEntity):
        answer: Any = TransitionCallbackReturn.FAILURE

        def on_activate(self, _state: Any) -> Any:
            return self.answer

    opened: list[str] = []

    class Gate(SimpleManagedEntity):
        @SimpleManagedEntity.when_enabled
        def open(self, who: str) -> None:
            opened.append(who)

        @SimpleManagedEntity.when_enabled(when_not_enabled=lambda: opened.append("refused"))
        def shout(self) -> None:
            opened.append("shouted")

    item = LifecycleNode("entities")
    entity, gate = Stubborn(), Gate()
    item.add_managed_entity(entity)
    assert item.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert item.trigger_activate() == TransitionCallbackReturn.FAILURE
    entity.answer = "yes"
    # A wrong answer is an error, which brings the node back to its beginning.
    assert item.trigger_activate() == TransitionCallbackReturn.ERROR
    entity.answer = TransitionCallbackReturn.SUCCESS
    item.add_managed_entity(gate)
    gate.open("early")
    gate.shout()
    assert item.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert item.trigger_activate() == TransitionCallbackReturn.SUCCESS
    gate.open("in time")
    gate.shout()
    assert item.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
    gate.open("late")
    assert opened == ["refused", "in time", "shouted"]
    with pytest.raises(TypeError):
        item.add_managed_entity("no entity")
    item.destroy_node()


def test_the_interface_can_be_left_out(node: Any, managed: Any) -> None:
    managed(enable_communication_interface=False)
    assert wait_until(lambda: "managed" in node.get_node_names())
    names = [name for name, _ in node.get_service_names_and_types_by_node("managed", "/")]
    assert not [name for name in names if name.endswith("_state")]
    assert wait_until(lambda: node.count_publishers("/managed/transition_event") == 1)
    with pytest.raises(TypeError):
        managed("wrong", enable_communication_interface="yes")


def test_others_see_the_interface_with_its_types(node: Any, managed: Any) -> None:
    managed(namespace="/cell")

    def found() -> dict[str, list[str]]:
        return dict(node.get_service_names_and_types_by_node("managed", "/cell"))

    assert wait_until(lambda: "/cell/managed/get_transition_graph" in found())
    assert {
        name.rsplit("/", 1)[1]: kinds
        for name, kinds in found().items()
        if kinds[0].startswith("lifecycle_msgs")
    } == {
        "change_state": ["lifecycle_msgs/srv/ChangeState"],
        "get_state": ["lifecycle_msgs/srv/GetState"],
        "get_available_states": ["lifecycle_msgs/srv/GetAvailableStates"],
        "get_available_transitions": ["lifecycle_msgs/srv/GetAvailableTransitions"],
        "get_transition_graph": ["lifecycle_msgs/srv/GetAvailableTransitions"],
    }
    assert dict(node.get_publisher_names_and_types_by_node("managed", "/cell"))[
        "/cell/managed/transition_event"
    ] == ["lifecycle_msgs/msg/TransitionEvent"]


@pytest.mark.usefixtures("ros")
def test_the_names_of_the_module() -> None:
    from rclpy import lifecycle
    from rclpy.node import Node

    assert lifecycle.Node is lifecycle.LifecycleNode and issubclass(lifecycle.Node, Node)
    assert lifecycle.State is lifecycle.LifecycleState
    assert lifecycle.Publisher is lifecycle.LifecyclePublisher
    assert lifecycle.NodeMixin is lifecycle.LifecycleNodeMixin
    assert lifecycle.State(label="active", state_id=3) == ("active", 3)
    labels = [
        getattr(lifecycle.TransitionCallbackReturn, name).to_label()
        for name in ("SUCCESS", "FAILURE", "ERROR")
    ]
    assert labels == ["transition_success", "transition_failure", "transition_error"]
