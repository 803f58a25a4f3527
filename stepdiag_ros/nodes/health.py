"""What a node publishes about itself on /diagnostics, and which nodes it receives there.

The form is that of ROS 2's diagnostic_updater: one array a node, one status for each of its tasks,
named ``node: task``. The task ``heartbeat`` is what the nodes of a run know each other by.
"""

import uuid
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from stepdiag_ros.nodes.links import Outlet
from stepdiag_ros.run.health import HealthFinding, Level
from stepdiag_ros.run.supervision import (
    GETTING_READY,
    HEARTBEAT,
    HEARTBEAT_PERIOD,
    MOST_PEERS,
    OPERATOR_ROLE,
    ROLE,
    RUN_ID,
    SESSION,
    START_PATIENCE,
    Peer,
    measure_together,
    peer_of,
)

TASK_PERIOD = 1.0
"""Real seconds after which every task is published again, whether it has changed or not."""
NO_HARDWARE = "none"
"""diagnostic_updater's identity of what is not a hardware."""


@dataclass
class _Task:
    name: str
    judge: Callable[[], HealthFinding]
    log: bool
    found: HealthFinding | None = None
    begun: bool = False


class Health:
    """Says what a node knows of itself.

    Args:
        node: that speaks.
        role: of the node in a run.
        publisher: on /diagnostics.
        real_time: s of a clock that never steps.
        run_id: of the run that the node works on.

    Attributes:
        facts: what else the heartbeat says, for example which stop a recorder has stored last.
        live_facts: the same, asked for at each heartbeat; an empty answer is left out.
        hardware_id: identity of the instrument or machine that the node drives.
    """

    def __init__(
        self,
        node: Node,
        role: str,
        publisher: Outlet,
        real_time: Callable[[], float],
        run_id: Callable[[], str],
    ) -> None:
        self._node = node
        self._role = role
        self._publisher = publisher
        self._real_time = real_time
        self._run_id = run_id
        self._session = uuid.uuid4().hex
        self._level, self._text = Level.OK, "ready"
        self._waiting = ""
        self._by_itself = False
        # Since when the node is ready, or gets ready.
        self._since = real_time()
        self._missed: list[str] = []
        self._tasks: list[_Task] = []
        self._told = -TASK_PERIOD
        # Sessions whose node was seen in the ROS graph.
        self._alive: set[str] = set()
        self.facts: dict[str, str] = {}
        self.live_facts: dict[str, Callable[[], str]] = {}
        self.hardware_id = NO_HARDWARE

    def add_task(self, name: str, judge: Callable[[], HealthFinding], log: bool = True) -> None:
        """Publish a subject of its own from now on.

        Args:
            name: of the subject.
            judge: is asked some times a second.
            log: what is not well goes to the log too; False where the node logs it by itself.
        """
        self._tasks.append(_Task(name, judge, log))

    # What is wrong with the node as a whole ------------------------------------------------------

    def say(self, level: Level, text: str) -> None:
        """Set the state of the node; a new state is published at once."""
        changed = bool(self._missed) or (level, text) != (self._level, self._text)
        self._level, self._text = level, text
        self._missed.clear()
        if changed:
            self.beat()

    def miss(self, text: str) -> None:
        """Say that another node has fallen silent, in the log and on /diagnostics."""
        self._node.get_logger().error(text)
        self._missed.append(text)
        self.beat()

    def miss_only(self, lost: Collection[str]) -> None:
        """No longer report nodes as silent that answer again (``lost``: all that do not)."""
        left = [text for text in self._missed if text in lost]
        changed, self._missed = left != self._missed, left
        if changed:
            self.beat()

    def unwell(self, text: str) -> None:
        """Say what is wrong, in the log and on /diagnostics."""
        if text != self._text:
            self._node.get_logger().error(text)
        self.say(Level.ERROR, text)

    def withdraw(self, text: str, instead: str) -> None:
        """Say that all is well again, if this is still what was wrong."""
        if text == self._text:
            self.say(Level.OK, instead)

    def not_ready(self, text: str, by_itself: bool = False) -> None:
        """Report what is still missing, until ``ready`` is called.

        Args:
            text: what is missing.
            by_itself: the node is about to get it without anybody's help: for ``START_PATIENCE``,
                it is getting ready.
        """
        changed = (text, by_itself) != (self._waiting, self._by_itself)
        if not self._waiting:
            self._since = self._real_time()
        self._waiting, self._by_itself = text, by_itself
        if changed:
            self.beat()

    def ready(self) -> None:
        """Say that nothing is missing any more; harmless when nothing was."""
        if self._waiting:
            self._waiting, self._since = "", self._real_time()
            self.look()
            self.beat()

    # What the tasks find -------------------------------------------------------------------------

    def look(self) -> None:
        """Judge all tasks. Publish changes at once; faults go to the log, too."""
        changed = False
        for task in self._tasks:
            found = task.judge()
            if not found.says(task.found):
                changed = True
                if task.log:
                    self._log(task, found)
            task.found = found
            task.begun |= found.level is not Level.STALE
        if changed:
            self._publish(True)

    def beat(self) -> None:
        """Publish the heartbeat, and what the tasks have found if that was not said lately."""
        self._publish(self._real_time() - self._told > TASK_PERIOD - 0.5 * HEARTBEAT_PERIOD)

    def _is_young(self) -> bool:
        """Say whether the node is getting ready by itself, or has only just become ready."""
        able = self._by_itself or not self._waiting
        return able and self._real_time() - self._since < START_PATIENCE

    def _is_starting(self, task: _Task) -> bool:
        """Say whether the subject of a task has not begun yet, and may still be about to."""
        found = task.found
        quiet = found is not None and found.level is Level.STALE and not found.forbids
        return quiet and not task.begun and self._is_young()

    def _log(self, task: _Task, found: HealthFinding) -> None:
        logger, text = self._node.get_logger(), f"{task.name}: {found.message}"
        # What has not begun yet is not news.
        before = task.found.level if task.found is not None else Level.STALE
        if found.level is Level.ERROR:
            logger.error(text)
        elif found.level is Level.WARN or (found.level is Level.STALE) > (before is Level.STALE):
            logger.warning(text)
        elif before in (Level.WARN, Level.ERROR):
            logger.info(text)

    def _publish(self, everything: bool) -> None:
        if not self._node.context.ok():
            return
        array = DiagnosticArray(status=[self._heartbeat()])
        if everything:
            self._told = self._real_time()
            array.status += [
                self._status(task.name, task.found, self._is_starting(task))
                for task in self._tasks
                if task.found
            ]
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)

    def _heartbeat(self) -> DiagnosticStatus:
        level, text = self._level, self._text
        if self._waiting:
            level, text = Level.ERROR, self._waiting
        elif level is not Level.ERROR:
            for task in self._tasks:
                if task.found is not None and task.found.forbids:
                    level, text = Level.ERROR, task.found.message
                    break
            else:
                if self._missed:
                    level, text = Level.WARN, self._missed[-1]
        values = {ROLE: self._role, RUN_ID: self._run_id(), SESSION: self._session, **self.facts}
        values.update({key: said for key, tell in self.live_facts.items() if (said := tell())})
        starting = bool(self._waiting) and self._is_young()
        return self._status(HEARTBEAT, HealthFinding(level, text, values), starting)

    def _status(self, task: str, found: HealthFinding, starting: bool) -> DiagnosticStatus:
        values = found.values | ({GETTING_READY: "yes"} if starting else {})
        return DiagnosticStatus(
            level=bytes((found.level,)),
            name=f"{self._node.get_fully_qualified_name().lstrip('/')}: {task}",
            message=found.message,
            hardware_id=self.hardware_id,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )

    # Whom it hears -------------------------------------------------------------------------------

    def peers_in(self, array: Any) -> list[tuple[str, Peer]]:
        """Return the heartbeats of other nodes in an array: full name of the node, what it says.

        Those of other cells are left out. Where time is simulated, a recording may be played, and
        the heartbeats in it are those of nodes that are long gone; they are left out too.
        """
        found = []
        for status in array.status:
            raw = status.level
            peer = peer_of(
                status.name,
                raw[0] if isinstance(raw, bytes) else int(raw),
                status.message,
                {entry.key: entry.value for entry in status.values},
                self._real_time(),
            )
            if peer is None or peer[1].session == self._session:
                continue
            simulated = self._is_simulated()
            clock_counts = simulated or self._role == OPERATOR_ROLE
            if not measure_together(self._node.get_namespace(), clock_counts, *peer):
                continue
            if not simulated or self._is_alive(*peer):
                found.append(peer)
        return found

    def _is_simulated(self) -> bool:
        return self._node.get_parameter("use_sim_time").value is True

    def _is_alive(self, name: str, peer: Peer) -> bool:
        """Say whether the ROS graph has the node that speaks, beside this one."""
        if peer.session not in self._alive:
            found = self._node.get_node_names_and_namespaces()
            names = [f"{namespace.rstrip('/')}/{node}" for node, namespace in found]
            if names.count(name) > (name == self._node.get_fully_qualified_name()):
                if len(self._alive) > MOST_PEERS:
                    self._alive.clear()
                self._alive.add(peer.session)
        return peer.session in self._alive
