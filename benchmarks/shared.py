"""What several benchmarks need: gaps in a sequence, and processor time of processes (Linux)."""

import os
import time
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")
CORES = os.sysconf("SC_NPROCESSORS_ONLN")


def gaps(sequence: Iterable[int]) -> int:
    """Return at how many places a sequence does not go on by exactly one."""
    return sum(after != before + 1 for before, after in pairwise(sequence))


def processor_seconds(process: int | str = "self") -> float:
    """Return the processor time that a process has used so far, user and system, s."""
    fields = _stat(process)
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_SECOND


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
