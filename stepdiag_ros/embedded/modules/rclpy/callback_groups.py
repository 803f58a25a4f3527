"""Callback groups: which callbacks may run at the same time."""

from __future__ import annotations

import threading
import weakref
from typing import Any


class CallbackGroup:
    """Set of entities whose callbacks share a rule about running together."""

    def __init__(self) -> None:
        self.entities: weakref.WeakSet[Any] = weakref.WeakSet()

    def add_entity(self, entity: Any) -> None:
        """Put an entity in the group."""
        self.entities.add(entity)

    def has_entity(self, entity: Any) -> bool:
        """Return whether an entity is in the group."""
        return entity in self.entities

    def can_execute(self, entity: Any) -> bool:
        """Return whether a callback of the entity may start now."""
        raise NotImplementedError

    def beginning_execution(self, entity: Any) -> bool:
        """Note the start of a callback; return whether it may start."""
        raise NotImplementedError

    def ending_execution(self, entity: Any) -> None:
        """Note the end of a callback."""
        raise NotImplementedError


class ReentrantCallbackGroup(CallbackGroup):
    """Callbacks may run at any time, even the same one twice."""

    def can_execute(self, entity: Any) -> bool:  # noqa: ARG002
        """Return ``True``."""
        return True

    def beginning_execution(self, entity: Any) -> bool:  # noqa: ARG002
        """Return ``True``."""
        return True

    def ending_execution(self, entity: Any) -> None:
        """Do nothing."""


class MutuallyExclusiveCallbackGroup(CallbackGroup):
    """One callback at a time."""

    def __init__(self) -> None:
        super().__init__()
        self._active: Any = None
        self._lock = threading.Lock()

    def can_execute(self, entity: Any) -> bool:  # noqa: ARG002
        """Return whether no callback of the group runs."""
        return self._active is None

    def beginning_execution(self, entity: Any) -> bool:
        """Note the start of a callback; return whether no other one runs."""
        with self._lock:
            if self._active is not None:
                return False
            self._active = entity
            return True

    def ending_execution(self, entity: Any) -> None:
        """Note the end of a callback."""
        with self._lock:
            if self._active is entity:
                self._active = None
