"""What the years of a machine show, in sentences."""

from math import inf, isfinite

from stepdiag_ros.archive.histories import FigureHistory, MachineHistory, date_of
from stepdiag_ros.archive.stated import FILE
from stepdiag_ros.metrology.trends.crossing import Outlook
from stepdiag_ros.metrology.trends.trend import FEWEST, LEVEL, Change, Trend
from stepdiag_ros.text.numbers import UNKNOWN, with_expanded
from stepdiag_ros.words.diagnosis import readable_unit

_DAY = "%Y-%m-%d"
_WHY_NOT = {
    Outlook.NOT_ASKED: "no tolerance",
    Outlook.UNKNOWN: UNKNOWN,
    Outlook.OUTSIDE: "outside now",
    Outlook.MAYBE_OUTSIDE: "may be outside",
}
_REASONS = {
    Outlook.NO_TREND: "its trend may be zero, or is not known to half its size",
    Outlook.TOO_FAR: "the end of the interval is beyond twice the length of the history",
    Outlook.WANDERS: "its runs deviate from the line together, more than chance allows",
    Outlook.MAYBE_CHANGED: "it may have changed, which its runs do not prove; measure again",
    Outlook.LAST_ALONE: "its last run stands alone; measure again",
    Outlook.MAYBE_OUTSIDE: "it may be outside its tolerance already",
}
_LAST = "(last)"
"""Marks a value that is of the last run, not of the level of all."""
LAST_SENTENCE = f"{_LAST}: the value of the last run with its U, since the level is unknown."
_MEANING = {"step": "changed", "bend": "changed its trend", "alone": "stands alone"}
_LEFT_OUT = {
    "temperature": "its influence is not separated: it hardly varies, or the runs are too few",
    "season": "a yearly wave is not separated: the runs are too few",
    "instrument": "instruments and trend, or two instruments, cannot be separated",
}


def value_words(figure: FigureHistory, value: float, expanded: float) -> str:
    """Write a value of a figure with its U, in the unit of ``unit_words``."""
    return with_expanded(value, expanded, readable_unit(figure.unit)[1])


def now_words(figure: FigureHistory) -> str:
    """Write what a figure is now, with its U: the level, or marked the last value without one."""
    trend = figure.trend
    if not trend.unknown:
        return value_words(figure, trend.level, trend.level_expanded)
    return f"{value_words(figure, figure.values[-1], figure.expanded[-1])} {_LAST}"


def unit_words(figure: FigureHistory) -> str:
    """Return the unit in which people read a figure."""
    return readable_unit(figure.unit)[0]


def crossing_words(trend: Trend) -> str:
    """Say in a few characters when a figure leaves its tolerance."""
    crossing, now = trend.crossing, trend.last
    if crossing.outlook in _WHY_NOT:
        return _WHY_NOT[crossing.outlook]
    earliest = date_of(now + crossing.earliest) if isfinite(crossing.earliest) else None
    if crossing.outlook is Outlook.INTERVAL and earliest is not None:
        return f"{earliest:%Y-%m}..{date_of(now + crossing.latest):%Y-%m}"
    return UNKNOWN if earliest is None else f"not by {earliest:%Y-%m}"


def crossing_sentence(figure: FigureHistory) -> str:
    """Say why it is not known when a figure leaves its tolerance; empty if it is known."""
    reason = _REASONS.get(figure.trend.crossing.outlook, "")
    return f"{figure.name}: when it leaves its tolerance is unknown: {reason}." if reason else ""


def change_sentence(figure: FigureHistory, change: Change) -> str:
    """Say what has changed and when."""
    first, last = date_of(change.earliest), date_of(change.latest)
    when = f"{first:{_DAY}}" if change.kind == "alone" else f"{first:{_DAY}} to {last:{_DAY}}"
    size = value_words(figure, change.size, change.expanded)
    per = " a year" if change.kind == "bend" else ""
    what = f"by {size} {unit_words(figure)}{per}"
    return f"{when}: {figure.name} {_MEANING[change.kind]} {what} (E_n {change.e_n:.1f})"


def change_sentences(machine: MachineHistory) -> list[str]:
    """Say what has changed and when, newest first."""
    said = (
        (change.latest, change_sentence(one, change))
        for one in machine.figures
        for change in one.trend.changes
    )
    return [sentence for _, sentence in sorted(said, reverse=True)]


def limitations(machine: MachineHistory) -> list[str]:
    """Say why crossings are not known, and what limits the statements on a machine."""
    return [*filter(None, map(crossing_sentence, machine.figures)), *remarks(machine)]


def attention_words(machine: MachineHistory) -> str:
    """Say what an owner must know first of a machine; empty if there is nothing."""
    few = all(one.trend.unknown for one in machine.figures)
    first = leaving_words(machine) or moving_words(machine)
    return f"fewer than {FEWEST} runs" if few and not first else first


def leaving_words(machine: MachineHistory) -> str:
    """Say what is or will be outside its tolerance, and when; empty if that is not known."""
    figures = machine.figures
    for told, words in (
        (Outlook.OUTSIDE, "outside"),
        (Outlook.MAYBE_OUTSIDE, "may be outside"),
    ):
        names = [one.name for one in figures if one.trend.crossing.outlook is told]
        if names:
            return f"{words}: {few_words(names)}"
    leaving = [one for one in figures if one.trend.crossing.outlook is Outlook.INTERVAL]
    if not leaving:
        return ""
    first = min(leaving, key=lambda one: one.trend.crossing.earliest)
    return f"{crossing_words(first.trend)} outside: {first.name}"


def staying_words(machine: MachineHistory) -> str:
    """Say until when no figure leaves its tolerance, or that this is unknown."""
    trends = [one.trend for one in machine.figures]
    asked = [one for one in trends if one.crossing.outlook is not Outlook.NOT_ASKED]
    if not asked:
        return _WHY_NOT[Outlook.NOT_ASKED]
    return crossing_words(min(asked, key=_known_until))


def _known_until(trend: Trend) -> float:
    until = trend.last + trend.crossing.earliest
    return until if isfinite(until) else -inf


def moving_words(machine: MachineHistory) -> str:
    """Say what has changed lately, or else what grows; empty if nothing does."""
    for moves, words in ((Trend.changed_lately, "changed"), (Trend.grows, "grows")):
        names = [one.name for one in machine.figures if moves(one.trend)]
        if names:
            return f"{words}: {few_words(names)}"
    return ""


def few_words(names: list[str]) -> str:
    """Write the first of some names, and how many more there are."""
    return names[0] + (f" +{len(names) - 1}" if len(names) > 1 else "")


def history_sentence(machine: MachineHistory) -> str:
    """Say what the history of a machine consists of."""
    many = len([one for one in machine.instruments if one])
    by = {0: "", 1: ", one instrument"}.get(many, f", {many} instruments")
    return (
        f"{machine.name}: {machine.runs} runs from {machine.first:{_DAY}} to"
        f" {machine.last:{_DAY}}{by}"
    )


def effects_sentence(machine: MachineHistory) -> str:
    """Say which named effects grow."""
    effects = [one for one in machine.figures if one.kind == "effect"]
    growing = [one.name for one in effects if one.trend.grows()]
    unknown = sum(bool(one.trend.unknown) for one in effects)
    if growing:
        return f"Effects that grow: {', '.join(growing)}."
    if not effects:
        return "No run names an effect."
    if unknown == len(effects):
        return f"Which effect grows is unknown: each is named in fewer than {FEWEST} runs."
    return "No named effect grows beyond its uncertainty."


def remarks(machine: MachineHistory) -> list[str]:
    """Return what limits the statements on a machine, a sentence each."""
    said = []
    if not machine.scale_known:
        said.append(
            "What the runs of an instrument share is not known, and levels do not contain it; a"
            f" difference between instruments is estimated. State it under scales in {FILE}."
        )
    said.append("Which weather station a run used is not known: its temperatures are taken as is.")
    if machine.without_temperature:
        said.append(f"{machine.without_temperature} of {machine.runs} runs state no temperature.")
    for name, words in _LEFT_OUT.items():
        if any(name in one.trend.left_out for one in machine.figures):
            said.append(f"{name.capitalize()}: {words}.")
    others = max(one.other_methods for one in machine.figures)
    if others:
        said.append(f"{others} runs were solved by another method, and are left out.")
    boxes = max(one.other_boxes for one in machine.figures)
    if boxes:
        said.append(
            f"{boxes} runs measured another box than the newest: figures that depend on the box are"
            " followed without them."
        )
    if all(one.trend.crossing.outlook is Outlook.NOT_ASKED for one in machine.figures):
        said.append(f"No tolerance is stated: give it under tolerances in {FILE}.")
    few = sum(one.trend.unknown == "runs" for one in machine.figures)
    if few:
        said.append(
            f"{few} of {len(machine.figures)} figures have fewer than {FEWEST} runs: their trend"
            " is unknown."
        )
    if any(one.trend.unknown for one in machine.figures):
        said.append(LAST_SENTENCE)
    said.append(f"If nothing changed, any change is reported with a chance of at most {LEVEL:.0%}.")
    return said
