"""ROS names: check, expand and remap them, and turn them into the names of DDS."""

from __future__ import annotations

import re
from collections.abc import Sequence

from .arguments import Remap

_TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_SUBSTITUTION = re.compile(r"\{([^{}]*)\}")
_MAX_NODE_NAME = 255


class InvalidNameError(ValueError):
    """A name breaks a rule of ROS 2; ``index`` is the position of the first wrong character."""

    def __init__(self, reason: str, index: int = 0) -> None:
        super().__init__(reason)
        self.reason = reason
        self.index = index


def check_node_name(name: str) -> None:
    """Raise :class:`InvalidNameError` if this cannot be the name of a node."""
    if not name:
        raise InvalidNameError("node name must not be empty")
    if len(name) > _MAX_NODE_NAME:
        raise InvalidNameError(f"node name must not have more than {_MAX_NODE_NAME} characters")
    if name[0].isdigit():
        raise InvalidNameError("node name must not start with a number")
    for index, char in enumerate(name):
        if not (char.isascii() and (char.isalnum() or char == "_")):
            raise InvalidNameError(
                "node name must not contain characters other than alphanumerics or '_'", index
            )


def check_namespace(namespace: str) -> None:
    """Raise :class:`InvalidNameError` if this cannot be the full namespace of a node."""
    if not namespace.startswith("/"):
        raise InvalidNameError("namespace must be absolute, it must lead with a '/'")
    if namespace != "/":
        check_full_name(namespace, "namespace")


def check_full_name(name: str, what: str) -> None:
    """Raise :class:`InvalidNameError` if this is not a full topic or service name."""
    if not name.startswith("/"):
        raise InvalidNameError(f"{what} must be absolute, it must lead with a '/'")
    position = 1
    for token in name[1:].split("/"):
        if not token:
            raise InvalidNameError(
                f"{what} must not have an empty part or end with a '/'", position - 1
            )
        if not _TOKEN.match(token):
            wrong = next(
                (i for i, c in enumerate(token) if not (c.isascii() and (c.isalnum() or c == "_"))),
                0,
            )
            reason = (
                "tokens must not start with a number"
                if token[0].isdigit()
                else f"{what} must not contain characters other than alphanumerics, '_' or '/'"
            )
            raise InvalidNameError(reason, position + wrong)
        position += len(token) + 1


def full_node_name(namespace: str, name: str) -> str:
    """Return a node's name with its namespace."""
    return f"/{name}" if namespace == "/" else f"{namespace}/{name}"


def expand(name: str, node: str, namespace: str, what: str = "topic name") -> str:
    """Return the full form of a topic or service name as a node writes it.

    Args:
        name: ``/absolute``, ``relative`` or ``~/private``, with ``{node}``, ``{ns}`` replaced.
        node: The node's name.
        namespace: The node's namespace.
        what: How to call the name in an error.

    Raises:
        InvalidNameError: The name breaks a rule of ROS 2.
    """
    if not name:
        raise InvalidNameError(f"{what} must not be empty")
    known = {"node": node, "ns": namespace, "namespace": namespace}

    def substitute(match: re.Match[str]) -> str:
        if match[1] not in known:
            raise InvalidNameError(f"unknown substitution '{match[0]}'", match.start())
        return known[match[1]]

    name = _SUBSTITUTION.sub(substitute, name)
    if name.startswith("~"):
        if len(name) > 1 and name[1] != "/":
            raise InvalidNameError(f"{what} must not have unexpected characters after '~'", 1)
        name = full_node_name(namespace, node) + name[1:]
    elif not name.startswith("/"):
        name = full_node_name(namespace, name)
    check_full_name(name, what)
    return name


def remap(
    name: str, node: str, namespace: str, rules: Sequence[Remap], service: bool = False
) -> str:
    """Return a full name after the first remapping rule that applies to it."""
    kinds = ("name", "service" if service else "topic")
    for rule in rules:
        if rule.kind not in kinds or (rule.node and rule.node != node):
            continue
        try:
            if expand(rule.match, node, namespace) == name:
                return expand(rule.replacement, node, namespace)
        except InvalidNameError:
            continue
    return name


def dds_type(name: str) -> str:
    """Return the DDS name of a type: ``std_msgs::msg::dds_::String_`` for std_msgs/msg/String."""
    package, kind, short = name.split("/")
    return f"{package}::{kind}::dds_::{short}_"


def ros_type(name: str) -> str | None:
    """Return the ROS name of a DDS type, or ``None`` for a type from outside ROS."""
    parts = name.split("::")
    if len(parts) != 4 or parts[2] != "dds_" or not parts[3].endswith("_"):
        return None
    return f"{parts[0]}/{parts[1]}/{parts[3][:-1]}"


def dds_topic(name: str) -> str:
    """Return the DDS name of a ROS topic."""
    return f"rt{name}"


def ros_topic(name: str) -> str | None:
    """Return the ROS name of a DDS topic, or ``None`` for a topic from outside ROS."""
    return name[2:] if name.startswith("rt/") else None


def dds_request(name: str) -> str:
    """Return the DDS topic of a service's requests."""
    return f"rq{name}Request"


def dds_reply(name: str) -> str:
    """Return the DDS topic of a service's replies."""
    return f"rr{name}Reply"


def ros_service(name: str) -> str | None:
    """Return the ROS service to which a DDS topic belongs, or ``None``."""
    if name.startswith("rq/") and name.endswith("Request"):
        return name[2:-7]
    if name.startswith("rr/") and name.endswith("Reply"):
        return name[2:-5]
    return None
