"""Runs of one machine over months: which belong together, and what becomes of every effect."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta, timezone
from itertools import combinations

from stepdiag_ros.bags.run import RecordedRun
from stepdiag_ros.evaluation.compensation import ANY_DATE
from stepdiag_ros.evaluation.diagnosis import NO_CHAIN, RunFile
from stepdiag_ros.evaluation.solving import one_thread
from stepdiag_ros.metrology.discrepancy.extension import ModelComparison, with_chain
from stepdiag_ros.metrology.discrepancy.findings import Diagnosis
from stepdiag_ros.metrology.discrepancy.history import DiagnosedRun, EffectHistory, histories_of
from stepdiag_ros.metrology.discrepancy.joint import joined, require_one_machine
from stepdiag_ros.metrology.effects.effect import Effect
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.model import MachineModel
from stepdiag_ros.metrology.refusal import Refusal

_UNNAMED = "unnamed"
"""Name of a machine whose file states none."""
_SERIAL = "machine_serial_number"
MONTH = timedelta(days=365.2425 / 12.0)


@dataclass(frozen=True)
class ReadRun:
    """A run as it was read, before it is diagnosed with others.

    Attributes:
        file: that it was read from.
        measurement: its lines.
        start: when it began, ns since 1970; 0 if not known.
        machine: what is stated of the machine in words, such as its name: what → text.
    """

    file: RunFile
    measurement: Measurement
    start: int = 0
    machine: Mapping[str, str] = field(default_factory=dict)

    @property
    def date(self) -> datetime | None:
        """Return when the run began; None if that is not known."""
        seconds = self.start * 1e-9
        return datetime.fromtimestamp(seconds, timezone.utc) if seconds > ANY_DATE else None


@dataclass(frozen=True)
class MeasuredTogether:
    """Runs that were made together, as one measurement.

    Attributes:
        files: that they were read from, in the order of their dates.
        start: when the first began.
        diagnosis: of them all.
    """

    files: tuple[RunFile, ...]
    start: datetime
    diagnosis: Diagnosis


@dataclass(frozen=True)
class HistoryReport:
    """What is shown of runs over months.

    Attributes:
        runs: in the order of their dates.
        effects: what becomes of each effect that any run names or describes, clearest first.
        model: that the runs were compared with.
        model_source: file of the model; empty if none was given.
        remarks: about the runs as a whole.
    """

    runs: tuple[MeasuredTogether, ...]
    effects: tuple[EffectHistory, ...]
    model: MachineModel
    model_source: str = ""
    remarks: tuple[str, ...] = ()


def machine_facts(recorded: RecordedRun) -> dict[str, str]:
    """Return what a recorded run states of its machine in words: what → text."""
    name = recorded.told_by_source.get("machine") or str(recorded.machine.get("name", _UNNAMED))
    stated = {"name": name, "serial number": recorded.told_by_source.get(_SERIAL, "")}
    return {what: text for what, text in stated.items() if text not in ("", _UNNAMED)}


def apart(runs: Sequence[ReadRun], days: float) -> list[list[ReadRun]]:
    """Sort runs by their dates and part those that were not made together.

    Args:
        runs: at least one.
        days: a run belongs to those before it if it begins within this time of the first of them.

    Returns:
        runs that belong together, in the order of their dates; all runs as they were given where
        none states its date, or those without a date could belong to all others.

    Raises:
        ValueError: runs are of different machines or boxes, one is given twice, or one without a
            date is among runs that were not made together; names the files.
    """
    require_one_machine([one.measurement for one in runs], [str(one.file.path) for one in runs])
    for one, other in combinations(runs, 2):
        _require_same_machine(one, other)
        _require_different(one, other)
    dated = [one for one in runs if one.date is not None]
    groups = list(_groups(sorted(dated, key=lambda one: one.start), timedelta(days=days)))
    undated = [one for one in runs if one.date is None]
    if len(groups) > 1 and undated:
        raise Refusal(
            f"{undated[0].file.path} states no date, and the other runs were made at different"
            " times: leave it out, or diagnose it alone",
            fault="missing",
            aspect="date",
        )
    return groups if len(groups) > 1 else [list(runs)]


def _groups(runs: Sequence[ReadRun], within: timedelta) -> Iterator[list[ReadRun]]:
    group: list[ReadRun] = []
    for one in runs:
        if group and one.start - group[0].start > within.total_seconds() * 1e9:
            yield group
            group = []
        group.append(one)
    if group:
        yield group


def _require_different(one: ReadRun, other: ReadRun) -> None:
    again = one.file.run_id == other.file.run_id != "" and one.start == other.start
    if one.file.sha256 == other.file.sha256 or (again and one.date is not None):
        raise Refusal(
            f"{other.file.path} is the same run as {one.file.path}: give each run once",
            fault="twice",
            aspect="run",
        )


def _require_same_machine(one: ReadRun, other: ReadRun) -> None:
    for what, stated in one.machine.items():
        again = other.machine.get(what, stated)
        if again != stated:
            raise Refusal(
                f"{other.file.path} is of another machine than {one.file.path}: its {what} is"
                f" '{again}', not '{stated}'; give runs of one machine",
                fault="mismatch",
                aspect="machine",
            )


def build_history(
    groups: Sequence[Sequence[ReadRun]],
    model: MachineModel,
    catalogue: Mapping[str, Effect],
    *,
    model_source: str = "",
    seed: int = 0,
    progress: Callable[[float, str], None] | None = None,
    remarks: tuple[str, ...] = (),
) -> HistoryReport:
    """Diagnose the runs of each time and say what becomes of every effect.

    Args:
        groups: of ``apart``, at least two; every run has a date.
        model: what is taken as known.
        catalogue: effects to try, by name.
        model_source: file of the model; empty if none was given.
        seed: of the draws that show the influence of chance.
        progress: called with the part that is done (0..1), and what is being done.
        remarks: about the runs as a whole.

    Raises:
        ValueError: runs and model contradict each other, or a run cannot be compared.
    """
    effects = tuple(catalogue.values())
    chain = require_one_machine([one.measurement for group in groups for one in group])
    told = with_chain(replace(groups[0][0].measurement, chain=chain), model)
    model = replace(model, chain=told.chain)
    made: list[MeasuredTogether] = []
    runs: list[DiagnosedRun] = []
    with one_thread():
        for number, group in enumerate(groups):
            start = group[0].date
            assert start is not None
            if progress is not None:
                progress(number / len(groups), f"run {number + 1}: {start:%Y-%m-%d}")
            measurement = with_chain(joined([one.measurement for one in group]), model)
            diagnosis = ModelComparison(measurement, effects, seed).under(model)
            files = tuple(one.file for one in group)
            made.append(MeasuredTogether(files, start, diagnosis))
            runs.append(DiagnosedRun(measurement, (start - made[0].start) / MONTH, diagnosis))
        found = histories_of(runs, model, effects)
    chainless = () if told.chain else (NO_CHAIN,)
    return HistoryReport(tuple(made), found, model, model_source, (*remarks, *chainless))
