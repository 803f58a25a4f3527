"""Work in a process beside this one, such as drawing while this one computes."""

import gc
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from typing import TypeVar

from stepdiag_ros.metrology.refusal import Unusable

Made = TypeVar("Made")


@contextmanager
def process_beside(get_ready: Callable[[], None]) -> Iterator[ProcessPoolExecutor]:
    """Start a process that works while the block runs.

    Args:
        get_ready: imports what the work needs, in the process.
    """
    # A new interpreter: what was forked from a process with threads may hang.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        with interrupts_held():
            pool.submit(_begin, get_ready)
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _begin(get_ready: Callable[[], None]) -> None:
    # What is imported stays until the end: looking through it for unused cycles is in vain.
    gc.disable()
    get_ready()
    gc.freeze()
    gc.enable()


def result_of(begun: Future[Made]) -> Made:
    """Wait for a piece of work of the process that draws.

    Raises:
        OSError: the process has ended.
    """
    try:
        return begun.result()
    except BrokenProcessPool:
        raise Unusable(
            "the process that draws the pictures has ended before it was done: is there enough"
            " memory?",
            fault="stopped",
        ) from None


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back while a process is started, which then never gets it.

    A terminal sends it to both. The other process ends when this one ends the pool; by itself it
    would end with a traceback. What is blocked stays so in a new process from its first
    instruction on, which no function that it runs could bring about.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    # A thread of a numerical library may take the signal in spite of that, and Python would then
    # raise it here, with the new process half begun.
    come: list[int] = []
    handler = None
    if threading.current_thread() is threading.main_thread():
        handler = signal.signal(signal.SIGINT, lambda number, _: come.append(number))
    try:
        yield
    finally:
        if handler is not None:
            signal.signal(signal.SIGINT, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    if come:
        signal.raise_signal(signal.SIGINT)
