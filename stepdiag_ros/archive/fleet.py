"""The machines of an archive as they are now: newest run, tolerances, trends, and the next run."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from math import nan
from typing import TYPE_CHECKING, Any

from stepdiag_ros.archive.histories import (
    UNNAMED,
    MachineHistory,
    histories,
    machine_urgency,
)
from stepdiag_ros.archive.stated import LARGEST, Stated
from stepdiag_ros.archive.work import BAGS, bags_of
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.standards.conformity import Conformity, conformity
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR

if TYPE_CHECKING:
    from stepdiag_ros.archive.catalogue import Catalogue
    from stepdiag_ros.archive.place import Place

REPORTS = "reports"
"""Folder of reports in an archive: one folder a run, named by its identity."""
REPORT = "report.html"
WORST_FIRST = (
    Conformity.NOT_WITHIN,
    Conformity.UNDECIDED,
    Conformity.WITHIN,
    Conformity.NOT_ASKED,
)
_RUNS = """
select coalesce(machine, ?) as machine, time, run_id, bag_sha256, serial_number, verdict, contained,
    largest_m, largest_expanded_uncertainty_m, largest_upper_bound_m, problem, simulated
from runs order by time desc nulls last, bag_sha256, run_number
"""
_FIGURES = """
with newest as (
    select machine, bag_sha256, run_id from runs where time is not null qualify row_number()
        over (partition by machine order by time desc, bag_sha256, run_number) = 1
)
select coalesce(f.machine, ?) as machine, name, unit, value,
    coalesce(expanded_uncertainty, ? * standard_uncertainty) as expanded
from figures f join newest n on f.bag_sha256 = n.bag_sha256
    and f.run_id is not distinct from n.run_id
where relied_on and kind in ('volume', 'effect', 'result') and list_contains(?, name)
"""


@dataclass(frozen=True)
class FleetRun:
    """A run of a machine.

    Attributes:
        run_id: its identity; empty if the bag states none.
        time: when it began; None if not known.
        verdict: name of the verdict of its diagnosis; empty without one.
        contained: every uncertainty contains all that acts beside the errors.
        largest: longest error vector in the volume, m; NaN if not known.
        expanded: its U, m; NaN if not known.
        upper_bound: of the error at every place (95 %), m; NaN if not known.
        problem: why it could not be evaluated; empty if it was.
        sha256: of its bag.
        bag: name of the bag in the place; empty if it is not there any more.
        report: page of its report, as a name in the place; empty without a report.
        alone: its bag holds no other run.
        simulated: it was made in a simulated cell; False too where its bag does not say so.
    """

    run_id: str
    time: datetime | None
    verdict: str
    contained: bool
    largest: float
    expanded: float
    upper_bound: float
    problem: str
    sha256: str
    bag: str
    report: str
    alone: bool
    simulated: bool


@dataclass(frozen=True)
class Judged:
    """A figure of the newest run beside its tolerance.

    Attributes:
        name: of the figure.
        unit: of value, U and tolerance.
        value: of the newest run; NaN if it does not determine it.
        expanded: its U; NaN if not known.
        tolerance: largest magnitude that the owner allows.
        conformity: what is proven, ISO 14253-1.
    """

    name: str
    unit: str
    value: float
    expanded: float
    tolerance: float
    conformity: Conformity


@dataclass(frozen=True)
class FleetMachine:
    """A machine of an archive.

    Attributes:
        name: in the archive.
        serial_number: of the newest bag that states one; empty if none does.
        runs: of the machine, newest first; those without a date at the end.
        judged: figures of the newest run that have a tolerance.
        history: what the years show; None without a figure of a run with a date.
    """

    name: str
    serial_number: str
    runs: tuple[FleetRun, ...]
    judged: tuple[Judged, ...]
    history: MachineHistory | None

    @property
    def newest(self) -> FleetRun | None:
        """Return the newest run; None if no run has a date."""
        return self.runs[0] if self.runs[0].time is not None else None

    @property
    def state(self) -> Conformity:
        """Return what is proven of the machine: the worst of its figures."""
        proven = {one.conformity for one in self.judged}
        return next((one for one in WORST_FIRST if one in proven), Conformity.NOT_ASKED)

    def due(self, every: int | None) -> datetime | None:
        """Return when the next run is due; None if that is not known.

        Args:
            every: days between runs; None: not stated.
        """
        last = None if self.newest is None else self.newest.time
        return None if last is None or every is None else last + timedelta(days=every)


def fleet(
    catalogue: "Catalogue", progress: Callable[[float, str], None] | None = None
) -> list[FleetMachine]:
    """Return the machines of an archive, worst first.

    First those whose newest run exceeds a tolerance, then those of which nothing is proven, those
    within, and those without a tolerance; among these in the order of their trends.

    Args:
        catalogue: of the archive.
        progress: called with the part that is done (0..1), and the name of the last machine.

    Raises:
        ValueError: a part is damaged, or the archive has no run.
    """
    rows = catalogue.ask(_RUNS, [UNNAMED])
    if not rows:
        url = catalogue.place.url
        raise Refusal(
            f"{url} has no run: 'stepdiag archive add {url} BAG' adds those of a bag",
            fault="missing",
            aspect="runs",
        )
    stated = catalogue.stated
    names = sorted({name for limits in stated.tolerances.values() for name in limits})
    figures: dict[str, list[dict[str, Any]]] = {}
    for row in catalogue.ask(_FIGURES, [UNNAMED, COVERAGE_FACTOR, names]) if names else ():
        figures.setdefault(row["machine"], []).append(row)
    known = {one.name: one for one in histories(catalogue, progress=progress)}
    machines = [
        _machine(name, runs, figures.get(name, ()), stated, known.get(name), serial)
        for name, serial, runs in _runs_of_machines(rows, catalogue.place)
    ]
    return sorted(machines, key=_order)


def _order(machine: FleetMachine) -> tuple[Any, ...]:
    history = machine.history
    trend = () if history is None else machine_urgency(history)
    return WORST_FIRST.index(machine.state), history is None, trend, machine.name


def _runs_of_machines(
    rows: Sequence[Mapping[str, Any]], place: "Place"
) -> Iterable[tuple[str, str, list[FleetRun]]]:
    """Yield name, serial number and runs of each machine; a run in two bags counts once."""
    bags = bags_of(place)
    pages = {name for name in place.names(BAGS) if name.endswith(f"/{REPORT}")}
    beside = {name.split("/")[1]: name for name in pages}
    stored = {*place.names(REPORTS)}
    number: dict[str, int] = {}
    for row in rows:
        number[row["bag_sha256"]] = number.get(row["bag_sha256"], 0) + 1
    machines: dict[str, dict[str, FleetRun]] = {}
    serials: dict[str, str] = {}
    for row in rows:
        run_id, sha256 = row["run_id"] or "", row["bag_sha256"]
        alone = number[sha256] == 1
        own = f"{REPORTS}/{run_id}/{REPORT}"
        report = own if own in stored else beside.get(sha256, "") if alone else ""
        run = FleetRun(
            run_id,
            row["time"],
            row["verdict"] or "",
            bool(row["contained"]),
            _number(row["largest_m"]),
            _number(row["largest_expanded_uncertainty_m"]),
            _number(row["largest_upper_bound_m"]),
            row["problem"] or "",
            sha256,
            bags.get(sha256, ""),
            report,
            alone,
            bool(row["simulated"]),
        )
        machines.setdefault(row["machine"], {}).setdefault(run_id or sha256, run)
        if row["serial_number"]:
            serials.setdefault(row["machine"], row["serial_number"])
    for name, runs in machines.items():
        yield name, serials.get(name, ""), [*runs.values()]


def _machine(
    name: str,
    runs: Sequence[FleetRun],
    figures: Iterable[Mapping[str, Any]],
    stated: Stated,
    history: MachineHistory | None,
    serial_number: str,
) -> FleetMachine:
    limits = {**stated.tolerances.get("", {}), **stated.tolerances.get(name, {})}
    before = {} if history is None else {one.name: one.unit for one in history.figures}
    newest = {row["name"]: row for row in figures}
    judged = []
    for figure, tolerance in limits.items():
        row = newest.get(figure)
        if row is None and figure not in before and figure != LARGEST:
            continue  # a machine that no plan has measured so
        value = nan if row is None else _number(row["value"])
        expanded = nan if row is None else _number(row["expanded"])
        more_acts = Verdict(runs[0].verdict, contained=runs[0].contained).more_acts
        bound = runs[0].upper_bound if figure == LARGEST else nan
        proven = conformity(abs(value), expanded, tolerance, more_acts=more_acts, upper_bound=bound)
        unit = before.get(figure, "m") if row is None else row["unit"]
        judged.append(Judged(figure, unit, value, expanded, tolerance, proven))
    return FleetMachine(name, serial_number, tuple(runs), tuple(judged), history)


def _number(value: float | None) -> float:
    return nan if value is None else float(value)
