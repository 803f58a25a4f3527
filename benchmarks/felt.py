"""What a user waits for, in this checkout and beside it in another one, as a table.

The two take turns within each round, so that what else the computer does slows both. Every row is
the median of the rounds. Without ``--before`` there is one column; nothing is judged.

    python benchmarks/felt.py RUN.mcap [--before DIR] [--rounds 5] [--json]

RUN.mcap is a run of ``stepdiag demo``. The other checkout runs in this Python, with the libraries
that this one has.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from shared import ONE_CORE

HERE = Path(__file__).parents[1]


class Row(NamedTuple):
    """What is measured: its name, unit and bar, and the arguments of ``stepdiag`` or the solver."""

    name: str
    unit: str
    bar: float
    arguments: tuple[str, ...]


ROWS = (
    Row("one least-squares solve, 36 blocks, four diagonals", "ms", 8, ("least_squares", "36")),
    Row("rigid body, 25 blocks, four diagonals, three orders", "ms", 60, ("rigid_body", "25", "3")),
    Row("stepdiag solve", "s", 2.5, ("solve", "RUN")),
    Row("stepdiag diagnose, processor time", "s of processor", 2.5, ("diagnose", "RUN")),
    Row("stepdiag report: HTML, PDF and JSON", "s", 4, ("report", "RUN", "--output", "FOLDER")),
    Row("stepdiag replay", "× real time", 200, ("replay", "RUN", "--rate", "0", "--json")),
)


def solver_ms(method: str, blocks: str, orders: str = "1") -> float:
    """Return the median time of a solve by the package that this process imports, ms."""
    from shared import simulated

    from stepdiag_ros.metrology.solvers import solve

    _, measured = simulated(int(blocks), 1, int(orders))
    solve(measured, method)
    times = []
    for _ in range(15):
        begin = time.perf_counter()
        solve(measured, method)
        times.append(time.perf_counter() - begin)
    return 1e3 * statistics.median(times)


def measured(row: Row, checkout: Path, bag: Path) -> float:
    """Return the figure of a row, measured once in a fresh process."""
    paths = os.pathsep.join([str(checkout), str(Path(__file__).parent)])
    environment = {**os.environ, "PYTHONPATH": paths}
    # An installed package is compiled once, not by each command.
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    if row.unit == "ms":
        command = [sys.executable, __file__, "--solver", *row.arguments]
        done = subprocess.run(
            command, env=environment | ONE_CORE, check=True, capture_output=True, text=True
        )
        return float(done.stdout)
    with tempfile.TemporaryDirectory() as folder:
        given = {"RUN": str(bag), "FOLDER": folder}
        arguments = [given.get(one, one) for one in row.arguments]
        before, began = _processor(), time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "stepdiag_ros.cli", *arguments],
            env=environment,
            cwd=folder,
            capture_output=True,
            text=True,
        )
        seconds = time.perf_counter() - began
    if done.returncode:
        sys.exit(f"{checkout}: stepdiag {row.arguments[0]}: {done.stderr.strip()}")
    if row.unit == "s of processor":
        return _processor() - before
    if row.unit == "× real time":
        return float(json.loads(done.stdout)["recorded_seconds"]) / seconds
    return seconds


def _processor() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", nargs="?", type=Path, help="a run of stepdiag demo")
    parser.add_argument("--before", type=Path, help="another checkout")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--solver", nargs="+", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.solver:
        print(solver_ms(*arguments.solver))
        return
    if arguments.bag is None or not arguments.bag.is_file():
        parser.error("give the bag of a run of stepdiag demo")
    bag = arguments.bag.resolve()
    checkouts = {"before": arguments.before, "now": HERE} if arguments.before else {"now": HERE}
    rows = []
    for row in ROWS:
        found: dict[str, list[float]] = {name: [] for name in checkouts}
        for _ in range(arguments.rounds):
            for name, checkout in checkouts.items():
                found[name].append(measured(row, checkout.resolve(), bag))
        medians = {name: round(statistics.median(one), 2) for name, one in found.items()}
        rows.append({"what": row.name, "unit": row.unit, "bar": row.bar, **medians})
        print(rows[-1], file=sys.stderr, flush=True)
    if arguments.json:
        print(json.dumps(rows, indent=2))
        return
    columns = ("what", "unit", *checkouts, "bar")
    lines = [columns, ["---"] * len(columns), *([str(one[key]) for key in columns] for one in rows)]
    for cells in lines:
        print(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
