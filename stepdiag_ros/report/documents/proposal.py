"""The extra plan of an ambiguous diagnosis as a part of a JSON document."""

from stepdiag_ros.metrology.discrepancy import proposal as proposals
from stepdiag_ros.planning.moves import describe
from stepdiag_ros.schemas.diagnosis import LeftOpen, Pair, Proposal


def proposal_part(proposal: proposals.ExtraPlan | None, path: str = "") -> Proposal | None:
    """Return a proposal as a part of a document; None without a proposal."""
    if proposal is None:
        return None
    plan = proposal.plan
    return Proposal(
        sentence=proposal.sentence,
        plan_file=path or None,
        duration_s=None if plan is None else proposal.seconds,
        certainty=None if plan is None else proposal.certainty,
        alignments=proposal.setups,
        passes=() if plan is None else tuple(describe(line) for line in plan.lines),
        rivals=proposal.rivals,
        pairs=[
            Pair(labels=pair.labels, separation=pair.separation, chance=pair.chance)
            for pair in proposal.pairs
        ],
        left_open=[LeftOpen(labels=one.labels, why=one.why) for one in proposal.left_open],
        conditions=proposal.conditions,
    )
