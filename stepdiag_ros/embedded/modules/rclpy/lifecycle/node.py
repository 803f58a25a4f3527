"""Managed nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from lifecycle_msgs.msg import State, TransitionDescription, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState

from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import RCLError
from rclpy.lifecycle._state_machine import STATES, STEPS, StateMachine, Step
from rclpy.lifecycle.managed_entity import ManagedEntity, TransitionCallbackReturn
from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.node import Node
from rclpy.qos import QoSProfile

_CALLBACKS = {
    State.TRANSITION_STATE_CONFIGURING: "on_configure",
    State.TRANSITION_STATE_CLEANINGUP: "on_cleanup",
    State.TRANSITION_STATE_SHUTTINGDOWN: "on_shutdown",
    State.TRANSITION_STATE_ACTIVATING: "on_activate",
    State.TRANSITION_STATE_DEACTIVATING: "on_deactivate",
    State.TRANSITION_STATE_ERRORPROCESSING: "on_error",
}


class LifecycleState(NamedTuple):
    """A state by label and number."""

    label: str
    state_id: int


class LifecycleNodeMixin(ManagedEntity):
    """What makes a :class:`rclpy.node.Node` a managed one.

    Args:
        enable_communication_interface: Whether others can see and change the state by services;
            the topic of transitions is there in any case.
        callback_group: The callback group of the services; the node's own if ``None``.

    Raises:
        TypeError: ``enable_communication_interface`` is not a bool.
    """

    # Of the node that this is mixed with.
    default_callback_group: CallbackGroup
    create_service: Callable[..., Any]
    create_publisher: Callable[..., Any]
    destroy_publisher: Callable[..., bool]
    get_logger: Callable[[], Any]

    def __init__(
        self,
        *,
        enable_communication_interface: bool = True,
        callback_group: CallbackGroup | None = None,
    ) -> None:
        if not isinstance(enable_communication_interface, bool):
            raise TypeError(
                "enable_communication_interface must be a bool, not"
                f" {enable_communication_interface!r}."
            )
        # Kept in the order of their making, in which they are told of transitions.
        self._managed_entities: dict[ManagedEntity, None] = {}
        self._state_machine = StateMachine()
        self._transition_events = self.create_publisher(
            TransitionEvent, "~/transition_event", QoSProfile(depth=10)
        )
        if not enable_communication_interface:
            return
        group = callback_group or self.default_callback_group
        for kind, name, callback in (
            (ChangeState, "change_state", self.__on_change_state),
            (GetState, "get_state", self.__on_get_state),
            (GetAvailableStates, "get_available_states", self.__on_get_states),
            (GetAvailableTransitions, "get_available_transitions", self.__on_get_transitions),
            (GetAvailableTransitions, "get_transition_graph", self.__on_get_graph),
        ):
            self.create_service(kind, f"~/{name}", callback, callback_group=group)

    def trigger_configure(self) -> TransitionCallbackReturn:
        """Go from unconfigured to inactive; return how ``on_configure`` ended.

        Raises:
            rclpy.exceptions.RCLError: The node is in another state.
        """
        return self.__change_state("configure")

    def trigger_cleanup(self) -> TransitionCallbackReturn:
        """Go from inactive to unconfigured; return how ``on_cleanup`` ended.

        Raises:
            rclpy.exceptions.RCLError: The node is in another state.
        """
        return self.__change_state("cleanup")

    def trigger_shutdown(self) -> TransitionCallbackReturn:
        """Go from unconfigured, inactive or active to finalized; return how ``on_shutdown`` ended.

        Raises:
            rclpy.exceptions.RCLError: The node is in another state.
        """
        return self.__change_state("shutdown")

    def trigger_activate(self) -> TransitionCallbackReturn:
        """Go from inactive to active; return how ``on_activate`` ended.

        Raises:
            rclpy.exceptions.RCLError: The node is in another state.
        """
        return self.__change_state("activate")

    def trigger_deactivate(self) -> TransitionCallbackReturn:
        """Go from active to inactive; return how ``on_deactivate`` ended.

        Raises:
            rclpy.exceptions.RCLError: The node is in another state.
        """
        return self.__change_state("deactivate")

    def add_managed_entity(self, entity: ManagedEntity) -> None:
        """Notify an entity of the transitions too.

        Raises:
            TypeError: It is not a managed entity.
        """
        if not isinstance(entity, ManagedEntity):
            raise TypeError("Expected a rclpy.lifecycle.ManagedEntity instance.")
        self._managed_entities[entity] = None

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Notify the managed entities; overriding methods call this one too."""
        return self.__tell_entities("on_configure", state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Notify the managed entities; overriding methods call this one too."""
        return self.__tell_entities("on_cleanup", state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Notify the managed entities; overriding methods call this one too."""
        return self.__tell_entities("on_shutdown", state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Notify the managed entities; overriding methods call this one too."""
        return self.__tell_entities("on_activate", state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Notify the managed entities; overriding methods call this one too."""
        return self.__tell_entities("on_deactivate", state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Notify the managed entities; overriding methods call this one too."""
        return self.__tell_entities("on_error", state)

    def create_lifecycle_publisher(self, *args: Any, **kwargs: Any) -> LifecyclePublisher:
        """Return a new publisher that publishes only while the node is active.

        It takes the arguments of ``create_publisher``.

        Raises:
            TypeError: ``publisher_class`` is among them.
        """
        if "publisher_class" in kwargs:
            raise TypeError(
                "create_publisher() got an unexpected keyword argument 'publisher_class'"
            )
        publisher: LifecyclePublisher = self.create_publisher(
            *args, **kwargs, publisher_class=LifecyclePublisher
        )
        self._managed_entities[publisher] = None
        return publisher

    def destroy_lifecycle_publisher(self, publisher: LifecyclePublisher) -> bool:
        """End a publisher; return whether it was this node's."""
        self._managed_entities.pop(publisher, None)
        return self.destroy_publisher(publisher)

    def __tell_entities(self, name: str, state: LifecycleState) -> TransitionCallbackReturn:
        for entity in list(self._managed_entities):
            outcome = getattr(entity, name)(state)
            if not isinstance(outcome, TransitionCallbackReturn):
                raise TypeError(
                    f"{name}() return value of class {type(entity)} should be"
                    f" `TransitionCallbackReturn`.\nInstance of the class that caused the failure:"
                    f" {entity}"
                )
            if outcome != TransitionCallbackReturn.SUCCESS:
                return outcome
        return TransitionCallbackReturn.SUCCESS

    def __change_state(self, transition: int | str) -> TransitionCallbackReturn:
        number, label = self._state_machine.current_state
        before = LifecycleState(label, number)
        self.__make(transition)
        outcome = self.__call_back(before)
        self.__make(outcome.to_label())
        if outcome == TransitionCallbackReturn.ERROR:
            self.__make(self.__call_back(before).to_label())
        return outcome

    def __make(self, transition: int | str) -> None:
        step = self._state_machine.find(transition)
        if step is None:
            label = self._state_machine.current_state[1]
            raise RCLError(
                "Failed to trigger lifecycle state machine transition: there is no transition"
                f" '{transition}' from the state '{label}'"
            )
        self._state_machine.make(step)
        event = TransitionEvent()
        event.start_state.id, event.start_state.label = step.start, STATES[step.start]
        event.goal_state.id, event.goal_state.label = step.goal, STATES[step.goal]
        self._transition_events.publish(event)

    def __call_back(self, before: LifecycleState) -> TransitionCallbackReturn:
        number, label = self._state_machine.current_state
        name = _CALLBACKS[number]
        try:
            outcome = getattr(self, name)(before)
        except Exception as error:
            # rclpy is silent here; an operator wants to know why the node is not there.
            self.get_logger().error(f"{name}() raised {type(error).__name__}: {error}")
            return TransitionCallbackReturn.ERROR
        if not isinstance(outcome, TransitionCallbackReturn):
            # As in rclpy, the node is left in the state of the transition.
            raise AttributeError(
                f"{name}() returned {outcome!r} while {label}; it must return a"
                " TransitionCallbackReturn."
            )
        return outcome

    def __on_change_state(self, request: Any, response: Any) -> Any:
        asked = request.transition
        # A label wins over the number, as in rclpy.
        wanted: int | str = asked.label or asked.id
        if self._state_machine.find(wanted) is None:
            label = self._state_machine.current_state[1]
            self.get_logger().warning(
                f"No transition matching {wanted} found for current state {label}"
            )
            response.success = False
            return response
        response.success = self.__change_state(wanted) == TransitionCallbackReturn.SUCCESS
        return response

    def __on_get_state(self, _request: Any, response: Any) -> Any:
        state = response.current_state
        state.id, state.label = self._state_machine.current_state
        return response

    def __on_get_states(self, _request: Any, response: Any) -> Any:
        response.available_states = [
            State(id=number, label=label) for number, label in STATES.items()
        ]
        return response

    def __on_get_transitions(self, _request: Any, response: Any) -> Any:
        response.available_transitions = [
            _describe(step) for step in self._state_machine.available_steps()
        ]
        return response

    def __on_get_graph(self, _request: Any, response: Any) -> Any:
        response.available_transitions = [_describe(step) for step in STEPS]
        return response


class LifecycleNode(LifecycleNodeMixin, Node):
    """Managed node.

    Args:
        node_name: The name.
        enable_communication_interface: Whether others can see and change the state by services.
        **kwargs: As for :class:`rclpy.node.Node`.
    """

    def __init__(
        self, node_name: str, *, enable_communication_interface: bool = True, **kwargs: Any
    ) -> None:
        Node.__init__(self, node_name, **kwargs)
        with self._ros_graph.together():
            LifecycleNodeMixin.__init__(
                self, enable_communication_interface=enable_communication_interface
            )


def _describe(step: Step) -> Any:
    description = TransitionDescription()
    description.transition.id, description.transition.label = step.number, step.label
    description.start_state.id, description.start_state.label = step.start, STATES[step.start]
    description.goal_state.id, description.goal_state.label = step.goal, STATES[step.goal]
    return description
