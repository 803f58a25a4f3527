"""The part of a node that deals with names: its own, and those of topics and services."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.context import Context
from rclpy.exceptions import (
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidServiceNameException,
    InvalidTopicNameException,
)
from rclpy.parameter import Parameter
from stepdiag_ros.embedded import arguments, naming


class NodeNames:
    """A node's names after remapping, and what the command line says of the node."""

    _context: Context
    _name: str
    _namespace: str
    _remaps: list[arguments.Remap]
    _argument_sets: list[arguments.RosArguments]
    _use_rosout: bool

    def get_name(self) -> str:
        """Return the name."""
        return self._name

    def get_namespace(self) -> str:
        """Return the namespace."""
        return self._namespace

    def get_fully_qualified_name(self) -> str:
        """Return the name with its namespace."""
        return naming.full_node_name(self._namespace, self._name)

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """Return a topic's full name, after remapping unless requested otherwise.

        Raises:
            rclpy.exceptions.InvalidTopicNameException: The name breaks the rules.
        """
        return self._resolve(topic, only_expand, False, InvalidTopicNameException)

    def resolve_service_name(self, service: str, *, only_expand: bool = False) -> str:
        """Return a service's full name, after remapping unless requested otherwise.

        Raises:
            rclpy.exceptions.InvalidServiceNameException: The name breaks the rules.
        """
        return self._resolve(service, only_expand, True, InvalidServiceNameException)

    def _resolve(self, name: str, only_expand: bool, service: bool, error: Any) -> str:
        what = "service name" if service else "topic name"
        try:
            full = naming.expand(name, self._name, self._namespace, what)
        except naming.InvalidNameError as reason:
            raise error(name, reason.reason, reason.index) from None
        if only_expand:
            return full
        return naming.remap(full, self._name, self._namespace, self._remaps, service)

    def _set_names(
        self, name: str, namespace: str, cli_args: Sequence[str] | None, use_global: bool
    ) -> None:
        own = arguments.parse(["--ros-args", *_ros_part(cli_args)] if cli_args else [])
        every = self._context._arguments if use_global else arguments.RosArguments()
        self._remaps = [*own.remaps, *every.remaps]
        self._argument_sets = [every, own]
        self._use_rosout = every.use_rosout and own.use_rosout
        rules = arguments.RosArguments(remaps=self._remaps)
        _check(naming.check_node_name, name, InvalidNodeNameException)
        name = rules.node_name(name)
        _check(naming.check_node_name, name, InvalidNodeNameException)
        namespace = rules.node_namespace(name, namespace)
        namespace = namespace if namespace.startswith("/") else f"/{namespace}"
        _check(naming.check_namespace, namespace, InvalidNamespaceException)
        self._name, self._namespace = name, namespace

    def _collect_overrides(self, given: list[Parameter]) -> dict[str, Parameter]:
        full = self.get_fully_qualified_name()
        found: dict[str, Parameter] = {}
        for given_set in self._argument_sets:
            for name, value in given_set.overrides(full).items():
                found[name] = Parameter(name, value=value)
        for parameter in given:
            found[parameter.name] = parameter
        return found

    def _logger_name(self) -> str:
        return self.get_fully_qualified_name()[1:].replace("/", ".")


def _ros_part(cli_args: Sequence[str]) -> list[str]:
    """Return a node's own arguments without a leading flag, which is allowed but not needed."""
    items = list(cli_args)
    return items[1:] if items[0] == "--ros-args" else items


def _check(test: Callable[[str], None], name: str, error: Any) -> None:
    try:
        test(name)
    except naming.InvalidNameError as reason:
        raise error(name, reason.reason, reason.index) from None
