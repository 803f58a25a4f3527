"""Nodes of devices: managed nodes, which open, use and close their device on request.

The states are those of every managed node of ROS 2:

==============  ============================================================================
unconfigured    the device is closed
inactive        it is open and watched, but nothing of it is published and nothing is done with it
active          it does its work
finalized       it is closed for good
==============  ============================================================================

A device that fails is closed, whatever state the node was in, and the node is unconfigured again.
The heartbeat goes on in every state, and says which.
"""

import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from enum import Enum
from functools import partial
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from rclpy.lifecycle import (
    LifecycleNodeMixin,
    LifecycleState,
    SimpleManagedEntity,
    TransitionCallbackReturn,
)

from stepdiag_ros.configuration import load_device
from stepdiag_ros.devices import NO_DRIVER
from stepdiag_ros.metrology.refusal import Refusal, fields_of
from stepdiag_ros.nodes.base import StepdiagNode
from stepdiag_ros.nodes.links import Outlet
from stepdiag_ros.parameters.declaration import Changeable
from stepdiag_ros.parameters.nodes import declared_node
from stepdiag_ros.run.accord import DRIVER, SIMULATED
from stepdiag_ros.run.health import HealthFinding, Level
from stepdiag_ros.text.sentence import sentence
from stepdiag_ros.topics import Topic

CLOCK_PERIOD = 0.01
"""Real seconds between two looks whether the ROS clock runs."""
SIMULATED_PERIOD = 0.02
"""Real seconds between two looks at a device in simulated time: it has news when that goes on, and
a node that must not be late with them looks then."""


class Closable(Protocol):
    """What every device can do."""

    def close(self) -> None:
        """Let the device go."""
        ...


D = TypeVar("D", bound=Closable)


class Phase(Enum):
    """Where a managed node stands between two transitions."""

    UNCONFIGURED = "unconfigured"
    INACTIVE = "inactive"
    ACTIVE = "active"
    FINALIZED = "finalized"


class Stream(SimpleManagedEntity):
    """Publishes what a device says, but only while its node is active.

    Args:
        outlet: on the topic.
    """

    def __init__(self, outlet: Outlet) -> None:
        super().__init__()
        self._outlet = outlet

    def publish(self, message: Any) -> None:
        """Publish a message, or drop it."""
        if self.is_activated:
            self._outlet.publish(message)

    def publish_all(self, messages: Iterable[Any]) -> None:
        """Publish messages that came at once, or drop them."""
        if self.is_activated:
            self._outlet.publish_all(messages)


class DeviceNode(LifecycleNodeMixin, StepdiagNode, Generic[D]):
    """A managed node that owns one device.

    Args:
        name: default name of the node.

    Attributes:
        device: the device; None unless the node is inactive or active. There is no device that is
            half open.
    """

    thing: ClassVar[str] = "device"
    """What the device is called in sentences."""
    poll_period: ClassVar[float] = 0.01
    """Real seconds between two looks at a device that is open."""

    def __init__(self, name: str) -> None:
        StepdiagNode.__init__(self, name)
        self.device: D | None = None
        self._phase = Phase.UNCONFIGURED
        self._failure = ""
        self._autostart: bool = self.parameter("autostart")
        self._starts_itself = self._autostart
        self._retry_after: float = self.parameter("retry_after")
        self.facts[DRIVER] = self.parameter("device")
        driver = f"{self.parameter('device')} {self.thing}"
        self.health.hardware_id = self.parameter("hardware_id") or driver
        for one in declared_node(self.role).parameters:
            if one.change is Changeable.WHILE_CLOSED:
                self.on_change(one.name, prepare=partial(self._acceptable, one.name))
        LifecycleNodeMixin.__init__(self)
        self._refuse_impossible_transitions()
        self._starting = self.every(CLOCK_PERIOD, self._start, real=True)
        self._retrying = self.every(self._retry_after, self._start, real=True)
        self._retrying.cancel()
        period = SIMULATED_PERIOD if self._is_simulated() else self.poll_period
        self.every(period, self.look_at_device, real=True)
        if self._autostart:
            self._say("waiting for the ROS clock to run")
        else:
            self._starting.cancel()
            self._say_how("configure", "the device is not open")

    # What a kind of device adds -----------------------------------------------------------------

    def opener(self, **changed: Any) -> Callable[[int], D]:
        """Return what opens the device, at a time in ns, with the present parameters.

        Args:
            changed: those that are to have another value than they have.

        Raises:
            ValueError: there is no such driver, or it refuses a value.
        """
        raise NotImplementedError

    def device_settings(self, changed: Mapping[str, Any], simulated: Mapping[str, str]) -> Any:
        """Return the settings of the driver: those of its file, and of the simulation if it is one.

        Args:
            changed: parameters that are to have another value than they have.
            simulated: parameter → setting, of the simulated device.

        Raises:
            ValueError: the file is not there or no table of settings.
        """
        file = changed.get("device_file", self.parameter("device_file"))
        settings = load_device(file)[0] if file else {}
        if self.parameter("device") == SIMULATED:
            given = {name: self.parameter(name) for name in simulated} | dict(changed)
            settings |= {setting: given[name] for name, setting in simulated.items()}
        return settings

    @contextmanager
    def naming_file(self, changed: Mapping[str, Any]) -> Iterator[None]:
        """Say in which file a setting is wrong that is refused in the block.

        Args:
            changed: parameters that are to have another value than they have.
        """
        file = changed.get("device_file", self.parameter("device_file"))
        try:
            yield
        except ValueError as error:
            fields = fields_of(error)
            if fields.get("aspect") == NO_DRIVER:
                # No file has chosen the driver.
                raise Refusal(
                    f"parameter 'device': {error}", **{**fields, "about": "device"}
                ) from None
            if file:
                raise Refusal(f"{file}: {error}", **fields) from None
            if fields.get("fault") == "missing":
                raise Refusal(
                    f"{error}. Set the parameter device_file to a YAML file with the settings",
                    **fields,
                ) from None
            raise

    def open_device(self) -> D:
        """Open the device and return it.

        Raises:
            OSError: it does not answer.
            ValueError: what it answers makes no sense.
        """
        return self.opener()(self.now())

    def on_open(self, device: D) -> None:
        """Called when the device was opened, before it is used."""

    def on_begin(self, device: D) -> None:
        """Called when the device is to do its work."""

    def on_end(self, device: D, reason: str) -> None:
        """Called when the device is to do nothing any more; it may fail."""

    def on_closed(self, reason: str, failed: bool) -> None:
        """Called when the device was closed, or could not be opened, while the node goes on.

        Args:
            reason: in words.
            failed: the device has failed; nobody wanted it closed.
        """

    def poll(self, device: D) -> None:
        """Called again and again while the device is open, whether active or not."""

    def busy(self, device: D) -> str:  # noqa: ARG002
        """Say why the device cannot be let go just now; empty if it can."""
        return ""

    # What they may use ----------------------------------------------------------------------------

    def device_is_open(self) -> bool:
        """Say whether the device is open."""
        return self.device is not None

    @property
    def active(self) -> bool:
        """Say whether the device does its work."""
        return self._phase is Phase.ACTIVE

    def stream(self, topic: Topic) -> Stream:
        """Return what publishes on a topic of the suite while the node is active."""
        stream = Stream(self.announce(topic))
        self.add_managed_entity(stream)
        return stream

    def add_device_task(self, name: str, judge: Callable[[], HealthFinding]) -> None:
        """Publish a subject of the device on /diagnostics; judged only while the node is active."""

        def judge_if_active() -> HealthFinding:
            if self.active:
                return judge()
            return HealthFinding(
                Level.STALE, f"the {self.thing} is not in use: {self._phase.value}"
            )

        self.health.add_task(name, judge_if_active)

    @contextmanager
    def failing(self, doing: str) -> Iterator[None]:
        """Use the device in the block; if it fails there, it goes through error processing.

        Args:
            doing: what cannot be done then, such as ``read the weather station``.
        """
        try:
            yield
        except (OSError, ValueError) as error:
            self.fail(f"cannot {doing}: {sentence(error)}")

    def look_at_device(self) -> None:
        """Take what the device has to say, if it is open.

        Drivers count by the latest time that they were given: a clock that is set back would stop
        their watch over the device until it has caught up.
        """
        set_back = self.clock_set_back()
        if self.device is None:
            return
        if set_back:
            self.fail(set_back)
        else:
            with self.failing(f"read the {self.thing}"):
                self.poll(self.device)

    def _look_around(self) -> None:
        # A process that did not get the computer for a while has not read what the device said
        # meanwhile: it listens before it judges the device by its silence.
        self.look_at_device()
        super()._look_around()

    def fail(self, text: str) -> None:
        """Close a device that has failed; the node is unconfigured then."""
        self._failure = text
        # Both end in the callback for errors, since there is no transition for failures as such.
        if self._phase is Phase.ACTIVE:
            self.trigger_deactivate()
        elif self._phase is Phase.INACTIVE:
            self.trigger_cleanup()

    def close(self) -> None:
        """Leave no device behind in the middle of its work."""
        self._log_error(self._let_go("the node ends"))

    # Transitions ----------------------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the device."""
        if self.now() <= 0:
            self.get_logger().error(
                "cannot be configured yet: use_sim_time is true, but nobody publishes /clock"
            )
            return TransitionCallbackReturn.FAILURE
        # From now on it is as the manager wants it, whoever that is.
        self._starting.cancel()
        self._retrying.cancel()
        self._failure = ""
        super().on_configure(state)
        outcome = self._try(f"open the {self.thing}", self._open)
        if outcome == TransitionCallbackReturn.SUCCESS:
            self._enter(Phase.INACTIVE)
        return outcome

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let the device do its work."""
        outcome = self._try(f"start the {self.thing}", lambda: self.on_begin(self._opened()))
        if outcome == TransitionCallbackReturn.SUCCESS:
            super().on_activate(state)
            self._enter(Phase.ACTIVE)
        return outcome

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop what the device does; it stays open."""
        super().on_deactivate(state)
        if self._failure:
            return TransitionCallbackReturn.ERROR
        outcome = self._try(
            f"stop the {self.thing}", lambda: self.on_end(self._opened(), "the node is deactivated")
        )
        if outcome == TransitionCallbackReturn.SUCCESS:
            self._enter(Phase.INACTIVE)
        return outcome

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the device."""
        if self._failure:
            return TransitionCallbackReturn.ERROR
        busy = self.busy(self._opened())
        if busy:
            self.get_logger().error(f"cannot be cleaned up yet: {busy}")
            return TransitionCallbackReturn.FAILURE
        self._put_away("the node is cleaned up", Phase.UNCONFIGURED)
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the device for good."""
        super().on_deactivate(state)
        self._starting.cancel()
        self._retrying.cancel()
        self._put_away("the node is shut down", Phase.FINALIZED)
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close a device that has failed, say so, and come back to it if that is wanted."""
        super().on_deactivate(state)
        self._starts_itself = False
        said = self._let_go(self._failure)
        self._failure = "; ".join(filter(None, (self._failure, said)))
        self._phase = Phase.UNCONFIGURED
        if self._autostart:
            self._retrying.reset()
            after = f"the device is closed and will be opened again in {self._retry_after:g} s"
        else:
            after = "the device is closed: configure and activate the node to open it again"
        text = f"{self._failure}; {after}"
        if text != self._said:
            self.get_logger().error(text)
        self._say(text)
        self.on_closed(self._failure, failed=True)
        return super().on_error(state)

    # ----------------------------------------------------------------------------------------------

    def _acceptable(self, name: str, value: Any) -> None:
        """Refuse what the driver would refuse when the device is opened."""
        self.opener(**{name: value})

    def _start(self) -> None:
        """Configure and activate the node, once the ROS clock runs."""
        if self.now() <= 0:
            return
        self._starting.cancel()
        self._retrying.cancel()
        # A manager may have shut the node down.
        if self._phase is not Phase.UNCONFIGURED:
            return
        if self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def _open(self) -> None:
        self.device = self.open_device()
        self.on_open(self.device)

    def _opened(self) -> D:
        assert self.device is not None
        return self.device

    def _let_go(self, reason: str) -> str:
        """Close the device, if there is one; return what was not possible."""
        device, self.device = self.device, None
        if device is None:
            return ""
        try:
            try:
                self.on_end(device, reason)
            finally:
                device.close()
        except Exception as error:
            # Whatever it is: the node goes on without the device, or ends.
            return f"cannot close the {self.thing}: {self._words(error)}"
        return ""

    def _put_away(self, reason: str, phase: Phase) -> None:
        self._log_error(self._let_go(reason))
        self._enter(phase)
        self.on_closed(reason, failed=False)

    def _log_error(self, text: str) -> None:
        if text:
            self.get_logger().error(text)

    def _try(self, doing: str, action: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            action()
        except Exception as error:
            # Otherwise the client library would catch it, and say nothing of it.
            self._failure = f"cannot {doing}: {self._words(error)}"
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def _words(self, error: Exception) -> str:
        """Say what a device raised; all of it in the log, if it is a mistake in its driver."""
        if isinstance(error, OSError | ValueError):
            return sentence(error)
        self.get_logger().error("".join(traceback.format_exception(error)))
        return f"{type(error).__name__}: {error}"

    def _enter(self, phase: Phase) -> None:
        self._phase = phase
        self.get_logger().info(f"{self.thing}: {phase.value} ({self.parameter('device')})")
        if phase is Phase.ACTIVE:
            self._said = ""
            self._starts_itself = False
            self.facts["lifecycle"] = phase.value
            self.ready()
        elif phase is Phase.INACTIVE:
            self._say_how("activate", "the device is open, but not in use")
        elif phase is Phase.UNCONFIGURED:
            self._say_how("configure", "the device is not open")
        else:
            self._say("shut down: start the node again")

    def _say_how(self, transition: str, text: str) -> None:
        node = self.get_fully_qualified_name()
        self._say(f"{self._phase.value}: {text}; ros2 lifecycle set {node} {transition}")

    def _say(self, text: str) -> None:
        """Say why no run can start with this node."""
        self._said = text
        self.facts["lifecycle"] = self._phase.value
        self.not_ready(text, by_itself=self._starts_itself)

    def _refuse_impossible_transitions(self) -> None:
        """Answer a request for a transition that the present state does not have.

        rclpy up to Jazzy raises an exception from the callback instead, which ends the process.
        """
        for service in self.services:
            if service.srv_name.endswith("/change_state"):
                service.callback = self._refusing(service.callback)

    def _refusing(self, change: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        def answer(request: Any, response: Any) -> Any:
            try:
                return change(request, response)
            except RuntimeError:
                asked = request.transition.label or request.transition.id
                self.get_logger().error(
                    f"there is no transition {asked} from the state {self._phase.value}"
                )
                response.success = False
                return response

        return answer
