"""Runs measured by hand: random recordings with and without faults, judged against the truth.

Each case is an NC program on a simulated machine, recorded at 2 to 100 Hz with noise, lag, drift
and a display's steps, with one fault (``test/by_hand/hand_cases.py``). Counted are cases in which a
stop was taken for another (there must be none), lines that the fault did not touch and that gave
nothing all the same, and lines that it did touch but that are whole and of which nothing was said.
A second table compares settled stops found by stillness with those of the same readings when every
command is known. The exit code is 1 if a single stop was taken for another, or too many lines are
lost for nothing.

    python benchmarks/by_hand.py --cases 28
"""

import argparse
import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
_TESTS = Path(__file__).parents[1] / "test"
sys.path[:0] = [str(_TESTS), str(_TESTS / "by_hand")]

import numpy as np  # noqa: E402
from hand_cases import FAULTS, HARMLESS, judge, make_case  # noqa: E402
from hand_values import compared  # noqa: E402

from stepdiag_ros.configuration import load_cell, load_plan  # noqa: E402

MOST_LOST = 2
"""Lines of 28 cases of each fault that may give nothing although nothing went wrong."""


def campaign(cases, first):
    """Return figures of some cases of each fault."""
    figures = {}
    for fault in FAULTS:
        one = dict.fromkeys(
            ("cases", "lines", "touched", "shifted", "unsaid", "lost", "touched_found"), 0
        )
        for seed in range(first, first + cases):
            case = make_case(fault, seed)
            outcome = judge(case)
            one["cases"] += 1
            one["lines"] += len(case.plan.lines)
            one["touched"] += len(case.touched)
            one["shifted"] += bool(outcome.shifted)
            one["unsaid"] += len(outcome.unsaid)
            one["lost"] += len(set(outcome.refused) - case.touched)
            one["touched_found"] += len(set(outcome.taken) & case.touched)
        figures[fault] = one
    return figures


def values():
    """Return how settled stops by stillness compare with those of known commands."""
    found = {}
    for cell in ("demo", "hidden_several"):
        for rate, dwell, window in ((100.0, 1.0, 0.3), (1000.0, 0.5, 0.3), (2.0, 4.0, 2.0)):
            plan = load_plan("quick")[0]
            sampling = replace(plan.sampling, dwell=dwell, window=window)
            differences, uncertainties = compared(
                replace(plan, sampling=sampling), load_cell(cell)[0], rate
            )
            found[f"{cell}, {rate:g} Hz"] = {
                "stops": len(differences),
                "rms_difference_um": float(np.sqrt(np.mean(differences**2))) * 1e6,
                "mean_uncertainty_um": float(np.mean(uncertainties)) * 1e6,
                "rms_of_ratio": float(np.sqrt(np.mean((differences / uncertainties) ** 2))),
            }
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=28, help=f"of each of {len(FAULTS)} faults")
    parser.add_argument("--seed", type=int, default=0, help="of the first case")
    arguments = parser.parse_args()
    began = time.process_time()
    figures = campaign(arguments.cases, arguments.seed)
    total = {key: sum(one[key] for one in figures.values()) for key in figures["none"]}
    document = {
        "faults": figures,
        "total": total,
        "values": values(),
        "processor_seconds": round(time.process_time() - began, 1),
    }
    print(json.dumps(document, indent=2))
    lost = sum(figures[fault]["lost"] for fault in HARMLESS)
    return 1 if total["shifted"] or lost > MOST_LOST else 0


if __name__ == "__main__":
    sys.exit(main())
