"""The JSON of a plan before it is run: SI everywhere, ``null`` for what is not determined."""

from typing import Any

from stepdiag_ros import schemas
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.planning.assessment import Assessment
from stepdiag_ros.planning.duration import PlanDuration
from stepdiag_ros.planning.expectation import Expectation
from stepdiag_ros.planning.proposal import Candidate, Proposal
from stepdiag_ros.report.documents.run import visibility_document


def _numbers(values: dict[str, float]) -> dict[str, float | None]:
    return {name: schemas.number(value) for name, value in values.items()}


def expectation_document(expectation: Expectation) -> dict[str, Any]:
    """Return expected standard uncertainties as a mapping that ``json`` can write."""
    return {
        "squareness": _numbers(expectation.squareness),
        "straightness": _numbers(expectation.straightness),
        "positioning": _numbers(expectation.positioning),
        "angular": _numbers(expectation.angular),
        "volumetric": schemas.number(expectation.volumetric),
        "degrees_of_freedom": expectation.degrees_of_freedom,
    }


def _duration_document(duration: PlanDuration) -> dict[str, Any]:
    return {
        "total": duration.total,
        "running": duration.running,
        "alignment": duration.alignment,
        "stops": duration.stops,
        "alignments": duration.alignments,
        "assumptions": {
            "linear_alignment": duration.assumptions.linear_alignment_s,
            "diagonal_alignment": duration.assumptions.diagonal_alignment_s,
            "settling": duration.assumptions.settling_s,
        },
        "lines": [
            {
                "setup": line.setup,
                "stops": line.stops,
                "alignment": line.alignment,
                "positioning": line.positioning,
                "moves": line.moves,
                "dwells": line.dwells,
            }
            for line in duration.lines
        ],
    }


def _plan_document(plan: Plan) -> dict[str, Any]:
    return {
        "name": plan.name,
        "origin": list(plan.volume.origin),
        "step": list(plan.volume.step),
        "blocks": plan.volume.blocks,
        "feed": plan.feed,
        "overrun": plan.overrun,
        "one_alignment_per_diagonal": plan.one_alignment_per_diagonal,
        "lines": [
            {
                "kind": line.kind,
                "name": line.name,
                "order": line.order or None,
                "repeat": line.repeat,
                "direction": line.direction,
                "offset": list(line.offset),
            }
            for line in plan.lines
        ],
    }


def _candidate_document(candidate: Candidate) -> dict[str, Any]:
    return {
        "lines": candidate.scheme.words,
        "blocks": candidate.plan.volume.blocks,
        "passes": len(candidate.plan.lines),
        "duration": candidate.duration.total,
        "expanded_uncertainty": schemas.number(candidate.uncertainty),
    }


def _proposal_document(proposal: Proposal) -> dict[str, Any]:
    return {
        "purpose": proposal.request.purpose,
        "reason": proposal.reason,
        "chosen": _candidate_document(proposal.chosen),
        "alternatives": [_candidate_document(one) for one in proposal.front],
        "considered": proposal.considered,
        "not_taken": list(proposal.discarded),
    }


def assessment_document(assessment: Assessment, proposal: Proposal | None = None) -> dict[str, Any]:
    """Return all that is known of a plan before it is run as a mapping that ``json`` can write.

    Lengths in m, angles in rad, times in s; uncertainties are standard uncertainties except where
    the key says expanded (95 %).
    """
    rotating = assessment.rotating
    content = {
        "plan": _plan_document(assessment.plan),
        "machine": assessment.machine.name,
        "chain": assessment.machine.chain or None,
        "stop_uncertainty": assessment.stop_uncertainty,
        "duration": _duration_document(assessment.duration),
        "expected_standard_uncertainty": {
            "least_squares": expectation_document(assessment.expectation),
            "rigid_body": None if rotating is None else expectation_document(rotating),
        },
        "visibility": visibility_document(assessment.seen),
        "visibility_with_rotations": None
        if assessment.seen_rotating is None
        else visibility_document(assessment.seen_rotating),
        "undetermined": list(assessment.undetermined.names),
        "lines_that_would_tell": assessment.undetermined.remedy_words or None,
        "limits": list(assessment.limits),
        "warnings": list(assessment.warnings),
        "proposal": None if proposal is None else _proposal_document(proposal),
    }
    return schemas.document("plan", content)


def assessment_json(assessment: Assessment, proposal: Proposal | None = None) -> str:
    """Return the JSON text; see ``assessment_document``."""
    return schemas.json_text(assessment_document(assessment, proposal))
