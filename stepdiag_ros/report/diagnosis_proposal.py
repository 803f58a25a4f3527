"""The extra plan of an ambiguous diagnosis in words, as a table and as JSON."""

from typing import Any

from rich.table import Table

from stepdiag_ros.evaluation.diagnosis import DiagnosisReport
from stepdiag_ros.metrology.discrepancy.proposal import Proposal
from stepdiag_ros.planning.moves import describe
from stepdiag_ros.report.diagnosis_next import next_sentences
from stepdiag_ros.report.tables import new_table
from stepdiag_ros.text.numbers import plain

_MOST_PAIRS = 12
_PAIR_COLUMNS = ("cause", "or", "expected difference in σ", "chance to tell")


def proposal_sentences(proposal: Proposal | None, path: str = "") -> list[str]:
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


def pairs_table(proposal: Proposal | None) -> Table | None:
    """Return how well the proposed lines tell the rivals apart, the least certain first."""
    if proposal is None or not proposal.pairs:
        return None
    shown = proposal.pairs[:_MOST_PAIRS]
    more = len(proposal.pairs) - len(shown)
    title = "What the proposed lines will tell apart"
    table = new_table(
        title + (f" (the {len(shown)} hardest of {len(proposal.pairs)} pairs)" if more else ""),
        *_PAIR_COLUMNS,
    )
    table.columns[1].justify = "left"
    for pair in shown:
        table.add_row(*pair.labels, plain(pair.separation, 3), _percent(pair.chance))
    return table


def _percent(chance: float) -> str:
    return f"{100.0 * chance:.1f} %" if chance < 0.9995 else "> 99.9 %"


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
