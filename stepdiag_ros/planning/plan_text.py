"""Writes a plan as the YAML that every command reads; read back, it is the same plan."""

import textwrap
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from math import isnan

from stepdiag_ros.metrology.checking import UNKNOWN
from stepdiag_ros.metrology.plan import STEP_DIAGONAL, Line, Plan, Sampling
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.tracked_line import TrackedLine, station_of, test_line_of

_WIDTH = 110


def plan_text(plan: Plan, comments: Sequence[str] = ()) -> str:
    """Return the YAML text of a plan.

    Lines that follow one another and differ in name, order, repeat and direction alone are written
    as one group.

    Args:
        plan: what is written.
        comments: sentences at the head of the file.

    Raises:
        ValueError: the lines are in an order that the file's layout cannot hold.
    """
    volume = plan.volume
    text = [f"# {line}" for sentence in comments for line in _wrapped(sentence)]
    text += [
        "",
        f"name: {_quoted(plan.name)}",
        "",
        f"origin_m: {_numbers(volume.origin)}",
        f"step_m: {_numbers(volume.step)}",
        f"blocks: {volume.blocks}",
        "",
        f"feed_m_per_s: {UNKNOWN if isnan(plan.feed) else _number(plan.feed)}",
        f"pause_for_setup: {str(plan.pause_for_setup).lower()}",
    ]
    if plan.one_alignment_per_diagonal:
        text.append("one_alignment_per_diagonal: true")
    if plan.overrun:
        text.append(f"overrun_m: {_number(plan.overrun)}")
    if plan.on_the_fly:
        text.append(f"measurement: {plan.measurement}")
    if plan.tracker is not None:
        text += ["", "tracker:", *_tracker_text(plan.tracker)]
    text += ["", "lines:"]
    _check_repeats(plan.lines)
    for group in _groups(plan.lines):
        text += _group_text(group)
    text += ["", *_sampling_text(plan.sampling)]
    return "\n".join(text).lstrip("\n") + "\n"


def _check_repeats(lines: tuple[Line, ...]) -> None:
    """Refuse repeats that are not counted from 0 on, since the file does not state them."""
    done: dict[Line, int] = {}
    for line in lines:
        once = replace(line, repeat=0)
        if line.repeat != done.get(once, 0):
            raise Refusal(
                f"line {line} has repeat {line.repeat}, not {done.get(once, 0)}",
                fault="out_of_order",
            )
        done[once] = line.repeat + 1


def _groups(lines: tuple[Line, ...]) -> list[list[Line]]:
    """Return runs of lines that one entry of the file makes in just this order."""
    groups = [
        list(group)
        for _, group in groupby(
            lines, key=lambda line: (line.kind, line.offset, line.mirror_offset, line.tracked)
        )
    ]
    made: list[list[Line]] = []
    for group in groups:
        made += _regular(group)
    return made


def _regular(lines: list[Line]) -> list[list[Line]]:
    """Split lines of one kind and place into the fewest full combinations, in order."""
    done: list[list[Line]] = []
    rest = lines
    while rest:
        length = max(n for n in range(1, len(rest) + 1) if _is_combination(rest[:n]))
        done.append(rest[:length])
        rest = rest[length:]
    return done


def _is_combination(lines: list[Line]) -> bool:
    names, orders, repeats, directions = _lists(lines)
    if repeats != list(range(repeats[0], repeats[0] + len(repeats))):
        return False
    wanted = [
        (name, order, repeat, direction)
        for name in names
        for order in orders
        for repeat in repeats
        for direction in directions
    ]
    return wanted == [(line.name, line.order, line.repeat, line.direction) for line in lines]


def _lists(lines: list[Line]) -> tuple[list[str], list[str], list[int], list[str]]:
    return (
        list(dict.fromkeys(line.name for line in lines)),
        list(dict.fromkeys(line.order for line in lines)),
        list(dict.fromkeys(line.repeat for line in lines)),
        list(dict.fromkeys(line.direction for line in lines)),
    )


def _group_text(lines: list[Line]) -> list[str]:
    names, orders, repeats, directions = _lists(lines)
    first = lines[0]
    if first.tracked is not None:
        names = [test_line_of(first.name)]
    text = [f"  - kind: {first.kind}", f"    names: [{', '.join(names)}]"]
    if first.tracked is not None:
        text += _tracked_text(station_of(first.name), first.tracked)
    if first.kind == STEP_DIAGONAL:
        text.append(f"    orders: [{', '.join(orders)}]")
    if any(first.offset):
        text.append(f"    offset_m: {_numbers(first.offset)}")
    if any(first.mirror_offset):
        text.append(f"    mirror_offset_m: {_numbers(first.mirror_offset)}")
    text.append(f"    repeats: {len(repeats)}")
    text.append(f"    directions: [{', '.join(directions)}]")
    return text


def _tracker_text(tracker: Tracker) -> list[str]:
    text = []
    for key, value in tracker.to_mapping().items():
        if isinstance(value, str):
            written = _quoted(value)
        else:
            written = _numbers(value) if isinstance(value, list) else _number(value)
        text.append(f"  {key}: {written}")
    return text


def _tracked_text(station: str, line: TrackedLine) -> list[str]:
    places = ", ".join(_numbers(place) for place in line.targets)
    text = [
        f"    station: {_quoted(station)}",
        f"    station_m: {_numbers(line.station)}",
        f"    targets_m: [{places}]",
    ]
    return [*text, f"    overrun_m: {_number(line.overrun)}"] if line.overrun else text


def _sampling_text(sampling: Sampling) -> list[str]:
    return [
        "sampling:",
        f"  dwell_s: {_number(sampling.dwell)}",
        f"  settle_s: {_number(sampling.settle)}",
        f"  window_s: {_number(sampling.window)}",
        f"  longest_wait_s: {_number(sampling.longest_wait)}",
        f"  standard_deviation_limit_m: {_number(sampling.standard_deviation_limit)}",
        f"  drift_limit_m: {_number(sampling.drift_limit)}",
        f"  stop_attempts: {sampling.stop_attempts}",
        f"  line_attempts: {sampling.line_attempts}",
        f"  after_attempts: {sampling.after_attempts}",
    ]


def _number(value: float) -> str:
    """Write a number with all its digits, and the point without which YAML reads a text."""
    text = repr(float(value))
    mantissa, mark, exponent = text.partition("e")
    return text if not mark or "." in mantissa else f"{mantissa}.0e{exponent}"


def _numbers(values: Sequence[float]) -> str:
    return "[" + ", ".join(_number(value) for value in values) + "]"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{" ".join(escaped.split())}"'


def _wrapped(sentence: str) -> list[str]:
    return textwrap.wrap(sentence, _WIDTH) or [""]
