"""Replay of a recorded run into live nodes: multiples of real time, the same to the last bit.

Replays with ``stepdiag replay BAG --check --json``, which starts an assembler and a solver and
compares every message of theirs with the recorded one: as fast as possible (``--rate 0``) and at a
hundred times real time (``--rate 100``). Without a bag the demo plan is measured first. The
multiple of publishing is that of the bag's messages; the multiple of the whole command includes
its start, the start of the nodes, and the 2 s of silence after which they count as done. Prints
JSON, medians of the rounds; the exit code is 1 if a replay is not the same, or if the fastest one
is below 100 times real time.

    python benchmarks/replay.py [BAG] [--rounds 3]
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from stepdiag_ros.embedded import client

STEPDIAG = [sys.executable, "-m", "stepdiag_ros.cli"]
LEAST = 100.0
"""Times real time that a replay as fast as possible must reach."""


def measure_demo(folder: Path) -> Path:
    """Measure the demo plan in the simulated cell and return its bag."""
    subprocess.run(
        [*STEPDIAG, "demo", "--pictures", "none", "--json", "--output", str(folder)],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    (bag,) = folder.glob("*.mcap")
    return bag


def replay(bag: Path, rate: float) -> dict[str, Any]:
    """Replay once and return what the command says, with the time that it took."""
    began = time.monotonic()
    done = subprocess.run(
        [*STEPDIAG, "replay", str(bag), "--rate", f"{rate:g}", "--check", "--json"],
        stdout=subprocess.PIPE,
        text=True,
    )
    seconds = time.monotonic() - began
    if not done.stdout:
        sys.exit(done.returncode or 1)  # The command has said why.
    return {**json.loads(done.stdout), "command_seconds": seconds}


def summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return medians over the rounds of one rate."""

    def median(key: str) -> float:
        return statistics.median(run[key] for run in runs)

    seconds, recorded = median("real_seconds"), runs[0]["recorded_seconds"]
    return {
        "seconds_of_publishing": round(seconds, 2),
        "seconds_of_command": round(median("command_seconds"), 2),
        "times_real_time_publishing": round(recorded / seconds, 1),
        "times_real_time_command": round(recorded / median("command_seconds"), 1),
        "messages_per_second": round(runs[0]["messages"] / seconds),
        # A topic that was not compared at all must not count as the same.
        "same_to_the_last_bit": all(len(run["same"]) > 0 for run in runs)
        and all(same for run in runs for same in run["same"].values()),
        "differences": [run["differences"] for run in runs if run["differences"]],
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", nargs="?", type=Path, help="a recorded run; else one is made")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bag = arguments.bag or measure_demo(Path(folder))
        runs: dict[str, list[dict[str, Any]]] = {"0": [], "100": []}
        for _ in range(arguments.rounds):
            for rate, of_rate in runs.items():
                of_rate.append(replay(bag, float(rate)))
    first = runs["0"][0]
    report = {
        "client": client(),
        "rounds": arguments.rounds,
        "recorded_seconds": round(first["recorded_seconds"], 1),
        "messages": first["messages"],
        "compared_topics": sorted(first["same"]),
        **{f"rate_{rate}": summary(of_rate) for rate, of_rate in runs.items()},
    }
    print(json.dumps(report, indent=2))
    same = all(report[f"rate_{rate}"]["same_to_the_last_bit"] for rate in runs)
    return int(not same or report["rate_0"]["times_real_time_publishing"] < LEAST)


if __name__ == "__main__":
    sys.exit(main())
