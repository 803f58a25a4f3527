"""The extra plan of an ambiguous diagnosis in words, as a table and as JSON."""

from stepdiag_ros.metrology.discrepancy.proposal import ExtraPlan
from stepdiag_ros.text.numbers import plain
from stepdiag_ros.text.table import Table, new_table

_MOST_PAIRS = 12
_PAIR_COLUMNS = ("cause", "or", "expected difference in σ", "probability of a decision")


def pairs_table(proposal: ExtraPlan | None) -> Table | None:
    """Return how well the proposed lines distinguish the rivals, the least certain first."""
    if proposal is None or not proposal.pairs:
        return None
    shown = proposal.pairs[:_MOST_PAIRS]
    more = len(proposal.pairs) - len(shown)
    title = "What the proposed lines will distinguish"
    table = new_table(
        title + (f" (the {len(shown)} hardest of {len(proposal.pairs)} pairs)" if more else ""),
        *_PAIR_COLUMNS,
    )
    table.columns[1].number = False
    for pair in shown:
        table.add_row(*pair.labels, plain(pair.separation, 3), _percent(pair.chance))
    return table


def _percent(chance: float) -> str:
    return f"{100.0 * chance:.1f} %" if chance < 0.9995 else "> 99.9 %"
