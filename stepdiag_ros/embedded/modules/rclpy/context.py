"""Context: this process in a ROS domain, from ``init`` to ``shutdown``."""

from __future__ import annotations

import atexit
import os
import sys
import threading
import weakref
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from rclpy import logging
from rclpy.exceptions import NotInitializedException
from stepdiag_ros.embedded import arguments, dds, security
from stepdiag_ros.embedded.graph import Graph

if TYPE_CHECKING:
    from rclpy.node import Node

_contexts: weakref.WeakSet[Context] = weakref.WeakSet()
_tested = False


class Context:
    """Life cycle of this process's part in a ROS domain."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._state = "new"
        self._participant: dds.Participant | None = None
        self._graph: Graph | None = None
        self._arguments = arguments.RosArguments()
        self._domain_id = 0
        self._callbacks: list[Callable[[], None]] = []
        #: Called at shutdown, to wake whoever waits.
        self._wakers: set[Callable[[], Any]] = set()
        self._nodes: set[Node] = set()

    def init(
        self,
        args: Sequence[str] | None = None,
        *,
        initialize_logging: bool = True,
        domain_id: int | None = None,
    ) -> None:
        """Join the domain.

        Args:
            args: Command line; ``sys.argv`` if ``None``.
            initialize_logging: Whether log levels of the command line count.
            domain_id: Number of the domain; ``ROS_DOMAIN_ID`` or 0 if ``None``.

        Raises:
            RuntimeError: It was called before, or the domain cannot be joined.
            ValueError: A ROS argument is wrong.
        """
        global _tested
        with self._lock:
            if self._state == "ok":
                raise RuntimeError("Context.init() must only be called once")
            self._arguments = arguments.parse(sys.argv if args is None else args)
            self._domain_id = _domain_id() if domain_id is None else domain_id
            enclave = self._arguments.enclave
            participant, warning = security.join(self._domain_id, f"enclave={enclave};", enclave)
            try:
                if not _tested and not participant.protected:
                    dds.self_test(participant)
                self._graph = Graph(participant)
            except dds.DdsError:
                participant.close()
                raise
            self._participant = participant
            self._state = "ok"
            _contexts.add(self)
        if initialize_logging:
            logging._configure(self._arguments)
        if warning:
            logging.get_logger("rclpy").warning(warning)
        if not _tested:
            _tested = True
            logging.get_logger("rclpy").info(
                f"This is the embedded ROS 2 client on Cyclone DDS, in domain {self._domain_id}."
            )

    def ok(self) -> bool:
        """Return whether the context is initialised and not shut down."""
        return self._state == "ok"

    def get_domain_id(self) -> int:
        """Return the number of the domain.

        Raises:
            rclpy.exceptions.NotInitializedException: ``init`` was not called.
        """
        if self._state == "new":
            raise NotInitializedException
        return self._domain_id

    def shutdown(self) -> None:
        """End the context; spinning ends, and the domain is left with the last node.

        Raises:
            RuntimeError: It is not running.
        """
        if not self.try_shutdown():
            raise RuntimeError(
                "failed to shutdown: rcl_shutdown already called on the given context"
            )

    def try_shutdown(self) -> bool:
        """End the context if it is running; return whether it was."""
        with self._lock:
            if self._state != "ok":
                return False
            self._state = "shut down"
            callbacks, self._callbacks = self._callbacks, []
        for wake in list(self._wakers):
            wake()
        for callback in callbacks:
            callback()
        self._leave_if_unused()
        if not any(context.ok() for context in list(_contexts)):
            # As rcl does: levels that were asked for hold until the last context has ended.
            logging.clear_config()
        return True

    def on_shutdown(self, callback: Callable[[], None]) -> None:
        """Call a function, or a bound method, at shutdown.

        Raises:
            TypeError: It cannot be called.
        """
        if not callable(callback):
            raise TypeError("callback should be a callable, got {}", type(callback))
        with self._lock:
            if self._state == "shut down":
                callback()
            else:
                self._callbacks.append(callback)

    def __enter__(self) -> Context:
        if self._state == "new":
            self.init()
        return self

    def __exit__(self, *_: object) -> None:
        self.try_shutdown()

    def _require(self) -> tuple[dds.Participant, Graph]:
        if self._participant is None or self._graph is None or not self.ok():
            raise NotInitializedException
        return self._participant, self._graph

    def _interrupt(self) -> None:
        """End the context from a signal handler, in which no lock may be waited for."""
        self.try_shutdown()

    def _leave_if_unused(self) -> None:
        if self._state != "ok" and not self._nodes:
            self._leave()

    def _leave(self) -> None:
        participant, self._participant = self._participant, None
        if participant is not None:
            participant.close()


def _domain_id() -> int:
    text = os.environ.get("ROS_DOMAIN_ID", "").strip()
    try:
        return int(text) if text else 0
    except ValueError:
        raise RuntimeError(
            f"ROS_DOMAIN_ID is '{text}'; set it to a number from 0 to 232."
        ) from None


@atexit.register
def _leave_all() -> None:
    """Leave the domain at exit, or peers see ghosts of the nodes until their lease ends."""
    for context in list(_contexts):
        context.try_shutdown()
        context._leave()
