"""Executors: wait for messages, requests and timers, and run the callbacks."""

from __future__ import annotations

import inspect
import itertools
import os
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from rclpy._source import Source
from rclpy.context import Context
from rclpy.signals import _uninterrupted
from rclpy.task import Future, Task
from rclpy.timer import Timer
from rclpy.utilities import get_default_context, timeout_sec_to_nsec
from stepdiag_ros.embedded import dds

if TYPE_CHECKING:
    from rclpy.node import Node

_FOREVER = 2**62
#: While callbacks are waiting to run, new arrivals are looked for as often as this, in ns.
_POLL_NS = 200_000
_turns = itertools.count(1)


class ExternalShutdownException(Exception):
    """The context was shut down while the executor waited."""

    def __init__(self, *args: object) -> None:
        super().__init__("Context has been shutdown.", *args)


class ShutdownException(Exception):
    """The executor was shut down while it waited."""


class TimeoutException(Exception):
    """Nothing was ready in time."""


class ConditionReachedException(Exception):
    """The condition for which an executor was spun is reached."""


async def await_or_execute(callback: Callable[..., Any], *args: Any) -> Any:
    """Call a function, or run a coroutine function to its end, and return what it returns."""
    if inspect.iscoroutinefunction(callback):
        return await callback(*args)
    return callback(*args)


class _Work:
    """One callback to run: of a source with an item, or a task."""

    __slots__ = ("item", "source", "task")

    def __init__(self, source: Source | None, item: Any, task: Task | None) -> None:
        self.source, self.item, self.task = source, item, task


class Executor:
    """Base of the executors; runs one callback for each :meth:`spin_once`."""

    def __init__(self, *, context: Context | None = None) -> None:
        self._context = context or get_default_context()
        participant, _ = self._context._require()
        self._lock = threading.RLock()
        self._wait_lock = threading.Lock()
        self._is_shutdown = False
        self._nodes: list[Node] = []
        self._waitset = dds.WaitSet(participant)
        self._guard = dds.GuardCondition(participant)
        self._waitset.attach(self._guard.handle, 0)
        self._sources: dict[int, Source] = {}
        self._attached: dict[Source, list[int]] = {}
        self._muted: set[Source] = set()
        self._last_key = 0
        self._timers: list[Timer] = []
        self._timer_due = 0
        self._ready: deque[Source] = deque()
        self._tasks: deque[Task] = deque()
        self._last_poll = 0
        self._errors: deque[BaseException] = deque()
        self._context._wakers.add(self.wake)

    @property
    def context(self) -> Context:
        """The context whose nodes are served."""
        return self._context

    def add_node(self, node: Node) -> bool:
        """Serve a node; return whether it was not served yet."""
        with self._lock:
            if node in self._nodes:
                return False
            self._nodes.append(node)
            node.executor = self
            for source in list(node._sources):
                self._add_source(source)
            # Who was served last is served last, even if the node comes and goes all the time.
            self._ready = deque(sorted(self._ready, key=lambda source: source._served))
        self.wake()
        return True

    def remove_node(self, node: Node) -> None:
        """Serve a node no longer."""
        with self._lock:
            if node not in self._nodes:
                return
            self._nodes.remove(node)
            for source in list(node._sources):
                self._remove_source(source)
        node._forget_executor(self)
        self.wake()

    def get_nodes(self) -> list[Node]:
        """Return the nodes that are served."""
        with self._lock:
            return list(self._nodes)

    def create_task(self, callback: Any, *args: Any, **kwargs: Any) -> Task:
        """Run a function or coroutine in this executor; return its future."""
        task = Task(callback, args, kwargs, executor=self)
        self._resume(task)
        return task

    def wake(self) -> None:
        """End the present wait, so that changes are seen."""
        guard = self._guard
        if guard.handle:
            guard.trigger()

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Stop; callbacks that run are finished. Return whether all did in time."""
        with self._lock:
            if self._is_shutdown:
                return True
            self._is_shutdown = True
        self.wake()
        finished = self._finish(timeout_sec)
        for node in self.get_nodes():
            self.remove_node(node)
        self._context._wakers.discard(self.wake)
        with self._wait_lock:
            self._waitset.close()
            self._guard.close()
        return finished

    def spin(self) -> None:
        """Run callbacks until shutdown.

        Raises:
            ExternalShutdownException: The context was shut down.
        """
        while self._context.ok() and not self._is_shutdown:
            self.spin_once()

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Run one callback, waiting for it as long as given (forever if ``None``).

        Raises:
            ExternalShutdownException: The context was shut down meanwhile.
        """
        with suppress(ShutdownException, TimeoutException):
            self._spin_once(timeout_sec_to_nsec(timeout_sec), None)

    def spin_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        """Run callbacks until a future is done, at most as long as given."""
        limit = timeout_sec_to_nsec(timeout_sec)
        end = _FOREVER if limit < 0 else time.monotonic_ns() + limit
        future.add_done_callback(lambda _: self.wake())
        while self._context.ok() and not future._pending_is_over() and not self._is_shutdown:
            left = end - time.monotonic_ns()
            if left < 0:
                return
            with suppress(ShutdownException, TimeoutException, ConditionReachedException):
                self._spin_once(-1 if end == _FOREVER else left, future._pending_is_over)

    def spin_once_until_future_complete(
        self, future: Future, timeout_sec: float | None = None
    ) -> None:
        """Run one callback, unless a future is done before."""
        future.add_done_callback(lambda _: self.wake())
        with suppress(ShutdownException, TimeoutException, ConditionReachedException):
            self._spin_once(timeout_sec_to_nsec(timeout_sec), future._pending_is_over)

    def __enter__(self) -> Executor:
        return self

    def __exit__(self, *_: object) -> None:
        self.shutdown()

    # What sources and nodes call.

    def _add_source(self, source: Source) -> None:
        with self._lock:
            if source in self._attached:
                return
            source._executor_ref = weakref.ref(self)
            self._last_key += 1
            key = self._last_key
            self._sources[key] = source
            self._attached[source] = [key, *source._conditions()]
            for condition in self._attached[source][1:]:
                self._waitset.attach(condition, key)
            source._queued = False
            if isinstance(source, Timer):
                self._timers.append(source)
                self._timer_due = 0
            elif source._pending:
                self._enqueue(source)

    def _remove_source(self, source: Source) -> None:
        with self._lock:
            entry = self._attached.pop(source, None)
            if entry is None:
                return
            del self._sources[entry[0]]
            for condition in entry[1:]:
                if self._waitset.handle:
                    self._waitset.detach(condition)
            self._muted.discard(source)
            if isinstance(source, Timer):
                self._timers.remove(source)
            if source._queued:
                source._queued = False
                self._ready = deque(item for item in self._ready if item is not source)
            source._executor_ref = None

    def _timers_changed(self) -> None:
        self._timer_due = 0
        self.wake()

    def _resume(self, task: Task) -> None:
        self._tasks.append(task)
        self.wake()

    # Waiting and running.

    def _spin_once(self, timeout_ns: int, condition: Callable[[], bool] | None) -> None:
        work = self._wait(timeout_ns, condition)
        self._execute(work)

    def _execute(self, work: _Work) -> None:
        """Run a callback in this thread."""
        if work.task is not None:
            self._run_task(work.task)
            return
        source = work.source
        assert source is not None
        group = source.callback_group
        outcome = None
        try:
            outcome = source._run(work.item)
        finally:
            if not inspect.iscoroutine(outcome) and group is not None:
                group.ending_execution(source)
        if inspect.iscoroutine(outcome):
            task = self.create_task(outcome)
            if group is not None:
                task.add_done_callback(lambda _: group.ending_execution(source))

    def _run_task(self, task: Task) -> None:
        task()
        if task._done and task._exception is not None and not task._exception_fetched:
            # As in rclpy: an exception of a callback ends the spinning.
            task.result()

    def _finish(self, timeout_sec: float | None) -> bool:  # noqa: ARG002
        return True

    def _wait(self, timeout_ns: int, condition: Callable[[], bool] | None) -> _Work:
        """Return the next callback to run.

        Raises:
            TimeoutException: None was ready in time.
            ShutdownException: The executor was shut down.
            ExternalShutdownException: The context was shut down.
            ConditionReachedException: ``condition`` became true.
        """
        end = _FOREVER if timeout_ns < 0 else time.monotonic_ns() + timeout_ns
        polled = False
        while True:
            if not self._context.ok():
                raise ExternalShutdownException
            if self._is_shutdown:
                raise ShutdownException
            if self._errors:
                raise self._errors.popleft()
            if condition is not None and condition():
                raise ConditionReachedException
            if self._tasks:
                return _Work(None, None, self._tasks.popleft())
            now = time.monotonic_ns()
            if now >= self._timer_due:
                self._scan_timers()
            if self._ready and now - self._last_poll < _POLL_NS:
                work = self._pop_ready()
                if work is not None:
                    return work
            if polled and now >= end:
                work = self._pop_ready()
                if work is not None:
                    return work
                raise TimeoutException
            self._poll(max(0, min(end, self._timer_due) - now))
            polled = True

    def _poll(self, wait_ns: int) -> None:
        """Look for arrivals, waiting for them if nothing else is to do."""
        if self._ready:
            with self._lock:
                runnable = any(self._can_run(source) for source in self._ready)
                if not runnable:
                    self._mute()
            if runnable:
                wait_ns = 0
        with self._wait_lock:
            if not self._waitset.handle:
                return
            try:
                hits = self._waitset.wait(wait_ns)
            except dds.DdsError:
                # The domain was left meanwhile; the caller sees that the context is shut down.
                if self._context.ok():
                    raise
                return
        self._last_poll = time.monotonic_ns()
        if not hits:
            return
        with self._lock:
            for key in hits:
                if key == 0:
                    self._guard.reset()
                    continue
                source = self._sources.get(key)
                if source is None:
                    continue
                if not source._pending:
                    source._fetch()
                if source._pending:
                    self._enqueue(source)

    def _scan_timers(self) -> None:
        with self._lock:
            due = _FOREVER
            for timer in self._timers:
                if timer._canceled or timer._queued:
                    continue
                if timer.is_ready():
                    self._enqueue(timer)
                elif not timer._clock._is_taken_over:
                    due = min(due, timer._next_call)
            self._timer_due = due

    def _enqueue(self, source: Source) -> None:
        if not source._queued:
            source._queued = True
            self._ready.append(source)

    def _can_run(self, source: Source) -> bool:
        group = source.callback_group
        return group is None or group.can_execute(source)

    def _pop_ready(self) -> _Work | None:
        """Return the next callback that may run now; sources take turns."""
        with self._lock:
            for _ in range(len(self._ready)):
                source = self._ready.popleft()
                group = source.callback_group
                if group is not None and not group.beginning_execution(source):
                    self._ready.append(source)
                    continue
                item = source._take()
                source._served = next(_turns)
                if source._pending:
                    self._ready.append(source)
                else:
                    source._queued = False
                    if source in self._muted:
                        self._unmute(source)
                if isinstance(source, Timer):
                    self._timer_due = 0
                if item is not None:
                    return _Work(source, item, None)
                if group is not None:
                    group.ending_execution(source)
        return None

    def _mute(self) -> None:
        """Stop waiting for sources whose callbacks cannot run, or the wait would not wait."""
        for source in self._ready:
            if source not in self._muted and source in self._attached:
                self._muted.add(source)
                for condition in self._attached[source][1:]:
                    self._waitset.detach(condition)

    def _unmute(self, source: Source) -> None:
        self._muted.discard(source)
        entry = self._attached.get(source)
        if entry is not None:
            for condition in entry[1:]:
                self._waitset.attach(condition, entry[0])


class SingleThreadedExecutor(Executor):
    """Runs callbacks in the thread that spins."""


class MultiThreadedExecutor(Executor):
    """Runs callbacks in a pool of threads.

    Args:
        num_threads: Number of threads; the number of processors (at least 2) if ``None``.
        context: The context; the default one if ``None``.
    """

    def __init__(self, num_threads: int | None = None, *, context: Context | None = None) -> None:
        super().__init__(context=context)
        count = num_threads if num_threads is not None else max(2, os.cpu_count() or 2)
        self._pool = ThreadPoolExecutor(count, thread_name_prefix="rclpy-executor")

    def _spin_once(self, timeout_ns: int, condition: Callable[[], bool] | None) -> None:
        # As in rclpy, spinning on several threads returns when the context is shut down.
        with suppress(ExternalShutdownException):
            work = self._wait(timeout_ns, condition)
            with _uninterrupted():
                self._pool.submit(self._execute_in_pool, work)

    def _execute_in_pool(self, work: _Work) -> None:
        try:
            self._execute(work)
        except BaseException as error:
            self._errors.append(error)
        self.wake()

    def _finish(self, timeout_sec: float | None) -> bool:
        if timeout_sec is None:
            self._pool.shutdown(wait=threading.current_thread().name[:14] != "rclpy-executor")
            return True
        waiter = threading.Thread(target=self._pool.shutdown, daemon=True)
        waiter.start()
        waiter.join(timeout_sec)
        return not waiter.is_alive()
