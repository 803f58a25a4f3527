"""The blind test of the discrepancy workflow in full: confusion matrix and figures, as JSON.

Cases come from a generator that knows nothing of the project (``test/blind``); every truth is
sealed until all verdicts are in. Stopped, it goes on where it was when started again with the same
folder. The exit code is 1 if a figure, its bounds taken into account, misses what it must be.

    python benchmarks/blind.py --folder FOLDER --write docs/blind.md
    python benchmarks/blind.py --folder FOLDER --runs none=20,one=10 --seed 500
    python benchmarks/blind.py --folder FOLDER --runs none=20,one=10 --many none=40,outside=15
    python benchmarks/blind.py --folder FOLDER --class outside --seed 5 --runs 1
"""

import argparse
import json
import os
import sys
import time
from importlib.metadata import version
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "test" / "blind"))

from blind_cases import CLASSES, LARGEST  # noqa: E402
from blind_document import not_right, put_into, results, table_of_seconds  # noqa: E402
from blind_figures import (  # noqa: E402
    as_table,
    by_kind,
    confusion,
    figures,
    missed,
    seconds_by_class,
)
from blind_schedule import blind_test, processor_time, wanted_cases  # noqa: E402

WHOLE = "none=100,one=160,two=80,outside=150,pair=60,unseen=30,gross=60"
"""The whole test: null runs of the classes one, two and pair bring those of none to 400."""
REPEATS = 12
"""That plans of many repeats have at least."""


def runs_of(text, classes):
    """Return class → number of runs of ``none=20,one=10``, or of ``20`` for each class.

    Raises:
        ValueError: a class that there is not, or no number.
    """
    if text.isdigit():
        return dict.fromkeys(classes, int(text))
    runs = {}
    for part in text.split(","):
        kind, _, count = part.partition("=")
        if kind not in CLASSES or not count.isdigit():
            raise ValueError(f"'{part}': expected CLASS=NUMBER with one of {', '.join(CLASSES)}")
        runs[kind] = int(count)
    return {kind: count for kind, count in runs.items() if kind in classes}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, required=True, help="of cases, seals and verdicts")
    parser.add_argument("--runs", default=WHOLE, help=f"of each class, such as {WHOLE}, or 20")
    parser.add_argument(
        "--many",
        default="",
        help=f"runs with {REPEATS} and more repeats, such as none=40,outside=15",
    )
    parser.add_argument("--class", dest="classes", action="append", choices=CLASSES)
    parser.add_argument("--seed", type=int, default=0, help="of the first case of each class")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--largest", type=int, default=LARGEST, help="readings of a run at most")
    parser.add_argument("--write", type=Path, help="document whose marked part gets the results")
    arguments = parser.parse_args()
    try:
        runs = runs_of(arguments.runs, arguments.classes or CLASSES)
        many = runs_of(arguments.many, CLASSES) if arguments.many else {}
    except ValueError as error:
        parser.error(str(error))
    wanted = wanted_cases(runs, arguments.seed)
    wanted += wanted_cases(many, arguments.seed, REPEATS)
    expected = processor_time(wanted) / 60.0
    begin = time.perf_counter()

    def progress(line):
        print(f"{time.perf_counter() - begin:7.0f} s  {line}", file=sys.stderr, flush=True)

    progress(
        f"{len(wanted)} cases: about {expected:.0f} min of processor time, "
        f"{expected / arguments.processes:.0f} min on {arguments.processes} processes"
    )
    judged = blind_test(arguments.folder, wanted, arguments.processes, arguments.largest, progress)
    counted = figures(judged)
    failures = missed(counted)
    told = [
        f"stepdiag_ros {version('stepdiag_ros')}, seeds from {arguments.seed} on, runs of at most "
        f"{arguments.largest:,} readings: "
        + ", ".join(f"{count} {kind}" for kind, count in runs.items())
        + "".join(f", {count} {kind} of many repeats" for kind, count in many.items())
        + f"; {len(judged)} verdicts.",
    ]
    if arguments.write:
        put_into(arguments.write, results(judged, told))
    print(as_table(confusion(judged), "hidden"), file=sys.stderr)
    print(as_table(by_kind(judged), "hidden, at 2 × or more"), file=sys.stderr)
    print(table_of_seconds(judged), file=sys.stderr)
    document = {
        "runs": len(judged),
        "seconds": round(time.perf_counter() - begin, 1),
        "figures": counted,
        "missed": failures,
        "confusion": confusion(judged),
        "by_kind": by_kind(judged),
        "seconds_by_class": seconds_by_class(judged),
        "not_right": [
            {
                "name": one["name"],
                "outcome": one["outcome"],
                "after_plan": one["after_plan"],
                "truth": {
                    key: one["truth"].get(key)
                    for key in ("level", "hidden", "gross", "sizes", "plan", "noise")
                },
                "verdict": one["verdict"]["verdict"],
                "description": one["verdict"].get("description"),
                "sentence": one["verdict"].get("sentence"),
                "lack_of_fit_p": one["verdict"].get("lack_of_fit_p"),
            }
            for one in not_right(judged)
        ],
    }
    print(json.dumps(document, indent=2))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
