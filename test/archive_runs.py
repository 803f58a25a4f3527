"""Runs for archives: rows made up, small bags, and work in which a process can be killed."""

import hashlib
import os
import signal
import time
from datetime import datetime, timedelta, timezone
from pathlib import Path

from stepdiag_ros import __version__
from stepdiag_ros.archive import catalogue, work
from stepdiag_ros.archive.columns import Curve, Figure, Run
from stepdiag_ros.archive.engine import Engine
from stepdiag_ros.archive.place import Place
from stepdiag_ros.archive.rows import Rows

BEGAN = datetime(2025, 3, 1, tzinfo=timezone.utc)
FIGURES = ("C0Y", "positioning E_XX")


def made_up(sha256: str, part: str, **changes) -> Rows:
    """Return rows of one run that follow from the digest of its bag."""
    number = int(sha256[:6], 16)
    key = {
        "part": part,
        "bag_sha256": sha256,
        "run_id": f"run {sha256[:8]}",
        "machine": f"machine {number % 3}",
        "serial_number": None,
        "start_time": BEGAN + timedelta(hours=number % 10_000),
    }
    key.update({name: changes.pop(name) for name in list(changes) if name in key})
    run = dict.fromkeys(Run.__dataclass_fields__) | key
    run |= {"run_number": 1, "file": "a.mcap", "effects": (), "software_version": __version__}
    run |= {"largest_m": number * 1e-12, "figure_count": len(FIGURES), "curve_count": 1}
    figures = [
        Figure(
            **key, kind="result", method="least_squares", name=name, unit="m", value=number * 1e-12,
            standard_uncertainty=1e-7, scatter_standard_uncertainty=None,
            expanded_uncertainty=2e-7, low=-1e-6, high=1e-6,
            relied_on=True,
        )
        for name in FIGURES
    ]  # fmt: skip
    curve = Curve(
        **key, method="least_squares", name="E_XX", unit="m", position_m=[0.0, 0.1],
        value=[0.0, None], standard_uncertainty=[0.0, None], relied_on=True,
    )  # fmt: skip
    return Rows([Run(**run | changes)], figures, [curve])


def digest(number: int) -> str:
    """Return a digest like that of a bag."""
    return hashlib.sha256(str(number).encode()).hexdigest()


def filled(place: Place, numbers, **changes) -> Place:
    """Write a part for each number, as a worker writes that of a bag."""
    for number in numbers:
        sha256 = digest(number)
        version = changes.get("software_version", __version__)
        part = catalogue._part(1, (sha256, version))
        catalogue.write_part(place, part, made_up(sha256, part, **changes))
    return place


def write_bag(path: Path, *, copy: int = 0, streams: bool = False, described=({},)) -> Path:
    """Write a bag: the small run, or only what describes a run, which cannot be evaluated.

    Args:
        path: of the bag.
        copy: number that changes its content.
        streams: with everything that the run has recorded.
        described: for each run what its description states otherwise.
    """
    # Not for the processes that are killed: it takes time to import.
    from small_run import RUN_ID, START, small_stream

    from stepdiag_ros import topics
    from stepdiag_ros.bags.header import RunHeader
    from stepdiag_ros.bags.types import own_types
    from stepdiag_ros.bags.writer import BagWriter

    facts = {"copy": str(copy)}
    header = RunHeader(RUN_ID, "small", __version__, 1, "none", START, facts=facts)
    wanted = topics.RUN_DESCRIPTION
    with BagWriter(path, header) as bag:
        for at, topic, data in small_stream():
            if topic is wanted:
                for changes in described:
                    message = own_types().decode(topic.type_name, data)
                    for name, value in changes.items():
                        setattr(message, name, value)
                    content = own_types().encode(topic.type_name, message)
                    bag.write(topics.absolute(topic), topic.type_name, content, at, at)
            elif streams:
                bag.write(topics.absolute(topic), topic.type_name, data, at, at)
    return path


def rows_made_up(path: Path, sha256: str, part: str) -> Rows:
    """Take the place of ``rows_of_bag`` where the time of solving does not matter."""
    return made_up(sha256, part, file=path.name)


def add_made_up(url: str, bags: list[Path], kept: timedelta, begun) -> None:
    """Add bags whose rows are made up, and set an event first; the target of a process."""
    work.rows_of_bag = rows_made_up
    catalogue.FEW, catalogue.KEPT = 3, kept
    begun.set()
    for outcome in work.add(Place(url), bags, Engine(workers=1)):
        assert not outcome.problem, outcome


def work_of_a_while(item: int) -> tuple[int, int]:
    """Return the item and which process had it; refuse every tenth."""
    time.sleep(0.2)
    if item % 10 == 7:
        raise ValueError(f"{item} is refused")
    return item, os.getpid()


def kill_own_worker_once(item: tuple[str, int]) -> int:
    """Kill the process of the worker at the first time that any task of a folder runs."""
    folder, number = item
    try:
        with Path(folder, "killed").open("x"):
            os.kill(os.getpid(), signal.SIGKILL)
    except FileExistsError:
        return number
    return -1
