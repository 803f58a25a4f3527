"""Samples at 50 kHz for a minute through driver, node, decimation and recorder: is one lost?

The whole cell runs on the computer's own clock, as on a real machine: nothing waits for a node that
is behind (unless asked to, for a machine that is busy otherwise). Every node is a process of its
own, as in ``graph.py``, but the interferometer hands over arrays. Counted are samples and readings
that are missing in the recorded bag, readings that are not to the last bit what a replay makes of
the samples, and the processor time of every node. Latency: from the last sample of a block to the
recorder's clock when it writes the block; the simulated instrument knows no sample before the axes'
position (50 Hz) that follows it, which is in it. The bag's messages are then written again with and
without compression. Prints JSON; the exit code is 1 if anything is missing or different, or if the
nodes took more than 2 cores.

    python benchmarks/stream.py [--seconds 60] [--rate 50000] [--simulated-clock] [--on-the-fly]
"""

import argparse
import json
import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from graph import MOST_CORES, Meter, examine, make_plan

from stepdiag_ros import configuration, topics
from stepdiag_ros.bags.info import bag_info
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.embedded import client
from stepdiag_ros.messages.samples import to_sample_block
from stepdiag_ros.processes.cell import simulated_cell
from stepdiag_ros.processes.measure import MeasuringSession
from stepdiag_ros.processes.node_process import NodeProcess

SIMULATED = "use_sim_time"


FLOWN_FOR = 100.0
"""s that the plan on_the_fly takes at least."""
BYTES = 8
"""Of a sample, as the instrument hands it over."""


def make_flown_plan(path: Path, seconds: float) -> None:
    """Write the plan on the fly with as many repeats as take so long."""
    mapping = yaml.safe_load(configuration.find("on_the_fly", "plans").read_text())
    mapping["repeats"] = math.ceil(seconds / FLOWN_FOR)
    path.write_text(yaml.safe_dump(mapping))


def on_the_computers_clock(nodes: list[NodeProcess]) -> list[NodeProcess]:
    """Return the nodes of a simulated cell without its clock."""
    return [
        NodeProcess(
            node.name, {name: value for name, value in node.parameters.items() if name != SIMULATED}
        )
        for node in nodes
        if node.name != "clock"
    ]


def latency(path: Path) -> dict[str, float]:
    """Return how many ms after its last sample a block was written, at most and for most."""
    with BagReader(path) as bag:
        waits = [
            (record.log_time - to_sample_block(message).last_time) * 1e-6
            for record, message in bag.messages(topics={topics.absolute(topics.SAMPLES)})
        ]
    quantiles = np.quantile(waits, [0.5, 0.99, 1.0])
    return {
        name: round(float(value), 1)
        for name, value in zip(("median", "p99", "max"), quantiles, strict=True)
    }


def rewrite(path: Path, copy: Path, compress: bool) -> dict[str, float]:
    """Write the bag's messages anew; return size and processor time."""
    with BagReader(path) as bag:
        header, records = bag.header, list(bag.records())
    began = time.process_time()
    with BagWriter(copy, header, compress=compress) as writer:
        for record in records:
            writer.write(record.topic, record.type_name, record.data, record.log_time)
    used = time.process_time() - began
    return {"bytes": copy.stat().st_size, "processor_seconds": round(used, 2)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="shortest time of the run")
    parser.add_argument("--rate", type=float, default=50_000.0, help="samples in a second")
    parser.add_argument(
        "--simulated-clock", action="store_true", help="wait for nodes that are behind"
    )
    parser.add_argument(
        "--on-the-fly", action="store_true", help="lines on the fly on a machine that vibrates"
    )
    arguments = parser.parse_args()
    meter = Meter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plan = folder / "plan.yaml"
        make, cell = (make_flown_plan, "moving") if arguments.on_the_fly else (make_plan, "demo")
        make(plan, arguments.seconds)
        nodes = simulated_cell(
            str(plan), "demo", cell, folder, factor=1.0, rate=arguments.rate, seed=1
        )
        if not arguments.simulated_clock:
            nodes = on_the_computers_clock(nodes)
        path = MeasuringSession(nodes, folder, meter).measure()
        found = examine(path)
        check = bag_info(path).samples["/"]
        report: dict[str, Any] = {
            "client": client(),
            "rate": arguments.rate,
            "samples": check.samples,
            "blocks": check.blocks,
            "bag_bytes_over_those_of_samples": round(
                path.stat().st_size / (BYTES * check.samples), 3
            ),
            "samples_missing": check.missing,
            "readings_made_again": check.made,
            "readings_different": check.different,
            **found,
            "latency_ms": latency(path),
            "rewritten": {
                "zstd": rewrite(path, folder / "zstd.mcap", compress=True),
                "none": rewrite(path, folder / "none.mcap", compress=False),
            },
            "processor": meter.report(),
        }
    print(json.dumps(report, indent=2))
    lost = found["gaps_in_bag"] + found["stops_rejected"]
    # On the fly all readings of a pass are used; a stop states those of its rest alone.
    lost += 0 if arguments.on_the_fly else found["readings_of_windows_not_used"]
    short = found["span_seconds"] < arguments.seconds
    bad = check.missing or check.different or not check.made or lost or short
    return int(bool(bad) or report["processor"]["cores"] > MOST_CORES)


if __name__ == "__main__":
    sys.exit(main())
