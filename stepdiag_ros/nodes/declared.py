"""A node whose parameters are those of ``stepdiag_ros/parameters/nodes.py``, no more and no fewer.

Wrong values are refused with the reason, in the same words at start, by ``ros2 param set`` and by
any other client. rclpy looks at read-only, type and range in words of its own before it asks a
callback, so that new values are judged here before rclpy sees them.
"""

from collections.abc import Callable
from typing import Any, ClassVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.parameters.declaration import (
    COMMON,
    HEARTBEAT_TIMEOUT,
    USE_SIM_TIME,
    Changeable,
    Declaration,
)
from stepdiag_ros.parameters.nodes import declared_node
from stepdiag_ros.text.sentence import sentence

CLIENT_PARAMETERS = ("start_type_description_service",)
"""Parameters of some ROS clients, which mean nothing to our nodes; they may be given to any."""

Take = Callable[[Any], None]
Prepare = Callable[[Any], Any]


def descriptor(declaration: Declaration) -> ParameterDescriptor:
    """Return what ``ros2 param describe`` is to say of a parameter."""
    unit = f" [{declaration.unit}]" if declaration.unit else ""
    constraints = f"can be set {declaration.change.value}"
    if declaration.choices:
        constraints = f"{declaration.limits}; {constraints}"
    made = ParameterDescriptor(
        description=f"{declaration.description}{unit}",
        read_only=declaration.change is Changeable.AT_START,
        additional_constraints=constraints,
    )
    low, high = declaration.low, declaration.high
    if low is not None and high is not None:
        if isinstance(declaration.default, float):
            made.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        else:
            made.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    return made


class DeclaringNode(Node):
    """A node with the parameters that are declared for its role.

    Args:
        name: default name of the node.

    Raises:
        ValueError: a given value is wrong, or the node has no parameter of a given name.
    """

    role: ClassVar[str] = ""
    run_id: str = ""
    run_over: bool = True

    def __init__(self, name: str) -> None:
        # Declared at first as they come, so that one that the node does not have is seen.
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        self._declared = declared_node(self.role)
        self._changes: dict[str, tuple[Take, Prepare]] = {}
        own = {one.name for one in (*COMMON, *self._declared.parameters)}
        self._of_client = {*self.get_parameters_by_prefix("")} - own
        for name in self._of_client.difference(CLIENT_PARAMETERS):
            # One that the client itself declares is described; one that was given to it is not.
            if not self.describe_parameter(name).description:
                raise Refusal(
                    self._declared.no_such(name, self.get_name()), fault="unknown", about=name
                )
        self._refuse_wrong(USE_SIM_TIME, self.get_parameter(USE_SIM_TIME.name).value)
        for declaration in (HEARTBEAT_TIMEOUT, *self._declared.parameters):
            self._declare(declaration)

    def parameter(self, name: str) -> Any:
        """Return the present value of a parameter that is declared for this node.

        Raises:
            ValueError: it is not.
        """
        return self.get_parameter(self._declared.find(name).name).value

    def on_change(
        self, name: str, take: Take = lambda _: None, prepare: Prepare = lambda value: value
    ) -> None:
        """Say what is to be done when a parameter is changed while the node runs.

        A node that reads ``parameter`` each time it needs the value has nothing to say.

        Args:
            name: of a parameter that may be changed.
            take: called with what ``prepare`` has returned, once all new values are accepted.
            prepare: called with the new value; a ValueError or OSError refuses it, in its words.

        Raises:
            ValueError: it is declared to be set at start only.
        """
        if self._declared.find(name).change is Changeable.AT_START:
            raise Refusal(
                f"parameter '{name}' of node {self.get_name()} is set at start only",
                fault="rejected",
                about=name,
            )
        self._changes[name] = (take, prepare)

    def device_is_open(self) -> bool:
        """Say whether a device is open that was opened with the present values."""
        return False

    def set_parameters(self, parameter_list: list[Parameter]) -> list[SetParametersResult]:
        """Set parameters one after the other, as rclpy does, and say of each why not."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set all of some parameters or none, and say why not; the parameter services call this."""
        taken: list[tuple[Take, Any]] = []
        try:
            for parameter in parameter_list:
                taken += self._judged(parameter)
        except (ValueError, OSError) as error:
            return SetParametersResult(successful=False, reason=sentence(error))
        result = super().set_parameters_atomically(parameter_list)
        if result.successful:
            for take, prepared in taken:
                take(prepared)
        return result

    def _judged(self, parameter: Parameter) -> list[tuple[Take, Any]]:
        """Return what is to be done with a new value; refuse it by a ValueError or OSError."""
        if parameter.name in self._of_client:
            return []
        try:
            declaration = self._declared.find(parameter.name)
        except ValueError:
            raise Refusal(
                self._declared.no_such(parameter.name, self.get_name()),
                fault="unknown",
                about=parameter.name,
            ) from None
        called = f"parameter '{parameter.name}' of node {self.get_name()}"
        if parameter.type_ is Parameter.Type.NOT_SET:
            raise ValueError(f"{called} cannot be deleted")
        if declaration.change is Changeable.AT_START:
            raise ValueError(
                f"{called} can be set at start only: restart the node with --ros-args -p"
                f" {parameter.name}:=VALUE"
            )
        self._refuse_wrong(declaration, parameter.value)
        # A device that has failed in a run must not go on in it with other settings.
        if declaration.change is not Changeable.ANY_TIME and not self.run_over:
            raise ValueError(
                f"{called} is set between runs only, and run {self.run_id} is going on:"
                " wait for its end or abort it"
            )
        if declaration.change is Changeable.WHILE_CLOSED and self.device_is_open():
            raise ValueError(
                f"{called} is set while the device is closed only: close it first, with"
                f" ros2 lifecycle set {self.get_fully_qualified_name()} deactivate, then cleanup"
            )
        if parameter.name not in self._changes:
            return []
        take, prepare = self._changes[parameter.name]
        return [(take, prepare(parameter.value))]

    def _declare(self, declaration: Declaration) -> None:
        name = declaration.name
        if self.has_parameter(name):
            self._refuse_wrong(declaration, self.get_parameter(name).value)
            self.undeclare_parameter(name)
        self.declare_parameter(name, declaration.default, descriptor(declaration))

    def _refuse_wrong(self, declaration: Declaration, value: object) -> None:
        if refusal := declaration.refusal(value):
            raise Refusal(
                f"parameter '{declaration.name}' of node {self.get_name()} is {refusal}",
                fault="out_of_range",
                about=declaration.name,
            )
