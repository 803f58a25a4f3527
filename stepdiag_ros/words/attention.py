"""What a plant's monitoring must know of the history of a machine."""

from stepdiag_ros.archive.histories import MachineHistory
from stepdiag_ros.run.health import HealthFinding, Level
from stepdiag_ros.words.trends import (
    attention_words,
    change_sentence,
    crossing_sentence,
    crossing_words,
    history_sentence,
)

NO_HISTORY = "no history of a machine yet: it begins with a run that is added"
_MOST = 5
"""Figures and changes that are named, of each kind."""


def attention(machine: MachineHistory | None) -> HealthFinding:
    """Say whether the history of a machine calls for attention, and why.

    Nothing here is a fault of the measurement: the level is at most WARN, and no run is stopped.

    Args:
        machine: whose history it is; None before the first run.
    """
    if machine is None:
        return HealthFinding(Level.OK, NO_HISTORY)
    words = attention_words(machine)
    values = {"history": history_sentence(machine)}
    leaving = [(one, crossing_words(one.trend)) for one in machine.figures if one.tolerance > 0.0]
    values |= {f"{one.name} leaves its tolerance": when for one, when in leaving[:_MOST]}
    reasons = [said for one, _ in leaving if (said := crossing_sentence(one))]
    changes = [
        (change.latest, one, change) for one in machine.figures for change in one.trend.changes
    ]
    newest = sorted(changes, key=lambda one: one[0], reverse=True)[:_MOST]
    values |= {
        f"change {n}": change_sentence(one, what) for n, (_, one, what) in enumerate(newest, 1)
    }
    values |= {f"unknown {n}": said for n, said in enumerate(reasons[:_MOST], 1)}
    known = not all(one.trend.unknown for one in machine.figures)
    level = Level.WARN if words and known else Level.OK
    text = f"machine {machine.name}: {words or 'nothing calls for attention'}"
    return HealthFinding(level, text, values)
