"""The sections of the live page as lines of text.

Each function takes the document of a section as ``viewers/page/state.py`` makes it, and computes
only where it stands on the screen. Colour only repeats what a word says.
"""

from collections.abc import Iterable
from typing import Any

from rich.text import Text

from stepdiag_ros.metrology.discrepancy import CONSISTENT, DESCRIBED, UNEXPLAINED
from stepdiag_ros.text.numbers import UNKNOWN, plain
from stepdiag_ros.viewers.terminal.glyphs import Glyphs

Document = dict[str, Any]
Lines = list[Text]

TITLE = "bold"
_GOOD, _DOUBTFUL, _BAD = "green", "yellow", "bold red"
_STATES = {
    "RUNNING": _GOOD,
    "FINISHED": _GOOD,
    "PAUSED": _DOUBTFUL,
    "WAITING_FOR_SETUP": _DOUBTFUL,
    "ABORTED": _BAD,
    "FAULT": _BAD,
}
_BEAMS = {"good": _GOOD, "dim": _DOUBTFUL, "lost": _BAD}
_VERDICTS = {CONSISTENT: _GOOD, DESCRIBED: _BAD, UNEXPLAINED: _BAD}
_RUN_BAR, _SIGNAL_BAR = 14, 20
_LEAST_CURVE = 8
"""Signs of a drawn curve, at least."""
_FIGURES = 39
"""Columns that the figures of a curve take."""


def titled(title: str, text: str = "", style: str = "") -> Text:
    """Return a line that begins with a title.

    Args:
        title: in bold.
        text: behind it.
        style: of that text.
    """
    return Text().append(title, TITLE).append(text, style)


def of_passes(count: int) -> str:
    """Return a count of passes in words."""
    return "1 pass" if count == 1 else f"{count} passes"


def run_lines(run: Document, progress: Document, signs: Glyphs) -> Lines:
    """Return where the run is and how long it takes still."""
    words = Text().append(run["words"], _STATES.get(run["state"] or "", TITLE))
    if run.get("text") and run["text"] != run["words"]:
        words.append(f": {run['text']}")
    lines = [words]
    if run["state"] is None:
        return lines
    if run["line"]:
        place = f"pass {run['line_number']} of {run['line_count']}: {run['line']}"
        if run["block_count"]:
            place += f", block {run['block']} of {run['block_count']}"
        lines.append(Text(f"{place}, stop {run['stop']} (0 to {run['stop_count'] - 1})"))
    if run["share"] is None:
        return lines
    told = f"{run['stops_done']} of {run['stops_total']} stops"
    if run["remaining"]:
        told += f", time left {run['remaining']}"
    incomplete = sum(course["incomplete"] for course in progress["courses"])
    if incomplete:
        told += f", {of_passes(incomplete)} incomplete"
    if run["target"]:
        lines.append(Text(run["target"]))
    lines.append(Text(f"{signs.bar(run['share'], _RUN_BAR)} {round(run['share'] * 100)} %, {told}"))
    return lines


def fault_lines(faults: Document) -> Lines:
    """Return what is wrong, a line for each, then what is only starting."""
    found = faults["faults"]
    note = faults["note"]
    starting = [Text(f"  starting: {one['who']}: {one['text']}") for one in faults["starting"]]
    if not found:
        return [titled("Faults: ", note or "none"), *starting]
    lines: Lines = []
    for one in found:
        line = titled("  " if lines else f"Faults ({len(found) + faults['more']}): ")
        line.append(f"{one['level']}: ", _BAD if one["level"] == "fault" else _DOUBTFUL)
        lines.append(line.append(f"{one['who']}: {one['text']}"))
    return lines + starting + [Text(f"  {note}")] * bool(note)


def beam_lines(beam: Document, signs: Glyphs) -> Lines:
    """Return whether the beam is there, how strong it is, and what it reads."""
    if beam["state"] is None:
        title = titled("Beam: ", beam["words"])
    else:
        title = titled("Beam: ", beam["state"], _BEAMS[beam["state"]])
    if beam["state"] not in (None, "good"):
        title.append(f", {beam['words']}")
    share = beam["strength"]
    strength = UNKNOWN if share is None else f"{signs.bar(share, _SIGNAL_BAR)} {beam['percent']}"
    return [title, Text(f"signal  {strength}"), Text(f"reading {beam.get('reading', UNKNOWN)}")]


def stop_lines(stop: Document, width: int) -> Lines:
    """Return the last stop against a perfect machine and against the model."""
    last = stop["last"]
    if last is None:
        return [titled("Last stop: ", "none yet")]
    title = titled("Last stop: ", f"{last['stop']}, {last['readings']} readings")
    if not last["settled"]:
        title.append(", not settled", _BAD)
        return [title, Text(last["line"]), Text(last["reason"])]
    if not last["zero_known"]:
        return [
            title,
            Text(last["line"]),
            Text("deviation: unknown, the first"),
            Text("stop of the setup is missing"),
        ]
    if last["note"]:
        # How far it is off is not known, which the note says.
        reading = f"length change {last['displacement']}"
        return [title, Text(last["line"]), Text(reading), Text(last["note"])]
    model = f"from model   {last['from_expected']}"
    by = f"{model} ({last['expected_by']})"
    return [
        title,
        Text(last["line"]),
        Text(f"reading {last['displacement']} from the first"),
        Text(f"from perfect {last['from_nominal']}"),
        Text(by if last["expected_by"] and len(by) <= width else model),
    ]


def block_lines(blocks: Document, width: int, signs: Glyphs) -> Lines:
    """Return the blocks of the present pass as a row, and of the pass before."""
    last = blocks["last"]
    if last is None:
        return [titled("Blocks: ", "none yet")]
    title, row = _block_row("Blocks", blocks["blocks"], width, signs)
    return [title, row, Text(f"last: {last['axis']} {last['block']}, {last['deviation']}")]


def before_lines(blocks: Document, width: int, signs: Glyphs) -> Lines:
    """Return the blocks of the pass before over the same line; nothing without one."""
    if not blocks["before"]:
        return []
    return list(_block_row("Blocks of the pass before", blocks["before"], width, signs))


def _block_row(name: str, blocks: list[Any], width: int, signs: Glyphs) -> tuple[Text, Text]:
    """Return a title and, along the line, a sign for each block by how far it is off nominal."""
    shown = sorted(blocks, key=lambda block: block[0])[-width:]
    values = [value for _, _, value, _ in shown]
    known = [value for value in values if value is not None]
    # Some that are not the whole pass are said to be that.
    what = " off nominal" if len(shown) == len(blocks) else f", last {len(shown)}"
    span = f"{plain(min(known), 1)} to {plain(max(known), 1)} µm" if known else UNKNOWN
    return titled(name, f"{what}: {signs.text(span)}"), Text(signs.row(values))


def weather_lines(weather: Document) -> Lines:
    """Return air and machine, two quantities a line."""
    values = weather["values"]
    known = [one for one in values if one["text"] != UNKNOWN]
    sources = {one["source"] for one in known}
    note = f" ({', '.join(sorted(sources))})" if len(sources) == 1 else ""
    if len(sources) > 1:
        note = " (* as compensated)"
    texts = []
    for one in values:
        star = " *" if len(sources) > 1 and one in known and one["source"] != "sensor" else ""
        texts.append(f"{one['name']} {one['text']}{star}")
    pairs = [texts[k : k + 2] for k in range(0, len(texts), 2)]
    return [titled("Air", note), *(Text(", ".join(pair)) for pair in pairs)]


def curve_lines(curves: Document, width: int, signs: Glyphs) -> Lines:
    """Return the largest value of each curve with U, where it is, and whether it grows."""
    if not curves["curves"]:
        told = f"{curves['method']} determines no curves" if curves["method"] else "no result yet"
        return [titled("Largest errors: ", told)]
    of = f", {curves['method']}, {of_passes(curves['lines'])}"
    lines = [titled("Worst (U 95 %)", of)]
    room = width - _FIGURES - 1
    for one in curves["curves"]:
        lines.append(Text(_curve_text(one)))
        if room >= _LEAST_CURVE:
            lines[-1].pad_right(max(0, _FIGURES - lines[-1].cell_len))
            lines[-1].append(f" {signs.row(_thinned(one['values'], room))}")
    return lines


def largest(curve: Document) -> tuple[str, str]:
    """Return the value of a curve that is farthest from zero, with U, and where it is."""
    worst = curve["worst"]
    if worst is None:
        return UNKNOWN, ""
    return worst["text"], UNKNOWN if worst["at"] is None else f"{worst['at']:g} mm"


def _curve_text(curve: Document) -> str:
    text, place = largest(curve)
    note = ""
    if curve["worst"] is not None:
        note = "in part" if curve["known"] != "all" else curve["worst"]["trend"] or "trend ?"
    return f"{curve['name']} {text:<18} {place:>7} {note}".rstrip()


def _thinned(values: list[float | None], room: int) -> list[float | None]:
    """Return as many values as there is room for, evenly chosen, both ends among them."""
    if len(values) <= room:
        return values
    return [values[round(k * (len(values) - 1) / (room - 1))] for k in range(room)]


def squareness_lines(squareness: Document) -> Lines:
    """Return the squareness of the three pairs of axes."""
    lines = [titled("Squareness", " (right-handed, U 95 %)")]
    lines += [Text(f"{one['name']} {one['words']} {one['text']}") for one in squareness["figures"]]
    return lines


def worst_lines(worst: Document) -> Lines:
    """Return the largest error so far, on which a supervisor decides; nothing while unknown."""
    if worst["value"] is None:
        return []
    what = f"Largest error, of {worst['curve']} alone: " if worst["curve"] else "Largest error: "
    limit = " (U at most)" if worst["limit"] else ""
    return [titled(what, f"{worst['text']}{limit} at {worst['where']}")]


def verdict_lines(verdict: Document) -> Lines:
    """Return the gap between run and model, and what is made of it; least important last."""
    if verdict["verdict"] is None:
        return [titled("Verdict: ", verdict["sentence"])]
    title = titled("Verdict: ", verdict["verdict"], _VERDICTS.get(verdict["verdict"], _DOUBTFUL))
    lines = f"{verdict['lines']} of {of_passes(verdict['lines_planned'])}"
    lines += "" if verdict["final"] else ", so far"
    gap = f"gap rms {verdict['gap']['rms']}, largest {verdict['gap']['largest']}"
    told = [title.append(f"; {lines}; {gap}"), Text(verdict["sentence"])]
    for finding in verdict["findings"]:
        told.append(Text("; ".join([f"found: {finding['label']}", *finding["sizes"]])))
    if verdict["gap_left"]:
        left = verdict["gap_left"]
        told.append(Text(f"gap left by what was found: rms {left['rms']}"))
    return told


def plan_lines(run: Document) -> Lines:
    """Return the name of the plan; the first row may have room for a part of it only."""
    return [titled("Plan: ", run["plan"])] if run["plan"] else []


def position_lines(position: Document) -> Lines:
    """Return where the tool is."""
    texts = ", ".join(f"{axis} {text}" for axis, text in position["texts"].items())
    return [titled("Tool: ", position["words"] or texts)]


def course_lines(volume: Document, progress: Document) -> Lines:
    """Return how each line of the plan stands."""
    if not volume["courses"]:
        return []
    told = []
    for course, stands in zip(volume["courses"], progress["courses"], strict=True):
        told.append(f"{course['name']} {stands['done']}/{course['passes']} {stands['look']}")
    return [titled("Lines: ", "; ".join(told))]


def remark_lines(curves: Document) -> Lines:
    """Return the remarks of the result and what it does not determine."""
    remarks: Iterable[str] = (*curves["not_determined"], *curves["remarks"])
    return [Text(f"result: {remark}") for remark in remarks]
