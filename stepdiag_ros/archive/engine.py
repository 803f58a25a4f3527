"""The same work on many things, by Dask: in processes on this computer, or on a cluster."""

import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain, islice
from typing import Any, Generic, TypeVar

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.text.sentence import sentence

Item = TypeVar("Item")
Value = TypeVar("Value")
_AHEAD = 4
"""Tasks that each thread of a worker is given in advance. Only these are held at a time."""
_PATIENCE = 30
"""s to wait for a scheduler, for its first worker, and for another one after the last is lost."""
_LOOK = 1.0
"""s between two looks whether there are workers, while none has done anything."""


@dataclass(frozen=True)
class Engine:
    """Where work is done.

    Attributes:
        workers: processes on this computer; 0: as many as it has processors.
        scheduler: address of the scheduler of a cluster that is there; empty: this computer.
    """

    workers: int = 0
    scheduler: str = ""


@dataclass(frozen=True)
class Done(Generic[Item, Value]):
    """What has become of one thing.

    Attributes:
        item: the thing.
        value: what the work has returned; None if it has failed.
        failure: why it has failed, in a sentence; empty if it has not.
    """

    item: Item
    value: Value | None = None
    failure: str = ""


def each(
    work: Callable[[Item], Value], items: Iterable[Item], engine: Engine
) -> Iterator[Done[Item, Value]]:
    """Do the same work on each thing, one task each, and yield what is done as it is done.

    One thing alone, or with one worker all of them, are done in this process, in their order. A
    task whose worker dies is done by another one (Dask). Work on one thing that fails does not
    disturb the others.

    Args:
        work: a function of a module that the workers can import; with the same thing it returns the
            same, so that it does not matter if it is done again.
        items: no two of them equal; taken as workers become free.
        engine: where.

    Raises:
        ValueError: the scheduler cannot be reached, or has no worker, or all workers are lost.
    """
    rest = iter(items)
    first = list(islice(rest, 2))
    workers = engine.workers or len(os.sched_getaffinity(0))
    if not engine.scheduler and (workers == 1 or len(first) < 2):
        for item in chain(first, rest):
            try:
                yield Done(item, work(item))
            except Exception as error:
                yield Done(item, failure=sentence(error))
        return
    with _client(engine.scheduler, workers) as client:
        yield from _by_dask(work, chain(first, rest), client)


def _by_dask(
    work: Callable[[Item], Value], items: Iterator[Item], client: Any
) -> Iterator[Done[Item, Value]]:
    from distributed import as_completed

    ahead = _AHEAD * max(1, sum(client.nthreads().values()))
    given: dict[str, Item] = {}

    def futures(number: int) -> Iterator[Any]:
        for item in islice(items, number):
            future = client.submit(work, item)
            given[future.key] = item
            yield future

    running = as_completed(futures(ahead))
    while not running.is_empty():
        _wait(running, client)
        future = next(running)
        item = given.pop(future.key)
        if future.status == "finished":
            done = Done(item, future.result())
        else:
            done = Done(item, failure=sentence(future.exception()))
        del future
        yield done
        running.update(futures(1))


def _wait(running: Any, client: Any) -> None:
    """Wait until a task is done.

    Raises:
        ValueError: there has been no worker for some time, so that none will ever be.
    """
    alone, looked = time.monotonic(), 0.0
    while not running.has_ready():
        if time.monotonic() - looked > _LOOK:
            looked = time.monotonic()
            if client.nthreads():
                alone = looked
            elif looked - alone > _PATIENCE:
                raise Refusal(
                    f"all workers are lost, and none has come for {_PATIENCE} s: give the command"
                    " again; what is done stays done",
                    fault="lost",
                    aspect="workers",
                )
        time.sleep(0.005)


@contextmanager
def _client(scheduler: str, workers: int) -> Iterator[Any]:
    """Give a client of a cluster: of one that is there, or of processes that end with the block."""
    from distributed import Client

    if scheduler:
        try:
            client = Client(scheduler, timeout=_PATIENCE)
        except (OSError, ValueError) as error:
            raise Refusal(
                f"the scheduler {scheduler} does not answer: {sentence(error)}",
                fault="lost",
                about=scheduler,
            ) from None
        with client:
            try:
                client.wait_for_workers(1, timeout=_PATIENCE)
            except TimeoutError:
                raise Refusal(
                    f"the scheduler {scheduler} has no worker: start some with 'dask worker"
                    f" {scheduler}'",
                    fault="not_ready",
                    about=scheduler,
                ) from None
            yield client
        return
    with local_cluster(workers) as cluster, Client(cluster) as client:
        yield client


@contextmanager
def local_cluster(workers: int) -> Iterator[Any]:
    """Give a cluster of processes of this computer, which listen on loopback, until the block ends.

    A worker that dies is started again by its nanny. A nanny gives up if that one dies while it
    starts; then the cluster makes another, so that it has all its workers to the end.
    """
    import dask.config
    from distributed import LocalCluster

    settings = {
        # Dask has workers return every freed array to the system at once. An evaluation makes and
        # frees thousands; fetching their pages again took a tenth of its time, and more of it where
        # two workers do so.
        "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
        # Nobody looks at the profile that a worker takes of itself a hundred times a second.
        "distributed.worker.profile.enabled": False,
        # Records of the last thousand events of each kind fill up over ten thousand bags.
        "distributed.admin.low-level-log-length": 10,
        "distributed.diagnostics.computations.max-history": 1,
    }
    with (
        dask.config.set(settings),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            silence_logs="CRITICAL",
        ) as made,
    ):
        made.adapt(minimum=workers, maximum=workers)
        yield made
