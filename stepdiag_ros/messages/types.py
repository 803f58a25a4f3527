"""Classes of messages, by the name of their type, of the client that runs here."""

import importlib
from collections.abc import Callable
from typing import Any

from stepdiag_ros.embedded import activate
from stepdiag_ros.metrology.refusal import Refusal

NewMessage = Callable[[str], Any]
"""Makes an empty message of a full type name such as ``stepdiag_ros/msg/RunState``."""


def message_type(type_name: str) -> Any:
    """Return the class of a type, ``stepdiag_ros/msg/RunState``, of the client that runs here.

    Raises:
        ValueError: it is missing, as where ROS 2 is sourced and the package run from its sources.
    """
    activate()
    package, _, name = type_name.split("/")
    try:
        module = importlib.import_module(f"{package}.msg")
    except ModuleNotFoundError:
        raise Refusal(
            f"the ROS 2 that is sourced has no messages of package {package}: build with colcon, "
            "source install/setup.bash and start outside of the source folder",
            fault="not_installed",
        ) from None
    try:
        return getattr(module, name)
    except AttributeError:
        raise Refusal(f"package {package} has no message {name}", fault="unknown") from None


def new_message(type_name: str) -> Any:
    """Return an empty message of a type; see ``message_type``."""
    return message_type(type_name)()
