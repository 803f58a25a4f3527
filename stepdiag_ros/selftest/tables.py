"""A reference problem as a user would hand it in: a run table and a case file."""

import csv
from pathlib import Path

import numpy as np
import yaml

from stepdiag_ros.bags.table_rows import COLUMNS
from stepdiag_ros.metrology.geometry import ROTATIONS
from stepdiag_ros.metrology.plausible import ROTATIONS_KEY
from stepdiag_ros.selftest.problems import UNKNOWN_NOISE, Problem

_SECONDS_A_STOP = 3.0


def write_problem(problem: Problem, folder: Path) -> Path:
    """Write ``run.csv`` and ``case.yaml`` into a folder; return the path of the table.

    Numbers are written so that reading them gives the same doubles.
    """
    table = folder / "run.csv"
    time = 0.0
    with table.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream)
        rows.writerow(COLUMNS)
        for line, readings in zip(problem.passes, problem.readings, strict=True):
            kind = "step_diagonal" if line.order else "linear"
            nodes = line.nodes(problem.blocks)
            for stop, (node, reading) in enumerate(zip(nodes, readings, strict=True)):
                rows.writerow(
                    [
                        repr(time),
                        kind,
                        line.name,
                        line.order,
                        line.repeat,
                        line.direction,
                        stop,
                        *(repr(float(value)) for value in problem.position(node)),
                        repr(float(reading)),
                        "20.0",
                        "101325.0",
                        "0.5",
                        "20.0",
                    ]
                )
                time += _SECONDS_A_STOP
    case = {
        "units": "SI",
        "chain": list(problem.chain),
        "origin_m": list(problem.origin),
        "step_m": list(problem.step),
        "blocks": problem.blocks,
        "dead_path_m": problem.dead_path,
    }
    if problem.noise > 0.0 and problem.kind != UNKNOWN_NOISE:
        case["reading_noise_m"] = problem.noise
    if not any(np.any(problem.curves.get(name, 0.0)) for name in ROTATIONS):
        case[ROTATIONS_KEY] = 0.0
    (folder / "case.yaml").write_text(yaml.safe_dump(case, sort_keys=False), encoding="utf-8")
    return table
