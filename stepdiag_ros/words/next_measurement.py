"""What to measure next where a gap is unexplained, by what the gap looks like."""

from collections.abc import Iterable, Sequence

from stepdiag_ros.metrology.discrepancy.findings import UNEXPLAINED, Diagnosis, Pattern

_ADVICE = (
    (
        "the same in every pass",
        "It repeats, so more repeats tell nothing new. Align laser and mirror anew and measure"
        " {lines} once more: what changes was the alignment, what stays is in the machine. Then"
        " measure lines beside {them}, through other places of the box (offset_m in the plan):"
        " they tell whether it belongs to one axis or depends on where the others stand.",
    ),
    (
        "opposite forward and backward",
        "Measure {lines} at half the feed, with twice the dwell, and with overrun_m: a lag and"
        " what settles change with them, lost motion of a drive stays.",
    ),
    (
        "growing with time",
        "Measure {lines} again when the machine has run for some hours, and in the opposite order:"
        " what is gone then was warming up or drift, what moves with the order goes with the clock"
        " and not with the line.",
    ),
    (
        "temperature",
        "Measure {lines} again at another temperature, at least as different as it was over this"
        " run, with further sensors at scale, column and laser: what goes with one of them shows"
        " its source.",
    ),
    (
        "growing with the place of",
        "Measure {lines} again on parallel lines, at two other places of the axis that it grows"
        " with (offset_m in the plan), with twice as many blocks: that shows the shape, and whether"
        " it is a turn of that axis, which an autocollimator or a level would confirm.",
    ),
    (
        "different from repeat to repeat",
        "Measure {lines} with five repeats or more: that tells a drift from jumps, and gives each"
        " jump its time.",
    ),
    (
        "swinging",
        "Let the machine stand and record the laser over three of these periods, with cooling,"
        " heating and spindle first on, then off: what switches with the period is the cause.",
    ),
    (
        "jump",
        "Measure that setup again without touching anything: a jump that does not come back was a"
        " break of the beam, a slip or a touched mirror; one that does is in the machine.",
    ),
)
"""Words of what a pattern goes with → what to measure; the first that fits counts."""
_SETTLING = (
    "Measure with twice the dwell and with a longer settle_s: what is still moving when it is read"
    " becomes smaller."
)
_NO_PATTERN = (
    "Nothing of the run stands out. Measure all lines once more with twice the repeats, with laser"
    " and mirror aligned anew: what comes back at the same stops is in the machine, what does not"
    " was this run."
)


def next_sentences(diagnosis: Diagnosis) -> list[str]:
    """Say what to measure next where the gap is UNEXPLAINED; empty for other verdicts.

    The advice goes by what the gap looks like (``metrology.discrepancy.patterns``), the clearest
    first. It names no cause.
    """
    if diagnosis.verdict != UNEXPLAINED:
        return []
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
    return advice.format(lines=_listed(named), them="it" if len(named) == 1 else "them")


def _listed(lines: Sequence[str]) -> str:
    if not lines:
        return "all lines"
    return " and ".join([", ".join(lines[:-1]), lines[-1]] if len(lines) > 1 else lines)
