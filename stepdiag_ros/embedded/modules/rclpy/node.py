"""Nodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from rclpy._node_graph import NodeGraph
from rclpy._node_names import NodeNames
from rclpy._node_parameters import NodeParameters
from rclpy._parameters import ParameterStore
from rclpy._rosout import Rosout
from rclpy._source import Source
from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock, ROSClock
from rclpy.context import Context
from rclpy.duration import NS_PER_S
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import NotInitializedException
from rclpy.executors import Executor
from rclpy.guard_condition import GuardCondition
from rclpy.logging import RcutilsLogger, get_logger
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService
from rclpy.publisher import Publisher
from rclpy.qos import (
    QoSProfile,
    _as_profile,
    qos_profile_parameter_events,
    qos_profile_services_default,
)
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.time_source import TimeSource
from rclpy.timer import Rate, Timer
from rclpy.utilities import get_default_context

_S = TypeVar("_S", bound=Source)


class Node(NodeNames, NodeParameters, NodeGraph):
    """A node: the named owner of publishers, subscriptions, services, timers and parameters.

    Args:
        node_name: The name.
        context: The context; the default one if ``None``.
        cli_args: Command line of this node alone.
        namespace: The namespace.
        use_global_arguments: Whether the process's command line counts too.
        enable_rosout: Whether logs go to ``/rosout``.
        start_parameter_services: Whether others can see and set the parameters.
        parameter_overrides: Values that win over those of the command line.
        allow_undeclared_parameters: Whether undeclared parameters can be set and read.
        automatically_declare_parameters_from_overrides: Whether every given value declares its
            parameter.

    Raises:
        rclpy.exceptions.NotInitializedException: ``rclpy.init`` was not called.
        rclpy.exceptions.InvalidNodeNameException: The name breaks the rules.
        rclpy.exceptions.InvalidNamespaceException: The namespace breaks the rules.
    """

    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = None,
        cli_args: Sequence[str] | None = None,
        namespace: str | None = None,
        use_global_arguments: bool = True,
        enable_rosout: bool = True,
        start_parameter_services: bool = True,
        parameter_overrides: list[Parameter] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        enable_logger_service: bool = False,
    ) -> None:
        self._destroyed = True
        self._context = context or get_default_context()
        if not self._context.ok():
            raise NotInitializedException("cannot create node")
        if enable_logger_service:
            raise NotImplementedError(
                "The embedded ROS 2 client has no logger service; use --log-level instead."
            )
        self._executor_ref: Executor | None = None
        self._sources: list[Source] = []
        self._publishers: list[Publisher] = []
        self._rates: list[Rate] = []
        self._set_names(node_name, namespace or "", cli_args, use_global_arguments)
        self._logger = get_logger(self._logger_name())
        _, self._ros_graph = self._context._require()
        self._default_callback_group: CallbackGroup = MutuallyExclusiveCallbackGroup()
        self._clock_group: CallbackGroup = MutuallyExclusiveCallbackGroup()
        self._clock = ROSClock()
        self._parameters = ParameterStore(
            self, self._collect_overrides(parameter_overrides or []), allow_undeclared_parameters
        )
        with self._ros_graph.together():
            self._graph_number = self._ros_graph.add_node(self._name, self._namespace)
            self._destroyed = False
            self._context._nodes.add(self)
            self._rosout = Rosout(self) if enable_rosout and self._use_rosout else None
            self._start_parameters(automatically_declare_parameters_from_overrides)
            self._time_source = TimeSource(node=self)
            self._time_source.attach_clock(self._clock)
            if start_parameter_services:
                ParameterService(self)

    def _start_parameters(self, declare_all: bool) -> None:
        from rcl_interfaces.msg import ParameterDescriptor, ParameterEvent

        publisher = self.create_publisher(
            ParameterEvent, "/parameter_events", qos_profile_parameter_events
        )
        self._parameters.publish = publisher.publish
        if declare_all:
            for name, parameter in self._parameters.overrides.items():
                self.declare_parameter(name, parameter.value, ParameterDescriptor())

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(
            f"The embedded ROS 2 client's {type(self).__name__} has no attribute '{name}'."
        )

    def __repr__(self) -> str:
        return f"<rclpy.node.Node {self.get_fully_qualified_name()}>"

    # Belongings.

    def get_logger(self) -> RcutilsLogger:
        """Return the logger."""
        return self._logger

    def get_clock(self) -> Clock:
        """Return the clock, which is ROS time."""
        return self._clock

    @property
    def context(self) -> Context:
        """The context."""
        return self._context

    @property
    def default_callback_group(self) -> CallbackGroup:
        """The callback group of whatever is made without one."""
        return self._default_callback_group

    @property
    def publishers(self) -> Any:
        """The publishers."""
        return iter(list(self._publishers))

    @property
    def subscriptions(self) -> Any:
        """The subscriptions."""
        return self._of(Subscription)

    @property
    def clients(self) -> Any:
        """The clients."""
        return self._of(Client)

    @property
    def services(self) -> Any:
        """The services."""
        return self._of(Service)

    @property
    def timers(self) -> Any:
        """The timers."""
        return self._of(Timer)

    @property
    def guards(self) -> Any:
        """The guard conditions."""
        return self._of(GuardCondition)

    def _of(self, kind: type) -> Any:
        # Not what is derived from it: parts of action servers are not the node's own.
        return iter([source for source in self._sources if type(source) is kind])

    @property
    def executor(self) -> Executor | None:
        """The executor that serves the node, if any."""
        return self._executor_ref

    @executor.setter
    def executor(self, new_executor: Executor | None) -> None:
        current = self._executor_ref
        if current is new_executor:
            return
        self._executor_ref = None
        if current is not None:
            current.remove_node(self)
        if new_executor is not None:
            self._executor_ref = new_executor
            new_executor.add_node(self)

    def _forget_executor(self, executor: Executor) -> None:
        if self._executor_ref is executor:
            self._executor_ref = None

    # Making and destroying.

    def create_publisher(
        self,
        msg_type: Any,
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: PublisherEventCallbacks | None = None,
        qos_overriding_options: Any = None,
        publisher_class: type[Publisher] = Publisher,
    ) -> Publisher:
        """Return a new publisher.

        Args:
            msg_type: Class of the messages.
            topic: The topic; relative names get the node's namespace.
            qos_profile: Quality of service, or the depth of a default one.
            callback_group: The callback group of the event callbacks; the node's own if ``None``.
            event_callbacks: What is called when a subscription asks for what is not offered; it
                is logged if ``None``.
            qos_overriding_options: Must be ``None``.
            publisher_class: Class of the publisher.

        Raises:
            rclpy.exceptions.InvalidTopicNameException: The topic's name breaks the rules.
            TypeError: ``msg_type`` is not a message class.
        """
        _refuse(qos_overriding_options, "qos_overriding_options")
        publisher = publisher_class(
            self,
            msg_type,
            self.resolve_topic_name(topic),
            _as_profile(qos_profile),
            callback_group or self._default_callback_group,
            event_callbacks,
        )
        self._publishers.append(publisher)
        self._add(publisher._watch)
        self._ros_graph.add_endpoints(self._graph_number, [], [publisher._guid])
        return publisher

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[..., Any],
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        qos_overriding_options: Any = None,
        raw: bool = False,
    ) -> Subscription:
        """Return a new subscription.

        Args:
            msg_type: Class of the messages.
            topic: The topic; relative names get the node's namespace.
            callback: Called with each message, or its CDR bytes if ``raw``; a second argument
                gets a dictionary with ``source_timestamp`` and ``received_timestamp`` (ns).
            qos_profile: Quality of service, or the depth of a default one.
            callback_group: The callback group; the node's own if ``None``.
            event_callbacks: What is called when a publisher does not offer what is asked for; it
                is logged if ``None``.
            qos_overriding_options: Must be ``None``.
            raw: Whether messages are left as bytes.

        Raises:
            rclpy.exceptions.InvalidTopicNameException: The topic's name breaks the rules.
            TypeError: ``msg_type`` is not a message class.
        """
        _refuse(qos_overriding_options, "qos_overriding_options")
        subscription = Subscription(
            self,
            msg_type,
            self.resolve_topic_name(topic),
            callback,
            callback_group or self._default_callback_group,
            _as_profile(qos_profile),
            raw,
            event_callbacks,
        )
        self._add(subscription._watch)
        self._add(subscription)
        self._ros_graph.add_endpoints(self._graph_number, [subscription._guid], [])
        return subscription

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Service:
        """Return a new service, whose callback gets request and response and returns the latter.

        Raises:
            rclpy.exceptions.InvalidServiceNameException: The name breaks the rules.
        """
        service = Service(
            self,
            srv_type,
            self.resolve_service_name(srv_name),
            callback,
            callback_group or self._default_callback_group,
            qos_profile,
        )
        self._add(service)
        self._ros_graph.add_endpoints(self._graph_number, *service._end.guids)
        return service

    def create_client(
        self,
        srv_type: Any,
        srv_name: str,
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Client:
        """Return a new client of a service.

        Raises:
            rclpy.exceptions.InvalidServiceNameException: The name breaks the rules.
        """
        client = Client(
            self,
            srv_type,
            self.resolve_service_name(srv_name),
            callback_group or self._default_callback_group,
            qos_profile,
        )
        self._add(client)
        self._ros_graph.add_endpoints(self._graph_number, *client._end.guids)
        return client

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., Any] | None,
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Return a new timer.

        Args:
            timer_period_sec: The period in seconds.
            callback: Called at each period; an argument gets a :class:`rclpy.timer.TimerInfo`.
            callback_group: The callback group; the node's own if ``None``.
            clock: The clock to go by; the node's, which is ROS time, if ``None``.
            autostart: Whether it runs at once.
        """
        timer = Timer(
            callback,
            callback_group or self._default_callback_group,
            int(float(timer_period_sec) * NS_PER_S),
            clock or self._clock,
            context=self._context,
            autostart=autostart,
        )
        return self._add(timer)

    def create_guard_condition(
        self, callback: Callable[[], Any], callback_group: CallbackGroup | None = None
    ) -> GuardCondition:
        """Return a new guard condition."""
        return self._add(GuardCondition(callback, callback_group or self._default_callback_group))

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        """Return an object whose ``sleep`` keeps a loop at a frequency in Hz.

        Raises:
            ValueError: The frequency is not positive.
        """
        if frequency <= 0:
            raise ValueError("frequency must be > 0")
        timer = self.create_timer(1.0 / frequency, None, MutuallyExclusiveCallbackGroup(), clock)
        rate = Rate(timer, context=self._context)
        self._rates.append(rate)
        return rate

    def destroy_publisher(self, publisher: Publisher) -> bool:
        """End a publisher; return whether it was this node's."""
        if publisher not in self._publishers:
            return False
        self._publishers.remove(publisher)
        self._drop(publisher._watch)
        self._ros_graph.remove_endpoints(self._graph_number, [publisher._guid])
        publisher.destroy()
        return True

    def destroy_subscription(self, subscription: Subscription) -> bool:
        """End a subscription; return whether it was this node's."""
        if not self._drop(subscription):
            return False
        self._drop(subscription._watch)
        self._ros_graph.remove_endpoints(self._graph_number, [subscription._guid])
        subscription.destroy()
        return True

    def destroy_service(self, service: Service) -> bool:
        """End a service; return whether it was this node's."""
        return self._destroy_pair(service)

    def destroy_client(self, client: Client) -> bool:
        """End a client; return whether it was this node's."""
        return self._destroy_pair(client)

    def destroy_timer(self, timer: Timer) -> bool:
        """End a timer; return whether it was this node's."""
        return self._destroy_simple(timer)

    def destroy_guard_condition(self, guard: GuardCondition) -> bool:
        """End a guard condition; return whether it was this node's."""
        return self._destroy_simple(guard)

    def destroy_rate(self, rate: Rate) -> bool:
        """End a rate; return whether it was this node's."""
        if rate not in self._rates:
            return False
        self._rates.remove(rate)
        self._drop(rate._timer)
        rate.destroy()
        return True

    def destroy_node(self) -> None:
        """End the node and all it has made."""
        if self._destroyed:
            return
        self._destroyed = True
        self.executor = None
        if self._rosout is not None:
            self._rosout.close()
        with self._ros_graph.together():
            self._ros_graph.remove_node(self._graph_number)
            for publisher in list(self._publishers):
                publisher.destroy()
            for source in list(self._sources):
                source.destroy()
        for rate in self._rates:
            rate.destroy()
        self._publishers.clear()
        self._sources.clear()
        self._context._nodes.discard(self)
        self._context._leave_if_unused()

    def __enter__(self) -> Node:
        return self

    def __exit__(self, *_: object) -> None:
        self.destroy_node()

    def _add(self, source: _S) -> _S:
        self._sources.append(source)
        executor = self._executor_ref
        if executor is not None:
            executor._add_source(source)
            executor.wake()
        return source

    def _drop(self, source: Source) -> bool:
        if source not in self._sources:
            return False
        self._sources.remove(source)
        return True

    def _destroy_simple(self, source: Source) -> bool:
        if not self._drop(source):
            return False
        source.destroy()
        return True

    def _destroy_pair(self, source: Service | Client) -> bool:
        if not self._drop(source):
            return False
        readers, writers = source._end.guids
        self._ros_graph.remove_endpoints(self._graph_number, readers + writers)
        source.destroy()
        return True


def _refuse(value: Any, name: str) -> None:
    if value is not None:
        raise NotImplementedError(f"The embedded ROS 2 client has no {name}; leave it out.")
