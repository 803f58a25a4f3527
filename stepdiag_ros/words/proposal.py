"""What to measure next, in sentences."""

from stepdiag_ros.evaluation.diagnosis import DiagnosisReport
from stepdiag_ros.metrology.discrepancy.proposal import ExtraPlan
from stepdiag_ros.words.next_measurement import next_sentences


def proposal_sentences(proposal: ExtraPlan | None, path: str = "") -> list[str]:
    """Say what to measure next, how sure that is, and what stays open.

    Args:
        proposal: None if none was asked for.
        path: of the file that it was written to; empty if it was not.
    """
    if proposal is None:
        return []
    words = [proposal.sentence]
    if proposal.plan is not None and path:
        words.append(f"The plan is in {path}: stepdiag run --plan {path}")
    words += proposal.conditions
    if proposal.plan is not None:
        words += [one.why for one in proposal.left_open]
    return words


def proposed_sentences(report: DiagnosisReport) -> list[str]:
    """Say what to measure next.

    Where the gap is unexplained, by what it looks like; of an extra plan only if one was asked for.
    """
    path = "" if report.proposal_path is None else str(report.proposal_path)
    return [*next_sentences(report.diagnosis), *proposal_sentences(report.proposal, path)]
