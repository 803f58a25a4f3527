"""How a single verdict of the blind test is judged against the truth."""

from blind_asking import CRASH, NO_ANSWER, REFUSED
from blind_descriptions import outside_outcome
from blind_words import Entry, is_at, means, rightly_said

OUTCOMES = (
    "right",
    "right, in a group",
    "right, with its rival",
    "wrong description",
    "wrong name",
    "unexplained",
    "consistent",
    "no verdict",
)
NO_PLAN = "no plan"
"""Outcome where an extra plan was asked for and none was proposed."""
GOOD = ("right", "right, in a group")


def labels_of(truth, verdict):
    """For each hidden effect the labels of the verdict that mean it."""
    entries = [Entry(*words) for words in verdict["words"]]
    return [
        {
            entry.label
            for entry in entries
            if means(entry, hidden["kind"], hidden["setting"], truth["setups"])
        }
        for hidden in truth["hidden"]
    ]


def names_of(finding):
    """Return every name that a finding states as the cause."""
    return {finding["label"], *finding["ambiguous"], *finding.get("equivalent", ())}


def found(labels, verdict):
    """Say how each hidden effect was found: ``right``, ``right, in a group`` or nothing.

    Args:
        labels: for each hidden effect those that mean it.
        verdict: document of one verdict.
    """
    ways = []
    for some in labels:
        named = [finding for finding in verdict["findings"] if some & names_of(finding)]
        # Several names of one and the same effect are no group, nor are those of an alignment that
        # is over, where it is stated that they are one.
        alone = any(not finding["ambiguous"] or names_of(finding) <= some for finding in named)
        ways.append("right" if alone else "right, in a group" if named else "")
    return ways


def outcome(truth, verdict):
    """Judge one verdict; one of OUTCOMES.

    With something hidden that the catalogue has, every effect must be found and nothing else named.
    A finding too many, alone or in a group of which no member is hidden, is a wrong name. With
    nothing hidden CONSISTENT is right; with something outside the catalogue a description is right
    that says what drives it (``blind_descriptions``); with something that nobody can
    see CONSISTENT is right where that effect is said not to be testable. A gross error is right
    where the sentence, or the refusal of the table, says which it is.
    """
    word = verdict["verdict"]
    if truth["class"] == "gross":
        return _gross_outcome(truth, verdict)
    if word in ("NOT TESTABLE", NO_ANSWER, CRASH, REFUSED):
        return "no verdict"
    if truth["class"] in ("none", "unseen"):
        if word == "CONSISTENT":
            said = truth["class"] == "none" or _said_not_testable(truth, verdict)
            return "right" if said else "consistent"
        return "unexplained" if word == "UNEXPLAINED" else "wrong name"
    if truth["class"] == "outside":
        return outside_outcome(truth, verdict)
    if word == "CONSISTENT":
        return "consistent"
    if word in ("UNEXPLAINED", "DESCRIBED"):
        return "unexplained"
    labels = labels_of(truth, verdict)
    ways = found(labels, verdict)
    hidden = set().union(*labels)
    strangers = [finding for finding in verdict["findings"] if not hidden & names_of(finding)]
    if strangers or not any(ways):
        return "wrong name"
    if not all(ways):
        # What was named is there, but not all that is there was named.
        return "consistent"
    return "right" if set(ways) == {"right"} else "right, in a group"


def _said_not_testable(truth, verdict):
    """Whether what is hidden, under any name that means it, was said not to be testable."""
    entries = [Entry(*words) for words in verdict["untestable"]]
    return any(
        means(entry, hidden["kind"], hidden["setting"], truth["setups"])
        for hidden in truth["hidden"]
        for entry in entries
    )


def _gross_outcome(truth, verdict):
    word, gross = verdict["verdict"], truth["gross"]
    text = " ".join([verdict.get("sentence", ""), *verdict["where"]])
    if word in (CRASH, NO_ANSWER):
        return "no verdict"
    if word in ("NAMED", "AMBIGUOUS"):
        placed = gross["kind"] == "outlier" and all(
            is_at(Entry(*one), truth["setups"][gross["setup"]], gross["stop"])
            for one in verdict["words"]
        )
        return "right" if placed else "wrong name"
    if word == "CONSISTENT":
        return "consistent"
    return "right" if rightly_said(gross, text, word == REFUSED) else "unexplained"


def after_plan(truth, verdict):
    """Judge what became of a run that could not tell, after the proposed plan.

    None where no plan was asked for; NO_PLAN where none was proposed; else the outcome of the
    verdict on both runs together.
    """
    further = verdict.get("further")
    if further is None or truth["class"] not in ("one", "two", "pair", "outside"):
        return None
    if further["verdict"] is None:
        return NO_PLAN
    return outcome(truth, further["verdict"])


def told_to_stay_open(truth, verdict):
    """Tell whether the proposal itself said that its plan leaves open what is hidden."""
    labels = set().union(*labels_of(truth, verdict))
    left = verdict["further"]["proposal"].get("left_open", [])
    return any(labels & set(some) for some in left)


def of_the_machine(truth):
    """Tell whether all that is hidden acts in every run, whatever alignment and pass."""
    return all("setup" not in hidden["setting"] for hidden in truth["hidden"])


def covered(truth, verdict):
    """Return for each named size whether its 95 % band holds the true one.

    Only where the effect was named under its very label: a slip one stop away has another size.
    """
    answers = []
    for expected in truth.get("expected", ()):
        for finding in verdict["findings"]:
            sizes = expected.get(finding["label"])
            if sizes is None:
                continue
            for name, size in sizes.items():
                low, high = finding["band"][name]
                answers.append(low <= size <= high)
    return answers
