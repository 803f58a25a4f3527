"""Do the uncertainties of the tracker hold? Random machines with every kind of error at once.

For each estimate with a ±: the share of true values inside ± U, the rms of (value - truth)/u, and
the median U. Machines: any chain, positioning, straightness, nine angles, lost motion, a zero and a
scale of the lengths that differ from pass to pass, a common scale of the lengths, noise and
repeatability; waves or bows; six volumes and places of the tracker in turn.

    python benchmarks/tracker_coverage.py --machines 200
"""

import argparse
import json
import os
import sys
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
_TESTS = Path(__file__).parents[1] / "test"
sys.path[:0] = [str(_TESTS), str(_TESTS / "metrology" / "tracker")]

import numpy as np  # noqa: E402
from random_machines import PLACES, any_measurement  # noqa: E402
from true_figures import figures  # noqa: E402

from stepdiag_ros.metrology.tracker.evaluation import evaluate_test  # noqa: E402


def rows_of(machines, seed):
    """Return kind of estimate → place → list of (departure over u, U)."""
    found = {}
    for number in range(machines):
        place = list(PLACES)[number % len(PLACES)]
        rng = np.random.default_rng([seed, number])
        how = {"runs": int(rng.integers(1, 6)), "targets": int(rng.integers(6, 13))}
        one = any_measurement(seed + number, place, **how)
        result = evaluate_test(one.readings, chain=one.cell.chain)
        for kind, value, spread, truth in figures(result, one):
            kept = found.setdefault(kind, [])
            kept.append(((value - truth) / spread, 1.96 * spread))
    return found


def main():
    """Print the document."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--machines", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    document = {}
    found = rows_of(arguments.machines, arguments.seed)
    for kind, values in found.items():
        standardised, expanded = np.array(values).T
        known = np.isfinite(standardised)
        document[kind] = {
            "values": len(values),
            "unknown": int(np.sum(~known)),
            "inside": round(float(np.mean(np.abs(standardised[known]) <= 1.96)), 4),
            "rms": round(float(np.sqrt(np.mean(standardised[known] ** 2))), 3),
            "median_U": float(np.median(expanded[known])),
        }
    print(json.dumps(document, indent=2))


if __name__ == "__main__":
    main()
