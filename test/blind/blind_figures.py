"""What the blind test counts: confusion matrix, and the issue's figures with their bounds."""

from collections import Counter, defaultdict
from statistics import median

from blind_cases import OUTSIDE_LEVEL
from blind_descriptions import described_rightly
from blind_judging import GOOD, NO_PLAN, OUTCOMES, covered, of_the_machine, told_to_stay_open
from scipy.special import betaincinv
from scipy.stats import binom

AT_MOST, AT_LEAST = "at most", "at least"
MUST_BE = {
    "false_name_on_null": (AT_MOST, 0.01),
    "right_name_or_group_at_2": (AT_LEAST, 0.95),
    "unique_name_where_promised": (AT_LEAST, 0.92),
    "outside_described_rightly": (AT_LEAST, 0.80),
    "outside_wrong_lone_name": (AT_MOST, 0.03),
    "described_held_out_below": (AT_LEAST, 0.80),
    "two_both_found": (AT_LEAST, 0.85),
}
"""Share → what the issue asks of it."""
COVERAGE = (0.92, 0.98)
HELD_OUT = 1.1
MEDIANS = {"described_held_out": 1.05, "described_error_in_box": 0.15, "seconds": 5.0}
"""Figure → what the issue asks of its median at most."""
SLOWEST = 30.0
"""Seconds that no verdict may take."""
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


def spread(values):
    """Return the median of some values with bounds of 95 % by order statistics, and the largest."""
    values = sorted(values)
    count = len(values)
    if not count:
        return {"runs": 0, "median": None, "bounds": None, "largest": None}
    # As many values lie below the median as heads fall; None where so few cannot bound it.
    outer = int(binom.ppf(0.025, count, 0.5))
    bounds = [round(values[outer - 1], 3), round(values[count - outer], 3)] if outer else None
    return {
        "runs": count,
        "median": round(median(values), 3),
        "bounds": bounds,
        "largest": round(values[-1], 3),
    }


def figures(judged):
    """Return the issue's figures.

    Args:
        judged: for each run a mapping with ``truth``, ``verdict``, ``outcome``, ``after_plan``,
            ``held_out``, ``described_errors`` and ``beyond_names``.
    """
    few = [one for one in judged if not one["truth"]["repeats"]]
    many = [one for one in judged if one["truth"]["repeats"]]
    groups = _groups(few)
    gross = groups["gross"]
    levels = sorted({one["truth"]["level"] for one in groups["one"]})
    return {
        **_of_nulls(groups["none"]),
        **{
            f"right_name_or_group_at_{level:g}": rate(_at(groups["one"], level), GOOD)
            for level in levels
        },
        "right_name_or_group_unscaled": rate(
            [one for one in groups["one"] if one["truth"]["scaled_by"] != "workflow"], GOOD
        ),
        "pair_name_or_group_from_2_on": rate(
            [one for one in groups["pair"] if one["truth"]["level"] >= 2.0], GOOD
        ),
        **_of_plans(few),
        **_of_outside(groups["outside"]),
        "two_both_found": rate(_at(groups["two"], 5.0), GOOD),
        "unseen_said_not_testable": rate(groups["unseen"], ("right",)),
        "unseen_named": rate(groups["unseen"], ("wrong name",)),
        "gross_rightly_said": rate(gross, ("right",)),
        "gross_named_as_something_else": rate(gross, ("wrong name",)),
        "crashes": share(sum(one["verdict"]["verdict"] == "CRASH" for one in judged), len(judged)),
        **_of_sizes(few),
        **_of_many(_groups(many)),
        "seconds": spread(
            one["verdict"]["seconds"] for one in few if FROM <= one["verdict"]["readings"] <= TO
        ),
    }


def _groups(judged):
    groups = defaultdict(list)
    for one in judged:
        groups[one["truth"]["class"]].append(one)
    return groups


def _at(chosen, level):
    """Those of a level; a size that could not be scaled to the workflow's limit is told apart."""
    return [
        one
        for one in chosen
        if one["truth"]["scaled_by"] == "workflow" and one["truth"]["level"] == level
    ]


def _of_nulls(nulls):
    tested = [one for one in nulls if one["outcome"] != "no verdict"]
    return {
        "false_name_on_null": rate(tested, ("wrong name",)),
        "unexplained_on_null": rate(tested, ("unexplained",)),
        "no_verdict_on_null": share(len(nulls) - len(tested), len(nulls)),
    }


def _of_plans(judged):
    asked = [
        one
        for one in judged
        if one["after_plan"]
        and one["outcome"] == "right, in a group"
        and one["truth"]["class"] != "outside"
    ]
    with_plan = [one for one in asked if one["after_plan"] != NO_PLAN]
    planned = [one for one in with_plan if of_the_machine(one["truth"])]
    promised = [one for one in planned if not told_to_stay_open(one["truth"], one["verdict"])]
    over = [one for one in with_plan if not of_the_machine(one["truth"])]
    return {
        "plan_proposed": share(len(with_plan), len(asked)),
        "unique_name_after_plan": rate(planned, ("right",), "after_plan"),
        "unique_name_where_promised": rate(promised, ("right",), "after_plan"),
        "name_or_group_of_what_is_over_after_plan": rate(over, GOOD, "after_plan"),
        "wrong_name_after_plan": rate(with_plan, ("wrong name",), "after_plan"),
    }


def _of_outside(outside):
    asked = [one for one in outside if one["truth"]["level"] == OUTSIDE_LEVEL]
    lasting = [one for one in asked if one["truth"]["drivers"]["lasting"]]
    passing = [one for one in asked if not one["truth"]["drivers"]["lasting"]]
    own = [described_rightly(one) for one in lasting]
    settled = [
        one["outcome"] if one["after_plan"] in (None, NO_PLAN) else one["after_plan"]
        for one in lasting
    ]
    described = [one for one in lasting if one["described_errors"]]
    held_out = [one["held_out"] for one in described if one["held_out"] is not None]
    errors = {
        name: [one["described_errors"][name] for one in described]
        for name in ("in_box", "at_stops")
    }
    beyond = [one["beyond_names"] for one in lasting if one["beyond_names"] is not None]
    with_rival = ("right", "right, with its rival")
    return {
        "outside_described_rightly": rate(lasting, ("right",)),
        "outside_described_or_rival": rate(lasting, with_rival),
        "outside_description_right_whatever_rivals": share(sum(own), len(own)),
        "outside_described_after_plan": share(settled.count("right"), len(settled)),
        "outside_in_a_group": rate(lasting, ("right, in a group",)),
        "outside_beyond_names": spread(beyond),
        "outside_unexplained": rate(lasting, ("unexplained",)),
        "outside_wrong_description": rate(lasting, ("wrong description",)),
        "passing_unexplained_or_in_time": rate(passing, ("right",)),
        "passing_or_its_jumps": rate(passing, with_rival),
        "outside_wrong_lone_name": rate(outside, ("wrong name",)),
        "described_held_out_below": share(sum(one <= HELD_OUT for one in held_out), len(held_out)),
        "described_held_out": spread(held_out),
        "described_error_in_box": spread([one for one in errors["in_box"] if one is not None]),
        "described_error_at_stops": spread(errors["at_stops"]),
    }


def _of_sizes(judged):
    bands = [
        answer
        for one in judged
        if one["outcome"] in GOOD and one["verdict"]["verdict"] == "NAMED"
        for answer in covered(one["truth"], one["verdict"])
    ]
    held_out = [
        one["held_out"]
        for one in judged
        if one["held_out"] is not None and one["verdict"]["verdict"] == "NAMED"
        if one["truth"]["class"] != "outside"
    ]
    return {
        "band_covers": share(sum(bands), len(bands)),
        "held_out_chi_squared": {
            "runs": len(held_out),
            "median": round(median(held_out), 3) if held_out else None,
            "not_above_1.1": share(sum(value <= HELD_OUT for value in held_out), len(held_out)),
        },
    }


def _of_many(groups):
    """Figures of the plans of many repeats."""
    outside = _of_outside(groups["outside"])
    return {
        "many_false_name_on_null": _of_nulls(groups["none"])["false_name_on_null"],
        "many_right_name_or_group_at_2": rate(_at(groups["one"], 2.0), GOOD),
        "many_outside_described_rightly": outside["outside_described_rightly"],
        "many_outside_wrong_lone_name": outside["outside_wrong_lone_name"],
        "many_described_held_out": outside["described_held_out"],
        "many_described_error_in_box": outside["described_error_in_box"],
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
    for name, limit in MEDIANS.items():
        figure = counted[name]
        # Where so few runs leave the median open, it is not missed.
        if figure["bounds"] and figure["bounds"][0] > limit:
            told.append(f"{name}: median {figure['median']} must be {AT_MOST} {limit}")
    slowest = counted["seconds"]["largest"]
    if slowest is not None and slowest > SLOWEST:
        told.append(f"{slowest} s for a verdict, more than {SLOWEST:g} s")
    return told


def confusion(judged):
    """Return class (with level, where sizes vary) → outcome → count."""
    table = defaultdict(Counter)
    for one in judged:
        truth = one["truth"]
        row = truth["class"]
        if row in ("one", "pair", "outside") or (row == "two" and truth["level"] < 5.0):
            row = f"{row}, {truth['level']:g} ×"
        if truth["repeats"]:
            row += ", many repeats"
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


def seconds_by_class(judged):
    """Return class → processor time of its verdicts, s: runs, median, bounds, largest."""
    classes = sorted({one["truth"]["class"] for one in judged})
    return {
        kind: spread(one["verdict"]["seconds"] for one in judged if one["truth"]["class"] == kind)
        for kind in classes
    }


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
