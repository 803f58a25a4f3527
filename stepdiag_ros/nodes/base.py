"""What all nodes share: topics, parameters, heartbeat, the watch on the other nodes."""

import sys
import uuid
from collections.abc import Callable
from difflib import get_close_matches
from importlib import import_module
from typing import Any, ClassVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.utilities import remove_ros_args
from std_srvs.srv import Trigger

from stepdiag_ros.refusals import PREFIX, sentence
from stepdiag_ros.run.supervision import HEARTBEAT_PERIOD, Peer, Watch
from stepdiag_ros.topics import DIAGNOSTICS, RUN_DESCRIPTION, RUN_STATE, Topic

CLIENT_PARAMETERS = ("start_type_description_service",)
"""Parameters that a ROS client declares by itself and that mean nothing to a node."""
_KINDS = {
    str: "a text",
    float: "a number with a point, such as 1.0,",
    int: "a whole number",
}


def quality(topic: Topic, keep_all: bool = False) -> QoSProfile:
    """Return the quality of service of a topic.

    Args:
        topic: which.
        keep_all: for a reader that must not miss a message however far it falls behind.
    """
    return QoSProfile(
        history=HistoryPolicy.KEEP_ALL if keep_all else HistoryPolicy.KEEP_LAST,
        depth=topic.qos.depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=(
            DurabilityPolicy.TRANSIENT_LOCAL
            if topic.qos.transient_local
            else DurabilityPolicy.VOLATILE
        ),
    )


def message_class(topic: Topic) -> Any:
    """Return the message class of a topic."""
    package, _, name = topic.type_name.split("/")
    return getattr(import_module(f"{package}.msg"), name)


class CannotStart(Exception):
    """A node cannot do its work after all; the text says why. Ends the process."""


class StepdiagNode(Node):
    """A node of the suite: says that it is alive, listens who else is, reports faults in words.

    Args:
        name: default name of the node.
    """

    role: ClassVar[str] = ""

    def __init__(self, name: str) -> None:
        # Declared at first as they come, so that one that the node does not have is seen.
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        self._own_parameters: set[str] = set()
        self.run_id = ""
        self.run_over = True
        self.watch = Watch()
        self._level, self._text = DiagnosticStatus.OK, "ready"
        self._waiting = ""
        self.facts: dict[str, str] = {}
        self._session = uuid.uuid4().hex
        self._real_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._diagnostics = self.announce(DIAGNOSTICS)
        self.listen(DIAGNOSTICS, self._on_diagnostics)
        self.create_timer(HEARTBEAT_PERIOD, self.beat, clock=self._real_clock)
        self.create_timer(HEARTBEAT_PERIOD / 2, self._check_peers, clock=self._real_clock)

    # Time --------------------------------------------------------------------------------------

    def now(self) -> int:
        """Return the ROS time in ns."""
        nanoseconds: int = self.get_clock().now().nanoseconds
        return nanoseconds

    def real_time(self) -> float:
        """Return the time in s of a clock that neither steps nor follows the simulation."""
        return float(self._real_clock.now().nanoseconds) * 1e-9

    def every(self, seconds: float, callback: Callable[[], None], real: bool = False) -> None:
        """Call back periodically, in ROS time or (``real``) on the clock that never steps."""
        self.create_timer(seconds, callback, clock=self._real_clock if real else None)

    def await_clock(self, then: Callable[[], None]) -> None:
        """Call back once the ROS clock runs: simulated time is zero until /clock is heard."""

        def look() -> None:
            if self.now() > 0:
                timer.cancel()
                try:
                    then()
                except (ValueError, OSError) as error:
                    raise CannotStart(sentence(error)) from error
                self.ready()

        self.not_ready("waiting for the ROS clock to run")

        timer = self.create_timer(0.01, look, clock=self._real_clock)

    # Topics, services, parameters ----------------------------------------------------------------

    def announce(self, topic: Topic) -> Publisher:
        """Return a publisher on a topic of the suite."""
        return self.create_publisher(message_class(topic), topic.name, quality(topic))

    def listen(
        self,
        topic: Topic,
        callback: Callable[[Any], None],
        keep_all: bool = False,
        raw: bool = False,
    ) -> None:
        """Call back with each message of a topic of the suite (its CDR bytes, if ``raw``)."""
        qos = quality(topic, keep_all)
        self.create_subscription(message_class(topic), topic.name, callback, qos, raw=raw)

    def offer(self, name: str, action: Callable[[], str]) -> None:
        """Offer a Trigger service; the action returns what it did, or raises ValueError."""

        def answer(_request: Any, response: Any) -> Any:
            try:
                response.message = action()
                response.success = True
            except ValueError as error:
                response.message = str(error)
                response.success = False
            return response

        self.create_service(Trigger, name, answer)

    def parameter(
        self,
        name: str,
        default: Any,
        description: str,
        low: float | None = None,
        high: float | None = None,
    ) -> Any:
        """Declare a parameter that is set at start and return its value.

        Raises:
            ValueError: the given value is out of range or of another type.
        """
        descriptor = ParameterDescriptor(description=description, read_only=True)
        if low is not None and high is not None:
            if isinstance(default, float):
                descriptor.floating_point_range = [
                    FloatingPointRange(from_value=low, to_value=high, step=0.0)
                ]
            else:
                descriptor.integer_range = [
                    IntegerRange(from_value=int(low), to_value=int(high), step=1)
                ]
        self._own_parameters.add(name)
        given = self.get_parameter_or(name, Parameter(name, value=default)).value
        if self.has_parameter(name):
            self.undeclare_parameter(name)
        try:
            return self.declare_parameter(name, default, descriptor).value
        except rclpy.exceptions.ParameterException:
            limits = "" if low is None or high is None else f" from {low:.15g} to {high:.15g}"
            raise ValueError(
                f"parameter '{name}' of node {self.get_name()} is {given!r};"
                f" expected {_KINDS.get(type(default), 'true or false')}{limits}"
            ) from None

    def refuse_unknown_parameters(self) -> None:
        """Refuse parameters that the node does not have: rclpy would ignore a typing error.

        Raises:
            ValueError: there is one; names it and those that there are.
        """
        if not isinstance(self.get_parameter("use_sim_time").value, bool):
            raise ValueError(f"parameter 'use_sim_time' of node {self.get_name()} is no true/false")
        own = sorted({*self._own_parameters, "use_sim_time"})
        for name in self.get_parameters_by_prefix(""):
            if name not in own and name not in CLIENT_PARAMETERS:
                near = get_close_matches(name, own, n=1)
                hint = f"did you mean '{near[0]}'?" if near else f"it has {', '.join(own)}"
                raise ValueError(f"node {self.get_name()} has no parameter '{name}'; {hint}")

    # Health --------------------------------------------------------------------------------------

    def healthy(self, text: str) -> None:
        """Say that all is well; others see it at once."""
        self._set_health(DiagnosticStatus.OK, text)

    def not_ready(self, text: str) -> None:
        """Say what is still missing; no run starts until ``ready`` is called."""
        self._waiting = text
        self._set_health(DiagnosticStatus.ERROR, text)

    def ready(self) -> None:
        """Say that nothing is missing any more; harmless when nothing was."""
        if self._waiting:
            self._waiting = ""
            self.healthy("ready")

    def unwell(self, text: str) -> None:
        """Say what is wrong, in the log and on /diagnostics."""
        if text != self._text:
            self.get_logger().error(text)
        self._set_health(DiagnosticStatus.ERROR, text)

    def beat(self) -> None:
        """Publish the heartbeat: role, health, run and process identity."""
        if not self.context.ok():
            return
        status = DiagnosticStatus(
            level=self._level,
            name=self.get_fully_qualified_name(),
            message=self._text,
            hardware_id=self.role,
            values=[
                KeyValue(key="run_id", value=self.run_id),
                KeyValue(key="session", value=self._session),
                *[KeyValue(key=key, value=value) for key, value in self.facts.items()],
            ],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)

    def on_heartbeat(self, peer: Peer) -> None:
        """Called with each heartbeat of another node."""

    def on_peer_lost(self, text: str) -> None:
        """Called when a node has fallen silent while a run is going on."""
        self.get_logger().error(text)
        self._set_health(DiagnosticStatus.WARN, text)

    def follow_run(self) -> None:
        """Call ``on_run`` when a run begins, ``on_run_state`` and ``on_run_end`` as it goes on."""
        self.listen(RUN_DESCRIPTION, self._on_description)
        self.listen(RUN_STATE, self._on_run_state)

    def on_run(self, description: Any) -> None:
        """Called with the RunDescription of a new run."""

    def on_run_state(self, state: Any) -> None:
        """Called with each RunState."""

    def on_run_end(self) -> None:
        """Called when the run has finished or was aborted."""

    def close(self) -> None:
        """Finish what must not be left half done; called once before the process ends."""

    def _on_description(self, description: Any) -> None:
        if description.run_id == self.run_id and not self.run_over:
            return
        try:
            self.on_run(description)
        except ValueError as error:
            self.unwell(f"cannot take up run {description.run_id}: {error}")
            return
        self.run_id = description.run_id
        self.run_over = False
        self.healthy(f"run {self.run_id}")

    def _on_run_state(self, state: Any) -> None:
        ended = state.state in (state.STATE_FINISHED, state.STATE_ABORTED)
        if ended and state.run_id == self.run_id and not self.run_over:
            self.run_over = True
            self.healthy(f"ready; run {self.run_id} has ended")
            self.on_run_end()
        self.on_run_state(state)

    def _set_health(self, level: bytes, text: str) -> None:
        changed = (level, text) != (self._level, self._text)
        self._level, self._text = level, text
        if changed:
            self.beat()

    def _on_diagnostics(self, array: Any) -> None:
        for status in array.status:
            values = {entry.key: entry.value for entry in status.values}
            if "session" not in values or values["session"] == self._session:
                continue
            peer = Peer(
                role=status.hardware_id,
                last_seen=self.real_time(),
                session=values["session"],
                run_id=values["run_id"],
                text=status.message,
                faulty=status.level == DiagnosticStatus.ERROR,
                facts=values,
            )
            if status.name == self.get_fully_qualified_name():
                self.unwell(f"two nodes are named {status.name}: end one of them or rename it")
            self.watch.heard(status.name, peer)
            self.on_heartbeat(peer)

    def _check_peers(self) -> None:
        for text in self.watch.check(self.real_time()):
            if not self.run_over:
                self.on_peer_lost(text)


def spin(node_class: Callable[[], StepdiagNode]) -> int:
    """Run a node until it is told to end; return the exit code.

    A node that cannot start says why in one sentence.
    """
    try:
        node = _make(node_class)
    except KeyboardInterrupt:
        rclpy.try_shutdown()
        return 0
    # RuntimeError is what the middleware raises, for example about ROS_DOMAIN_ID.
    except (ValueError, OSError, RuntimeError, NameValidationException) as error:
        return _refuse(error)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except CannotStart as error:
        return _refuse(error)
    except RuntimeError:
        # A callback that was at work when the process was told to end can publish no more.
        if rclpy.ok():
            raise
    finally:
        node.close()
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _make(node_class: Callable[[], StepdiagNode]) -> StepdiagNode:
    left = remove_ros_args(sys.argv)[1:]
    if left:
        raise ValueError(f"'{' '.join(left)}' is not understood; parameters go behind --ros-args")
    rclpy.init()
    node = node_class()
    node.refuse_unknown_parameters()
    return node


def _refuse(error: Exception) -> int:
    print(f"{PREFIX}{sentence(error)}", file=sys.stderr)
    rclpy.try_shutdown()
    return 1
