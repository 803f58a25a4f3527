"""Coverage of every estimator that states a ±, on worst plausible machines, as a table and JSON.

Every machine has all kinds of errors at once (``test/bands/plausible_machines.py``). A row counts
how many true values lie inside value ± U, and how many values the estimator says to be unknown. The
exit code is 1 if a band is too narrow: the whole interval of its coverage lies below 93 %.

    python benchmarks/coverage.py --machines 200 --write docs/methods.md
    python benchmarks/coverage.py --machines 50 --without rotations --without air
    python benchmarks/coverage.py --first 17 --machines 1
"""

import argparse
import json
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
_TESTS = Path(__file__).parents[1] / "test"
sys.path[:0] = [str(_TESTS / "bands"), str(_TESTS / "blind")]

import numpy as np  # noqa: E402
from band_rows import all_rows  # noqa: E402
from band_table import NARROW, as_table, counted, summaries  # noqa: E402
from blind_document import put_into  # noqa: E402
from plausible_machines import PARTS, draw  # noqa: E402

BEGIN = "<!-- results of benchmarks/coverage.py: begin; written by it, not by hand -->"
END = "<!-- results of benchmarks/coverage.py: end -->"


def rows_of(seed, without):
    """Return the counts of every row on one machine."""
    return {row: counted(*both) for row, both in all_rows(draw(seed, without)).items()}


def measure(seeds, without, processes, progress):
    """Return the counts of every row, machine by machine in the order of the seeds."""
    begin, found = time.perf_counter(), []
    with ProcessPoolExecutor(processes) as pool:
        for rows in pool.map(rows_of, seeds, [without] * len(seeds)):
            found.append(rows)
            passed = time.perf_counter() - begin
            left = passed / len(found) * (len(seeds) - len(found))
            progress(f"{passed:6.0f} s  machine {len(found)}/{len(seeds)}, {left:.0f} s left")
    names = dict.fromkeys(row for rows in found for row in rows)
    return {row: np.array([rows[row] for rows in found if row in rows]) for row in names}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--machines", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="seed of the first machine")
    parser.add_argument("--without", action="append", choices=PARTS, default=[], help="leave out")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--write", type=Path, help="document whose marked part gets the table")
    arguments = parser.parse_args()

    def progress(line):
        print(line, file=sys.stderr, flush=True)

    seeds = range(arguments.first, arguments.first + arguments.machines)
    found = summaries(measure(seeds, tuple(arguments.without), arguments.processes, progress))
    table = as_table(found)
    if arguments.write:
        told = f"stepdiag_ros {version('stepdiag_ros')}, {len(seeds)} machines"
        told += f" without {', '.join(arguments.without)}" if arguments.without else ""
        told += f", seeds from {arguments.first} on:"
        put_into(arguments.write, "\n".join([BEGIN, told, "", table, "", END]))
    progress(table)
    narrow = [row for row, one in found.items() if one["says"] == NARROW]
    print(json.dumps({"machines": arguments.machines, "rows": found, "narrow": narrow}, indent=2))
    return 1 if narrow else 0


if __name__ == "__main__":
    sys.exit(main())
