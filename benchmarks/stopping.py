"""Whether stopping at an uncertainty biases the result, on worst plausible machines.

Each machine (``test/bands/plausible_machines.py``) is measured with four passes of every line, up
to the uncertainty that it had on another day after a random number of lines. Counted is how often
value ± U contains the true value: where the run stopped, in the same runs after their last line,
and in all runs after that random number of lines. Prints one JSON document.

    python benchmarks/stopping.py --machines 200
"""

import argparse
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
sys.path[:0] = [str(Path(__file__).parents[1] / "test" / "bands")]

import numpy as np  # noqa: E402
from plausible_machines import draw  # noqa: E402
from scipy.stats import beta  # noqa: E402
from shared import lead_of_all  # noqa: E402

from stepdiag_ros.evaluation.pursuit import reached  # noqa: E402
from stepdiag_ros.metrology.solvers import solve  # noqa: E402
from stepdiag_ros.metrology.standards.volumetric import of_result  # noqa: E402
from stepdiag_ros.metrology.target import VOLUMETRIC, Target, line_ends  # noqa: E402
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR  # noqa: E402

QUANTITIES = {VOLUMETRIC: "m", "C0Y": "rad"}
WHEN = ("at the stop", "the same runs at the end", "after a fixed number of lines")


def looked(machine, measurement, count):
    """Return what the first lines show: quantity → U to be compared with a target, error, U."""
    first = replace(measurement, lines=measurement.lines[:count])
    results = {"least_squares": solve(first)}
    lead = lead_of_all(results, first)
    result, truth = results["least_squares"], machine.truth(first.volume)
    worst = of_result(result, machine.chain, first.plausible)
    places = np.array([worst.position, machine.origin])
    true = -np.diff(truth.error_map.errors(places), axis=0)[0]
    errors = {
        VOLUMETRIC: np.array(worst.vector) / worst.value @ (np.array(worst.vector) - true),
        "C0Y": result.figure("C0Y").value - truth.figures["C0Y"],
    }
    expanded = {
        VOLUMETRIC: lead.expanded_uncertainty,
        "C0Y": COVERAGE_FACTOR * result.figure("C0Y").standard_uncertainty,
    }
    return {
        name: (
            reached(Target(name, 1.0, unit), first, results, lead),
            float(errors[name]),
            expanded[name],
        )
        for name, unit in QUANTITIES.items()
    }


def stopped(seed):
    """Return of one machine, for each quantity: whether U contains the true value, or None."""
    machine = draw(seed)
    plan = machine.steps(passes=4)
    ends = line_ends(Target(VOLUMETRIC, 1.0, "m"), plan)
    # Before the third of four diagonals nothing of this is determined.
    third = next(number for number, line in enumerate(plan.lines) if line.name == "pnp")
    ends = [end for end in ends if end > third]
    chosen = int(np.random.default_rng([seed, 77]).integers(len(ends)))
    asked = looked(machine, machine.measure(plan, day=1), ends[chosen])
    measurement = machine.measure(plan)
    course = [looked(machine, measurement, end) for end in ends]
    found = {}
    for name in QUANTITIES:
        inside = [abs(one[name][1]) <= one[name][2] for one in course]
        at = next((k for k, one in enumerate(course) if one[name][0] <= asked[name][0]), None)
        found[name] = (
            None if at is None else inside[at],
            None if at is None else inside[-1],
            inside[chosen],
        )
    return found


def share(known):
    """Return a count with the interval (95 %, Clopper and Pearson) of what it is a share of."""
    inside, count = sum(known), len(known)
    low = float(beta.ppf(0.025, inside, count - inside + 1)) if inside else 0.0
    high = float(beta.ppf(0.975, inside + 1, count - inside)) if inside < count else 1.0
    return {"inside": inside, "runs": count, "low": round(low, 3), "high": round(high, 3)}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--machines", type=int, default=200)
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    with ProcessPoolExecutor(arguments.processes) as pool:
        rows = list(pool.map(stopped, range(arguments.machines)))
    document = {
        name: {
            when: share([row[name][k] for row in rows if row[name][k] is not None])
            for k, when in enumerate(WHEN)
        }
        for name in QUANTITIES
    }
    print(json.dumps({"machines": arguments.machines, **document}, indent=2))


if __name__ == "__main__":
    main()
