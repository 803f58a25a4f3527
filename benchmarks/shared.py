"""What several benchmarks need: simulated measurements, gaps, and time of processes (Linux)."""

import os
import time
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stepdiag_ros.evaluation.lead import RunLead
    from stepdiag_ros.metrology.measurement import Measurement
    from stepdiag_ros.metrology.solvers.result import VolumetricErrors

TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")
CORES = os.sysconf("SC_NPROCESSORS_ONLN")
ONE_CORE = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of a process that calculates in one thread."""
ORDERS = ("XYZ", "YZX", "ZXY", "XZY", "YXZ", "ZYX")
TRAVEL = 0.36
"""Of each axis of the simulated machine, m."""


def lead_of_all(results: "dict[str, VolumetricErrors]", lines: "Measurement") -> "RunLead":
    """Return what verdict and report state of results of all lines that were planned."""
    from stepdiag_ros.bags.passes import Completeness
    from stepdiag_ros.evaluation.decision import lead_of_results

    return lead_of_results(results, lines, Completeness(len(lines.lines), len(lines.lines)))


def simulated(
    blocks: int, passes: int = 1, orders: int = 1
) -> "tuple[dict[str, Any], Measurement]":
    """Return a plan, as its file has it, and a measurement by it.

    Three linear lines and four step diagonals in some move orders, each in some passes, over a cube
    of 0.36 m of a machine with errors of positioning and straightness.
    """
    # Only here: whoever sets the number of threads does so before numpy is imported.
    from stepdiag_ros.metrology.cell import SimulatedCell
    from stepdiag_ros.metrology.geometry import BODY_DIAGONALS, LINEAR_LINES
    from stepdiag_ros.metrology.plan import Plan
    from stepdiag_ros.metrology.simulation import simulate

    names, told = list(BODY_DIAGONALS), list(ORDERS[:orders])
    plan = {
        "step_m": [TRAVEL / blocks] * 3,
        "blocks": blocks,
        "feed_m_per_s": 0.05,
        "repeats": passes,
        "lines": [
            {"kind": "linear", "names": list(LINEAR_LINES)},
            {"kind": "step_diagonal", "names": names, "orders": told},
        ],
    }
    errors = {
        "travel_low_m": [0.0] * 3,
        "travel_high_m": [TRAVEL] * 3,
        "positioning_m": 2e-6,
        "straightness_m": 1e-6,
    }
    misalignment = {"beam_sigma_rad": 150e-6}
    cell = {"seed": 1, "chain": "YXZ", "errors": errors, "misalignment": misalignment}
    source = "benchmark"
    measured = simulate(Plan.from_mapping(plan, source), SimulatedCell.from_mapping(cell, source))
    return plan, measured


def gaps(sequence: Iterable[int]) -> int:
    """Return at how many places a sequence does not go on by exactly one."""
    return sum(after != before + 1 for before, after in pairwise(sequence))


def processor_seconds(process: int | str = "self") -> float:
    """Return the processor time that a process has used so far, user and system, s."""
    fields = _stat(process)
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_SECOND


def memory_mb(process: int | str) -> float:
    """Return what a process has in memory, MB."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") * 1e-6


def machine_seconds() -> float:
    """Return the processor time that the whole machine has used so far on all its cores, s.

    Counted as what was not idle: Linux measures idle time, but only samples what a processor does,
    and short work that timers start escapes the samples.
    """
    columns = Path("/proc/stat").read_text().splitlines()[0].split()
    idle, waiting = int(columns[4]), int(columns[5])
    return time.clock_gettime(time.CLOCK_BOOTTIME) * CORES - (idle + waiting) / TICKS_PER_SECOND


def node_processes() -> dict[str, int]:
    """Return name → process of the nodes that this process has started and that still run."""
    nodes = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if int(_stat(folder.name)[1]) == os.getpid():
                arguments = (folder / "cmdline").read_bytes().split(b"\0")
                nodes[arguments[2].decode().rpartition(".")[2]] = int(folder.name)
        except (OSError, IndexError):
            continue  # It ended meanwhile, or it is no node.
    return nodes


def _stat(process: int | str) -> list[str]:
    # The fields after the program's name, which may hold blanks; state is the first of them.
    return Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2].split()
