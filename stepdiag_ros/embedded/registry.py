"""Registry: message, service and action classes by name, each made once, when first needed.

Definitions come from the package's own ``msg``, ``srv`` and ``action`` folders (``stepdiag_ros``),
from the texts in ``interfaces/``, and for every other standard message from rosbags' type store.
"""

from __future__ import annotations

import threading
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from .cdr import Deserializer, Serializer, make_deserializer, make_serializer
from .classes import make_class
from .definitions import Definition, Field, FieldType, parse_action, parse_message, parse_service
from .packages import FROM_ROSBAGS, OWN, TEXTS
from .typehash import type_hash

_lock = threading.RLock()
_definitions: dict[str, Definition] = {}
_classes: dict[str, type] = {}
_services: dict[str, type] = {}
_actions: dict[str, type] = {}


class UnknownTypeError(LookupError):
    """There is no message or service of this name."""


def definition(name: str) -> Definition:
    """Return the definition of a message (``package/msg/Name``).

    Raises:
        UnknownTypeError: There is no such message.
        stepdiag_ros.embedded.definitions.DefinitionError: Its text cannot be understood.
    """
    with _lock:
        if name not in _definitions:
            _load(name)
        return _definitions[name]


def message_class(name: str) -> type:
    """Return the class of a message (``package/msg/Name``).

    Raises:
        UnknownTypeError: There is no such message.
    """
    with _lock:
        if name not in _classes:
            package, kind, short = name.split("/")
            found = definition(name)
            # To find a part of a service or action makes all its classes, this one among them.
            if name not in _classes:
                _classes[name] = make_class(found, message_class, f"{package}.{kind}", short)
        return _classes[name]


def service_class(name: str) -> type:
    """Return the class of a service (``package/srv/Name``) with its ``Request`` and ``Response``.

    Raises:
        UnknownTypeError: There is no such service.
    """
    with _lock:
        if name not in _services:
            path = _text_path(name)
            if path is None:
                raise UnknownTypeError(f"There is no service {name}; check its name and package.")
            for part in parse_service(name, path.read_text(encoding="utf-8")):
                _definitions[part.name] = part
            _services[name] = _make_service(name)
        return _services[name]


def action_class(name: str) -> type:
    """Return the class of an action (``package/action/Name``).

    It has ``Goal``, ``Result`` and ``Feedback``, and under ``Impl`` what goes over the wire.

    Raises:
        UnknownTypeError: There is no such action.
    """
    with _lock:
        if name not in _actions:
            path = _text_path(name)
            if path is None:
                raise UnknownTypeError(f"There is no action {name}; check its name and package.")
            from . import actions

            parts = parse_action(name, path.read_text(encoding="utf-8"))
            for part in (*parts, *actions.wire_definitions(name)):
                _definitions[part.name] = part
            for service in actions.wire_services(name):
                _services[service] = _make_service(service)
            _actions[name] = actions.make_class(name, message_class, service_class)
        return _actions[name]


def _make_service(name: str) -> type:
    package, kind, short = name.split("/")
    return type(
        short,
        (),
        {
            "__module__": f"{package}.{kind}",
            "__doc__": f"Service class '{short}' ({name}).",
            "_SERVICE": name,
            "Request": message_class(f"{name}_Request"),
            "Response": message_class(f"{name}_Response"),
        },
    )


def type_name(cls: type) -> str:
    """Return the full name of a message or service class.

    Raises:
        TypeError: It is not one.
    """
    found: Any = getattr(cls, "_DEFINITION", None)
    if isinstance(found, Definition):
        return found.name
    service: Any = getattr(cls, "_SERVICE", None)
    if isinstance(service, str):
        return service
    raise TypeError(f"{cls!r} is not a message or service class; import one from a .msg module.")


def check_action(cls: Any) -> None:
    """Raise :class:`TypeError` if this is not an action class."""
    if not isinstance(getattr(cls, "_ACTION", None), str):
        raise TypeError(f"{cls!r} is not an action class; import one from an .action module.")


@cache
def serializer(cls: type[Any]) -> Serializer:
    """Return the function that turns a message of this class into CDR."""
    return make_serializer(definition(type_name(cls)), definition)


@cache
def deserializer(cls: type[Any]) -> Deserializer:
    """Return the function that makes a message of this class from CDR."""
    return make_deserializer(definition(type_name(cls)), definition, message_class)


@cache
def hash_of(cls: type[Any]) -> str:
    """Return the RIHS01 type hash of a message class."""
    return type_hash(definition(type_name(cls)), definition)


def names(package: str, kind: str) -> list[str]:
    """Return the short names of a package's interfaces of a kind (``msg``, ``srv``, ``action``)."""
    folder = _folder(package, kind)
    found = {path.stem for path in folder.glob(f"*.{kind}")} if folder else set()
    if kind == "msg" and package in FROM_ROSBAGS:
        prefix = f"{package}/msg/"
        found |= {name[len(prefix) :] for name in _store().fielddefs if name.startswith(prefix)}
    return sorted(found)


def _load(name: str) -> None:
    package, kind, _ = name.split("/")
    if kind == "msg":
        path = _text_path(name)
        if path is not None:
            _definitions[name] = parse_message(name, path.read_text(encoding="utf-8"))
        elif package in FROM_ROSBAGS and (entry := _store().fielddefs.get(name)) is not None:
            _definitions[name] = _from_rosbags(name, entry)
    elif kind == "action":
        from . import actions

        # Makes all definitions of the action, this one among them if there is such a part.
        action_class(actions.action_of(name))
    elif name.endswith(("_Request", "_Response")):
        service_class(name.rsplit("_", 1)[0])
    if name not in _definitions:
        raise UnknownTypeError(f"There is no message {name}; check its name and package.")


def _folder(package: str, kind: str) -> Path | None:
    if package == OWN:
        from stepdiag_ros import resources

        try:
            return resources.directory(kind)  # type: ignore[arg-type]
        except FileNotFoundError:
            # A package need not have services or actions, but it has messages.
            if kind == "msg":
                raise
            return None
    return TEXTS / package / kind


def _text_path(name: str) -> Path | None:
    package, kind, short = name.split("/")
    folder = _folder(package, kind)
    path = folder / f"{short}.{kind}" if folder else None
    return path if path is not None and path.is_file() else None


@lru_cache(maxsize=1)
def _store() -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def _from_rosbags(name: str, entry: Any) -> Definition:
    constants, fields = entry
    return Definition(
        name,
        tuple(
            Field(field, _kind(description))
            for field, description in fields
            if field != "structure_needs_at_least_one_member"
        ),
        {
            constant: bytes([value]) if kind == "byte" else value
            for constant, kind, value in constants
        },
    )


def _kind(description: Any) -> FieldType:
    """Translate a rosbags field description: 1 primitive, 2 message, 3 array, 4 sequence."""
    node, content = int(description[0]), description[1]
    if node == 1:
        return FieldType(content[0], text_bound=content[1])
    if node == 2:
        return FieldType(content)
    inner = _kind(content[0])
    array = "fixed" if node == 3 else "bounded" if content[1] else "unbounded"
    return FieldType(inner.name, array, content[1], inner.text_bound)
