"""How ``stepdiag solve`` grows with a run: processor time and memory of the whole command, as JSON.

Bags of simulated measurements (4 step diagonals and 3 linear lines) are solved each in a fresh
process, as a user would: every method, the diagnosis, the tables. Peak memory is the largest
resident set that Linux saw of the process; both are medians of the rounds.

    python benchmarks/solve_growth.py [--plans 25x1,100x1,12x10x3] [--rounds 3]

A plan ``200x1`` has 200 blocks and 1 pass of each line; ``12x10x3`` has 12 blocks, 10 passes and 3
move orders. The slopes are those of log time and log memory over log stops, 1 if in proportion, of
the plans named but the smallest: a process takes 2 s and 110 MB for anything. The exit code is 1 if
a run of at most 5,000 stops takes more than 300 MB.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import yaml
from shared import ONE_CORE, TRAVEL, simulated

PLANS = "12x1,25x1,50x1,100x1,200x1,12x10x3"
MOST_MEMORY = 300.0
"""MB for a run of 5,000 stops."""


def make_bag(path, blocks, passes, orders=1):
    """Write the bag of a simulated measurement; return its number of stops."""
    from stepdiag_ros.bags.imports.writing import ToWrite, write_bag
    from stepdiag_ros.configuration import load_machine

    plan, measured = simulated(blocks, passes, orders)
    machine = yaml.safe_load(load_machine("demo")[1])
    machine.update(chain="YXZ", travel_low_m=[0.0] * 3, travel_high_m=[TRAVEL] * 3)
    content = ToWrite(
        run_id=path.stem,
        plan_name="benchmark",
        middleware="none: simulated",
        plan=yaml.safe_dump(plan),
        machine=yaml.safe_dump(machine),
        lines=measured.lines,
    )
    write_bag(path, content)
    return sum(len(line.time) for line in measured.lines)


def solved(bag):
    """Return processor seconds and peak memory (MB) of the command on a bag."""
    command = [sys.executable, "-m", "stepdiag_ros.cli", "solve", str(bag), "--json"]
    environment = {**os.environ, **ONE_CORE}
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{bag.name}: stepdiag solve ended with {process.returncode}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0


def slope(rows, key):
    """Return the slope of the logarithm of a figure over that of the stops."""
    import numpy as np

    stops = np.log([row["stops"] for row in rows])
    return round(float(np.polyfit(stops, np.log([row[key] for row in rows]), 1)[0]), 2)


def main():
    """Print the document."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plans", default=PLANS, help="BLOCKSxPASSES[xORDERS], with commas")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for text in arguments.plans.split(","):
            bag = Path(folder) / f"plan_{text}.mcap"
            stops = make_bag(bag, *(int(part) for part in text.split("x")))
            runs = [solved(bag) for _ in range(arguments.rounds)]
            seconds, memory = (statistics.median(column) for column in zip(*runs, strict=True))
            row = {
                "plan": text,
                "stops": stops,
                "processor_s": round(seconds, 2),
                "peak_memory_MB": round(memory),
            }
            print(row, file=sys.stderr, flush=True)
            rows.append(row)
    document = {"runs": rows}
    grown = sorted(rows, key=lambda row: row["stops"])[1:]
    if len(grown) > 1:
        document["slope_of_time"] = slope(grown, "processor_s")
        document["slope_of_memory"] = slope(grown, "peak_memory_MB")
    print(json.dumps(document, indent=2))
    return int(any(r["peak_memory_MB"] > MOST_MEMORY for r in rows if r["stops"] <= 5000))


if __name__ == "__main__":
    sys.exit(main())
