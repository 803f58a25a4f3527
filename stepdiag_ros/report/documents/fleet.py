"""The machines of an archive as they are now, as a JSON document."""

from collections.abc import Sequence
from datetime import datetime

from stepdiag_ros import schemas
from stepdiag_ros.archive.fleet import FleetMachine, FleetRun
from stepdiag_ros.schemas.fleet import Document, Judged, Machine, Run
from stepdiag_ros.schemas.parts import part_of
from stepdiag_ros.words.fleet import change_words, outlook_words, overdue


def fleet_json(
    place: str, machines: Sequence[FleetMachine], every: int | None, made: datetime
) -> str:
    """Return the machines as JSON text; SI, ``null`` where not known.

    Args:
        place: of the archive.
        machines: in the order in which they stand in the document.
        every: days between runs; None: not stated.
        made: when the archive was read.
    """
    content = Document(
        place=place,
        made=made.isoformat(timespec="seconds"),
        every_days=every,
        machines=[_machine(one, every, made) for one in machines],
    )
    return schemas.json_text(schemas.document("fleet", content))


def _machine(machine: FleetMachine, every: int | None, made: datetime) -> Machine:
    due = machine.due(every)
    return Machine(
        name=machine.name,
        serial_number=machine.serial_number or None,
        state=machine.state.name,
        judged=[
            part_of(Judged, one, expanded_uncertainty=one.expanded, conformity=one.conformity.name)
            for one in machine.judged
        ],
        outlook=outlook_words(machine),
        changed=change_words(machine) or None,
        due=None if due is None else f"{due:%Y-%m-%d}",
        overdue=None if every is None else overdue(machine, every, made),
        runs=[_run(one) for one in machine.runs],
    )


def _run(run: FleetRun) -> Run:
    return Run(
        run_id=run.run_id or None,
        time=None if run.time is None else run.time.isoformat(timespec="seconds"),
        verdict=run.verdict or None,
        largest=run.largest,
        largest_expanded_uncertainty=run.expanded,
        problem=run.problem or None,
        bag=run.bag or None,
        report=run.report or None,
        simulated=run.simulated or None,
    )
