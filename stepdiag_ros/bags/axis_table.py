"""Reads a test of one axis from a plain CSV, as other programs write it.

The columns are ``cycle,direction,target_mm,position_mm``: the number of the run, ``forward``
(targets approached ascending) or ``backward``, the commanded target and the measured position.
Every run has each target once, in any order of rows; targets may be negative.
"""

from pathlib import Path

import numpy as np

from stepdiag_ros.bags.deviation_check import Deviation, check_deviations
from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.plain_table import read_rows
from stepdiag_ros.bags.table_rows import refusal
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD, LINEAR
from stepdiag_ros.metrology.standards.axis_test import NO_OVERRUN, BidirectionalRuns
from stepdiag_ros.metrology.units import MILLI

COLUMNS = ("cycle", "direction", "target_mm", "position_mm")


def read_axis_table(path: str | Path, name: str = "") -> BidirectionalRuns:
    """Read the runs in a table.

    Args:
        path: the CSV.
        name: of the axis; the table's name if not given (X of ``x.csv``).

    Raises:
        TableError: not there, not readable, incomplete or contradictory, or a deviation seems to
            have another unit; names row and reason.
    """
    rows = read_rows(path, COLUMNS)
    targets = sorted({row.number("target_mm") for row in rows})
    if len(targets) < 2:
        raise TableError(
            f"{path} has a single target; a test needs two or more",
            fault="too_few",
            aspect="target",
        )
    runs: dict[str, dict[int, dict[float, Deviation]]] = {FORWARD: {}, BACKWARD: {}}
    for row in rows:
        direction = row.one_of("direction", (FORWARD, BACKWARD))
        run = runs[direction].setdefault(row.whole("cycle"), {})
        target = row.number("target_mm")
        if target in run:
            raise refusal(
                row.source,
                row.row,
                f"target {target:g} mm appears twice in the {direction} run of cycle"
                f" {row.text('cycle')}",
                fault="twice",
            )
        # Subtracted in mm, in which both are written exactly.
        value = (row.number("position_mm") - target) * MILLI
        run[target] = Deviation(row.row, target * MILLI, value)
    for direction, cycles in runs.items():
        for cycle, run in cycles.items():
            for target in targets:
                if target not in run:
                    raise TableError(
                        f"{path}: the {direction} run of cycle {cycle} has no target"
                        f" {target:g} mm; complete the run or leave it out",
                        fault="missing",
                    )
            length = (targets[-1] - targets[0]) * MILLI
            check_deviations(rows[0].source, list(run.values()), length)

    def table(direction: str) -> Vector:
        cycles = runs[direction]
        values = [[cycles[cycle][target].value for target in targets] for cycle in sorted(cycles)]
        return np.array(values, dtype=np.float64).reshape(len(values), len(targets))

    stem = Path(path).stem
    return BidirectionalRuns(
        name=name or (stem.upper() if stem.upper() in AXES else stem),
        kind=LINEAR,
        target=np.array(targets) * MILLI,
        forward=table(FORWARD),
        backward=table(BACKWARD),
        remarks=(NO_OVERRUN,) if runs[FORWARD] and runs[BACKWARD] else (),
    )
