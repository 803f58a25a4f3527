"""What all nodes share: topics, parameters, heartbeat, the watch on the other nodes."""

import os
import signal
import sys
import time
from collections.abc import Callable
from math import inf
from typing import Any, ClassVar, NamedTuple

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.utilities import remove_ros_args
from std_srvs.srv import Trigger

from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.nodes.declared import DeclaringNode
from stepdiag_ros.nodes.health import Health
from stepdiag_ros.nodes.links import LinkedNode
from stepdiag_ros.run.health import Clockwork, HealthFinding, Level, SetBack
from stepdiag_ros.run.supervision import (
    BYSTANDERS,
    HEARTBEAT_PERIOD,
    HELD,
    MISSES,
    REFUSES,
    TIME_SOURCE,
    Peer,
    Watch,
)
from stepdiag_ros.text.sentence import PREFIX, sentence
from stepdiag_ros.topics import DIAGNOSTICS, RUN_DESCRIPTION, RUN_STATE

HOLDS = 2.0
"""Real seconds for which a node that cannot take up a run is at fault, though another is led."""
_SIGNAL_TAKES = 0.5
"""Real seconds, at most, from a signal to the end of the context, which another thread ends."""


class _Refused(NamedTuple):
    run_id: str
    since: float
    why: str


class StepdiagNode(DeclaringNode, LinkedNode):
    """A node of the suite: says that it is alive, listens who else is, reports faults in words.

    Args:
        name: default name of the node.
    """

    role: ClassVar[str] = ""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.run_id = ""
        self.run_over = True
        self._refused: _Refused | None = None
        self._twin_heard = inf
        self._unusable, self._unusable_heard = "", inf
        self.watch = Watch(self.parameter("heartbeat_timeout"))
        speaker = self.announce(DIAGNOSTICS)
        self.health = Health(self, self.role, speaker, self.real_time, lambda: self.run_id)
        self.facts = self.health.facts
        self._clockwork = Clockwork(simulated=bool(self.get_parameter("use_sim_time").value))
        self.facts[TIME_SOURCE] = self._clockwork.source
        self._set_back = SetBack()
        self.health.live_facts[MISSES] = lambda: self.watch.missed
        self.health.add_task("clock", self._judge_clock)
        self.health.add_task("links", self._judge_links)
        self.listen(DIAGNOSTICS, self._on_diagnostics)
        self.every(HEARTBEAT_PERIOD, self.beat, real=True)
        self.every(HEARTBEAT_PERIOD / 2, self._look_around, real=True)

    def namespaces_with(self, name: str) -> str:
        """Name the namespaces that hold a node of this name, for a caller in another namespace.

        Returns:
            a clause for the end of a sentence; empty if no namespace has one.
        """
        found = {space for node, space in self.get_node_names_and_namespaces() if node == name}
        return f"; there is a {name} in the namespace {', '.join(sorted(found))}" if found else ""

    def clock_set_back(self) -> str:
        """Say that the clock of the computer was set back since the last look; empty if not."""
        back = 0.0 if self._is_simulated() else self._set_back.look(self.now())
        return f"the clock of this computer was set back by {back:.1f} s" if back else ""

    # Services ------------------------------------------------------------------------------------

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

    # Health --------------------------------------------------------------------------------------

    def healthy(self, text: str) -> None:
        """Say that all is well; others see it at once."""
        self.health.say(Level.OK, text)

    def not_ready(self, text: str, by_itself: bool = False) -> None:
        """Say what is still missing; no run starts until ``ready`` is called.

        Args:
            text: what is missing.
            by_itself: the node is about to get it without anybody's help.
        """
        self.health.not_ready(text, by_itself)

    def ready(self) -> None:
        """Say that nothing is missing any more; harmless when nothing was."""
        self.health.ready()

    def unwell(self, text: str) -> None:
        """Say what is wrong, in the log and on /diagnostics."""
        self.health.unwell(text)

    def on_unusable(self, topic: str, error: ValueError) -> None:
        """Say that a message makes no sense: of many that come one after another, the first."""
        self._unusable_heard = self.real_time()
        if not self._unusable:
            self._unusable = f"a message on {topic} cannot be used: {sentence(error)}"
            self.unwell(self._unusable)

    def beat(self) -> None:
        """Publish the heartbeat: role, health, run and process identity."""
        self.health.beat()

    def on_heartbeat(self, peer: Peer) -> None:
        """Called with each heartbeat of another node."""

    def on_peer_lost(self, text: str) -> None:
        """Called when a node has fallen silent while a run is going on."""
        self.health.miss(text)

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
        self.forget_results()
        try:
            self.on_run(description)
        except ValueError as error:
            self.facts[REFUSES] = f"{description.run_id} {error}"
            why = f"cannot take part in run {description.run_id}: {error}"
            self._refused = _Refused(description.run_id, self.real_time(), why)
            self.unwell(why)
            return
        self._refused = None
        self.run_id = description.run_id
        self.run_over = False
        self.healthy(f"run {self.run_id}")

    def _on_run_state(self, state: Any) -> None:
        ended = state.state in (state.STATE_FINISHED, state.STATE_ABORTED)
        self._forgive(state.run_id, ended)
        if ended and state.run_id == self.run_id and not self.run_over:
            self.run_over = True
            self.healthy(f"ready; run {self.run_id} has ended")
            self.on_run_end()
        self.on_run_state(state)

    def _forgive(self, run_id: str, ended: bool) -> None:
        """Report OK again when there is no longer a run that could not be taken up."""
        if self._refused is None:
            return
        refused = self._refused
        # The state of the run before may still come after the description of the next.
        over = ended if run_id == refused.run_id else self.real_time() > refused.since + HOLDS
        if over:
            self._refused = None
            self.health.withdraw(refused.why, f"ready; run {refused.run_id} was not taken up")

    def _judge_clock(self) -> HealthFinding:
        return self._clockwork.judge(self.now(), self.real_time())

    def _judge_links(self) -> HealthFinding:
        troubles = self.link_troubles
        if troubles:
            return HealthFinding(Level.WARN, "; ".join(troubles))
        return HealthFinding(Level.OK, "every topic has ends that understand each other")

    def _on_diagnostics(self, array: Any) -> None:
        for name, peer in self.health.peers_in(array):
            if name == self.get_fully_qualified_name():
                self._twin_heard = self.real_time()
                self.unwell(self._twin_words)
                continue
            self.watch.heard(name, peer)
            # Only data are laid side by side, and commands and views have none.
            if BYSTANDERS.isdisjoint((self.role, peer.role)):
                source, stamp = peer.facts.get(TIME_SOURCE, ""), to_nanoseconds(array.header.stamp)
                self._clockwork.hear(name, source, stamp, self.now())
            self.on_heartbeat(peer)

    @property
    def _twin_words(self) -> str:
        name = self.get_fully_qualified_name()
        return f"two nodes are named {name}: end one of them or rename it"

    def _look_around(self) -> None:
        now = "ready" if self.run_over else f"run {self.run_id}"
        if self.real_time() > self._twin_heard + self.watch.silence_limit:
            self._twin_heard = inf
            self.health.withdraw(self._twin_words, now)
        if self.real_time() > self._unusable_heard + HOLDS:
            self._unusable_heard = inf
            self.health.withdraw(self._unusable, now)
            self._unusable = ""
        for text in self.watch.check(self.real_time()):
            if not self.run_over:
                self.on_peer_lost(text)
        self._clockwork.forget(self.watch.lost)
        self.health.miss_only(self.watch.lost.values())
        self.health.look()


def spin(node_class: Callable[[], StepdiagNode]) -> int:
    """Run a node until it is asked to end; return the exit code of the process.

    A node that cannot start says why in one sentence. Signals are ignored afterwards.
    """
    node = executor = None
    begun = False
    try:
        _begin()
        begun = True
        # Before the node: nothing may be made for a context that has been ended meanwhile.
        executor = SingleThreadedExecutor()
        node = node_class()
        rclpy.spin(node, executor)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except Exception as error:
        told_to_end = begun and _is_told_to_end()
        if node is None and not told_to_end:
            # RuntimeError is what the middleware raises, for example about ROS_DOMAIN_ID.
            if isinstance(error, (ValueError, OSError, RuntimeError, NameValidationException)):
                return _refuse(error)
            raise
        # What is made after the process was told to end cannot be a part of the graph any more,
        # and a callback that was at work then can publish no more.
        if node is not None and not (told_to_end and isinstance(error, RuntimeError)):
            raise
    finally:
        _ignore_signals()
        if node is not None:
            node.close()
            node.destroy_node()
        if executor is not None:
            executor.shutdown()
        rclpy.try_shutdown()
        # The client library has given the signals back.
        _ignore_signals()
    return 0


def _is_told_to_end() -> bool:
    """Say whether a signal has come; what it has interrupted may fail before the context ends."""
    until = time.monotonic() + _SIGNAL_TAKES
    while rclpy.ok() and time.monotonic() < until:
        time.sleep(0.01)
    return not rclpy.ok()


def _ignore_signals() -> None:
    """Let nothing cut short what stops the machine and closes the bag, to the end of the process.

    Ctrl-C reaches the nodes of ``ros2 launch`` twice: from the terminal, and from launch itself.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


def _begin() -> None:
    left = remove_ros_args(sys.argv)[1:]
    if left:
        raise ValueError(f"'{' '.join(left)}' is not understood; parameters go behind --ros-args")
    if os.environ.pop(HELD, ""):
        # Until whoever has started this process closes the pipe.
        sys.stdin.read()
    rclpy.init()


def _refuse(error: Exception) -> int:
    print(f"{PREFIX}{sentence(error)}", file=sys.stderr)
    return 1
