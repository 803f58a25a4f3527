"""Command line: ``--ros-args`` with remappings, parameters, parameter files and log levels."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

_FLAG = "--ros-args"
_RULE = re.compile(
    r"^(?:(?P<node>[A-Za-z_]\w*):(?!//))?(?P<from>(?:rostopic://|rosservice://)?[^:]+):=(?P<to>\S*)$"
)
_PARAMETER = re.compile(r"^(?:(?P<node>[^:]+):)?(?P<name>[^:]+):=(?P<value>.*)$", re.DOTALL)
_LEVELS = {"debug": 10, "info": 20, "warn": 30, "warning": 30, "error": 40, "fatal": 50}


_SWITCHES = {
    "--enable-rosout-logs": ("use_rosout", True),
    "--disable-rosout-logs": ("use_rosout", False),
    "--enable-stdout-logs": ("use_stdout", True),
    "--disable-stdout-logs": ("use_stdout", False),
    # There are no log files to switch on or off.
    "--enable-external-lib-logs": ("", True),
    "--disable-external-lib-logs": ("", False),
}


class ArgumentError(ValueError):
    """A ROS argument cannot be understood; the message says which one."""


@dataclass(frozen=True)
class Remap:
    """One remapping rule; ``kind`` is name, topic, service, node or namespace."""

    kind: str
    node: str
    match: str
    replacement: str


@dataclass
class RosArguments:
    """What the ROS arguments of a command line say."""

    remaps: list[Remap] = field(default_factory=list)
    #: Pairs of a pattern for the full node name and the parameters for such nodes.
    parameters: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    #: Paths of the parameter files, which ``parameters`` holds too.
    parameter_files: list[str] = field(default_factory=list)
    #: Level by logger name; ``""`` is the default of all.
    log_levels: dict[str, int] = field(default_factory=dict)
    use_stdout: bool = True
    use_rosout: bool = True
    enclave: str = "/"
    #: What is left for the program itself.
    remaining: list[str] = field(default_factory=list)

    def node_name(self, name: str) -> str:
        """Return a node's name after ``__node`` remapping."""
        return self._special("node", name, name)

    def node_namespace(self, name: str, namespace: str) -> str:
        """Return a node's namespace after ``__ns`` remapping; ``name`` is its remapped name."""
        return self._special("namespace", name, namespace)

    def _special(self, kind: str, name: str, value: str) -> str:
        for rule in self.remaps:
            if rule.kind == kind and rule.node in ("", name):
                return rule.replacement
        return value

    def overrides(self, full_name: str) -> dict[str, Any]:
        """Return the parameters given for a node, later ones winning."""
        found: dict[str, Any] = {}
        for pattern, values in self.parameters:
            if matches(pattern, full_name):
                found.update(values)
        return found


def parse(args: Sequence[str]) -> RosArguments:
    """Parse a command line; everything between ``--ros-args`` and ``--`` is ROS's.

    Raises:
        ArgumentError: A ROS argument is unknown, incomplete or malformed.
    """
    result = RosArguments()
    inside = False
    items = iter(args)
    for item in items:
        if item == _FLAG:
            inside = True
        elif inside and item == "--":
            inside = False
        elif not inside:
            result.remaining.append(item)
        elif item in _SWITCHES:
            _set_switch(result, item)
        else:
            option, joined, value = item.partition("=")
            if not (joined and option.startswith("--")):
                option, value = item, next(items, "")
                if not value:
                    raise ArgumentError(f"The ROS argument '{item}' is unknown or lacks its value.")
            _set_option(result, option, value)
    return result


def matches(pattern: str, full_name: str) -> bool:
    """Return whether a node name pattern (``/**``, ``/*/name``, ``name``) fits a full node name."""
    if not pattern.startswith("/"):
        pattern = f"/{pattern}"
    text = ""
    for part in pattern[1:].split("/"):
        if part == "**":
            text += "(/[^/]+)*"
        elif part == "*":
            text += "/[^/]+"
        else:
            text += "/" + re.escape(part)
    return re.fullmatch(text, full_name) is not None


def yaml_value(text: str) -> Any:
    """Return the value of a parameter given as YAML text on the command line.

    Raises:
        ArgumentError: It is not YAML, or not a value a parameter can have.
    """
    from stepdiag_ros.embedded import yaml_values

    try:
        value = yaml_values.read(text)
    except ValueError as error:
        raise ArgumentError(f"'{text}' is not a YAML value: {error}.") from error
    if isinstance(value, dict):
        raise ArgumentError(f"'{text}' is a mapping; a parameter must be a single value or a list.")
    if value is None:
        raise ArgumentError("There is no value; an empty text is written '' (with the quotes).")
    return check_value(value, text)


def check_value(value: Any, where: str) -> Any:
    """Return a parameter value from YAML: a single one, or a list whose items have one type.

    Raises:
        ArgumentError: No parameter type can hold it.
    """
    if isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, list):
        kinds = {type(item) for item in value}
        if len(kinds) <= 1 and kinds <= {bool, int, float, str}:
            return value
    raise ArgumentError(
        f"{where}: {value!r} is not a parameter value; give a bool, an integer, a float, a string,"
        " or a list of one of these."
    )


def load_parameter_file(path: str) -> list[tuple[str, dict[str, Any]]]:
    """Return the node patterns of a ROS parameter file and the parameters for each.

    Raises:
        ArgumentError: The file is missing, not YAML, or not laid out as ROS parameters.
    """
    from stepdiag_ros.embedded import yaml_values

    try:
        content = yaml_values.read(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ArgumentError(f"There is no parameter file {path}.") from error
    except OSError as error:
        raise ArgumentError(
            f"The parameter file {path} cannot be read: {error.strerror}."
        ) from error
    except ValueError as error:
        raise ArgumentError(f"The parameter file {path} is not YAML for ROS: {error}.") from error
    found: list[tuple[str, dict[str, Any]]] = []
    if content is None:
        return found
    if not isinstance(content, dict):
        raise ArgumentError(f"The parameter file {path} must map node names to ros__parameters.")
    _collect(content, "", path, found)
    return found


def _collect(
    content: dict[Any, Any], prefix: str, path: str, found: list[tuple[str, dict[str, Any]]]
) -> None:
    for key, value in content.items():
        name = f"{prefix}/{str(key).strip('/')}"
        if not isinstance(value, dict):
            raise ArgumentError(f"In the parameter file {path}, '{name}' lacks ros__parameters.")
        for inner, nested in value.items():
            if inner == "ros__parameters":
                if nested is not None and not isinstance(nested, dict):
                    raise ArgumentError(
                        f"In the parameter file {path}, ros__parameters of '{name}' is not a"
                        " mapping."
                    )
                flat: dict[str, Any] = {}
                _flatten(nested or {}, "", f"{path}, {name}", flat)
                found.append((name, flat))
            else:
                _collect({inner: nested}, name, path, found)


def _flatten(values: dict[Any, Any], prefix: str, where: str, flat: dict[str, Any]) -> None:
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            _flatten(value, f"{name}.", where, flat)
        else:
            flat[name] = check_value(value, f"{where}, parameter '{name}'")


def _set_switch(result: RosArguments, item: str) -> None:
    name, value = _SWITCHES[item]
    if name:
        setattr(result, name, value)


def _set_option(result: RosArguments, option: str, value: str) -> None:
    if option in ("-r", "--remap"):
        result.remaps.append(_parse_remap(value))
    elif option in ("-p", "--param"):
        match = _PARAMETER.match(value)
        if match is None:
            raise ArgumentError(f"The parameter '{value}' must read name:=value.")
        if "/" in (match["node"] or ""):
            raise ArgumentError(
                f"The parameter '{value}' names a node with its namespace, which ROS 2 does not"
                " understand here; give it in a parameter file (--params-file)."
            )
        # As in ROS 2, a name alone is that of a node without namespace.
        pattern = f"/{match['node']}" if match["node"] else "/**"
        try:
            given = yaml_value(match["value"])
        except ArgumentError as error:
            raise ArgumentError(f"The parameter '{value}' is wrong: {error}") from error
        result.parameters.append((pattern, {match["name"]: given}))
    elif option == "--params-file":
        result.parameters.extend(load_parameter_file(value))
        result.parameter_files.append(value)
    elif option == "--log-level":
        name, given, level = value.rpartition(":=")
        if level.lower() not in _LEVELS:
            known = ", ".join(_LEVELS)
            raise ArgumentError(f"The log level '{level}' is unknown; use one of {known}.")
        result.log_levels[name if given else ""] = _LEVELS[level.lower()]
    elif option in ("-e", "--enclave"):
        result.enclave = value
    elif option in ("--log-config-file", "--log-file-name"):
        raise ArgumentError(f"The embedded ROS 2 client writes no log files; leave {option} out.")
    else:
        raise ArgumentError(f"The ROS argument '{option}' is unknown.")


def _parse_remap(text: str) -> Remap:
    match = _RULE.match(text)
    if match is None or not match["to"]:
        raise ArgumentError(f"The remapping '{text}' must read from:=to.")
    node, source, target = match["node"] or "", match["from"], match["to"]
    if source in ("__node", "__name"):
        return Remap("node", node, "", target)
    if source == "__ns":
        return Remap("namespace", node, "", target)
    for scheme, kind in (("rostopic://", "topic"), ("rosservice://", "service")):
        if source.startswith(scheme):
            return Remap(kind, node, source[len(scheme) :], target.removeprefix(scheme))
    return Remap("name", node, source, target)
