"""The extra plan of an ambiguous diagnosis as a part of a JSON document."""

from typing import Any

from stepdiag_ros.metrology.discrepancy.proposal import Proposal
from stepdiag_ros.planning.moves import describe


def proposal_document(proposal: Proposal | None, path: str = "") -> dict[str, Any] | None:
    """Return a proposal as a mapping that ``json`` can write; None if there is none."""
    if proposal is None:
        return None
    plan = proposal.plan
    return {
        "sentence": proposal.sentence,
        "plan_file": path or None,
        "duration_s": None if plan is None else float(proposal.seconds),
        "certainty": None if plan is None else float(proposal.certainty),
        "alignments": list(proposal.setups),
        "passes": [] if plan is None else [describe(line) for line in plan.lines],
        "rivals": [list(group) for group in proposal.rivals],
        "pairs": [
            {
                "labels": list(pair.labels),
                "separation": float(pair.separation),
                "chance": float(pair.chance),
            }
            for pair in proposal.pairs
        ],
        "left_open": [{"labels": list(one.labels), "why": one.why} for one in proposal.left_open],
        "conditions": list(proposal.conditions),
    }
