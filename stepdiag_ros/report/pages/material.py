"""What the report tells: all that is found out about a run, by the functions that commands call.

Whatever a run has no data for is None, and a sentence says why.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from math import nan
from typing import TypeVar

import numpy as np

from stepdiag_ros.bags.digest import sha256_of
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.header import RunHeader
from stepdiag_ros.bags.passes import TakenLine, completeness_of, taken
from stepdiag_ros.bags.run import RecordedRun
from stepdiag_ros.bags.seal import Seal, read_seal
from stepdiag_ros.compensation import control as control_of
from stepdiag_ros.compensation.control import Layout, checked_settings
from stepdiag_ros.configuration import machine_if_described
from stepdiag_ros.evaluation.budget import (
    BudgetReport,
    LargestErrorUncertainty,
    budget_of,
    is_lower_bound,
    uncertainty_of_largest,
)
from stepdiag_ros.evaluation.compensation import CompensationReport, compensation_of, identified_of
from stepdiag_ros.evaluation.diagnosing import verdict_of
from stepdiag_ros.evaluation.diagnosis import Ask, DiagnosisReport, build_diagnosis, with_proposal
from stepdiag_ros.evaluation.experiment import Experiment, experiment_of
from stepdiag_ros.evaluation.flown import FlownRun, flown_run
from stepdiag_ros.evaluation.lead import RunLead, lead_of, uneven_of
from stepdiag_ros.evaluation.positioning import PositioningReport, positioning_of
from stepdiag_ros.evaluation.recorded_run import Correct
from stepdiag_ros.evaluation.report import Report
from stepdiag_ros.evaluation.single_errors import SingleError, at_least_of_tests, single_errors
from stepdiag_ros.evaluation.volumetric import accuracies_of
from stepdiag_ros.metrology.air.recompensation import SensorValue
from stepdiag_ros.metrology.discrepancy.proposal import is_open
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.model import MachineModel
from stepdiag_ros.metrology.solvers import solvers
from stepdiag_ros.metrology.solvers.catalogue import in_order_of_reliance
from stepdiag_ros.metrology.solvers.observations import observe
from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy
from stepdiag_ros.metrology.uncertainty.coverage import Expanded
from stepdiag_ros.metrology.uncertainty.largest_error import LargestErrorBudget
from stepdiag_ros.metrology.uncertainty.repeats import Repeats, repeats_of
from stepdiag_ros.report.pages.given import Given
from stepdiag_ros.words.positioning import uneven_reason

_Made = TypeVar("_Made")
_MOST_SOURCES = 4
"""Sources of uncertainty that a sentence names."""
_PARTS = (
    "machine",
    "weather",
    "experiment",
    "positioning",
    "budget",
    "diagnosis",
    "compensation",
)
"""Properties of a material that a run may have nothing for."""


def unsolved(recorded: RecordedRun, why: str, correct: Correct | None = None) -> Report:
    """Return the report of a run whose lines no method can be asked about.

    Args:
        recorded: the run.
        why: in a sentence; of lines with unevenly spaced targets a shorter one is taken.
        correct: returns the lines at 20 °C, and in words how; None: as they were measured.

    Raises:
        ValueError: the lines cannot be corrected.
    """
    measured = recorded.measurement
    measurement, corrections = (measured, ()) if correct is None else correct(measured)
    name = recorded.machine.get("name", "")
    uneven = uneven_of(measurement)
    reason = uneven_reason(uneven) if uneven else _sentence(ValueError(why), recorded)
    return Report(
        results=(),
        refused=dict.fromkeys(in_order_of_reliance(solvers()), reason),
        run_id=recorded.run_id,
        plan=recorded.plan.name,
        machine=name if isinstance(name, str) else "",
        chain=recorded.chain,
        run_software_version=recorded.software_version,
        bag=recorded.path,
        simulated=True if recorded.simulated_cell else None,
        measurement=measurement,
        remarks=corrections,
        passes=completeness_of(recorded, measurement),
        recording=recorded.flaws,
    )


def with_told(given: Given, recorded: RecordedRun) -> Given:
    """Return what is given, and where nothing is, what the source of an imported bag states."""
    told = recorded.told_by_source
    return replace(
        given,
        operator=given.operator or told.get("operator", ""),
        place=given.place or told.get("location", ""),
        serial=given.serial or told.get("machine_serial_number", ""),
        laser_serial=given.laser_serial or told.get("instrument_serial_number", ""),
    )


class Material:
    """Everything that a report is made of; each part is found out when it is first asked for.

    Args:
        recorded: the run.
        report: of ``report.recorded_run.report_of_run``, with the visibility table.
        given: what the bag cannot know.

    Attributes:
        recorded: as given.
        report: as given.
        measurement: its lines, as they were solved.
        given: as given, and where nothing was, what the source of an imported bag tells.

    Raises:
        ValueError: the report was made without the lines of the run.
    """

    def __init__(self, recorded: RecordedRun, report: Report, given: Given) -> None:
        if report.measurement is None:
            raise ValueError(f"{recorded.path}: the report needs the lines of the run")
        self.recorded, self.report = recorded, report
        self.measurement: Measurement = report.measurement
        self._missing: dict[str, str] = {}
        self.given = with_told(given, recorded)

    def why_not(self, part: str) -> str:
        """Return why a part is None or empty, in a sentence; empty if it is not.

        Args:
            part: name of a property.
        """
        getattr(self, part)
        return self._missing.get(part, "")

    @property
    def missing(self) -> dict[str, str]:
        """Return which parts are None or empty: name → why, in a sentence."""
        reasons = {part: self.why_not(part) for part in _PARTS}
        return {part: why for part, why in reasons.items() if why}

    @cached_property
    def header(self) -> RunHeader | None:
        """Return what the bag says in front of its messages; None of another recorder's bag."""
        try:
            return self.recorded.bag.header
        except BagError:
            return None

    @cached_property
    def machine(self) -> Machine | None:
        """Return the machine that measured; None where the bag does not describe it."""
        if not self.recorded.machine_text:
            self._missing["machine"] = "The bag does not describe the machine."
            return None
        source = f"{self.recorded.path}: machine"
        machine = machine_if_described(self.recorded.machine_text, source)
        if machine is None:
            self._missing["machine"] = "The bag holds nothing of the machine but its name."
        return machine

    @cached_property
    def sha256(self) -> str:
        """Return the SHA-256 of the bag; empty where it is a folder."""
        return sha256_of(self.recorded.path) if self.recorded.path.is_file() else ""

    @cached_property
    def seal(self) -> Seal | None:
        """Return the seal beside the bag, compared with it; None if there is none."""
        return read_seal(self.recorded.path)

    @cached_property
    def weather(self) -> tuple[SensorValue, ...]:
        """Return what the sensors told, in order of time."""
        values = tuple(self.recorded.weather())
        if not values:
            stated = any(np.isfinite(one.environment).any() for one in self.measurement.lines)
            air = " Temperatures and air are as stated with the readings." if stated else ""
            self._missing["weather"] = f"No weather sensor was recorded.{air}"
        return values

    @cached_property
    def flown(self) -> FlownRun | None:
        """Return how the lines were measured on the fly; None where none was."""
        return flown_run(self.recorded)

    @cached_property
    def experiment(self) -> Experiment | None:
        """Return Table 1 of Ibaraki & Hata 2010; None where the lines are not enough for it."""
        found = experiment_of(self.report)
        if found is None:
            why = self.report.refused.get("setup_robust", "not all nine curves are determined")
            self._missing["experiment"] = (
                f"The table needs the setup-robust method: {why.rstrip('.')}."
            )
        return found

    @cached_property
    def taken(self) -> tuple[TakenLine, ...]:
        """Return what was taken of each line of the plan."""
        return taken(self.recorded.plan, self.measurement)

    @cached_property
    def repeats(self) -> Repeats:
        """Return scatter and drift of repeated passes; NaN without repeats."""
        try:
            return repeats_of(self.measurement, observe(self.measurement))
        except ValueError:
            # Lines that are not those of a box; why they are not is told with the error curves.
            return Repeats(nan, 0.0, nan, nan, 0, np.empty(0))

    @cached_property
    def uneven(self) -> tuple[str, ...]:
        """Return the lines whose targets are not evenly spaced, which no method can use."""
        return uneven_of(self.measurement)

    @property
    def repeated(self) -> bool:
        """Say whether a line was measured more than once in one direction."""
        passes = [
            (line.setup, line.line.name, line.line.order, line.line.direction)
            for line in self.measurement.lines
        ]
        return len(set(passes)) < len(passes)

    @cached_property
    def positioning(self) -> PositioningReport | None:
        """Return the tests by ISO 230-2 and ISO 230-6; None where no line is complete."""
        return self._made_or_missing(
            "positioning",
            lambda: positioning_of(
                self.recorded, self.given.conditions, correct=self.given.correct
            ),
        )

    @cached_property
    def accuracies(self) -> Mapping[str, VolumetricAccuracy]:
        """Return the longest error vector in the volume by every method."""
        return accuracies_of(self.report)

    @cached_property
    def accuracy(self) -> VolumetricAccuracy | None:
        """Return the longest error vector by the method to rely on; None where none was solved."""
        preferred = self.report.preferred()
        return None if preferred is None else self.accuracies[preferred.method]

    @cached_property
    def expanded(self) -> Expanded:
        """Return the expanded uncertainty of the longest error vector, m; NaN where not known.

        The larger of two: of what the readings tell alone, and of all sources that the budget
        knows; see ``lower_bound``.
        """
        return Expanded() if self._largest is None else self._largest.expanded

    @property
    def expanded_of_readings(self) -> Expanded:
        """Return that of the readings; NaN where not known."""
        return Expanded() if self._largest is None else self._largest.of_readings

    @property
    def expanded_of_budget(self) -> Expanded:
        """Return what the sources of the budget make of it; NaN where not known."""
        return Expanded() if self._largest is None else self._largest.of_budget

    @property
    def budget_of_largest_error(self) -> LargestErrorBudget | None:
        """Return the budget of the longest error vector; None where one of the two is not known."""
        return None if self._largest is None else self._largest.budget

    @cached_property
    def _largest(self) -> LargestErrorUncertainty | None:
        """Return how well the longest error vector is known; None where none was solved."""
        if self.accuracy is None:
            return None
        budget = None if self.budget is None else self.budget.budget
        return uncertainty_of_largest(self.report, self.accuracy, budget)

    @property
    def expanded_uncertainty(self) -> float:
        """Return the expanded uncertainty of the longest error vector (95 %), m."""
        return self.expanded.value

    @cached_property
    def single_errors(self) -> tuple[SingleError, ...]:
        """Return the errors over the travel by the method to rely on; empty where unknown."""
        preferred = self.report.preferred()
        if preferred is None:
            return ()
        known = single_errors(preferred, None if self.budget is None else self.budget.budget)
        tests = () if self.positioning is None else self.positioning.tests
        return at_least_of_tests(known, tests)

    @property
    def unknown_sources(self) -> str:
        """Return the sources that act and are not known, in words; empty without a budget."""
        names = () if self.budget is None else self.budget.budget.unknown_sources
        more = f" and {len(names) - _MOST_SOURCES} more" if len(names) > _MOST_SOURCES else ""
        return f"{', '.join(names[:_MOST_SOURCES])}{more}"

    @property
    def lower_bound(self) -> bool:
        """Say whether that uncertainty is a lower bound: a source that acts is not known."""
        return is_lower_bound(None if self.budget is None else self.budget.budget)

    @cached_property
    def budget(self) -> BudgetReport | None:
        """Return the uncertainty budget of the method to rely on; None where there is none."""

        def made() -> BudgetReport:
            given = self.given
            budget = budget_of(
                self.report, given.instrument, given.expansion, given.material_temperature
            )
            return BudgetReport(budget, None, self.report.run_id, self.report.bag)

        return self._made_or_missing("budget", made)

    @cached_property
    def diagnosis(self) -> DiagnosisReport | None:
        """Return what ``stepdiag diagnose`` says; None where the run cannot be compared.

        Where it is ambiguous an extra plan is sought that would tell, as with ``--propose``.
        """

        def made() -> DiagnosisReport:
            if self.uneven:
                raise ValueError(uneven_reason(self.uneven))
            lines_alone = replace(self.measurement, direct=None)
            report = build_diagnosis(
                lines_alone,
                MachineModel(),
                catalogue(),
                bag=self.recorded.path if self.recorded.path.is_file() else None,
                run_id=self.report.run_id,
                again=False,
                remarks=()
                if self.measurement.direct is None
                else ("what was measured directly is not in this comparison",),
            )
            if not is_open(report.diagnosis):
                return report
            plan = self.recorded.plan
            ask = Ask(plan if plan.feed > 0.0 else None, self.machine)
            return with_proposal(report, lines_alone, ask)

        return self._made_or_missing("diagnosis", made)

    @cached_property
    def diagnosed_report(self) -> Report:
        """Return the report with the verdict of the diagnosis and the budget."""
        if self.diagnosis is None:
            verdict = Verdict(sentence=self.why_not("diagnosis"))
        else:
            verdict = verdict_of(self.diagnosis.diagnosis, self.measurement)
        budget = None if self.budget is None else self.budget.budget
        return replace(self.report, verdict=verdict, budget=budget)

    @cached_property
    def lead(self) -> RunLead:
        """Return what is said first, with the uncertainty of all sources that are known."""
        return lead_of(
            self.diagnosed_report,
            self.accuracy,
            self.single_errors,
            self.positioning,
        )

    @cached_property
    def compensation(self) -> CompensationReport | None:
        """Return tables and what they leave; None where there is no error map."""

        def made() -> CompensationReport:
            control = control_of(self.given.control)
            identified = identified_of(
                self.diagnosed_report, self.recorded.start_time, sha256=self.sha256
            )
            return compensation_of(
                control, identified, Layout(settings=checked_settings(control, {}))
            )

        return self._made_or_missing("compensation", made)

    def _made_or_missing(self, name: str, make: Callable[[], _Made]) -> _Made | None:
        try:
            return make()
        except ValueError as error:
            self._missing[name] = _sentence(error, self.recorded)
            return None


def _sentence(error: Exception, recorded: RecordedRun) -> str:
    """Return why a part is not there, without the name of the file that the whole report is of."""
    text = " ".join(str(error).split()).removeprefix(f"{recorded.path}: ")
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."
