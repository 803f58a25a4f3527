"""What the blind test counts: confusion matrix, and the issue's figures with their bounds."""

from collections import Counter, defaultdict
from statistics import median

from blind_judging import GOOD, NO_PLAN, OUTCOMES, covered, of_the_machine, told_to_stay_open
from scipy.special import betaincinv

AT_MOST, AT_LEAST = "at most", "at least"
MUST_BE = {
    "false_name_on_null": (AT_MOST, 0.02),
    "right_name_or_group_at_2": (AT_LEAST, 0.95),
    "unique_name_after_plan": (AT_LEAST, 0.90),
    "outside_unexplained_or_group": (AT_LEAST, 0.90),
    "two_both_found": (AT_LEAST, 0.85),
}
"""Figure → what the issue asks of it."""
COVERAGE = (0.92, 0.98)
HELD_OUT = 1.1
SECONDS = 20.0
FROM, TO = 1500, 2500
"""Readings of a run that the time for a verdict is asked for: about 2,000."""


def clopper_pearson(hits, runs, confidence=0.95):
    """Exact two-sided bounds of a share."""
    tail = 0.5 * (1.0 - confidence)
    low = float(betaincinv(hits, runs - hits + 1, tail)) if hits else 0.0
    high = float(betaincinv(hits + 1, runs - hits, 1.0 - tail)) if hits < runs else 1.0
    return low, high


def share(hits, runs):
    """Return a share with its bounds."""
    if not runs:
        return {"runs": 0, "hits": 0, "share": None, "bounds": None}
    low, high = clopper_pearson(hits, runs)
    return {
        "runs": runs,
        "hits": hits,
        "share": round(hits / runs, 4),
        "bounds": [round(low, 4), round(high, 4)],
    }


def rate(chosen, wanted, of="outcome"):
    """Return the share of outcomes that are among those wanted."""
    return share(sum(one[of] in wanted for one in chosen), len(chosen))


def figures(judged):
    """Return the issue's figures.

    Args:
        judged: for each run a mapping with ``truth``, ``verdict``, ``outcome``, ``after_plan`` and
            ``held_out``.
    """
    groups = defaultdict(list)
    for one in judged:
        groups[one["truth"]["class"]].append(one)
    tested = [one for one in groups["none"] if one["outcome"] != "no verdict"]

    # A size of the seal that could not be scaled to the workflow's own limit is told apart.
    def at(kind, level):
        return [
            one
            for one in groups[kind]
            if one["truth"]["scaled_by"] == "workflow" and one["truth"]["level"] == level
        ]

    levels = sorted({one["truth"]["level"] for one in groups["one"]})
    asked = [one for one in judged if one["after_plan"] and one["outcome"] == "right, in a group"]
    with_plan = [one for one in asked if one["after_plan"] != NO_PLAN]
    planned = [one for one in with_plan if of_the_machine(one["truth"])]
    promised = [one for one in planned if not told_to_stay_open(one["truth"], one["verdict"])]
    over = [one for one in with_plan if not of_the_machine(one["truth"])]
    bands = [
        answer
        for one in judged
        if one["outcome"] in GOOD and one["verdict"]["verdict"] == "NAMED"
        for answer in covered(one["truth"], one["verdict"])
    ]
    held_out = [one["held_out"] for one in judged if one["held_out"] is not None]
    times = [
        one["verdict"]["seconds"] for one in judged if FROM <= one["verdict"]["readings"] <= TO
    ]
    gross = groups["gross"]
    return {
        "false_name_on_null": rate(tested, ("wrong name",)),
        "unexplained_on_null": rate(tested, ("unexplained",)),
        "no_verdict_on_null": share(len(groups["none"]) - len(tested), len(groups["none"])),
        **{f"right_name_or_group_at_{level:g}": rate(at("one", level), GOOD) for level in levels},
        "right_name_or_group_unscaled": rate(
            [one for one in groups["one"] if one["truth"]["scaled_by"] != "workflow"], GOOD
        ),
        "pair_name_or_group_from_2_on": rate(
            [one for one in groups["pair"] if one["truth"]["level"] >= 2.0], GOOD
        ),
        "plan_proposed": share(len(with_plan), len(asked)),
        "unique_name_after_plan": rate(planned, ("right",), "after_plan"),
        "unique_name_where_promised": rate(promised, ("right",), "after_plan"),
        "name_or_group_of_what_is_over_after_plan": rate(over, GOOD, "after_plan"),
        "wrong_name_after_plan": rate(with_plan, ("wrong name",), "after_plan"),
        "outside_unexplained_or_group": rate(groups["outside"], GOOD),
        "two_both_found": rate(at("two", 5.0), GOOD),
        "unseen_said_not_testable": rate(groups["unseen"], ("right",)),
        "unseen_named": rate(groups["unseen"], ("wrong name",)),
        "gross_rightly_said": rate(gross, ("right",)),
        "gross_named_as_something_else": rate(gross, ("wrong name",)),
        "crashes": share(sum(one["verdict"]["verdict"] == "CRASH" for one in judged), len(judged)),
        "band_covers": share(sum(bands), len(bands)),
        "held_out_chi_squared": {
            "runs": len(held_out),
            "median": round(median(held_out), 3) if held_out else None,
            "not_above_1.1": share(sum(value <= HELD_OUT for value in held_out), len(held_out)),
        },
        "seconds": {
            "runs": len(times),
            "median": round(median(times), 2) if times else None,
            "largest": round(max(times), 2) if times else None,
        },
    }


def missed(counted):
    """Say which figures miss what they must be, beyond what so few runs leave open."""
    told = []
    for name, (sense, limit) in MUST_BE.items():
        bounds = counted.get(name, {}).get("bounds")
        if bounds and (bounds[0] > limit if sense == AT_MOST else bounds[1] < limit):
            told.append(f"{name}: {counted[name]['share']} must be {sense} {limit}")
    if counted["crashes"]["hits"]:
        told.append(f"{counted['crashes']['hits']} crashes")
    bands = counted["band_covers"]["bounds"]
    if bands and (bands[1] < COVERAGE[0] or bands[0] > COVERAGE[1]):
        told.append(f"95 % band covers {counted['band_covers']['share']}, not 0.92 to 0.98")
    held_out = counted["held_out_chi_squared"]["median"]
    if held_out is not None and held_out > HELD_OUT:
        told.append(f"held-out chi squared per degree of freedom {held_out} > {HELD_OUT}")
    seconds = counted["seconds"]["median"]
    if seconds is not None and seconds > SECONDS:
        told.append(f"{seconds} s for a verdict, more than {SECONDS:g} s")
    return told


def confusion(judged):
    """Return class (with level, where sizes vary) → outcome → count."""
    table = defaultdict(Counter)
    for one in judged:
        truth = one["truth"]
        row = truth["class"]
        if row in ("one", "pair") or (row == "two" and truth["level"] < 5.0):
            row = f"{row}, {truth['level']:g} ×"
        table[row][one["outcome"]] += 1
        if one["after_plan"]:
            table[f"{truth['class']}, after the plan"][one["after_plan"]] += 1
    names = (*OUTCOMES, NO_PLAN)
    return {row: {name: table[row][name] for name in names} for row in sorted(table)}


def by_kind(judged):
    """Return kind of the hidden effect → outcome → count, sizes from 2 × the limit on."""
    table = defaultdict(Counter)
    for one in judged:
        truth = one["truth"]
        if truth["class"] == "gross":
            table[f"gross: {truth['gross']['kind']}"][one["outcome"]] += 1
        elif truth["hidden"] and truth["class"] != "two" and truth["level"] >= 2.0:
            table[f"{truth['class']}: {truth['hidden'][0]['kind']}"][one["outcome"]] += 1
    return {row: dict(table[row]) for row in sorted(table)}


def as_table(rows, corner):
    """Return a markdown table of a mapping of mappings."""
    names = [
        name for name in (*OUTCOMES, NO_PLAN) if any(counts.get(name) for counts in rows.values())
    ]
    lines = [f"| {corner} | {' | '.join(names)} |", f"|---|{'---:|' * len(names)}"]
    lines += [
        f"| {row} | {' | '.join(str(counts.get(name, 0)) for name in names)} |"
        for row, counts in rows.items()
    ]
    return "\n".join(lines)
