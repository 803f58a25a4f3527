"""Futures and tasks."""

from __future__ import annotations

import inspect
import threading
import warnings
import weakref
from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rclpy.executors import Executor


class Future:
    """Outcome of work that is not done yet.

    Args:
        executor: Who runs the callbacks; without one they run in the thread that sets the result.
    """

    def __init__(self, *, executor: Executor | None = None) -> None:
        self._done = False
        self._cancelled = False
        self._result: Any = None
        self._exception: BaseException | None = None
        self._exception_fetched = False
        self._callbacks: list[Callable[[Any], Any]] = []
        self._lock = threading.Lock()
        self._executor: Callable[[], Executor | None] = lambda: None
        self._set_executor(executor)

    def __del__(self) -> None:
        if self._exception is not None and not self._exception_fetched:
            warnings.warn(
                f"The following exception was never retrieved: {self._exception}", stacklevel=1
            )

    def __await__(self) -> Generator[Any, None, Any]:
        while not self._pending_is_over():
            yield self
        return self.result()

    def _pending_is_over(self) -> bool:
        return self._done or self._cancelled

    def cancel(self) -> None:
        """Cancel the work if it is not done; callbacks are called."""
        with self._lock:
            if self._pending_is_over():
                return
            self._cancelled = True
        self._call_back()

    def cancelled(self) -> bool:
        """Return whether it was cancelled."""
        return self._cancelled

    def done(self) -> bool:
        """Return whether a result or an exception was set."""
        return self._done

    def result(self) -> Any:
        """Return the result, ``None`` if not done yet; raise the exception if one was set."""
        if self._exception is not None:
            self._exception_fetched = True
            raise self._exception
        return self._result

    def exception(self) -> BaseException | None:
        """Return the exception that was set, if any."""
        self._exception_fetched = True
        return self._exception

    def set_result(self, result: Any) -> None:
        """Set the result; callbacks are called."""
        with self._lock:
            self._result = result
            self._done = True
            self._cancelled = False
        self._call_back()

    def set_exception(self, exception: BaseException) -> None:
        """Set an exception as the outcome; callbacks are called."""
        with self._lock:
            self._exception = exception
            self._exception_fetched = False
            self._done = True
            self._cancelled = False
        self._call_back()

    def add_done_callback(self, callback: Callable[[Any], Any]) -> None:
        """Call a function with this future when it is done, or now if it is."""
        with self._lock:
            if not self._pending_is_over():
                self._callbacks.append(callback)
                return
        self._schedule(callback)

    def remove_done_callback(self, callback: Callable[[Any], Any]) -> bool:
        """Remove a callback; return whether it was there."""
        with self._lock:
            if callback in self._callbacks:
                self._callbacks.remove(callback)
                return True
            return False

    def _set_executor(self, executor: Executor | None) -> None:
        self._executor = (lambda: None) if executor is None else weakref.ref(executor)

    def _call_back(self) -> None:
        with self._lock:
            callbacks, self._callbacks = self._callbacks, []
        for callback in callbacks:
            self._schedule(callback)

    def _schedule(self, callback: Callable[[Any], Any]) -> None:
        executor = self._executor()
        if executor is not None and not executor._is_shutdown:
            executor.create_task(callback, self)
            return
        outcome = callback(self)
        if inspect.iscoroutine(outcome):
            outcome.close()
            raise RuntimeError("A coroutine as callback needs a future with an executor.")


class Task(Future):
    """A function or coroutine run by an executor, as a future."""

    def __init__(
        self,
        handler: Any,
        args: tuple[Any, ...] = (),
        kwargs: dict[str, Any] | None = None,
        executor: Executor | None = None,
    ) -> None:
        super().__init__(executor=executor)
        self._handler = handler
        self._args = args
        self._kwargs = kwargs or {}
        self._coroutine: Any = handler if inspect.iscoroutine(handler) else None
        self._running = threading.Lock()

    def __call__(self) -> None:
        """Run the function, or the coroutine up to its next wait."""
        # Another thread may just be about to leave it: then this one waits, or a wake-up is lost.
        self._running.acquire()
        try:
            if self._pending_is_over():
                return
            if self._coroutine is None:
                outcome = self._handler(*self._args, **self._kwargs)
                if not inspect.iscoroutine(outcome):
                    self.set_result(outcome)
                    return
                self._coroutine = outcome
            awaited = self._coroutine.send(None)
        except StopIteration as stop:
            self.set_result(stop.value)
        except Exception as error:
            self.set_exception(error)
        else:
            self._continue_after(awaited)
        finally:
            self._running.release()

    def executing(self) -> bool:
        """Return whether it runs right now."""
        return self._running.locked()

    def cancel(self) -> None:
        """Cancel it; a coroutine is closed."""
        if self._coroutine is not None and not self._done:
            self._coroutine.close()
        super().cancel()

    def _continue_after(self, awaited: Any) -> None:
        executor = self._executor()
        if executor is None:
            return
        if isinstance(awaited, Future) and not awaited._pending_is_over():
            awaited.add_done_callback(lambda _: executor._resume(self))
        else:
            executor._resume(self)
