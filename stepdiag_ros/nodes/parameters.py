"""Collects the parameters of all nodes, for the record."""

from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node

PATIENCE = 5.0
"""Real seconds that a node has to answer before a run starts without its parameters."""
RETRY = 1.0
"""Real seconds after which a node is asked again: an answer that was sent before the two ends of a
service had found each other wholly is lost."""
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
    """Asks nodes for their parameters by the standard services.

    Args:
        node: that asks.

    Attributes:
        values: node name → parameter name → value, of all nodes that have answered.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._asked: dict[str, Any] = {}
        self._asked_last: dict[str, float] = {}
        self.values: dict[str, dict[str, Any]] = {}

    def waiting(self, real: float) -> bool:
        """Say whether a node that was first asked less than ``PATIENCE`` ago has yet to answer.

        Args:
            real: time on a clock that never steps, s.
        """
        return any(
            name not in self.values and real - asked[0] < PATIENCE
            for name, asked in self._asked.items()
        )

    def ask(self, name: str, real: float) -> None:
        """Ask a node, once it can be reached; harmless when called again.

        Args:
            name: of the node, in full.
            real: time on a clock that never steps, s.
        """
        if name in self.values:
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
            names = list(future.result().result.names)

            def got(answer: Any) -> None:
                values = [plain(value) for value in answer.result().values]
                self.values[name] = dict(zip(names, values, strict=True))

            getter.call_async(GetParameters.Request(names=names)).add_done_callback(got)

        lister.call_async(ListParameters.Request()).add_done_callback(listed)

    def _forget(self, name: str) -> None:
        """Let go of the clients of a node that has answered; each would cost time in every wait."""
        if name in self._asked:
            _, *clients = self._asked.pop(name)
            for client in clients:
                self._node.destroy_client(client)
