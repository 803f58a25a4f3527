"""What the blind test counts: outcomes, confusion matrix, the issue's figures with their bounds."""

from collections import Counter, defaultdict
from statistics import median

from scipy.stats import beta

NO_ANSWER = "NO ANSWER"
"""Stands for the verdict where none came in time."""
OUTCOMES = (
    "right",
    "right, in a group",
    "wrong name",
    "unexplained",
    "consistent",
    "no verdict",
)

MUST_BE = {
    "false_name_on_null": ("at most", 0.02),
    "outside_unexplained_or_group": ("at least", 0.90),
    "two_both_found": ("at least", 0.85),
}
RIGHT_AT_TWICE = 0.95
COVERAGE = (0.92, 0.98)


def clopper_pearson(hits, runs, confidence=0.95):
    """Exact two-sided bounds of a share."""
    tail = 0.5 * (1.0 - confidence)
    low = float(beta.ppf(tail, hits, runs - hits + 1)) if hits else 0.0
    high = float(beta.ppf(1.0 - tail, hits + 1, runs - hits)) if hits < runs else 1.0
    return low, high


def found(hidden_labels, verdict):
    """Say how each hidden effect was found: ``right``, ``right, in a group`` or nothing.

    Args:
        hidden_labels: for each hidden effect the catalogue's labels that mean it.
        verdict: document of one verdict.
    """
    ways = []
    for labels in hidden_labels:
        alone = any(
            finding["label"] in labels and not finding["ambiguous"]
            for finding in verdict["findings"]
        )
        grouped = any(
            set(labels) & {finding["label"], *finding["ambiguous"]}
            for finding in verdict["findings"]
        )
        ways.append("right" if alone else "right, in a group" if grouped else "")
    return ways


def outcome(truth, verdict):
    """Judge one verdict; one of OUTCOMES.

    With something hidden that the catalogue has, every effect must be found and nothing else named.
    A finding too many, alone or in a group of which no member is hidden, is a wrong name. With
    nothing hidden CONSISTENT is right; with something outside the catalogue UNEXPLAINED is right,
    and a stated group of look-alikes right in a group.
    """
    word = verdict["verdict"]
    if word in ("NOT TESTABLE", NO_ANSWER):
        return "no verdict"
    if truth["class"] == "none":
        return {"CONSISTENT": "right", "UNEXPLAINED": "unexplained"}.get(word, "wrong name")
    if word == "CONSISTENT":
        return "consistent"
    if truth["class"] == "outside":
        if word == "UNEXPLAINED":
            return "right"
        stated = all(finding["ambiguous"] for finding in verdict["findings"])
        return "right, in a group" if word == "AMBIGUOUS" and stated else "wrong name"
    if word == "UNEXPLAINED":
        return "unexplained"
    ways = found(truth["labels"], verdict)
    hidden = {label for labels in truth["labels"] for label in labels}
    strangers = [
        finding
        for finding in verdict["findings"]
        if not hidden & {finding["label"], *finding["ambiguous"]}
    ]
    if strangers or not any(ways):
        return "wrong name"
    if not all(ways):
        # What was named is there, but not all that is there was named.
        return "consistent"
    return "right" if set(ways) == {"right"} else "right, in a group"


def covered(truth, verdict):
    """Return for each named size whether its 95 % band holds the true one.

    Only where the effect was named under its very label: a slip one stop away has another size.
    """
    answers = []
    for expected in truth["expected"]:
        for finding in verdict["findings"]:
            sizes = expected.get(finding["label"])
            if sizes is None:
                continue
            for name, size in sizes.items():
                low, high = finding["band"][name]
                answers.append(low <= size <= high)
    return answers


def _share(hits, runs):
    if not runs:
        return {"runs": 0, "share": None, "bounds": None}
    low, high = clopper_pearson(hits, runs)
    return {
        "runs": runs,
        "hits": hits,
        "share": round(hits / runs, 4),
        "bounds": [round(low, 4), round(high, 4)],
    }


def figures(judged):
    """Return the issue's figures.

    Args:
        judged: for each run a mapping with ``truth``, ``verdict`` and ``outcome``.
    """
    groups = defaultdict(list)
    for one in judged:
        groups[one["truth"]["class"]].append(one)
    tested = [one for one in groups["none"] if one["outcome"] != "no verdict"]
    good = ("right", "right, in a group")

    def rate(chosen, wanted):
        return _share(sum(one["outcome"] in wanted for one in chosen), len(chosen))

    # A size of the seal that could not be scaled to the workflow's own limit is told apart.
    scaled = [one for one in groups["one"] if one["truth"]["scaled_by"] == "workflow"]
    by_level = {
        f"{level:g}": rate([one for one in scaled if one["truth"]["level"] == level], good)
        for level in sorted({one["truth"]["level"] for one in scaled})
    }
    bands = [
        answer
        for one in judged
        if one["outcome"] in good and one["verdict"]["verdict"] == "NAMED"
        for answer in covered(one["truth"], one["verdict"])
    ]
    held_out = [one["held_out"] for one in judged if one.get("held_out") is not None]
    times = [
        one["verdict"]["seconds"] for one in judged if 1500 <= one["verdict"]["readings"] <= 2500
    ]
    return {
        "false_name_on_null": rate(tested, ("wrong name",)),
        "unexplained_on_null": rate(tested, ("unexplained",)),
        "no_verdict_on_null": _share(len(groups["none"]) - len(tested), len(groups["none"])),
        "right_name_or_group_by_level": by_level,
        "right_name_or_group_unscaled": rate(
            [one for one in groups["one"] if one["truth"]["scaled_by"] != "workflow"], good
        ),
        "outside_unexplained_or_group": rate(groups["outside"], good),
        "two_both_found": rate(groups["two"], good),
        "pair_name_in_group": rate(
            [one for one in groups["pair"] if one["truth"]["level"] >= 2.0], good
        ),
        "pair_named_alone": rate(groups["pair"], ("right", "wrong name")),
        "band_covers": _share(sum(bands), len(bands)),
        "held_out_chi_squared_per_degree": {
            "runs": len(held_out),
            "median": round(median(held_out), 3) if held_out else None,
            "not_above_1.1": _share(sum(value <= 1.1 for value in held_out), len(held_out)),
        },
        "seconds_for_1500_to_2500_readings": {
            "runs": len(times),
            "median": round(median(times), 2) if times else None,
            "largest": round(max(times), 2) if times else None,
        },
    }


def missed(counted):
    """Say which figures miss what they must be, beyond what so few runs leave open."""
    told = []
    for name, (sense, limit) in MUST_BE.items():
        bounds = counted[name]["bounds"]
        if bounds and (bounds[0] > limit if sense == "at most" else bounds[1] < limit):
            told.append(f"{name}: {counted[name]['share']} must be {sense} {limit}")
    twice = counted["right_name_or_group_by_level"].get("2", {})
    if twice and twice["bounds"][1] < RIGHT_AT_TWICE:
        told.append(f"right name at 2 x the limit: {twice['share']} < {RIGHT_AT_TWICE}")
    bands = counted["band_covers"]["bounds"]
    if bands and (bands[1] < COVERAGE[0] or bands[0] > COVERAGE[1]):
        told.append(f"95 % band covers {counted['band_covers']['share']}, not 0.92 to 0.98")
    held_out = counted["held_out_chi_squared_per_degree"]["median"]
    if held_out is not None and held_out > 1.1:
        told.append(f"held-out chi squared per degree of freedom {held_out} > 1.1")
    seconds = counted["seconds_for_1500_to_2500_readings"]["median"]
    if seconds is not None and seconds > 20.0:
        told.append(f"{seconds} s for a verdict, more than 20 s")
    return told


def confusion(judged):
    """Return class (with level, where sizes vary) → outcome → count."""
    table = defaultdict(Counter)
    for one in judged:
        truth = one["truth"]
        row = truth["class"]
        if row in ("one", "pair"):
            row = f"{row}, {truth['level']:g} x limit"
        table[row][one["outcome"]] += 1
    return {row: {name: table[row][name] for name in OUTCOMES} for row in sorted(table)}


def by_kind(judged):
    """Return kind of the (first) hidden effect → outcome → count, sizes from 2 x the limit on."""
    table = defaultdict(Counter)
    for one in judged:
        if one["truth"]["hidden"] and one["truth"]["level"] >= 2.0:
            kinds = " + ".join(hidden["kind"] for hidden in one["truth"]["hidden"])
            table[f"{one['truth']['class']}: {kinds}"][one["outcome"]] += 1
    return {row: dict(table[row]) for row in sorted(table)}


def as_table(rows, corner):
    """Return a markdown table of a mapping of mappings."""
    names = list(OUTCOMES)
    lines = [f"| {corner} | {' | '.join(names)} |", f"|---|{'---:|' * len(names)}"]
    lines += [
        f"| {row} | {' | '.join(str(counts.get(name, 0)) for name in names)} |"
        for row, counts in rows.items()
    ]
    return "\n".join(lines)
