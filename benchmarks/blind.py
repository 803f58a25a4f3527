"""The blind test of the discrepancy workflow in full: confusion matrix and figures, as JSON.

Cases come from a generator that knows nothing of the project (``test/blind``); every truth is
sealed until all verdicts are in. Stopped, it goes on where it was when started again with the same
folder. The exit code is 1 if a figure, its bounds taken into account, misses what it must be.

    python benchmarks/blind.py --folder FOLDER [--runs 200] [--class none --class one] [--seed 0]
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "test" / "blind"))

from blind_cases import CLASSES, LARGEST, LEVELS  # noqa: E402
from blind_figures import as_table, by_kind, confusion, figures, missed  # noqa: E402
from blind_harness import blind_test  # noqa: E402


def wanted_cases(runs, classes, seed):
    """Return (class, seed, level) of each case: half the levels' runs at 2 x the limit."""
    levels = (*LEVELS, 2.0, 2.0)
    cases = []
    for kind in classes:
        for number in range(runs):
            level = levels[number % len(levels)] if kind in ("one", "pair") else None
            cases.append((kind, seed + number, level))
    return cases


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, required=True, help="of cases, seals and verdicts")
    parser.add_argument("--runs", type=int, default=200, help="of each class")
    parser.add_argument("--class", dest="classes", action="append", choices=CLASSES)
    parser.add_argument("--seed", type=int, default=0, help="of the first case of each class")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--largest", type=int, default=LARGEST, help="readings of a run at most")
    parser.add_argument("--wrong", action="store_true", help="list every case that was not right")
    arguments = parser.parse_args()

    begin = time.perf_counter()

    def progress(line):
        print(f"{time.perf_counter() - begin:7.1f} s  {line}", file=sys.stderr, flush=True)

    wanted = wanted_cases(arguments.runs, arguments.classes or CLASSES, arguments.seed)
    judged = blind_test(arguments.folder, wanted, arguments.processes, arguments.largest, progress)
    counted = figures(judged)
    failures = missed(counted)
    print(as_table(confusion(judged), "hidden"), file=sys.stderr)
    print(as_table(by_kind(judged), "hidden, at 2 x or more"), file=sys.stderr)
    document = {
        "runs": len(judged),
        "seconds": round(time.perf_counter() - begin, 1),
        "figures": counted,
        "missed": failures,
        "confusion": confusion(judged),
        "by_kind": by_kind(judged),
    }
    if arguments.wrong:
        document["not_right"] = [
            {
                "name": one["name"],
                "outcome": one["outcome"],
                "level": one["truth"]["level"],
                "hidden": one["truth"]["hidden"],
                "sizes": one["truth"]["sizes"],
                "plan": one["truth"]["plan"],
                "verdict": one["verdict"]["verdict"],
                "named": [
                    [finding["label"], *finding["ambiguous"][:4]]
                    for finding in one["verdict"]["findings"]
                ],
                "lack_of_fit_p": one["verdict"].get("lack_of_fit_p"),
            }
            for one in judged
            if not one["outcome"].startswith("right")
        ]
    print(json.dumps(document, indent=2))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
