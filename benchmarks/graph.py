"""The whole simulated cell in real time with readings at 1 kHz: gaps, and the processor it takes.

Every node is a process of its own, as in ``stepdiag run``. The plan is the quick one, repeated
until the run is long enough. Counted are the gaps in the sequence of readings in the recorded bag,
the readings of each stop's window that the bag holds but the assembler did not use, and the
processor time of every node while the run goes on. Prints JSON; the exit code is 1 if a reading is
missing in either, if a stop was rejected, or if the nodes took more than 2 cores.

    python benchmarks/graph.py [--seconds 60] [--rate 1000]
"""

import argparse
import json
import math
import sys
import tempfile
import time
from bisect import bisect_left
from collections import defaultdict
from pathlib import Path
from typing import Any

import yaml
from shared import gaps, machine_seconds, memory_mb, node_processes, processor_seconds

from stepdiag_ros import configuration, topics
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.embedded import client
from stepdiag_ros.messages.conversion import to_settled_stop
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.metrology.measurement import SettledStop
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.processes.cell import simulated_cell
from stepdiag_ros.processes.following import RunNews
from stepdiag_ros.processes.measure import MeasuringSession

MOST_CORES = 2.0
"""That the nodes may take together."""
COMING_TO_REST = 0.09
"""Seconds that the simulated machine needs at least for ramps, lag and report of arrival."""


class Meter:
    """Samples the processor time of all nodes each time it is told that the run goes on."""

    def __init__(self) -> None:
        self._samples: list[tuple[float, float, dict[str, float]]] = []
        self._memory: defaultdict[str, list[float]] = defaultdict(list)

    def __call__(self, told: RunNews) -> None:
        """Sample, once stops are measured."""
        if told.done:
            nodes = node_processes()
            used = {name: processor_seconds(pid) for name, pid in nodes.items()}
            for name, pid in nodes.items():
                self._memory[name].append(memory_mb(pid))
            used["operator (this process)"] = processor_seconds()
            self._samples.append((time.monotonic(), machine_seconds(), used))

    def report(self) -> dict[str, Any]:
        """Return the cores that each node took from the first sample to the last."""
        (began, machine_before, before), (ended, machine_after, after) = (
            self._samples[0],
            self._samples[-1],
        )
        seconds = ended - began
        cores = {name: (after[name] - before[name]) / seconds for name in before}
        total = sum(cores.values())
        machine = (machine_after - machine_before) / seconds
        return {
            "seconds": round(seconds, 1),
            "cores": round(total, 3),
            "cores_by_node": {name: round(cores[name], 3) for name in sorted(cores)},
            "cores_of_everything_else": round(machine - total, 3),
            "memory_mb_at_a_third_and_at_the_end": {
                name: [round(seen[len(seen) // 3], 1), round(seen[-1], 1)]
                for name, seen in sorted(self._memory.items())
            },
        }


def make_plan(path: Path, seconds: float) -> None:
    """Write the quick plan with as many repeats as keep the cell busy for so long."""
    mapping = yaml.safe_load(configuration.find("quick", "plans").read_text())
    plan = Plan.from_mapping(mapping, "quick")
    # At each stop the machine moves by one block, comes to rest and stays for the dwell.
    one_stop = min(plan.volume.step) / plan.feed + COMING_TO_REST + plan.sampling.dwell
    mapping["repeats"] = math.ceil(seconds / (one_stop * plan.stop_count))
    path.write_text(yaml.safe_dump(mapping))


def examine(path: Path) -> dict[str, Any]:
    """Return what is missing in a bag, and in what its stops were taken from."""
    sequence: list[int] = []
    times: list[int] = []
    stops: list[SettledStop] = []
    names = {topics.absolute(topic) for topic in (topics.READING, topics.STOP)}
    with BagReader(path) as bag:
        for record, message in bag.messages(topics=names):
            if record.topic == topics.absolute(topics.READING):
                sequence.append(int(message.sequence))
                times.append(to_nanoseconds(message.header.stamp))
            else:
                stops.append(to_settled_stop(message))
    span = (times[-1] - times[0]) * 1e-9
    # The assembler has to use every reading of a window that the recorder has heard.
    unused = sum(
        abs(
            bisect_left(times, stop.window_end)
            - bisect_left(times, stop.window_start)
            - stop.readings
        )
        for stop in stops
    )
    return {
        "readings": len(sequence),
        "span_seconds": round(span, 3),
        "readings_per_second": round((len(sequence) - 1) / span, 2),
        "gaps_in_bag": gaps(sequence),
        "stops": len(stops),
        "stops_rejected": sum(not stop.settled for stop in stops),
        "readings_used_by_assembler": sum(stop.readings for stop in stops),
        "readings_in_smallest_window": min(stop.readings for stop in stops),
        "readings_of_windows_not_used": unused,
        "bag_bytes": path.stat().st_size,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="shortest time of the run")
    parser.add_argument("--rate", type=float, default=1000.0, help="readings in a second")
    arguments = parser.parse_args()
    meter = Meter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plan = folder / "plan.yaml"
        make_plan(plan, arguments.seconds)
        nodes = simulated_cell(
            str(plan), "demo", "demo", folder, factor=1.0, rate=arguments.rate, seed=1
        )
        found = examine(MeasuringSession(nodes, folder, meter).measure())
    report = {"client": client(), "rate": arguments.rate, **found, "processor": meter.report()}
    print(json.dumps(report, indent=2))
    lost = found["gaps_in_bag"] + found["readings_of_windows_not_used"] + found["stops_rejected"]
    short = found["span_seconds"] < arguments.seconds
    return int(bool(lost) or short or report["processor"]["cores"] > MOST_CORES)


if __name__ == "__main__":
    sys.exit(main())
