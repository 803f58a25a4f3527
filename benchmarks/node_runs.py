"""Runs on the whole node graph: until a target, and on the fly on several machines.

``--until N`` measures N simulated machines up to an uncertainty: of the largest error, of C0Y or of
E_XX in turns, as large as another laser had it on the same machine after a random number of lines.
Counted is how often the U of the finished run is at most the target where the run says so, and by
how much its time exceeds the best possible one: that of the first line end at which the same
decision, made for the lines in the bag, is "reached". ``--fly N`` measures N worst plausible
machines on the fly, with rotations, drift, lag, vibration and jitter, and counts how many true
values of nine curves and squareness their U contains. Prints one JSON document; the exit code is 1
if a run says that a U is reached that is not, or if the longest of all runs together exceed the
best possible time by more than 15 %.

    python benchmarks/node_runs.py --folder FOLDER --until 50 --fly 5
"""

import argparse
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
sys.path[:0] = [str(Path(__file__).parents[1] / "test")]

import numpy as np  # noqa: E402
import yaml  # noqa: E402
from domains import own_domain  # noqa: E402
from forked import ForkedPopen  # noqa: E402
from running_cell import nodes_of  # noqa: E402
from shared import lead_of_all  # noqa: E402

from stepdiag_ros.bags.run import load_run  # noqa: E402
from stepdiag_ros.configuration import load_cell, load_machine, load_plan  # noqa: E402
from stepdiag_ros.evaluation.pursuit import pursuit_from_text, reached, standing  # noqa: E402
from stepdiag_ros.evaluation.recorded_run import report_of_run  # noqa: E402
from stepdiag_ros.evaluation.report import compare_with_truth  # noqa: E402
from stepdiag_ros.metrology.measurement import Measurement  # noqa: E402
from stepdiag_ros.metrology.plausible import Plausible  # noqa: E402
from stepdiag_ros.metrology.simulation import simulate  # noqa: E402
from stepdiag_ros.metrology.solvers import NotDeterminable, solve  # noqa: E402
from stepdiag_ros.metrology.target import Target, TargetState, line_ends  # noqa: E402
from stepdiag_ros.processes.measure import MeasuringSession  # noqa: E402

PLAN = """\
name: three blocks, four times
step_m: [0.02, 0.02, 0.02]
blocks: 3
repeats: 4
directions: [forward, backward]
feed_m_per_s: 0.1
pause_for_setup: false
lines:
  - {kind: linear, names: [x, y, z]}
  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn], orders: [XYZ]}
sampling: {dwell_s: 0.4, settle_s: 0.1, window_s: 0.3}
"""
TARGETS = (("volumetric", "m"), ("C0Y", "rad"), ("E_XX", "m"))
ROTATION = 10e-6
"""rad: of the worst machines; as large as machine files assume."""
LARGEST_OVERSHOOT = 0.15
UNTIL_FACTOR, FLY_FACTOR = 10.0, 3.0
"""Times real time."""


def cell_file(folder: Path, base: str, seed: int, **changes: Any) -> Path:
    """Write the file of a cell that differs from one of the package by its seed, and more."""
    cell = yaml.safe_load(load_cell(base)[1])
    cell |= {"name": f"{base} {seed}", "seed": seed, **changes}
    cell["errors"] |= {"rotation_rad": ROTATION}
    path = folder / f"cell_{seed}.yaml"
    path.write_text(yaml.safe_dump(cell), encoding="utf-8")
    return path


def results_of(lines: Measurement) -> dict[str, Any]:
    """Return what least squares makes of some lines; nothing where they do not determine it."""
    try:
        return {"least_squares": solve(lines)}
    except NotDeterminable:
        return {}


def first(measurement: Measurement, count: int) -> Measurement:
    """Return the first lines of a measurement."""
    return replace(measurement, lines=measurement.lines[:count])


def reached_by(target: Target, lines: Measurement) -> float:
    """Return the expanded uncertainty of a target's quantity after some lines."""
    results = results_of(lines)
    return reached(target, lines, results, lead_of_all(results, lines))


def target_of(plan: Path, cell: Path, number: int) -> str:
    """Return what is asked of a run, as ``--until`` takes it."""
    quantity, unit = TARGETS[number % len(TARGETS)]
    loaded, simulated, machine = load_plan(plan)[0], load_cell(cell)[0], load_machine("demo")[0]
    other = simulate(loaded, replace(simulated, reading_noise=0.7 * simulated.reading_noise))
    other = replace(other, chain=machine.chain, plausible=Plausible(machine.rotations))
    target = Target(quantity, 1.0, unit)
    ends = [end for end in line_ends(target, loaded) if end >= len(loaded.lines) // 4]
    chosen = int(np.random.default_rng([number, 5]).integers(len(ends)))
    sizes = (reached_by(target, first(other, end)) for end in ends[chosen:])
    size = next(size for size in sizes if np.isfinite(size))
    text = f"{size * 1e6:.4f}"
    return f"{quantity}={text}{'um' if unit == 'm' else 'urad'}"


def measured(folder: Path, plan: str, cell: Path, factor: float, until: str = "") -> Path:
    """Return the bag of a run on nodes that are started for it."""
    nodes = nodes_of(folder, plan=plan, cell=str(cell), factor=factor, tick=0.004)
    return MeasuringSession(nodes, folder, lambda _: None, until=until).measure()


def until_run(folder: Path, number: int) -> dict[str, Any]:
    """Return what ``judged`` does of one machine and target."""
    plan = folder / "plan.yaml"
    plan.write_text(PLAN, encoding="utf-8")
    cell = cell_file(folder, "demo", 4000 + number)
    asked = target_of(plan, cell, number)
    return judged(measured(folder, str(plan), cell, UNTIL_FACTOR, asked))


def judged(bag: Path) -> dict[str, Any]:
    """Return of a run with a target what was said, what holds, and the times."""
    run = load_run(bag)
    pursuit = pursuit_from_text(run.until, run.plan, run.machine_text)
    assert pursuit is not None
    lines = run.measurement
    best = None
    for count in pursuit.line_ends:
        some = first(lines, count)
        if count > len(lines.lines):
            break
        results = results_of(some)
        now = standing(pursuit, some, results, lead_of_all(results, some))
        if now.state is TargetState.REACHED:
            best = count
            break
    said = run.states[-1].target
    final = reached_by(pursuit.target, lines)
    start, last = run.start_time, lines.lines[-1].end_time
    taken = (last - start) * 1e-9 + (run.states[-1].time - last) * 1e-9 / UNTIL_FACTOR
    possible = (lines.lines[(best or len(lines.lines)) - 1].end_time - start) * 1e-9
    return {
        "asked": run.until,
        "said_reached": said is not None and said.state is TargetState.REACHED,
        "is_reached": bool(final <= pursuit.target.size),
        "lines": len(lines.lines),
        "best_lines": best,
        "overshoot": taken / possible - 1.0,
    }


def fly_run(folder: Path, number: int) -> dict[str, Any]:
    """Return of one machine on the fly: true values inside U, and all of them."""
    cell = cell_file(folder, "moving", 6000 + number)
    run = load_run(measured(folder, "on_the_fly", cell, FLY_FACTOR))
    report = report_of_run(run)
    assert report.truth is not None
    result = report.preferred()
    assert result is not None
    compared = compare_with_truth(result, report.truth)
    return {
        "inside": compared.points_inside,
        "values": compared.points_with_uncertainty,
        "lines": len(run.lines),
    }


def one_by_one(folder: Path, name: str, count: int, run: Any) -> list[dict[str, Any]]:
    """Make so many runs, each in a folder of its own."""
    rows = []
    for number in range(count):
        own = folder / f"{name}_{number}"
        own.mkdir(parents=True)
        with own_domain():
            rows.append(run(own, number))
        print(f"{name} {number}: {rows[-1]}", file=sys.stderr, flush=True)
    return rows


def main() -> int:
    """Print the figures; return whether one misses its bar."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, required=True, help="for bags and logs; new")
    parser.add_argument("--until", type=int, default=50, help="runs with a target")
    parser.add_argument("--fly", type=int, default=5, help="machines on the fly")
    arguments = parser.parse_args()
    subprocess.Popen = ForkedPopen  # type: ignore[misc]
    ended = one_by_one(arguments.folder, "until", arguments.until, until_run)
    flown = one_by_one(arguments.folder, "fly", arguments.fly, fly_run)
    said = [one for one in ended if one["said_reached"]]
    document: dict[str, Any] = {"runs": len(ended), "said_reached": len(said)}
    good = all(one["is_reached"] for one in said)
    document["of_these_reached"] = sum(one["is_reached"] for one in said)
    if said:
        over = np.array([one["overshoot"] for one in said])
        document["overshoot"] = {
            "median": round(float(np.median(over)), 3),
            "largest": round(float(np.max(over)), 3),
            "further_lines": sum(one["lines"] - (one["best_lines"] or 0) for one in said),
        }
        good &= bool(np.max(over) <= LARGEST_OVERSHOOT)
    if flown:
        inside, values = (sum(one[name] for one in flown) for name in ("inside", "values"))
        document["on_the_fly"] = {"machines": len(flown), "inside": inside, "values": values}
    print(json.dumps(document, indent=2))
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
