"""Makes what a supervisor decides on of the results and the diagnosis of a run."""

from collections.abc import Mapping
from math import isfinite, nan

from stepdiag_ros.bags.passes import Completeness
from stepdiag_ros.evaluation.budget import with_budget
from stepdiag_ros.evaluation.lead import RunLead, lead_of
from stepdiag_ros.evaluation.report import Report
from stepdiag_ros.evaluation.solving import one_thread
from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    CONSISTENT,
    DESCRIBED,
    NAMED,
    NOT_TESTABLE,
    UNEXPLAINED,
)
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.conformity import conformity
from stepdiag_ros.metrology.standards.decision import Agreement, RunDecision
from stepdiag_ros.metrology.target import TargetStanding

UNKNOWN_PLACE = (nan, nan, nan)


_AGREEMENTS = {
    CONSISTENT: Agreement.CONSISTENT,
    NAMED: Agreement.NAMED,
    AMBIGUOUS: Agreement.AMBIGUOUS,
    DESCRIBED: Agreement.DESCRIBED,
    UNEXPLAINED: Agreement.UNEXPLAINED,
    NOT_TESTABLE: Agreement.NOT_TESTABLE,
}


def lead_of_results(
    results: Mapping[str, VolumetricErrors], measurement: Measurement, passes: Completeness
) -> RunLead:
    """Return the summary of results by method, before a diagnosis and without the recording.

    Its uncertainties are those that ``stepdiag solve`` states of the same lines. A target is judged
    by them, so live and from a bag they are bit-identical.

    Args:
        results: of all methods that could be used.
        measurement: that was solved.
        passes: how much of the plan it is.
    """
    found = tuple(results.values())
    report = Report(found, chain=measurement.chain, measurement=measurement, passes=passes)
    with one_thread():
        return lead_of(with_budget(report))


def decide(
    lead: RunLead,
    method: str,
    tolerance: float,
    target: TargetStanding | None = None,
    aborted: bool = False,
) -> RunDecision:
    """Return what a supervisor decides on.

    Args:
        lead: summary of the run.
        method: to rely on; empty if there is no result.
        tolerance: largest permissible length of an error vector, m; NaN if none was agreed.
        target: how far the run is from its target; None if it has none.
        aborted: the run was ended before its plan or its target; then nothing is proven.
    """
    volume = lead.volume
    value, expanded = nan if volume is None else volume.value, lead.expanded_uncertainty
    upper_bound = nan if volume is None else volume.upper_bound(expanded)
    return RunDecision(
        conformity=conformity(
            value,
            expanded,
            tolerance,
            more_acts=lead.more_acts or aborted,
            noise=lead.noise,
            upper_bound=upper_bound,
        ),
        diagnosis=_AGREEMENTS.get(lead.verdict.name, Agreement.UNKNOWN),
        worst_error=value,
        expanded_uncertainty=expanded,
        coverage_factor=lead.coverage_factor,
        budgeted=lead.budgeted and isfinite(expanded),
        upper_bound=upper_bound,
        worst_place=UNKNOWN_PLACE if volume is None else volume.position,
        tolerance=tolerance,
        method=method,
        not_determined=lead.unknown,
        target=target,
    )
