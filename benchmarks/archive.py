"""Measures an archive: cost and memory a bag, queries over a million runs, Dask beside a loop.

    python benchmarks/archive.py [--only PART] [--bag RUN.mcap] [--bags N]

growth: bags of some bytes, whose rows are made up, are added by one process; the time of solving,
which is the same for each bag, is left out, so that what grows would show. Processor time, since
other work on the computer does not count in it. driver: tasks that do nothing, on two workers.
queries: rows made by DuckDB; judged by processor time, in which a computer without other work
answers. speed: copies of a bag (``--bag``), evaluated in turns by a loop and by two workers that
have imported everything; ratios are of one round, and need two processors that do nothing else.
``--bags 100 --rounds 10`` re-solves 1,000 bags each way, 100 in turn.
deaths: one of two workers is killed ten times. The exit code is 1 if a bar of the table is missed.
"""

import argparse
import hashlib
import itertools
import json
import os
import random
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from distributed import Client
from mcap.reader import make_reader
from mcap.writer import Writer

sys.path.append(str(Path(__file__).parents[1] / "test"))

from archive_runs import rows_made_up, work_of_a_while

from stepdiag_ros import __version__
from stepdiag_ros.archive import work
from stepdiag_ros.archive.catalogue import Catalogue, write_part
from stepdiag_ros.archive.columns import TABLES
from stepdiag_ros.archive.engine import Engine, each, local_cluster
from stepdiag_ros.archive.place import Place
from stepdiag_ros.archive.rows import Rows

EXAMPLE = Path(__file__).parents[1] / "docs" / "examples" / "small_run.mcap"
_MOST = 10_000
_MACHINES = 400
_RUNS = 1_000_000
_PARTS = 100
_WORST = (
    "select machine, arg_max(largest_m, time) as now from runs group by machine order by now desc"
    " limit 10"
)
_HISTORY = (
    "select time, value, expanded_uncertainty from figures where machine = 'machine 7' and"
    " name = 'positioning E_XX' order by time"
)


def growth(rounds: int) -> Iterator[dict[str, Any]]:
    found: dict[int, list[tuple[float, float]]] = {}
    for _ in range(rounds):
        for bags in (100, 1_000, _MOST):
            found.setdefault(bags, []).append(_alone("add", bags))
    yield from _flat("adding a bag, processor", found)


def driver(rounds: int) -> Iterator[dict[str, Any]]:
    found: dict[int, list[tuple[float, float]]] = {}
    for _ in range(rounds):
        for tasks in (100, 1_000, 10_000):
            found.setdefault(tasks, []).append(_alone("drive", tasks))
    yield from _flat("a task of Dask in the driver, processor", found)


def _flat(what: str, found: dict[int, list[tuple[float, float]]]) -> Iterator[dict[str, Any]]:
    """Return medians for each number of bags, and what the largest is to the smallest."""
    costs = {number: statistics.median(cost for cost, _ in one) for number, one in found.items()}
    peaks = {number: statistics.median(peak for _, peak in one) for number, one in found.items()}
    for name, unit, values in ((what, "ms", costs), (f"{what}: peak memory", "MB", peaks)):
        first, *_, last = values.values()
        told = ", ".join(f"{number}: {value:.1f} {unit}" for number, value in values.items())
        yield {"what": name, "figure": told, "bar": "flat within 10 %", "met": last <= 1.1 * first}


def _alone(part: str, number: int) -> tuple[float, float]:
    """Return what a process of its own has measured: ms for each, and its peak memory, MB."""
    command = [sys.executable, __file__, "--part", part, str(number)]
    cost, peak = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    return cost, peak


def add(number: int) -> None:
    """Add bags with rows that are made up; print ms for each and peak memory."""
    work.rows_of_bag = rows_made_up
    with tempfile.TemporaryDirectory() as folder:
        # As many names each time: the list that is given is no part of what grows.
        names = [Path(folder) / f"{one}.mcap" for one in range(_MOST + 1)]
        bags = names[: number + 1]
        for bag in bags:
            bag.write_bytes(bag.name.encode())
        place = Place(f"{folder}/archive")
        list(work.add(place, bags[:1], Engine(workers=1)))  # imports what is imported late
        started = time.process_time()
        for outcome in work.add(place, bags[1:], Engine(workers=1)):
            assert outcome.evaluated
        _tell(1e3 * (time.process_time() - started) / number)


def drive(number: int) -> None:
    """Give tasks to two workers; print ms of this process for each and peak memory."""
    with _two_workers() as client:
        here = Engine(scheduler=client.scheduler.address)
        list(each(abs, range(-100, 0), here))
        started = time.process_time()
        assert sum(1 for _ in each(abs, iter(range(number)), here)) == number
        _tell(1e3 * (time.process_time() - started) / number)


def _tell(cost: float) -> None:
    print(json.dumps([cost, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024]))


def queries(rounds: int) -> Iterator[dict[str, Any]]:
    with tempfile.TemporaryDirectory() as folder:
        place = Place(f"{folder}/archive")
        _make_runs(place)
        for what, query in (("worst machines now", _WORST), ("one machine's history", _HISTORY)):
            times = []
            for _ in range(rounds):
                started, used = time.monotonic(), time.process_time()
                with Catalogue(place) as catalogue:
                    rows = catalogue.ask(query)
                times.append((time.monotonic() - started, time.process_time() - used))
            assert len(rows) == (10 if query is _WORST else _RUNS // _MACHINES)
            took, used = (statistics.median(column) for column in zip(*times, strict=True))
            told = f"{took:.2f} s with opening the catalogue, {used:.2f} s of processor"
            yield {"what": f"{what}, {_RUNS:,} runs", "figure": told, "bar": "< 1 s",
                   "met": used < 1.0}  # fmt: skip


def _make_runs(place: Place) -> None:
    """Write parts of rows that are made up, five figures a run, sorted as packing sorts them."""
    with tempfile.TemporaryDirectory() as folder:
        write_part(place, "0-none", Rows())
        with Catalogue(place) as catalogue:
            for number in range(_PARTS):
                part = f"{_RUNS // _PARTS}-{number:016x}"
                first, last = number * _RUNS // _PARTS, (number + 1) * _RUNS // _PARTS
                run = (
                    f"select '{part}' as part, sha256(i::varchar) as bag_sha256, 'run ' || i as"
                    f" run_id, 'machine ' || (i % {_MACHINES}) as machine, timestamptz"
                    " '2020-01-01 00:00:00+00' + interval (i) minute as start_time, 1 as"
                    f" run_number, '{__version__}' as software_version, random() * 1e-5 as"
                    f" largest_m from range({first}, {last}) t(i)"
                )
                figure = (
                    f"select part, bag_sha256, run_id, machine, start_time, name, 'single' as kind,"
                    f" random() * 1e-5 as value, 1e-6 as expanded_uncertainty from ({run}), (values"
                    " ('positioning E_XX'), ('E_YY'), ('E_ZZ'), ('C0Y'), ('B0Z')) as v(name)"
                )
                nothing = "select * from every_curves"
                for table, made, order in (
                    ("curves", nothing, "machine"),
                    ("figures", figure, "machine, kind, name, start_time"),
                    ("runs", run, "machine, start_time"),
                ):
                    if table != "curves":
                        made = f"from every_{table} where false union all by name {made}"
                    target = Path(folder) / table
                    form = "(format parquet, compression zstd)"
                    catalogue.ask(f"copy ({made} order by {order}) to '{target}' {form}")
                    place.put(target, f"catalogue/1/{table}/{part}.parquet")


@contextmanager
def _two_workers() -> Iterator[Any]:
    with local_cluster(2) as cluster, Client(cluster) as client:
        yield client


def _copies(bag: Path, folder: Path, number: int) -> list[Path]:
    """Return copies of a bag that differ in a word of their first record."""
    made = [folder / f"{one}.mcap" for one in range(number)]
    for path in made:
        with bag.open("rb") as source, path.open("wb") as target:
            reader, writer = make_reader(source), Writer(target)
            summary, header = reader.get_summary(), reader.get_header()
            assert summary is not None
            writer.start(profile=header.profile, library=f"{header.library}, copy {path.stem}")
            schemas = {
                one.id: writer.register_schema(one.name, one.encoding, one.data)
                for one in summary.schemas.values()
            }
            channels = {
                one.id: writer.register_channel(
                    one.topic, one.message_encoding, schemas[one.schema_id], one.metadata
                )
                for one in summary.channels.values()
            }
            for record in reader.iter_metadata():
                writer.add_metadata(record.name, record.metadata)
            for _, channel, one in reader.iter_messages(log_time_order=False):
                channel_id = channels[channel.id]
                writer.add_message(
                    channel_id, one.log_time, one.data, one.publish_time, one.sequence
                )
            writer.finish()
    return made


def speed(rounds: int, bag: Path, bags: int) -> Iterator[dict[str, Any]]:
    """Compare a loop with two workers; the rows that they write must be equal to the bit."""
    ratios, costs, rows = [], [], []
    whole = [0.0, 0.0]

    def used() -> float:
        return time.process_time() + sum(client.run(time.process_time).values())

    with tempfile.TemporaryDirectory() as folder, _two_workers() as client:
        files = _copies(bag, Path(folder), bags)
        source = Place(f"{folder}/source")
        both = Engine(scheduler=client.scheduler.address), Engine(workers=1)
        list(work.add(source, files, both[0]))  # workers import what they need
        for number in range(rounds + 1):
            took, spent = [], []
            for engine in both:
                for name in source.names("catalogue"):
                    source.remove(name)
                started, before = time.monotonic(), used()
                list(work.update(source, engine)[1])
                took.append(time.monotonic() - started)
                spent.append(used() - before)
                rows.append(_rows(source))
            if number:  # the first is to warm up
                ratios.append(took[1] / took[0])
                whole = [sum(pair) for pair in zip(whole, took, strict=True)]
                costs.append(spent[0] / spent[1])
    equal = all(one == rows[0] for one in rows)
    told = f"median {statistics.median(ratios):.2f} x, {[round(one, 2) for one in ratios]}"
    told += f"; in all {whole[1]:.0f} s alone, {whole[0]:.0f} s with two"
    bar = ">= 1.8 x, equal to the bit"
    met = equal and statistics.median(ratios) >= 1.8
    what = f"two workers beside a loop, {bags} bags"
    told += f", equal: {equal}; processor time {statistics.median(costs):.2f} x that of the loop"
    yield {"what": what, "figure": told, "bar": bar, "met": met}


def _rows(place: Place) -> dict[str, str]:
    """Return a digest of the rows of each table, in whatever parts they are."""
    with Catalogue(place) as catalogue:
        return {
            table: hashlib.sha256(
                repr(
                    catalogue.ask(f"select * exclude (part) from rows_{table} order by all")
                ).encode()
            ).hexdigest()
            for table in TABLES
        }


def deaths(_: int, kills: int = 10) -> Iterator[dict[str, Any]]:
    """Kill one of two workers as soon as both have done something since the last was killed."""
    chance, killed, done = random.Random(1), [], []
    working: set[int] = set()
    with _two_workers() as client:
        more = itertools.takewhile(lambda _: len(killed) < kills, itertools.count())
        for one in each(work_of_a_while, more, Engine(scheduler=client.scheduler.address)):
            done.append(one)
            if one.value and one.value[1] not in killed:
                working.add(one.value[1])
            if len(working) == 2 and len(killed) < kills:
                killed.append(chance.choice(sorted(working)))
                os.kill(killed[-1], signal.SIGKILL)
                working.clear()
    count = Counter(one.item for one in done)
    wrong = [one for one in done if one.failure and one.item % 10 != 7]
    whole = sorted(count) == list(range(len(count))) and set(count.values()) == {1} and not wrong
    told = f"{len(killed)} killed in {len(count)} tasks; each done once: {whole}"
    yield {"what": "1 of 2 workers killed", "figure": told, "bar": "nothing lost, nothing twice",
           "met": whole and len(killed) == kills}  # fmt: skip


PARTS = {one.__name__: one for one in (growth, driver, queries, speed, deaths)}
ALONE = {"add": add, "drive": drive}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=PARTS, action="append")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--bag", type=Path, default=EXAMPLE, help="copied for speed")
    parser.add_argument("--bags", type=int, default=12, help="copies for speed, each round")
    parser.add_argument("--part", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.part:
        ALONE[arguments.part[0]](int(arguments.part[1]))
        return 0
    table = []
    for name in arguments.only or PARTS:
        further = (arguments.bag, arguments.bags) if name == "speed" else ()
        for row in PARTS[name](arguments.rounds, *further):
            print(f"{row['what']}: {row['figure']}", file=sys.stderr)
            table.append(row)
    print(json.dumps(table, indent=2))
    return int(not all(row["met"] for row in table))


if __name__ == "__main__":
    sys.exit(main())
