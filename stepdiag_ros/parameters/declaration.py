"""What a parameter of a node is: name, default, meaning, unit, range, and when it may be set.

Plain data, no ROS client. Says in words why a value cannot be a parameter's.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.spelling import nearest, suggestion
from stepdiag_ros.metrology.units import IN_MICRO

Value = bool | int | float | str
"""What a parameter may be."""

_SMALL_LENGTH = 1e-3
"""m; a person states it in micrometres."""
_KINDS: dict[type, str] = {bool: "true or false", int: "a whole number", str: "a text"}


class Changeable(Enum):
    """When a parameter may be changed; the value says it in words."""

    AT_START = "at start only"
    WHILE_CLOSED = "while the device is closed"
    BETWEEN_RUNS = "between runs"
    ANY_TIME = "at any time"


@dataclass(frozen=True)
class Declaration:
    """One parameter of a node.

    Attributes:
        name: of the parameter.
        default: its value where none is given; says the type too.
        description: what it means; a phrase without a full stop.
        unit: of the value and the range, such as ``s``; empty if it has none.
        low: least allowed number, itself allowed; None for a text or a truth value.
        high: greatest allowed number, itself allowed; None for a text or a truth value.
        choices: the only texts allowed, or what returns them, which is called when they are asked
            for; empty if any is.
        change: when it may be changed.
        example: a usual value where the default is zero.

    Raises:
        ValueError: the declaration contradicts itself.
    """

    name: str
    default: Value
    description: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] | Callable[[], tuple[str, ...]] = ()
    change: Changeable = Changeable.AT_START
    example: float = 0.0

    def __post_init__(self) -> None:
        ranged = type(self.default) in (int, float)
        if ranged is (self.low is None) or ranged is (self.high is None):
            raise Refusal(
                f"parameter '{self.name}': a number, and no other, has a range", fault="mismatch"
            )
        if not callable(self.choices) and (refusal := self.refusal(self.default)):
            raise Refusal(f"the default of parameter '{self.name}' is {refusal}", fault="malformed")

    @property
    def allowed(self) -> tuple[str, ...]:
        """Return the only texts allowed; empty if any is."""
        return self.choices() if callable(self.choices) else self.choices

    @property
    def type_name(self) -> str:
        """Return the type as ``ros2 param describe`` names it."""
        return {bool: "boolean", int: "integer", float: "double", str: "string"}[type(self.default)]

    @property
    def limits(self) -> str:
        """Return range or choices in words, without the unit; empty if there are none."""
        if allowed := self.allowed:
            return f"{', '.join(allowed[:-1])} or {allowed[-1]}"
        if self.low is None or self.high is None:
            return ""
        if isinstance(self.default, int):
            return f"{int(self.low)} to {int(self.high)}"
        return f"{self.low:.15g} to {self.high:.15g}"

    @property
    def expected(self) -> str:
        """Return in words what may be given."""
        if self.choices:
            return self.limits
        unit = f" {self.unit}" if self.unit else ""
        if isinstance(self.default, float) and self.high is not None:
            # The default may be zero, which many take for "none".
            usual = self.example or self.default or self.high
            small = self.unit == "m" and usual < _SMALL_LENGTH
            example = written(usual) + (f" ({usual * IN_MICRO:g} µm)" if small else "")
            return f"a number with a point, such as {example}, from {self.limits}{unit}"
        kind = _KINDS[type(self.default)]
        return f"{kind} from {self.limits}{unit}" if self.limits else kind

    def refusal(self, value: object) -> str:
        """Say why a value cannot be the parameter's; empty if it can.

        Returns:
            the value and what is expected, to be put behind "parameter 'NAME' is".
        """
        if type(value) is not type(self.default):
            return f"{value!r}; expected {self.expected}{self._hint(value)}"
        allowed = value in self.allowed if self.choices else True
        if isinstance(value, int | float) and self.low is not None and self.high is not None:
            # NaN is neither within nor without.
            allowed = self.low <= value <= self.high
        return "" if allowed else f"{value!r}; expected {self.expected}{self._near(value)}"

    def _hint(self, value: object) -> str:
        """Say how to write a value that is meant well but is of another type."""
        if isinstance(self.default, float):
            number = _number(value)
            if number is not None and not self.refusal(number):
                return f"; write {written(number)}"
        elif isinstance(self.default, str) and isinstance(value, int | float):
            # YAML reads these words without quotes as true and false.
            words = {"True": ("on", "yes"), "False": ("off", "no")}.get(str(value), ())
            meant = next((word for word in words if word in self.allowed), written(value))
            return f'; if a text is meant, put it in quotes: "{written(meant)}"'
        elif isinstance(self.default, int) and not isinstance(self.default, bool):
            number = _number(value)
            if number is not None and number.is_integer() and not self.refusal(int(number)):
                return f"; write {int(number)}"
        return ""

    def _near(self, value: object) -> str:
        near = nearest(value, self.allowed)
        return f"; {suggestion(near)}" if near else ""


def _number(value: object) -> float | None:
    """Return the number that an integer, a double or a text such as '1e5' stands for."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def written(value: object) -> str:
    """Return a value as it is written in YAML, in any parameter file or on a command line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    mantissa, exponent, power = repr(value).partition("e")
    # Many YAML readers take 1e-05 for a text.
    return f"{mantissa}.0e{power}" if exponent and "." not in mantissa else repr(value)


USE_SIM_TIME = Declaration(
    "use_sim_time", False, "take the time from the topic /clock instead of the computer's clock"
)
"""Declared by every ROS client for every node."""
HEARTBEAT_TIMEOUT = Declaration(
    "heartbeat_timeout",
    2.0,
    "real time without a heartbeat after which another node counts as lost; what nodes may take"
    " to answer grows in proportion",
    "s",
    1.0,
    60.0,
)
COMMON = (USE_SIM_TIME, HEARTBEAT_TIMEOUT)
"""Parameters of every node."""


@dataclass(frozen=True)
class DeclaredNode:
    """A node and its parameters.

    Attributes:
        module: in ``stepdiag_ros.nodes``, and the name of its executable.
        name: that the node has in the graph unless it is renamed; its role too.
        purpose: what it does, in a phrase.
        parameters: its own, in the order of their declaration.
    """

    module: str
    name: str
    purpose: str
    parameters: tuple[Declaration, ...] = ()

    def find(self, name: str) -> Declaration:
        """Return the declaration of a parameter.

        Raises:
            ValueError: the node has no such parameter; names one that is near, or all.
        """
        for declaration in (*self.parameters, *COMMON):
            if declaration.name == name:
                return declaration
        raise Refusal(self.no_such(name, self.name), fault="unknown", about=name)

    def no_such(self, name: str, node: str) -> str:
        """Say that the node, by the name it has now, has no parameter of that name."""
        own = [declaration.name for declaration in (*self.parameters, *COMMON)]
        near = nearest(name, own)
        hint = suggestion(near, f"it has {', '.join(sorted(own))}")
        return f"node {node} has no parameter '{name}'; {hint}"

    def check(self, name: str, value: object) -> None:
        """Refuse a value, or a name, that the node would refuse when it is started.

        Raises:
            ValueError: says what is expected.
        """
        if refusal := self.find(name).refusal(value):
            raise Refusal(
                f"parameter '{name}' of node {self.name} is {refusal}",
                fault="out_of_range",
                about=name,
            )
