"""A node's parameters: declaring, checking and setting them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import (
    ListParametersResult,
    ParameterDescriptor,
    ParameterEvent,
    ParameterValue,
    SetParametersResult,
)

from rclpy.exceptions import (
    InvalidParameterException,
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterAlreadyDeclaredException,
    ParameterImmutableException,
    ParameterNotDeclaredException,
    ParameterUninitializedException,
)
from rclpy.parameter import PARAMETER_SEPARATOR_STRING, Parameter, parameter_value_to_python

if TYPE_CHECKING:
    from rclpy.node import Node

_NOT_SET = Parameter.Type.NOT_SET
_WRONG_TYPE = "Wrong parameter type"
#: Relative difference up to which a double counts as equal to a bound or step.
PARAM_REL_TOL = 1e-6

OnSet = Callable[[list[Parameter]], Any]


class ParameterStore:
    """The parameters of one node."""

    def __init__(self, node: Node, overrides: dict[str, Parameter], allow_undeclared: bool) -> None:
        self._node = node
        self.overrides = overrides
        self.allow_undeclared = allow_undeclared
        self.values: dict[str, Parameter] = {}
        self.descriptors: dict[str, Any] = {}
        self.before: list[Callable[[list[Parameter]], list[Parameter]]] = []
        self.checks: list[OnSet] = []
        self.after: list[Callable[[list[Parameter]], None]] = []
        #: Publishes changes, once the node has its publisher.
        self.publish: Callable[[Any], None] | None = None

    def declare(
        self, namespace: str, entries: Iterable[tuple[Any, ...]], ignore_override: bool
    ) -> list[Parameter]:
        """Declare parameters from tuples of name, default or type, and descriptor."""
        wanted: list[tuple[Parameter, Any]] = []
        for index, entry in enumerate(entries):
            if not 1 <= len(entry) <= 3:
                raise TypeError(
                    f"Invalid parameter tuple length at index {index} in parameters list: {entry};"
                    " expecting length between 1 and 3"
                )
            wanted.append(self._declaration(namespace, index, *entry, ignore=ignore_override))
        known = [parameter.name for parameter, _ in wanted if parameter.name in self.values]
        if known:
            raise ParameterAlreadyDeclaredException(known)
        for parameter, descriptor in wanted:
            result = self._set_together([parameter], {parameter.name: descriptor}, keep_unset=True)
            if result.successful:
                continue
            if result.reason.startswith(_WRONG_TYPE):
                expected = Parameter.Type(descriptor.type).name
                raise InvalidParameterTypeException(parameter, expected)
            raise InvalidParameterValueException(parameter.name, parameter.value, result.reason)
        return [self.values[parameter.name] for parameter, _ in wanted]

    def _declaration(
        self,
        namespace: str,
        index: int,
        name: Any,
        default: Any = None,
        descriptor: Any = None,
        *,
        ignore: bool,
    ) -> tuple[Parameter, Any]:
        if not isinstance(name, str):
            raise TypeError(
                f"First element {name} at index {index} in parameters list is not a str."
            )
        name = f"{namespace}.{name}" if namespace else name
        if not name:
            raise InvalidParameterException(name)
        descriptor = ParameterDescriptor() if descriptor is None else descriptor
        if not isinstance(descriptor, ParameterDescriptor):
            raise TypeError(
                f"Third element {descriptor} at index {index} in parameters list"
                " is not a ParameterDescriptor."
            )
        if isinstance(default, ParameterValue):
            default = parameter_value_to_python(default)
        value = default
        if isinstance(default, Parameter.Type):
            if default is _NOT_SET:
                raise ValueError(
                    f"Cannot declare parameter {{{name}}} as statically typed of type NOT_SET"
                )
            if descriptor.dynamic_typing:
                raise ValueError(
                    f"When declaring parameter {{{name}}} passing a descriptor with"
                    "`dynamic_typing=True` is not allowed when the parameter type is provided"
                )
            descriptor.type = default.value
            value = None
        elif not descriptor.dynamic_typing:
            descriptor.type = Parameter.Type.from_parameter_value(default).value
            if default is None:
                raise ValueError(
                    "Cannot declare a statically typed parameter with default value"
                    f" of type PARAMETER_NOT_SET: {name}"
                )
        if not ignore and name in self.overrides:
            value = self.overrides[name].value
            if value == [] and descriptor.type > Parameter.Type.STRING.value:
                # YAML cannot say of what an empty list is a list.
                return Parameter(name, Parameter.Type(descriptor.type), value), descriptor
        return Parameter(name, value=value), descriptor

    def undeclare(self, name: str) -> None:
        """Remove a parameter."""
        if name not in self.values:
            raise ParameterNotDeclaredException(name)
        if self.descriptors[name].read_only:
            raise ParameterImmutableException(name)
        del self.values[name]
        del self.descriptors[name]

    def get(self, name: str) -> Parameter:
        """Return a parameter that is declared and has a value."""
        if name not in self.values:
            if self.allow_undeclared:
                return Parameter(name, _NOT_SET, None)
            raise ParameterNotDeclaredException(name)
        found = self.values[name]
        if found.type_ is _NOT_SET and not self.descriptors[name].dynamic_typing:
            raise ParameterUninitializedException(name)
        return found

    def describe(self, name: str) -> Any:
        """Return the descriptor of a parameter."""
        if name in self.descriptors:
            return self.descriptors[name]
        if self.allow_undeclared:
            return ParameterDescriptor(name=name)
        raise ParameterNotDeclaredException(name)

    def set_each(self, parameters: list[Parameter]) -> list[Any]:
        """Set parameters one after the other; return a result for each."""
        results = []
        for parameter in parameters:
            results.append(self.set_together([parameter]))
        return results

    def set_together(self, parameters: list[Parameter]) -> Any:
        """Set all parameters or none."""
        for callback in self.before:
            parameters = callback(parameters)
        if self.before and not parameters:
            return SetParametersResult(
                successful=False,
                reason="parameter list cannot be empty, this might be due to "
                "pre_set_parameters_callback modifying the original parameters list.",
            )
        if not all(isinstance(parameter, Parameter) for parameter in parameters):
            raise TypeError(f"parameter must be instance of type '{Parameter!r}'")
        undeclared = [p.name for p in parameters if p.name not in self.values]
        if undeclared and not self.allow_undeclared:
            raise ParameterNotDeclaredException(undeclared)
        return self._set_together(parameters, None, keep_unset=False)

    def _set_together(
        self, parameters: list[Parameter], descriptors: dict[str, Any] | None, *, keep_unset: bool
    ) -> Any:
        for parameter in parameters:
            descriptor = (self.descriptors if descriptors is None else descriptors).get(
                parameter.name
            )
            if descriptor is not None:
                reason = self._refuse(parameter, descriptor, descriptors is None)
                if reason:
                    return SetParametersResult(successful=False, reason=reason)
        for check in list(self.checks):
            result = check(parameters)
            if not result.successful:
                return result
        event = ParameterEvent(node=self._node.get_fully_qualified_name())
        for parameter in parameters:
            name = parameter.name
            if parameter.type_ is _NOT_SET and not keep_unset:
                event.deleted_parameters.append(parameter.to_parameter_msg())
                self.values.pop(name, None)
                self.descriptors.pop(name, None)
                continue
            if descriptors is not None:
                self.descriptors[name] = descriptors[name]
            elif name not in self.descriptors:
                self.descriptors[name] = ParameterDescriptor(
                    name=name, dynamic_typing=True, type=parameter.type_.value
                )
            before = self.values.get(name)
            is_new = before is None or before.type_ is _NOT_SET
            changes = event.new_parameters if is_new else event.changed_parameters
            changes.append(parameter.to_parameter_msg())
            self.values[name] = parameter
        if self.publish is not None:
            event.stamp = self._node.get_clock().now().to_msg()
            self.publish(event)
        for callback in list(self.after):
            callback(parameters)
        return SetParametersResult(successful=True)

    def _refuse(self, parameter: Parameter, descriptor: Any, check_read_only: bool) -> str:
        """Return why a parameter cannot be set, or ``""``."""
        descriptor.name = parameter.name
        if check_read_only and descriptor.read_only:
            return f"Trying to set a read-only parameter: {parameter.name}."
        if descriptor.dynamic_typing:
            descriptor.type = parameter.type_.value
        elif parameter.type_ is _NOT_SET:
            if parameter.name in self.values:
                return "Static parameter cannot be undeclared"
        elif parameter.type_.value != descriptor.type:
            expected = Parameter.Type(descriptor.type)
            return f"{_WRONG_TYPE}, expected '{expected}' got '{parameter.type_}'"
        if parameter.type_ is Parameter.Type.INTEGER and descriptor.integer_range:
            return _outside_integers(parameter, descriptor.integer_range[0])
        if parameter.type_ is Parameter.Type.DOUBLE and descriptor.floating_point_range:
            return _outside_doubles(parameter, descriptor.floating_point_range[0])
        return ""

    def list(self, prefixes: list[str], depth: int) -> Any:
        """Return the names of parameters under prefixes, down to a depth (0: all)."""
        result = ListParametersResult()
        dot = PARAMETER_SEPARATOR_STRING
        for name in self.values:
            rests = [name] if not prefixes else []
            for prefix in prefixes:
                if name == prefix:
                    rests.append("")
                elif name.startswith(prefix + dot):
                    rests.append(name[len(prefix) + 1 :])
            if not any(depth == 0 or rest.count(dot) < depth for rest in rests):
                continue
            result.names.append(name)
            parent = name.rpartition(dot)[0]
            if parent and parent not in result.prefixes:
                result.prefixes.append(parent)
        return result


def _outside_integers(parameter: Parameter, bounds: Any) -> str:
    low, high = sorted((bounds.from_value, bounds.to_value))
    value, step = parameter.value, bounds.step
    if value in (low, high):
        return ""
    if not low < value < high:
        return f"Parameter {parameter.name} out of range. Min: {low}, Max: {high}, value: {value}"
    if step and (value - low) % step:
        return (
            f"The parameter value for {parameter.name} is not a valid step. "
            f"Min: {low}, max: {high}, value: {value}, step: {step}"
        )
    return ""


def _outside_doubles(parameter: Parameter, bounds: Any) -> str:
    low, high = sorted((bounds.from_value, bounds.to_value))
    value, step = parameter.value, bounds.step
    if any(math.isclose(value, bound, rel_tol=PARAM_REL_TOL) for bound in (low, high)):
        return ""
    if not low < value < high:
        return f"Parameter {parameter.name} out of range Min: {low}, Max: {high}, value: {value}"
    if step:
        nearest = low + round((value - low) / step) * step
        if not math.isclose(nearest, value, rel_tol=PARAM_REL_TOL):
            return (
                f"The parameter value for {parameter.name} is not close enough to a valid step. "
                f"Min: {low}, max: {high}, value: {value}, step: {step}"
            )
    return ""
