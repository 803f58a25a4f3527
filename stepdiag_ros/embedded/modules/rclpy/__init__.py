"""The embedded ROS 2 client library: the part of rclpy that nodes use, on Cyclone DDS.

It stands in for rclpy where no ROS 2 is installed, with the same names and behaviour. What it lacks
raises an error that says so.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions, install_signal_handlers, uninstall_signal_handlers
from rclpy.utilities import (
    _renew_default_context,
    get_default_context,
    get_rmw_implementation_identifier,
    ok,
)
from rclpy.utilities import shutdown as _shutdown
from rclpy.utilities import try_shutdown as _try_shutdown

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.node import Node
    from rclpy.task import Future

#: Tells this library from the real rclpy.
IS_EMBEDDED = True

__all__ = [
    "IS_EMBEDDED",
    "Context",
    "SignalHandlerOptions",
    "create_node",
    "get_default_context",
    "get_global_executor",
    "get_rmw_implementation_identifier",
    "init",
    "ok",
    "shutdown",
    "spin",
    "spin_once",
    "spin_until_future_complete",
    "try_shutdown",
]

_global_executor: Executor | None = None


#: Classes of submodules that real rclpy has here, too; imported when they are asked for.
_CLASSES = {"Future": "rclpy.task", "Parameter": "rclpy.parameter"}


def __getattr__(name: str) -> Any:
    if name in _CLASSES:
        return getattr(importlib.import_module(_CLASSES[name]), name)
    # The real rclpy imports its submodules itself, so that "rclpy.qos" works after "import rclpy".
    here = Path(__file__).parent
    if name[:1] != "_" and ((here / f"{name}.py").is_file() or (here / name).is_dir()):
        return importlib.import_module(f"rclpy.{name}")
    raise AttributeError(
        f"The embedded ROS 2 client has no rclpy.{name}; source a ROS 2 installation to use it."
    )


def init(
    *,
    args: Sequence[str] | None = None,
    context: Context | None = None,
    domain_id: int | None = None,
    signal_handler_options: SignalHandlerOptions | None = None,
) -> Any:
    """Join the ROS domain; must be called before nodes are made.

    Args:
        args: Command line; ``sys.argv`` if ``None``.
        context: The context to initialise; the default one if ``None``.
        domain_id: Number of the domain; ``ROS_DOMAIN_ID`` or 0 if ``None``.
        signal_handler_options: Which signals end the context; Ctrl-C and SIGTERM for the default
            context, none for another one.

    Raises:
        RuntimeError: It was called before, or the domain cannot be joined.
        ValueError: A ROS argument is wrong.
    """
    if signal_handler_options is None:
        default = context is None or context is get_default_context()
        signal_handler_options = SignalHandlerOptions.ALL if default else SignalHandlerOptions.NO
    if context is None:
        context = _renew_default_context()
    context.init(args, domain_id=domain_id)
    install_signal_handlers(signal_handler_options)
    return _InitContextManager(context)


class _InitContextManager:
    """Shuts down at the end of ``with rclpy.init():``."""

    def __init__(self, context: Context) -> None:
        self.context = context

    def __enter__(self) -> _InitContextManager:
        return self

    def __exit__(self, *_: object) -> None:
        try_shutdown(context=self.context)


def shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    """End a context (the default one); nodes should be destroyed before.

    Raises:
        RuntimeError: It is not running, for instance because Ctrl-C has ended it; see
            :func:`try_shutdown`.
    """
    _shutdown(context=context)
    _end_global_executor(context)
    if uninstall_handlers or (uninstall_handlers is None and context is None):
        uninstall_signal_handlers()


def try_shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    """End a context (the default one) if it is running."""
    _try_shutdown(context=context)
    _end_global_executor(context)
    if uninstall_handlers or (uninstall_handlers is None and context is None):
        uninstall_signal_handlers()


def create_node(node_name: str, **kwargs: Any) -> Node:
    """Return a new node; see :class:`rclpy.node.Node` for the arguments."""
    from rclpy.node import Node

    return Node(node_name, **kwargs)


def get_global_executor() -> Executor:
    """Return the executor used where none is given."""
    global _global_executor
    from rclpy.executors import SingleThreadedExecutor

    stale = _global_executor is not None and (
        _global_executor._is_shutdown or not _global_executor.context.ok()
    )
    if _global_executor is None or stale:
        _global_executor = SingleThreadedExecutor()
    return _global_executor


def spin(node: Node, executor: Executor | None = None) -> None:
    """Run a node's callbacks until shutdown.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed.
        rclpy.executors.ExternalShutdownException: The context was shut down, as by SIGTERM.
    """
    chosen = executor or get_global_executor()
    try:
        chosen.add_node(node)
        while chosen.context.ok():
            chosen.spin_once()
    finally:
        chosen.remove_node(node)


def spin_once(
    node: Node, *, executor: Executor | None = None, timeout_sec: float | None = None
) -> None:
    """Run one of a node's callbacks, waiting for it as long as given (forever if ``None``)."""
    chosen = executor or get_global_executor()
    try:
        chosen.add_node(node)
        chosen.spin_once(timeout_sec=timeout_sec)
    finally:
        chosen.remove_node(node)


def spin_until_future_complete(
    node: Node,
    future: Future,
    executor: Executor | None = None,
    timeout_sec: float | None = None,
) -> None:
    """Run a node's callbacks until a future is done, at most as long as given."""
    chosen = executor or get_global_executor()
    try:
        chosen.add_node(node)
        chosen.spin_until_future_complete(future, timeout_sec)
    finally:
        chosen.remove_node(node)


def _end_global_executor(context: Context | None) -> None:
    global _global_executor
    executor = _global_executor
    if executor is not None and executor.context is (context or get_default_context()):
        _global_executor = None
        executor.shutdown()
