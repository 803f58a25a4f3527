"""Guard conditions: callbacks that other threads can ask for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy._source import Source
from rclpy.callback_groups import CallbackGroup


class GuardCondition(Source):
    """Calls a function once after each burst of :meth:`trigger`."""

    def __init__(
        self, callback: Callable[[], Any] | None, callback_group: CallbackGroup | None
    ) -> None:
        super().__init__(callback_group)
        self.callback = callback
        self._triggered = False

    def trigger(self) -> None:
        """Ask for the callback."""
        self._triggered = True
        executor = self._executor()
        if executor is not None:
            executor.create_task(self._call)

    def _call(self) -> Any:
        if not self._triggered:
            return None
        self._triggered = False
        return self.callback() if self.callback is not None else None

    def _run(self, item: Any) -> Any:  # noqa: ARG002
        return self._call()
