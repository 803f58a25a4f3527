"""What to measure next where a gap is unexplained, by the look of the gap."""

from collections.abc import Iterable, Sequence

from stepdiag_ros.metrology.discrepancy.findings import UNEXPLAINED, Diagnosis, Pattern, listed

_ADVICE = (
    (
        "the same in every pass",
        "It repeats, so more repeats show nothing new. Align laser and mirror again and measure"
        " {lines} once more: what changes was the alignment, what stays is in the machine. Then"
        " measure lines parallel to {them}, elsewhere in the volume (offset_m in the plan): they"
        " show whether it belongs to one axis or depends on where the others stand.",
    ),
    (
        "opposite forward and backward",
        "Measure {lines} at half the feed, with twice the dwell, and with overrun_m: lag and"
        " settling change with them, backlash of a drive stays.",
    ),
    (
        "growing with time",
        "Measure {lines} again when the machine has run for some hours, and in the opposite order:"
        " what has gone was warm-up or drift; what moves with the order depends on time and not on"
        " the line.",
    ),
    (
        "temperature",
        "Measure {lines} again at another temperature, at least as different as it was over this"
        " run, with further sensors at scale, column and laser: the sensor that it follows shows"
        " its source.",
    ),
    (
        "growing with the place of",
        "Measure {lines} again on parallel lines, at two other places of the axis that it grows"
        " with (offset_m in the plan), with twice as many blocks: that shows the shape, and whether"
        " it is an angular error of that axis, which an autocollimator or a level would confirm.",
    ),
    (
        "different from repeat to repeat",
        "Measure {lines} with five repeats or more: that separates drift from jumps, and gives the"
        " time of each jump.",
    ),
    (
        "swinging",
        "Let the machine stand and record the laser over three of these periods, with cooling,"
        " heating and spindle first on, then off: the one that starts and stops it is the cause.",
    ),
    (
        "jump",
        "Measure that setup again without touching anything: a jump that does not come back was a"
        " broken beam, a slip or a touched mirror; a jump that comes back is in the machine.",
    ),
)
"""Words in the description of a pattern → what to measure; the first match counts."""
_SETTLING = (
    "Measure with twice the dwell and with a longer settle_s: motion that is still settling when"
    " the laser is read becomes smaller."
)
_NO_PATTERN = (
    "No part of the run stands out. Measure all lines once more with twice the repeats, with laser"
    " and mirror aligned again: what comes back at the same stops is in the machine, the rest"
    " belonged to this run."
)
_WRONG_READING = (
    "Compare the reading at {which} with what was noted there (stops and repeats count from 0: the"
    " first run of a table is repeat 0). Correct the table, or mark the stop as rejected, and"
    " import the table again; of a recorded run, measure the line again."
)


def next_sentences(diagnosis: Diagnosis) -> list[str]:
    """Say what to measure next where the gap is UNEXPLAINED; empty for other verdicts.

    The advice goes by what the gap looks like (``metrology.discrepancy.patterns``), the clearest
    first. It names no cause.
    """
    if diagnosis.verdict != UNEXPLAINED:
        return []
    if diagnosis.wrong_readings:
        return [_WRONG_READING.format(which=" and at ".join(diagnosis.wrong_readings))]
    wanted: dict[str, list[Pattern]] = {}
    for pattern in diagnosis.patterns or diagnosis.patterns_after:
        for advice in _advices(pattern):
            wanted.setdefault(advice, []).append(pattern)
    return [_said(advice, patterns) for advice, patterns in wanted.items()] or [_NO_PATTERN]


def _advices(pattern: Pattern) -> Iterable[str]:
    for words, advice in _ADVICE:
        if words in pattern.with_what:
            yield advice
            break
    if "stops right after" in pattern.place:
        yield _SETTLING


def _said(advice: str, patterns: Sequence[Pattern]) -> str:
    """Return an advice with the lines of all patterns that ask for it."""
    everywhere = any(not one.lines for one in patterns)
    lines = dict.fromkeys(line for one in patterns for line in one.lines)
    named = () if everywhere else tuple(lines)
    return advice.format(
        lines=listed(named) or "all lines", them="it" if len(named) == 1 else "them"
    )
