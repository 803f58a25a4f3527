"""What an executor serves: anything that can have callbacks ready to run."""

from __future__ import annotations

import weakref
from collections import deque
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import CallbackGroup

if TYPE_CHECKING:
    from rclpy.executors import Executor


class Source:
    """Entity with callbacks. Executors use the members with a leading underscore."""

    def __init__(self, callback_group: CallbackGroup | None) -> None:
        self.callback_group = callback_group
        if callback_group is not None:
            callback_group.add_entity(self)
        #: Items that have arrived and wait for the callback.
        self._pending: deque[Any] = deque()
        #: Whether it stands in its executor's queue.
        self._queued = False
        #: Number of the turn in which its last callback was taken.
        self._served = 0
        self._executor_ref: weakref.ref[Executor] | None = None

    def _executor(self) -> Executor | None:
        return self._executor_ref() if self._executor_ref is not None else None

    def _conditions(self) -> list[int]:
        """Return the DDS conditions to wait for."""
        return []

    def _fetch(self) -> None:
        """Move what has arrived to :attr:`_pending`."""

    def _take(self) -> Any:
        """Return the next item for the callback, ``None`` without one."""
        return self._pending.popleft() if self._pending else None

    def _run(self, item: Any) -> Any:
        """Call the callback with an item; a coroutine it returns is run to its end."""
        raise NotImplementedError

    def destroy(self) -> None:
        """Leave the executor."""
        executor = self._executor()
        if executor is not None:
            executor._remove_source(self)
        self._executor_ref = None
