"""The results of a blind test as the marked part of a Markdown document."""

from pathlib import Path

from blind_figures import (
    AT_MOST,
    COVERAGE,
    HELD_OUT,
    MEDIANS,
    MUST_BE,
    SLOWEST,
    as_table,
    by_kind,
    confusion,
    figures,
    seconds_by_class,
)
from blind_judging import NO_PLAN

BEGIN = "<!-- results of benchmarks/blind.py: begin; written by it, not by hand -->"
END = "<!-- results of benchmarks/blind.py: end -->"
_WORDS = {
    "false_name_on_null": "a name or DESCRIBED on null data",
    "unexplained_on_null": "nothing hidden, yet UNEXPLAINED",
    "right_name_or_group_at_0.5": "right name, or group that contains it, at 0.5 × the limit",
    "right_name_or_group_at_1": "same, at 1 ×",
    "right_name_or_group_at_2": "same, at 2 ×",
    "right_name_or_group_at_5": "same, at 5 ×",
    "right_name_or_group_unscaled": "same, where the workflow states no limit",
    "pair_name_or_group_from_2_on": "one of a confounded pair: it or its group named, 2 × and more",
    "plan_proposed": "an extra plan proposed where a group was named",
    "unique_name_after_plan": "right unique name after the proposed extra plan",
    "unique_name_where_promised": "same, where the proposal does not say that it stays open",
    "name_or_group_of_what_is_over_after_plan": (
        "same, alone or in a group, where the effect belonged to one alignment or pass"
    ),
    "wrong_name_after_plan": "wrong name after it",
    "outside_described_rightly": (
        "outside the catalogue, 3 ×: DESCRIBED, all drivers right and none wrong"
    ),
    "outside_described_or_rival": "same, or with what is right as a stated rival",
    "outside_description_right_whatever_rivals": "same, the description right, whatever its rivals",
    "outside_described_after_plan": (
        "same, at once or after the extra plan that was proposed for what stayed open"
    ),
    "outside_in_a_group": "same: AMBIGUOUS, a stated group of names",
    "outside_beyond_names": (
        "same: what is hidden beyond all that the names can do, in standard deviations, median"
    ),
    "outside_unexplained": "same: UNEXPLAINED",
    "outside_wrong_description": "same: DESCRIBED by a wrong driver, or not by all",
    "described_held_out_below": f"its held-out χ² per degree of freedom ≤ {HELD_OUT}",
    "described_held_out": "same, median",
    "described_error_in_box": (
        "described minus true displacement over the measured box, rms over the true rms, median"
    ),
    "described_error_at_stops": "same, of the readings of the run",
    "passing_unexplained_or_in_time": (
        "random, or of one alignment, 3 ×: UNEXPLAINED or by time alone"
    ),
    "passing_or_its_jumps": "same, or a mirror's jumps as two jumps of the reading",
    "outside_wrong_lone_name": "outside the catalogue: a wrong lone name",
    "two_both_found": "two effects both found, each at 5 ×",
    "unseen_said_not_testable": "what nobody can see: CONSISTENT, and said not to be testable",
    "unseen_named": "what nobody can see: named",
    "gross_rightly_said": "gross error rightly said",
    "gross_named_as_something_else": "gross error named as an effect",
    "crashes": "crashes",
    "band_covers": "95 % coverage interval contains the true size",
    "many_false_name_on_null": "12 and more repeats: a name or DESCRIBED on null data",
    "many_right_name_or_group_at_2": "same: right name or group, at 2 × the limit",
    "many_outside_described_rightly": "same: outside the catalogue, 3 ×, DESCRIBED rightly",
    "many_outside_wrong_lone_name": "same: outside the catalogue, a wrong lone name",
    "many_described_held_out": "same: held-out χ² of a description, median",
    "many_described_error_in_box": "same: described minus true displacement, median",
}


def _percent(value):
    return f"{100.0 * value:.3g} %"


def _counted(figure):
    if not figure["runs"]:
        return "none", ""
    if "median" in figure:
        # Of a few runs the median has no bounds.
        bounds = "{} … {}".format(*figure["bounds"]) if figure["bounds"] else "unknown"
        return (
            f"{figure['median']:.3f}, {figure['largest']:.3g} at most ({figure['runs']} runs)",
            bounds,
        )
    hits, runs = figure["hits"], figure["runs"]
    low, high = figure["bounds"]
    bounds = f"{100.0 * low:.1f}-{100.0 * high:.1f} %"
    return f"{_percent(hits / runs)} ({hits} of {runs})", bounds


def _must_be(name):
    if name == "band_covers":
        return f"{100 * COVERAGE[0]:.0f}-{100 * COVERAGE[1]:.0f} %"
    if name in MEDIANS:
        return f"≤ {MEDIANS[name]:g}"
    if name not in MUST_BE:
        return ""
    sense, limit = MUST_BE[name]
    return f"{'≤' if sense == AT_MOST else '≥'} {_percent(limit)}"


def _table_of_figures(counted):
    lines = ["| figure | must be | measured | 95 % bounds |", "|---|---|---|---|"]
    for name, words in _WORDS.items():
        if name in counted:
            measured, bounds = _counted(counted[name])
            lines.append(f"| {words} | {_must_be(name)} | {measured} | {bounds} |")
    held_out = counted["held_out_chi_squared"]
    if held_out["runs"]:
        below, bounds = _counted(held_out["not_above_1.1"])
        lines.append(
            f"| held-out χ² per degree of freedom, where NAMED | ≤ {HELD_OUT} | median "
            f"{held_out['median']:.3f}; not above in {below} | {bounds} |"
        )
    seconds = counted["seconds"]
    if seconds["runs"]:
        lines.append(
            "| processor time for a verdict on 1,500-2,500 readings | "
            f"≤ {MEDIANS['seconds']:g} s median, {SLOWEST:g} s at most | "
            f"{seconds['median']:.1f} s median, {seconds['largest']:.0f} s at most "
            f"({seconds['runs']} runs) | |"
        )
    return lines


def table_of_seconds(judged):
    """Return the processor time of the verdicts of each class as a table."""
    rows = [
        f"| {kind} | {one['runs']} | {one['median']:.1f} | {one['largest']:.1f} |"
        for kind, one in seconds_by_class(judged).items()
    ]
    return "\n".join(
        ["| processor time, s | verdicts | median | at most |", "|---|---:|---:|---:|", *rows]
    )


def _effects(hidden):
    return " + ".join(
        " ".join([one["kind"], *(str(value) for value in one["setting"].values())])
        for one in hidden
    )


def _truth(truth):
    if truth["class"] == "none":
        return "nothing"
    if truth["class"] == "gross":
        return " ".join(str(value) for value in truth["gross"].values())
    return f"{_effects(truth['hidden'])}, {truth['level']:g} ×"


def _said(verdict):
    named = "; ".join(
        one["label"] + (f" or {len(one['ambiguous'])} others" if one["ambiguous"] else "")
        for one in verdict["findings"] or verdict.get("partial", [])
    )
    return f"{verdict['verdict']}{': ' if named else ''}{named}"


def not_right(judged):
    """Return the runs that were not judged right, those at half the limit left out."""
    return [
        one
        for one in judged
        if not one["outcome"].startswith("right")
        and not (one["truth"]["class"] in ("one", "pair", "two") and one["truth"]["level"] < 1.0)
    ]


def results(judged, told):
    """Return the marked part: what was run, figures, confusion matrix, what went wrong.

    Args:
        judged: what ``opened`` returned.
        told: lines that say what was run, how, and with which version.
    """
    counted = figures(judged)
    own = sum(one["truth"]["class"] == "none" and "null" not in one["name"] for one in judged)
    nulls = counted["false_name_on_null"]["runs"] - own
    wrong = [
        f"- `{one['name']}` ({_truth(one['truth'])}): {one['outcome']}; {_said(one['verdict'])}"
        for one in not_right(judged)
    ]
    wrong += [
        f"- `{one['name']}` after the plan ({_truth(one['truth'])}): {one['after_plan']}; "
        f"{_said(one['verdict']['further']['verdict'])}"
        for one in judged
        if one["after_plan"] not in (None, NO_PLAN, "right")
    ]
    return "\n".join(
        [
            BEGIN,
            *told,
            f"Null data: {own} runs of the class *none* and {nulls} null runs on which the limits "
            "of other cases were asked.",
            "",
            *_table_of_figures(counted),
            "",
            as_table(confusion(judged), "hidden"),
            "",
            as_table(by_kind(judged), "at 2 × the limit and more"),
            "",
            table_of_seconds(judged),
            "",
            f"Not right (`--class CLASS --seed SEED --runs 1` makes one again): {len(wrong)}",
            "",
            *wrong,
            END,
        ]
    )


def put_into(path, text):
    """Put a marked part in the place of the one that a document has.

    Args:
        path: of the document.
        text: its first and last lines are the markers.

    Raises:
        ValueError: the document has no such part.
    """
    path = Path(path)
    whole = path.read_text()
    begin, *_, end = text.splitlines()
    if whole.count(begin) != 1 or whole.count(end) != 1:
        raise ValueError(f"{path}: expected one part between '{begin}' and '{end}'")
    before, rest = whole.split(begin)
    path.write_text(before + text + rest.split(end)[1])
