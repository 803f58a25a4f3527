"""The part of a node that deals with parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy._parameters import OnSet, ParameterStore
from rclpy.parameter import PARAMETER_SEPARATOR_STRING, Parameter, ParameterKind


class NodeParameters:
    """Declaring, reading and setting parameters."""

    _parameters: ParameterStore

    def declare_parameter(
        self,
        name: str,
        value: Any = None,
        descriptor: Any = None,
        ignore_override: bool = False,
    ) -> Parameter:
        """Declare a parameter and return it with its value.

        Args:
            name: The name.
            value: The default, or a :class:`rclpy.parameter.Parameter.Type` without a default.
            descriptor: Range, description and read-only flag.
            ignore_override: Whether a value from the command line is left out of account.

        Raises:
            rclpy.exceptions.ParameterAlreadyDeclaredException: It is declared already.
            rclpy.exceptions.InvalidParameterTypeException: The given value has another type.
            rclpy.exceptions.InvalidParameterValueException: The value is out of range or refused.
        """
        entry = (name, value) if descriptor is None else (name, value, descriptor)
        return self._parameters.declare("", [entry], ignore_override)[0]

    def declare_parameters(
        self, namespace: str, parameters: Sequence[tuple[Any, ...]], ignore_override: bool = False
    ) -> list[Parameter]:
        """Declare parameters, given as name, default and descriptor, under a common prefix."""
        return self._parameters.declare(namespace, parameters, ignore_override)

    def undeclare_parameter(self, name: str) -> None:
        """Remove a parameter.

        Raises:
            rclpy.exceptions.ParameterNotDeclaredException: It is not declared.
            rclpy.exceptions.ParameterImmutableException: It is read-only.
        """
        self._parameters.undeclare(name)

    def has_parameter(self, name: str) -> bool:
        """Return whether a parameter is declared."""
        return name in self._parameters.values

    def get_parameter(self, name: str) -> Parameter:
        """Return a parameter.

        Raises:
            rclpy.exceptions.ParameterNotDeclaredException: It is not declared.
            rclpy.exceptions.ParameterUninitializedException: It has no value.
        """
        return self._parameters.get(name)

    def get_parameters(self, names: list[str]) -> list[Parameter]:
        """Return parameters by their names."""
        if not all(isinstance(name, str) for name in names):
            raise TypeError("All names must be instances of type str")
        return [self.get_parameter(name) for name in names]

    def get_parameter_or(self, name: str, alternative_value: Parameter | None = None) -> Parameter:
        """Return a parameter, or another one if it is not declared or has no value."""
        found = self._parameters.values.get(name)
        if found is not None and found.type_ is not Parameter.Type.NOT_SET:
            return found
        if alternative_value is not None:
            return alternative_value
        return Parameter(name, Parameter.Type.NOT_SET, None)

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Parameter]:
        """Return the parameters under a prefix, by their names without it."""
        start = f"{prefix}{PARAMETER_SEPARATOR_STRING}" if prefix else ""
        return {
            name[len(start) :]: parameter
            for name, parameter in self._parameters.values.items()
            if name.startswith(start)
        }

    def get_parameter_type(self, name: str) -> ParameterKind:
        """Return a parameter's type."""
        return self.get_parameter(name).type_

    def get_parameter_types(self, names: list[str]) -> list[ParameterKind]:
        """Return the types of parameters."""
        return [self.get_parameter_type(name) for name in names]

    def set_parameters(self, parameter_list: list[Parameter]) -> list[Any]:
        """Set parameters one after the other; return a result for each.

        Raises:
            rclpy.exceptions.ParameterNotDeclaredException: One is not declared.
        """
        return self._parameters.set_each(parameter_list)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        """Set all parameters or none; return the result.

        Raises:
            rclpy.exceptions.ParameterNotDeclaredException: One is not declared.
        """
        return self._parameters.set_together(parameter_list)

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        """Return the names of the parameters under prefixes, down to a depth (0: all)."""
        if not isinstance(prefixes, list) or not all(isinstance(item, str) for item in prefixes):
            raise TypeError("The prefixes argument must be a list of str")
        if depth < 0:
            raise ValueError("The depth must be greater than or equal to zero")
        return self._parameters.list(prefixes, depth)

    def describe_parameter(self, name: str) -> Any:
        """Return a parameter's descriptor."""
        return self._parameters.describe(name)

    def describe_parameters(self, names: list[str]) -> list[Any]:
        """Return the descriptors of parameters."""
        return [self.describe_parameter(name) for name in names]

    def set_descriptor(self, name: str, descriptor: Any, alternative_value: Any = None) -> Any:
        """Raise: changing a descriptor after its declaration is not supported."""
        raise NotImplementedError(
            "The embedded ROS 2 client has no set_descriptor; give the descriptor when declaring."
        )

    def add_pre_set_parameters_callback(
        self, callback: Callable[[list[Parameter]], list[Parameter]]
    ) -> None:
        """Let a function change the list of parameters before it is checked."""
        self._parameters.before.insert(0, callback)

    def add_on_set_parameters_callback(self, callback: OnSet) -> None:
        """Let a function accept or refuse new values; it returns a ``SetParametersResult``."""
        self._parameters.checks.insert(0, callback)

    def add_post_set_parameters_callback(self, callback: Callable[[list[Parameter]], None]) -> None:
        """Call a function after parameters were set."""
        self._parameters.after.insert(0, callback)

    def remove_pre_set_parameters_callback(
        self, callback: Callable[[list[Parameter]], list[Parameter]]
    ) -> None:
        """Remove a function that changes the list."""
        self._parameters.before.remove(callback)

    def remove_on_set_parameters_callback(self, callback: OnSet) -> None:
        """Remove a function that accepts or refuses."""
        self._parameters.checks.remove(callback)

    def remove_post_set_parameters_callback(
        self, callback: Callable[[list[Parameter]], None]
    ) -> None:
        """Remove a function that is called afterwards."""
        self._parameters.after.remove(callback)
