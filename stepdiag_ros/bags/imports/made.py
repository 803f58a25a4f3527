"""What a user compares an import with: the measured box, and how far readings are from nominal."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.bags.run import RecordedRun
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.plan import BACKWARD, DIAGONAL, FORWARD, STEP_DIAGONAL, Volume
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.text.extent import extent_words

WITHOUT_CHAIN = (
    "the kinematic chain is not stated: U takes the mean of what rotations do in all six chains,"
    " and may be too small for the chain of this machine; methods that determine angular errors"
    " refuse"
)
NO_CHAIN = f"{WITHOUT_CHAIN}. State 'chain'"


@dataclass(frozen=True)
class FarthestReading:
    """The reading that deviates most from the commanded displacement.

    Attributes:
        deviation: m; relative to the first reading of its pass.
        line: pass that it is of.
        stop: from 0 along the direction.
    """

    deviation: float
    line: MeasuredLine
    stop: int


def farthest_reading(lines: Sequence[MeasuredLine], volume: Volume) -> FarthestReading | None:
    """Return the reading with the largest deviation; None without one.

    Args:
        lines: as they were measured, not by a tracker.
        volume: the measured box.
    """
    found: FarthestReading | None = None
    for line in lines:
        nominal = line.line.beam(volume).between(line.target[0], line.target)
        away = line.displacement - nominal
        known = np.flatnonzero(np.isfinite(away))
        if not len(known):
            continue
        away = away - away[known[0]]
        stop = int(known[np.argmax(np.abs(away[known]))])
        if found is None or abs(away[stop]) > abs(found.deviation):
            found = FarthestReading(float(away[stop]), line, stop)
    return found


def what_was_made(run: RecordedRun) -> list[str]:
    """Return the box and the largest deviation of a reading, in sentences.

    Args:
        run: that was imported.
    """
    volume = run.plan.volume
    said = [f"measured box: {extent_words(run.plan)}"]
    # A tracker reads lengths from its own place, which the evaluation has to locate first.
    farthest = farthest_reading(run.lines, volume) if run.plan.tracker is None else None
    if farthest is not None:
        said.append(
            f"largest deviation of a reading from nominal: {farthest.deviation * IN_MICRO:.4g} µm"
            f" ({farthest.line.line}, stop {farthest.stop})"
        )
    return said


def unequal_runs(run: RecordedRun) -> list[str]:
    """Return a sentence for each line that was not measured equally often in both directions.

    Args:
        run: that was imported; a line that has one direction only is not named.
    """
    counts: dict[tuple[str, str], Counter[str]] = {}
    for one in run.measurement.lines:
        counts.setdefault((one.setup, one.line.name), Counter())[one.line.direction] += 1
    return [
        f"line {name} has {found[FORWARD]} forward and {found[BACKWARD]} backward runs; check that"
        " no run is missing"
        for (_, name), found in counts.items()
        if len(found) > 1 and found[FORWARD] != found[BACKWARD]
    ]


def overrun_passed_over(overrun: float, lines: Iterable[MeasuredLine]) -> list[str]:
    """Return a sentence where an overrun was stated that lines did not take.

    Args:
        overrun: that was stated for a whole table, m; NaN if none was.
        lines: as they were imported.
    """
    steps = (line for line in lines if line.line.kind == STEP_DIAGONAL)
    if not (overrun > 0.0 and any(not line.overrun > 0.0 for line in steps)):
        return []
    return [
        "the overrun that is stated for the whole table does not apply to step diagonals. State"
        " theirs by 'overrun_of_step_diagonals_m' in the mapping (0: they began at their first"
        " stop), or for each pass in a column of overruns"
    ]


def lacks_chain(run: RecordedRun) -> bool:
    """Say whether a run has lines along which rotations act by the chain, and states none."""
    return not run.chain and any(one.kind in (STEP_DIAGONAL, DIAGONAL) for one in run.plan.lines)
