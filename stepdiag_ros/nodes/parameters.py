"""Collects the parameters of all nodes, for the record, and follows their changes."""

from collections.abc import Collection
from typing import Any

from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.qos import qos_profile_parameter_events

PATIENCE = 5.0
"""Real seconds that a node has to answer before a run starts without its parameters."""
RETRY = 1.0
"""Real seconds after which a node is asked again: an answer that was sent before the two ends of a
service had found each other wholly is lost."""
GHOST = 30.0
"""Real seconds after which a process that was killed is no longer taken for there by any
middleware."""
CONFIRMED = 5.0
"""Real seconds after which a process that is there has confirmed a request, if busy. A client that
is destroyed before all have confirmed what it sent waits for that, up to a second, and the node
that destroys it is deaf meanwhile."""
VALUE_FIELDS = {
    1: "bool_value",
    2: "integer_value",
    3: "double_value",
    4: "string_value",
    5: "byte_array_value",
    6: "bool_array_value",
    7: "integer_array_value",
    8: "double_array_value",
    9: "string_array_value",
}
"""rcl_interfaces/msg/ParameterType → field of rcl_interfaces/msg/ParameterValue."""


def plain(value: Any) -> Any:
    """Return a ParameterValue as a plain Python value; None if it is not set."""
    field = VALUE_FIELDS.get(value.type)
    content = None if field is None else getattr(value, field)
    return content if isinstance(content, bool | int | float | str | None) else list(content)


class ParameterCollector:
    """Asks nodes for their parameters by the standard services, and follows changes.

    Args:
        node: that asks.

    Attributes:
        values: node name → parameter name → value, of all nodes that have answered.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._asked: dict[str, Any] = {}
        self._asked_last: dict[str, float] = {}
        self._sessions: dict[str, str] = {}
        self._revived: dict[str, float] = {}
        self._changed: dict[str, dict[str, Any]] = {}
        self.values: dict[str, dict[str, Any]] = {}
        node.create_subscription(
            ParameterEvent, "/parameter_events", self._on_event, qos_profile_parameter_events
        )

    def waiting(self, real: float) -> bool:
        """Say whether a node that was first asked less than ``PATIENCE`` ago has yet to answer.

        Args:
            real: time on a clock that never steps, s.
        """
        return any(
            name not in self.values and real - asked[0] < PATIENCE
            for name, asked in self._asked.items()
        )

    def ask(self, name: str, session: str, real: float) -> None:
        """Ask a node, once it can be reached; harmless when called again.

        Args:
            name: of the node, in full.
            session: of its process; one that was started again is asked again.
            real: time on a clock that never steps, s.
        """
        if self._sessions.get(name) != session:
            if name in self._sessions:
                self._revived[name] = real
            self._sessions[name] = session
            self.values.pop(name, None)
            self._changed.pop(name, None)
            self._asked_last.pop(name, None)
            if name in self._asked:
                self._asked[name] = (real, *self._asked[name][1:])
        if name in self.values:
            if (
                real - self._asked_last[name] >= CONFIRMED
                and real - self._revived.get(name, -GHOST) >= GHOST
            ):
                self._forget(name)
            return
        if real - self._asked_last.get(name, -RETRY) < RETRY:
            return
        if name not in self._asked:
            self._asked[name] = (
                real,
                self._node.create_client(ListParameters, f"{name}/list_parameters"),
                self._node.create_client(GetParameters, f"{name}/get_parameters"),
            )
        _, lister, getter = self._asked[name]
        if not (lister.service_is_ready() and getter.service_is_ready()):
            return
        self._asked_last[name] = real

        def listed(future: Any) -> None:
            if self._sessions.get(name) != session:
                return
            names = list(future.result().result.names)

            def got(answer: Any) -> None:
                if self._sessions.get(name) == session:
                    values = [plain(value) for value in answer.result().values]
                    # What was changed while the answer was on its way is newer, or the same.
                    changed = self._changed.get(name, {})
                    self.values[name] = {**dict(zip(names, values, strict=True)), **changed}

            getter.call_async(GetParameters.Request(names=names)).add_done_callback(got)

        lister.call_async(ListParameters.Request()).add_done_callback(listed)

    def forget_all_but(self, names: Collection[str]) -> None:
        """Forget nodes that no longer answer, and the requests to them."""
        for name in self._sessions.keys() - names:
            self._forget(name)
            for kept in (self._sessions, self._asked_last, self._revived, self._changed):
                kept.pop(name, None)
            self.values.pop(name, None)

    def _on_event(self, event: Any) -> None:
        if event.node not in self._sessions:
            return  # what it has changed by now is part of its answer when it is asked
        changed = {each.name: plain(each.value) for each in event.changed_parameters}
        self._changed.setdefault(event.node, {}).update(changed)
        if event.node in self.values:
            self.values[event.node].update(changed)

    def _forget(self, name: str) -> None:
        """Let go of the clients of a node that has answered; each would cost time in every wait."""
        if name in self._asked:
            _, *clients = self._asked.pop(name)
            for client in clients:
                self._node.destroy_client(client)
