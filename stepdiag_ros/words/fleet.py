"""What is stated of the machines of an archive, in a few words and in sentences."""

from collections.abc import Sequence
from datetime import datetime

from stepdiag_ros.archive.fleet import WORST_FIRST, FleetMachine, FleetRun, Judged
from stepdiag_ros.archive.stated import FILE, LARGEST
from stepdiag_ros.metrology.standards.conformity import Conformity
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.text.numbers import UNKNOWN, with_expanded
from stepdiag_ros.words.diagnosis import readable_unit
from stepdiag_ros.words.trends import few_words, leaving_words, moving_words, staying_words

STATES = {
    Conformity.NOT_WITHIN: "beyond",
    Conformity.UNDECIDED: "undecided",
    Conformity.WITHIN: "within",
    Conformity.NOT_ASKED: "no tolerance",
}
"""What is proven of a machine → the word for it."""
NOT_EVALUATED = "not evaluated"


def headline(machines: Sequence[FleetMachine]) -> str:
    """Say how many machines exceed a tolerance."""
    number = sum(one.state is Conformity.NOT_WITHIN for one in machines)
    every = f"{len(machines)} machine{'s' * (len(machines) != 1)}"
    if all(one.state is Conformity.NOT_ASKED for one in machines):
        return f"{every}, no tolerance stated"
    if not number:
        return f"Of {every}, none is proven to exceed a tolerance"
    return f"{number} of {every} exceed{'s' * (number == 1)} a tolerance"


def sentences(machines: Sequence[FleetMachine], every: int | None, made: datetime) -> list[str]:
    """Say what the states of the machines mean, and what is due.

    Args:
        machines: of the archive.
        every: days between runs; None: not stated.
        made: when the archive was read.
    """
    states = [one.state for one in machines]
    found = []
    if {*states} == {Conformity.NOT_ASKED}:
        found.append(f"State tolerances in {FILE} of the archive to compare machines with them.")
    else:
        counts = ", ".join(
            f"{states.count(one)} {STATES[one]}" for one in WORST_FIRST if one in states
        )
        found.append(f"Newest runs against tolerances (ISO 14253-1): {counts}.")
    if every is None:
        found.append(
            "No interval between runs is stated (--every DAYS): what is overdue is unknown."
        )
    else:
        late = sum(overdue(one, every, made) for one in machines)
        found.append(
            f"A run is due {every} days after the last: on {made:%Y-%m-%d}, {late} overdue."
        )
    return found


def overdue(machine: FleetMachine, every: int | None, now: datetime) -> bool:
    """Say whether the next run is late; a machine without a dated run is."""
    due = machine.due(every)
    return every is not None and (due is None or due.date() < now.date())


def beside_words(machine: FleetMachine) -> str:
    """Name the figures beside the largest error that are beyond their tolerance, or undecided.

    Empty if the largest error has the state of the machine, or if all are within.
    """
    names = [one.name for one in machine.judged if one.conformity is machine.state]
    open_state = machine.state in (Conformity.NOT_WITHIN, Conformity.UNDECIDED)
    return few_words(names) if open_state and LARGEST not in names else ""


def outlook_words(machine: FleetMachine) -> str:
    """Say when the machine leaves a tolerance, or that this is not known."""
    history = machine.history
    return UNKNOWN if history is None else leaving_words(history) or staying_words(history)


def change_words(machine: FleetMachine) -> str:
    """Say what has changed lately, or grows; empty if nothing does."""
    return "" if machine.history is None else moving_words(machine.history)


def verdict_words(run: FleetRun | None) -> str:
    """Return the verdict on a run, or the reason why it is unknown."""
    if run is None:
        return "no run with a date"
    verdict = NOT_EVALUATED if run.problem else run.verdict or UNKNOWN
    return f"{verdict}, simulated cell" if run.simulated else verdict


def largest_words(run: FleetRun | None) -> str:
    """Write the largest error of a run with its U, µm."""
    return UNKNOWN if run is None else with_expanded(run.largest, run.expanded, IN_MICRO)


def judged_words(figure: Judged) -> str:
    """Write a figure of the newest run beside its tolerance."""
    unit, factor = readable_unit(figure.unit)
    value = with_expanded(figure.value, figure.expanded, factor)
    limit = f"{figure.tolerance * factor:.10g} {unit}".rstrip()
    shown = value if value == UNKNOWN else f"{value} {unit}".rstrip()
    return f"{figure.name}: {shown}, tolerance {limit}: {STATES[figure.conformity]}"
