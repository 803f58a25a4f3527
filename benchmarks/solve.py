"""Time of least-squares solves and of Monte Carlo replicates, on one core, as JSON.

The first plan: 36 blocks, 4 step diagonals and 3 linear lines, one pass each (547 stops).
Cold is the first solve of a fresh process after its imports, warm the median of the following ones.
The large plan: 12 blocks, 4 step diagonals in 3 move orders and 3 linear lines, 10 passes (4,830
stops). The slopes are those of log time over log stops, 1 if the time is proportional: over the
blocks (12 to 100) and over the passes of the large plan (5 to 80).

    python benchmarks/solve.py [--processes 5] [--solves 30]
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time

from shared import ONE_CORE


def measure_in_this_process(solves):
    started = time.perf_counter()
    import numpy as np
    from shared import simulated

    from stepdiag_ros.metrology.solvers import solve
    from stepdiag_ros.metrology.solvers.monte_carlo import replicate

    imported = time.perf_counter() - started

    def measurement_of(*plan):
        return simulated(*plan)[1]

    def timed(function, *arguments):
        begin = time.perf_counter()
        function(*arguments)
        return time.perf_counter() - begin

    measured = measurement_of(36)
    cold = timed(solve, measured, "least_squares")
    warm = [timed(solve, measured, "least_squares") for _ in range(solves)]
    replicates = {
        method: timed(replicate, measured, 1000, 1, method)
        for method in ("conventional", "setup_robust", "least_squares")
    }
    large = measurement_of(12, 10, 3)

    def best(measurement, method):
        timed(solve, measurement, method)
        return min(timed(solve, measurement, method) for _ in range(5))

    def slope(measurements):
        stops = [sum(len(line.time) for line in one.lines) for one in measurements]
        times = [best(one, "least_squares") for one in measurements]
        return float(np.polyfit(np.log(stops), np.log(times), 1)[0])

    return {
        "large_ms": {
            method: 1e3 * best(large, method) for method in ("least_squares", "rigid_body")
        },
        "large_replicates_10000_s": timed(replicate, large, 10_000, 1, "least_squares"),
        "slope_over_blocks": slope([measurement_of(n) for n in (12, 25, 50, 100)]),
        "slope_over_passes": slope(
            [measurement_of(12, passes, 3) for passes in (5, 10, 20, 40, 80)]
        ),
        "import_ms": 1e3 * imported,
        "cold_ms": 1e3 * cold,
        "warm_ms": 1e3 * statistics.median(warm),
        "replicates_1000_s": replicates,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--processes", type=int, default=5)
    parser.add_argument("--solves", type=int, default=30)
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        print(json.dumps(measure_in_this_process(arguments.solves)))
        return
    command = [sys.executable, __file__, "--child", "--solves", str(arguments.solves)]
    runs = [
        json.loads(
            subprocess.run(
                command, env={**os.environ, **ONE_CORE}, check=True, capture_output=True, text=True
            ).stdout
        )
        for _ in range(arguments.processes)
    ]

    def median(key):
        return round(statistics.median(run[key] for run in runs), 3)

    print(
        json.dumps(
            {
                "plan": "36 blocks, 4 diagonals, 3 linear lines, 1 pass",
                "cores": 1,
                "processes": arguments.processes,
                "import_ms": median("import_ms"),
                "large_plan_ms": {
                    method: round(statistics.median(run["large_ms"][method] for run in runs), 1)
                    for method in runs[0]["large_ms"]
                },
                "large_plan_monte_carlo_10000_s": median("large_replicates_10000_s"),
                "slope_over_blocks_12_to_100": median("slope_over_blocks"),
                "slope_over_passes_5_to_80": median("slope_over_passes"),
                "least_squares_cold_ms": median("cold_ms"),
                "least_squares_warm_ms": median("warm_ms"),
                "monte_carlo_1000_s": {
                    method: round(
                        statistics.median(run["replicates_1000_s"][method] for run in runs), 3
                    )
                    for method in runs[0]["replicates_1000_s"]
                },
            },
            indent=2,
        )
    )


if __name__ == "__main__":
    main()
