"""Work by Dask is the same as one after the other, whatever happens to the workers."""

import os

import pytest
from archive_runs import kill_own_worker_once, work_of_a_while, write_bag
from refused import refused

from stepdiag_ros.archive import engine, work
from stepdiag_ros.archive.engine import Engine, each, local_cluster
from stepdiag_ros.archive.place import Place
from stepdiag_ros.metrology.refusal import Refusal


@pytest.fixture(scope="module")
def cluster():
    """Return the address of a scheduler with two workers."""
    with local_cluster(2) as made:
        yield Engine(scheduler=made.scheduler_address)


def test_each_thing_is_done_once_by_both_workers_and_failures_are_listed(cluster):
    numbers = range(40)
    done = list(each(work_of_a_while, iter(numbers), cluster))
    assert sorted(one.item for one in done) == list(numbers)
    good = [one for one in done if not one.failure]
    assert all(one.value[0] == one.item for one in good)
    assert len({one.value[1] for one in good}) == 2
    here = {one.item: one.failure for one in each(work_of_a_while, numbers[:8], Engine(workers=1))}
    assert {one.item: one.failure for one in done if one.item < 8} == here
    assert [one.item for one in done if one.failure and one.item % 10 != 7] == []


def test_a_worker_keeps_the_memory_that_its_tasks_use_again(cluster):
    done = each(os.getenv, ["MALLOC_TRIM_THRESHOLD_", "OPENBLAS_NUM_THREADS"], cluster)
    kept = {one.item: one.value for one in done}
    assert kept["MALLOC_TRIM_THRESHOLD_"] == os.getenv("MALLOC_TRIM_THRESHOLD_")
    assert kept["OPENBLAS_NUM_THREADS"] is not None  # Dask's other settings stay


def test_a_worker_that_dies_loses_nothing_and_doubles_nothing(cluster, tmp_path):
    items = [(str(tmp_path), number) for number in range(12)]
    done = list(each(kill_own_worker_once, items, cluster))
    assert (tmp_path / "killed").exists()
    assert sorted(one.value for one in done) == list(range(12))


def test_the_catalogue_is_the_same_to_the_byte(cluster, tmp_path):
    bags = [write_bag(tmp_path / f"{n}.mcap", copy=n, streams=n < 2) for n in range(3)]
    written = []
    for name, how in (("one by one", Engine(workers=1)), ("at once", cluster)):
        place = Place(str(tmp_path / name))
        outcomes = list(work.add(place, bags, how))
        assert sorted(one.file for one in outcomes) == ["0.mcap", "1.mcap", "2.mcap"]
        assert [one.file for one in outcomes if one.problem] == ["2.mcap"]
        names = place.names("")
        written.append({one: place.read(one) for one in names})
    assert written[0] == written[1]


def test_a_scheduler_that_is_not_there_or_has_no_workers_is_named(monkeypatch):
    monkeypatch.setattr(engine, "_PATIENCE", 1)
    address = "tcp://127.0.0.1:9"
    with refused(Refusal, "lost", about=address):
        list(each(abs, [1], Engine(scheduler=address)))
    with local_cluster(0) as empty:
        address = empty.scheduler_address
        with refused(Refusal, "not_ready", about=address):
            list(each(abs, [1], Engine(scheduler=address)))


def test_who_has_lost_all_workers_is_not_waited_for(monkeypatch):
    monkeypatch.setattr(engine, "_PATIENCE", 2)
    with local_cluster(1) as made:
        done = each(work_of_a_while, range(1000), Engine(scheduler=made.scheduler_address))
        next(done)
        made.adapt(minimum=0, maximum=0)  # otherwise the cluster makes another worker
        made.scale(0)
        with refused(Refusal, "lost", aspect="workers"):
            list(done)


def test_processes_are_started_where_there_are_several_things():
    found = list(each(work_of_a_while, range(3), Engine(workers=2)))
    assert sorted(one.value[0] for one in found) == [0, 1, 2]
