"""Machine seconds to a stated uncertainty: the demonstration's lines on the fly and with stops.

Both plans are measured by the same sequencer, simulated devices and assembler in one process
(``test/devices/live_cell.py``, without the time that messages take between nodes), with noise,
drift, servo lag, a vibration of 0.3 um at 40 Hz and 20 us of jitter (``config/cells/moving.yaml``):
stops with 100 readings a second, as the demonstration has them, on the fly with 1000. Counted are
the machine's seconds from the start of the run to its last stop, the largest expanded uncertainty
(k = 1.96) of the nine curves and of squareness, how many of the true values these contain, and E_n
of each node on the fly against the same node at a stop. "of the readings" leaves out what the
machine may do although no line shows it. With ``--machines`` a step diagonal is measured on the fly
on that many worst plausible machines (``test/metrology/on_the_fly/moving_machine.py``), and values
within their U are counted. Prints one JSON document; the exit code is 1 if the ratio of the times
is above 0.25, an uncertainty on the fly is larger, E_n is above 1 for more than 5 % of the nodes,
or the coverage of a node is not 93 to 97 %.

    python benchmarks/on_the_fly.py [--machines 100]
"""

import argparse
import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
_TEST = Path(__file__).parents[1] / "test"
sys.path[:0] = [str(_TEST), str(_TEST / "devices"), str(_TEST / "metrology" / "on_the_fly")]

import numpy as np  # noqa: E402
from live_cell import MS, LiveCell  # noqa: E402
from moving_machine import judged  # noqa: E402

from stepdiag_ros.configuration import load_cell, load_plan  # noqa: E402
from stepdiag_ros.metrology.cell import SimulatedCell  # noqa: E402
from stepdiag_ros.metrology.geometry import SQUARENESS  # noqa: E402
from stepdiag_ros.metrology.measurement import Measurement  # noqa: E402
from stepdiag_ros.metrology.plausible import NOTHING  # noqa: E402
from stepdiag_ros.metrology.solvers import solve  # noqa: E402
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR  # noqa: E402

CELL = "moving"
TICK = 4 * MS
RATES = {"on_the_fly": (1000.0, 500.0), "demo": (100.0, 50.0)}
"""Readings and positions in a second."""
LEAST, MOST = 0.93, 0.97
"""Part of the values that their U may contain."""
HIGHEST_RATIO = 0.25
SMALLEST_SHARE = 0.95


def measured(name: str, cell: SimulatedCell) -> tuple[Measurement, float]:
    """Return the lines of a plan, and the machine's seconds that they took."""
    rate, position_rate = RATES[name]
    live = LiveCell(load_plan(name)[0], cell, TICK, rate=rate, position_rate=position_rate)
    lines = live.measure()
    return lines, (lines.lines[-1].end_time - live.start) * 1e-9


def figures(lines: Measurement, seconds: float, cell: SimulatedCell) -> dict[str, Any]:
    """Return seconds, uncertainties and coverage of a run."""
    true = cell.truth(lines.volume)
    whole, readings = solve(lines), solve(replace(lines, plausible=NOTHING))
    u = np.concatenate([line.standard_uncertainty for line in lines.lines])
    inside = [
        np.abs(curve - true[name])[1:] <= COVERAGE_FACTOR * whole.standard_uncertainty[name][1:]
        for name, curve in whole.curves.items()
    ]
    return {
        "machine_seconds": round(seconds, 1),
        "passes": len(lines.lines),
        "nodes": len(u),
        "node_u_um": round(1e6 * float(np.median(u)), 4),
        "curves_U_um": round(1e6 * _largest(whole), 4),
        "curves_U_of_the_readings_um": round(1e6 * _largest(readings), 4),
        "squareness_U_urad": round(1e6 * _squareness(whole), 4),
        "squareness_U_of_the_readings_urad": round(1e6 * _squareness(readings), 4),
        "true_values_inside": round(float(np.mean(np.concatenate(inside))), 4),
    }


def _largest(result: Any) -> float:
    values = [np.nanmax(curve) for curve in result.standard_uncertainty.values()]
    return COVERAGE_FACTOR * float(max(values))


def _squareness(result: Any) -> float:
    return COVERAGE_FACTOR * max(result.figure(name).standard_uncertainty for name in SQUARENESS)


def normalised(moved: Measurement, stopped: Measurement) -> "np.ndarray[Any, Any]":
    """Return E_n of each node on the fly against the same node at a stop."""
    found = []
    stops = {line.line: line for line in stopped.lines}
    for line in moved.lines:
        other = stops[line.line]
        difference = line.displacement - other.displacement
        spread = np.hypot(line.standard_uncertainty, other.standard_uncertainty)
        spread = np.hypot(spread, spread[0])[1:]
        found.append((difference - difference[0])[1:] / (COVERAGE_FACTOR * spread))
    return np.abs(np.concatenate(found))


def side_by_side() -> dict[str, Any]:
    """Return the figures of both plans on one machine."""
    cell = load_cell(CELL)[0]
    runs = {name: measured(name, cell) for name in RATES}
    report: dict[str, Any] = {name: figures(*run, cell) for name, run in runs.items()}
    moved, stopped = report["on_the_fly"], report["demo"]
    report["ratio_of_machine_seconds"] = round(
        moved["machine_seconds"] / stopped["machine_seconds"], 3
    )
    e_n = normalised(runs["on_the_fly"][0], runs["demo"][0])
    report["e_n_within_1"] = round(float(np.mean(e_n <= 1.0)), 4)
    return report


def coverage(machines: int) -> dict[str, float]:
    """Return which part of the values their expanded uncertainty contains, over many machines."""
    nodes, e_n, delays, curves = judged(machines)
    return {
        "machines": machines,
        "nodes_inside": round(float(np.mean(nodes <= COVERAGE_FACTOR)), 4),
        "curves_inside": round(float(np.mean(curves <= COVERAGE_FACTOR)), 4),
        "delays_inside": round(float(np.mean(delays <= COVERAGE_FACTOR)), 4),
        "e_n_within_1": round(float(np.mean(e_n <= 1.0)), 4),
    }


def main() -> int:
    """Print the figures; return whether one misses its bar."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--machines", type=int, default=0, help="for the coverage; 0: none")
    arguments = parser.parse_args()
    report = side_by_side()
    moved, stopped = report["on_the_fly"], report["demo"]
    good = report["ratio_of_machine_seconds"] <= HIGHEST_RATIO
    good &= all(moved[name] <= stopped[name] for name in moved if "_U_" in name)
    good &= report["e_n_within_1"] >= SMALLEST_SHARE
    if arguments.machines:
        report["coverage"] = found = coverage(arguments.machines)
        good &= LEAST <= found["nodes_inside"] <= MOST
    print(json.dumps(report, indent=2))
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
