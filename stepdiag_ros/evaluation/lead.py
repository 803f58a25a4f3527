"""Summary of a run, wherever it is shown: one lead for terminal, page and documents.

First what decides whether the errors may be used at all: whether the recording holds what was
recorded, whether the run is complete, what the diagnosis says, whether the errors explain the
readings, what is unknown. Only then how large the errors are. What to do next follows from the
same.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stepdiag_ros.bags.passes import Completeness
from stepdiag_ros.bags.tally import Flaw
from stepdiag_ros.evaluation.budget import (
    is_lower_bound,
    lacks_material,
    shown_rotations,
    uncertainty_of_largest,
)
from stepdiag_ros.evaluation.positioning import PositioningReport, tests_alone, tests_of
from stepdiag_ros.evaluation.report import Report
from stepdiag_ros.evaluation.single_errors import SingleError, single_errors
from stepdiag_ros.evaluation.solving import one_thread
from stepdiag_ros.metrology.credibility import Misfit, is_noise, misfit
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.geometry import ROTATIONS, SQUARENESS, TRANSLATIONS, Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.plausible import ORDINARY, Plausible
from stepdiag_ros.metrology.solvers.observations import unevenly_spaced
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy, of_result
from stepdiag_ros.metrology.target import TargetStanding
from stepdiag_ros.metrology.tracker.tracked_line import TRACKER
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.planning.undetermined import undetermined


@dataclass(frozen=True)
class RunLead:
    """Summary of a run.

    Attributes:
        verdict: of the diagnosis, or why it is missing.
        passes: how much of the run is there; None if that is not known.
        bag: the recording; None if not at hand.
        solved: errors were estimated, and all that follows is of the method to rely on; None: they
            were not asked for.
        misfit: whether the errors explain the readings.
        reduced_chi_squared: of the fit; NaN if not known.
        unknown: names of the curves (of nine) and squareness errors that are not determined.
        remedy: which lines would determine them, in words; empty if that is not known.
        noise: the errors are no more than noise makes.
        volume: longest error vector in the measured box; None if not known.
        expanded_uncertainty: of that (95 %), m: with a budget the larger of U of the readings and U
            by the budget, without one U of the readings; NaN if not known.
        coverage_factor: of this U.
        expanded_uncertainty_of_readings: U of the readings alone (95 %), m; NaN if not known.
        budgeted: an uncertainty budget is in the uncertainties.
        lower_bound: a source that acts is not known: uncertainties are lower bounds.
        material: errors were corrected to 20 °C, and nothing was stated of how well that is known.
        plausible: sizes of rotations and of the laser's scale that uncertainties contain.
        rotation_stated: somebody stated that of rotations; if not, it is assumed.
        rotation_shown: how large the readings show rotations where that is more, rad; NaN if not.
        errors: the single errors that are known, largest first.
        directions: of the lines that were measured.
        as_zero: names of the rotations that were taken as zero.
        told_elsewhere: those of them that another method determines.
        recording: what is wrong with the recording: missing, doubled, out of order.
        tracked: the lines were measured with a laser tracker.
        repeated: at least one line was measured more than once.
        target: how far the run has come to its target; None if it has none.
        uneven: lines whose targets are not evenly spaced, so that only ISO 230-2 and ISO 230-6
            evaluate the run; empty if errors were estimated.
        positioning: the tests by these standards; None where they were not evaluated, or the run
            is more than such tests.
    """

    verdict: Verdict = field(default_factory=Verdict)
    passes: Completeness | None = None
    bag: Path | None = None
    solved: bool | None = None
    misfit: Misfit = Misfit.NONE
    reduced_chi_squared: float = math.nan
    unknown: tuple[str, ...] = ()
    remedy: str = ""
    noise: bool = False
    volume: VolumetricAccuracy | None = None
    expanded_uncertainty: float = math.nan
    coverage_factor: float = COVERAGE_FACTOR
    expanded_uncertainty_of_readings: float = math.nan
    budgeted: bool = False
    lower_bound: bool = True
    material: bool = False
    plausible: Plausible = ORDINARY
    rotation_stated: bool = False
    rotation_shown: float = math.nan
    errors: tuple[SingleError, ...] = ()
    directions: tuple[str, ...] = ()
    as_zero: tuple[str, ...] = ()
    told_elsewhere: tuple[str, ...] = ()
    recording: tuple[Flaw, ...] = ()
    tracked: bool = False
    repeated: bool = True
    target: TargetStanding | None = None
    uneven: tuple[str, ...] = ()
    positioning: PositioningReport | None = None

    @property
    def whole(self) -> bool:
        """Say whether nothing of the plan is known to be missing."""
        return self.passes is None or self.passes.whole

    @property
    def more_acts(self) -> bool:
        """Say whether more acts than errors and their uncertainty contain."""
        return self.verdict.more_acts or self.misfit is Misfit.SHOWN


def lead_of(
    report: Report,
    accuracy: VolumetricAccuracy | None = None,
    errors: Sequence[SingleError] | None = None,
    positioning: PositioningReport | None = None,
) -> RunLead:
    """Return the summary of a run that was solved, or could not be solved.

    Args:
        report: of the run; with a budget every uncertainty is at least that of the budget.
        accuracy: of the method to rely on, where it was computed already.
        errors: by the same method, where computed already.
        positioning: the tests by ISO 230-2 and ISO 230-6, where they were evaluated.
    """
    result, measurement = report.preferred(), report.measurement
    if result is None:
        uneven = () if measurement is None else uneven_of(measurement)
        return RunLead(
            *(report.verdict, report.passes, report.bag),
            solved=False,
            unknown=(*TRANSLATIONS, *SQUARENESS),
            remedy="" if uneven else _remedy(measurement, report.passes),
            recording=report.recording,
            target=report.target,
            uneven=uneven,
            positioning=positioning,
        )
    rotating = any(name in result.curves for name in ROTATIONS)
    if accuracy is None:
        accuracy = accuracy_of(result, report.chain, report.plausible)
    elif not math.isfinite(accuracy.value):
        accuracy = None
    known = [
        one
        for one in (single_errors(result, report.budget) if errors is None else errors)
        if math.isfinite(one.value)
    ]
    freedom = result.degrees_of_freedom
    lines = () if measurement is None else measurement.lines
    unknown = _unknown(result)
    with one_thread():
        noise = accuracy is not None and is_noise(result)
    return RunLead(
        verdict=report.verdict,
        passes=report.passes,
        recording=report.recording,
        bag=report.bag,
        solved=True,
        misfit=misfit(result, measurement),
        reduced_chi_squared=result.chi_squared / freedom if freedom else math.nan,
        unknown=unknown,
        remedy=_remedy(measurement, report.passes) if unknown else "",
        noise=noise,
        volume=accuracy,
        **_sureness(report, accuracy),
        positioning=_tests(report, positioning),
        errors=tuple(sorted(known, key=lambda one: one.value, reverse=True)),
        directions=tuple(dict.fromkeys(one.line.direction for one in lines)),
        tracked=measurement is not None and _is_tracked(measurement),
        repeated=not lines or len({one.line.setup for one in lines}) < len(lines),
        as_zero=() if rotating else ROTATIONS,
        told_elsewhere=() if rotating else _told(report.results),
        target=report.target,
    )


def accuracy_of(
    result: VolumetricErrors, chain: str, plausible: Plausible
) -> VolumetricAccuracy | None:
    """Return the longest error vector in the volume; None where it is not determined."""
    if not chain and any(name in result.curves for name in ROTATIONS):
        return None
    found = of_result(result, chain, plausible)
    return found if math.isfinite(found.value) else None


def _sureness(report: Report, accuracy: VolumetricAccuracy | None) -> dict[str, Any]:
    """Return the fields of a lead on how well the largest error is known."""
    fields: dict[str, Any] = {
        "budgeted": report.budget is not None,
        "lower_bound": is_lower_bound(report.budget),
        "material": lacks_material(report.budget),
        "plausible": report.plausible,
        "rotation_stated": report.rotation_stated,
        "rotation_shown": shown_rotations(report.budget, report.plausible.rotation),
    }
    if accuracy is not None:
        sure = uncertainty_of_largest(report, accuracy, report.budget)
        fields["expanded_uncertainty"] = sure.expanded.value
        fields["coverage_factor"] = sure.expanded.coverage_factor
        fields["expanded_uncertainty_of_readings"] = sure.of_readings.value
    return fields


def _tests(report: Report, found: PositioningReport | None) -> PositioningReport | None:
    """Return the tests of a run that is nothing but tests of axes; None of any other run."""
    measurement = report.measurement
    if measurement is None or not tests_alone(measurement):
        return None
    if found is not None:
        return found
    made = tests_of(measurement, str(report.bag or ""), report.run_id)
    return made if made.tests else None


def uneven_of(measurement: Measurement) -> tuple[str, ...]:
    """Return the lines of a run whose targets are not evenly spaced; see ``unevenly_spaced``."""
    return unevenly_spaced(measurement.lines, measurement.volume)


def _unknown(result: VolumetricErrors) -> tuple[str, ...]:
    figures = {figure.name: figure.value for figure in result.figures}
    curves = [name for name in TRANSLATIONS if not _known(result.curves.get(name))]
    angles = [name for name in SQUARENESS if not math.isfinite(figures.get(name, math.nan))]
    return (*curves, *angles)


def _known(curve: Vector | None) -> bool:
    """Say whether every node of a curve is determined."""
    return curve is not None and all(math.isfinite(float(value)) for value in curve)


def _remedy(measurement: Measurement | None, passes: Completeness | None) -> str:
    """Return which lines would determine the unknown errors; of a run cut short, its own lines.

    Empty for a run with a tracker: what its lines determine depends on where it stands.
    """
    cut_short = passes is not None and not passes.whole
    if measurement is None or not measurement.lines or cut_short or _is_tracked(measurement):
        return ""
    lines = tuple(one.line for one in measurement.lines)
    plan = Plan("as measured", measurement.volume, lines, math.nan)
    return undetermined(plan).remedy_words


def _is_tracked(measurement: Measurement) -> bool:
    return any(one.line.kind == TRACKER for one in measurement.lines)


def _told(results: Sequence[VolumetricErrors]) -> tuple[str, ...]:
    return tuple(
        name
        for name in ROTATIONS
        if any(_known(one.curves[name]) for one in results if name in one.curves)
    )
