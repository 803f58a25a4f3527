"""How much of a plan was measured, and how the run ended."""

import math
from dataclasses import dataclass, replace

from stepdiag_ros.bags.run import RecordedRun, StateChange
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import Line, Plan
from stepdiag_ros.metrology.target import TargetState

_FINISHED = 4
"""``RunState.FINISHED``."""
_STATES = {
    _FINISHED: "all lines are measured",
    5: "ended by an operator before all lines were measured",
    6: "stopped by a fault",
}


@dataclass(frozen=True)
class TakenLine:
    """Counts of a line: passes, complete passes, stops, restarts."""

    name: str
    planned: int
    measured: int
    complete: int
    stops: int
    rejected: int
    again: int


@dataclass(frozen=True)
class Completeness:
    """How much of a run is there.

    Attributes:
        planned: passes of the plan (or its stops, see ``unit``).
        complete: passes of which every stop has a value (or stops that have one).
        missing: lines of which a pass is not complete, in the order of the plan.
        end: how the run ended, in words; empty if the recording does not state it.
        unit: what is counted: ``passes`` or ``stops``.
    """

    planned: int
    complete: int
    missing: tuple[str, ...] = ()
    end: str = ""
    unit: str = "passes"

    @property
    def whole(self) -> bool:
        """Say whether nothing of the plan is missing."""
        return self.complete >= self.planned and not self.missing


def taken(plan: Plan, measurement: Measurement) -> tuple[TakenLine, ...]:
    """Return what was taken of each line of a plan, in its order."""
    planned: dict[tuple[str, str], list[int]] = {}
    for index, line in enumerate(plan.lines):
        planned.setdefault((line.kind, pass_name(line)), []).append(index)
    lines = {line.line_index: line for line in measurement.lines}
    found = []
    for (_, name), indices in planned.items():
        here = [lines[index] for index in indices if index in lines]
        values = [float(value) for line in here for value in line.displacement]
        rejected = sum(not math.isfinite(value) for value in values)
        found.append(
            TakenLine(
                name,
                len(indices),
                len(here),
                sum(line.complete for line in here),
                len(values) - rejected,
                rejected,
                sum(line.attempt - 1 for line in here),
            )
        )
    return tuple(found)


def completeness_of(recorded: RecordedRun, measurement: Measurement) -> Completeness:
    """Return how much of a recorded run is there.

    Args:
        recorded: the run.
        measurement: its lines, as they are solved.
    """
    lines = taken(_asked_for(recorded), measurement)
    planned, complete = sum(one.planned for one in lines), sum(one.complete for one in lines)
    missing = dict.fromkeys(one.name for one in lines if one.complete < one.planned)
    end = _end_of_run(recorded, complete >= planned)
    return Completeness(planned, complete, tuple(missing), end)


def _asked_for(recorded: RecordedRun) -> Plan:
    """Return the part of the plan that a run has to hold: that to its target, if it reached it."""
    if not recorded.states or not _ended_at_target(recorded.states[-1]):
        return recorded.plan
    return replace(recorded.plan, lines=recorded.plan.lines[: recorded.states[-1].line_index])


def _ended_at_target(last: StateChange) -> bool:
    reached = last.target is not None and last.target.state is TargetState.REACHED
    return last.state == _FINISHED and reached


def _end_of_run(recorded: RecordedRun, whole: bool) -> str:
    if not recorded.states:
        return ""
    last = recorded.states[-1]
    if whole and _ended_at_target(last):
        return last.text
    return end_words(last.state, last.text, whole)


def end_words(state: int, text: str, whole: bool = True) -> str:
    """Say how a run ended.

    Args:
        state: the last that was recorded, one of STATE_* of RunState.
        text: what the run said of it.
        whole: every stop has a value.
    """
    words = _STATES.get(state, "the recording ends before the run does")
    if state == _FINISHED and not whole:
        words = "the run went to its end, but not all lines are complete"
    return f"{words}: {text}" if text and text != words else words


def pass_name(line: Line) -> str:
    """Return what the passes of a line are called together, for example ``ppp XYZ``."""
    return f"{line.name} {line.order}".rstrip()


def incomplete_sentences(passes: Completeness) -> list[str]:
    """Say that a run is not complete, and how it ended; nothing where it is."""
    if passes.whole:
        return []
    said = (
        f"The measurement is not complete: {passes.complete} of {passes.planned} planned"
        f" {passes.unit} have {'a value' if passes.unit == 'stops' else 'every stop'}."
    )
    return [f"{said} End of the run: {passes.end.rstrip('.')}." if passes.end else said]
