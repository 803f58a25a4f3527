"""Embedded ROS 2 client: lets nodes written for rclpy run on machines without ROS 2.

:func:`activate` makes ``import rclpy`` and ``from std_msgs.msg import Header`` work where no ROS 2
is sourced. Where one is, nothing here is used.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

#: Name of the real client library, as :func:`client` returns it.
REAL = "rclpy"
#: Name of this one.
EMBEDDED = "embedded"

_MODULES = str(Path(__file__).parent / "modules")


def client() -> str:
    """Return which ROS 2 client library ``import rclpy`` gives: ``"rclpy"`` or ``"embedded"``."""
    loaded = sys.modules.get("rclpy")
    if loaded is not None:
        return EMBEDDED if getattr(loaded, "IS_EMBEDDED", False) else REAL
    spec = importlib.util.find_spec("rclpy")
    if spec is None or spec.origin is None:
        return EMBEDDED
    return EMBEDDED if spec.origin.startswith(_MODULES) else REAL


def activate() -> str:
    """Make ``import rclpy`` work, and return which client library it gives.

    Cheap, and harmless when called again. A sourced ROS 2 always wins: its folders stand in
    ``sys.path`` before the one added here.
    """
    if _MODULES in sys.path or "rclpy" in sys.modules:
        return client()
    if importlib.util.find_spec("rclpy") is None:
        from . import finder

        sys.path.append(_MODULES)
        finder.install()
    return client()
