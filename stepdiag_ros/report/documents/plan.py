"""The JSON of a plan before it is run: SI everywhere, ``null`` for what is not determined."""

from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.metrology import plan as plans
from stepdiag_ros.planning.assessment import Assessment
from stepdiag_ros.planning.duration import PlanDuration
from stepdiag_ros.planning.proposal import PlanProposal
from stepdiag_ros.planning.request import PlanCandidate
from stepdiag_ros.report.documents.run import visibility_part
from stepdiag_ros.schemas.parts import part_of
from stepdiag_ros.schemas.plan import (
    AssumedRotations,
    Assumptions,
    AxisWithoutLine,
    Candidate,
    Document,
    Duration,
    Expectation,
    Expectations,
    Line,
    LineDuration,
    Plan,
    Proposal,
)


def _duration(duration: PlanDuration) -> Duration:
    return part_of(
        Duration,
        duration,
        assumptions=Assumptions(
            linear_alignment=duration.assumptions.linear_alignment_s,
            diagonal_alignment=duration.assumptions.diagonal_alignment_s,
            settling=duration.assumptions.settling_s,
        ),
        lines=[part_of(LineDuration, line) for line in duration.lines],
    )


def _plan(plan: plans.Plan) -> Plan:
    return part_of(
        Plan,
        plan,
        origin=plan.volume.origin,
        step=plan.volume.step,
        blocks=plan.volume.blocks,
        lines=[part_of(Line, line, order=line.order or None) for line in plan.lines],
        measurement=plan.measurement,
    )


def _candidate(candidate: PlanCandidate) -> Candidate:
    return Candidate(
        lines=candidate.words,
        blocks=candidate.plan.volume.blocks,
        passes=len(candidate.plan.lines),
        duration=candidate.duration.total,
        expanded_uncertainty=candidate.uncertainty,
        expanded_drift=candidate.drift,
        limited_by=candidate.limited or None,
    )


def _proposal(proposal: PlanProposal) -> Proposal:
    return Proposal(
        purpose=proposal.request.purpose,
        reason=proposal.reason,
        chosen=_candidate(proposal.chosen),
        alternatives=[_candidate(one) for one in proposal.front],
        considered=proposal.considered,
        not_taken=proposal.discarded,
        assumed_rotations=None
        if proposal.assumed is None
        else part_of(AssumedRotations, proposal.assumed),
    )


def assessment_document(
    assessment: Assessment, proposal: PlanProposal | None = None
) -> dict[str, Any]:
    """Return all that is known of a plan before it is run as a mapping that ``json`` can write.

    Lengths in m, angles in rad, times in s; uncertainties are standard uncertainties except where
    the key says expanded (95 %).
    """
    rotating = assessment.rotating
    content = Document(
        plan=_plan(assessment.plan),
        machine=assessment.machine.name,
        chain=assessment.machine.chain or None,
        stop_uncertainty=assessment.stop_uncertainty,
        duration=_duration(assessment.duration),
        expected_standard_uncertainty=Expectations(
            least_squares=part_of(Expectation, assessment.expectation),
            with_rotations=part_of(Expectation, assessment.with_rotations),
            rigid_body=None if rotating is None else part_of(Expectation, rotating),
        ),
        visibility=visibility_part(assessment.seen),
        visibility_with_rotations=None
        if assessment.seen_rotating is None
        else visibility_part(assessment.seen_rotating),
        undetermined=assessment.undetermined.names,
        lines_that_would_tell=assessment.undetermined.remedy_words or None,
        axes_without_line=[
            AxisWithoutLine(
                axis=one.axis,
                curve=one.curve,
                standard_uncertainty=one.uncertainty,
                standard_uncertainty_with_line=one.with_line,
                duration_of_line=one.seconds,
            )
            for one in assessment.without_line
        ],
        limits=assessment.limits,
        warnings=assessment.warnings,
        proposal=None if proposal is None else _proposal(proposal),
    )
    return schemas.document("plan", content)


def assessment_json(assessment: Assessment, proposal: PlanProposal | None = None) -> str:
    """Return the JSON text; see ``assessment_document``."""
    return schemas.json_text(assessment_document(assessment, proposal))
