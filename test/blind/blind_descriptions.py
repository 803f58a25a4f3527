"""How a description of something outside the catalogue is judged: its drivers, and its amounts."""

from dataclasses import replace
from itertools import product

import numpy as np
from blind_drivers import READING, arms_of
from blind_machine import Machine
from blind_plans import box_places
from blind_words import Entry, is_one_of, quantities_of
from blind_yardstick import Yardstick

LEARNED = ("learned shape", "learned rotation")
"""Names of findings that are shapes and no effects of the catalogue."""
MOST_RIVALS = 3
"""Rivals of a dependence that a report states."""


def outside_outcome(truth, verdict):
    """Judge a verdict on a run in which something outside the catalogue is hidden."""
    word, lasting = verdict["verdict"], truth["drivers"]["lasting"]
    if word == "DESCRIBED":
        return _described_outcome(truth, verdict)
    if word == "UNEXPLAINED":
        return "unexplained" if lasting else "right"
    if word == "CONSISTENT":
        return "consistent"
    if truth["jumps"] and _is_named_by_its_jumps(truth, verdict):
        return "right, with its rival"
    stated = all(finding["ambiguous"] for finding in verdict["findings"])
    return "right, in a group" if word == "AMBIGUOUS" and stated else "wrong name"


def _described_outcome(truth, verdict):
    """Judge a description: all drivers right and none wrong, alone or with a stated rival."""
    if any(one["effect"] not in LEARNED for one in verdict["findings"]):
        return "wrong name"
    dependences = verdict["description"]["dependences"]
    own = [[one["acts_on"], one["drivers"]] for one in dependences]
    rivals = [one["rivals"][:MOST_RIVALS] for one in dependences]
    right = _is_right(truth, own)
    # A rival that is a part of what is hidden is no doubt about it.
    if right and all(_is_part(truth, other) for some in rivals for other in some):
        return "right"
    ways = product(*([one, *some] for one, some in zip(own, rivals, strict=True)))
    stated = any(_is_right(truth, list(way)) for way in ways)
    return "right, with its rival" if stated else "wrong description"


def described_rightly(one):
    """Tell whether a description itself is right, whatever rivals it states."""
    if one["verdict"]["verdict"] != "DESCRIBED" or one["outcome"] == "wrong name":
        return False
    dependences = one["verdict"]["description"]["dependences"]
    return _is_right(one["truth"], [[each["acts_on"], each["drivers"]] for each in dependences])


def _moved(truth, dependence):
    """Return a dependence as displacements: what a rotation moves by the arms of later axes."""
    acts_on, drivers = dependence
    if not acts_on.startswith("E_"):
        return [dependence]
    arms = arms_of(acts_on, truth["chain"]).items()
    moved = [[axis, [*drivers, f"the place of {arm}"]] for axis, arm in arms]
    return moved or [[READING, drivers]]


def _is_part(truth, dependence):
    told = truth["drivers"]
    return all(
        acts_on in told["acts_on"]
        and quantities_of(drivers, truth["one_temperature"]) <= set(told["quantities"])
        for acts_on, drivers in _moved(truth, dependence)
    )


def _is_right(truth, dependences):
    """Tell whether dependences together say all that drives the hidden effect, and no more."""
    told = truth["drivers"]
    moved = [each for one in dependences for each in _moved(truth, one)]
    meant = [quantities_of(drivers, truth["one_temperature"]) for _, drivers in moved]
    return (
        all(_is_part(truth, one) for one in dependences)
        and {acts_on for acts_on, _ in moved} == set(told["acts_on"])
        and set().union(*meant) == set(told["quantities"])
    )


def _is_named_by_its_jumps(truth, verdict):
    """Tell whether all that is named are jumps where the mirror jumped and where it jumped back.

    The same readings are two slips of the counter: no run tells these from the mirror.
    """
    setup = truth["setups"][truth["hidden"][0]["setting"]["setup"]]
    entries = [Entry(*words) for words in verdict["words"]]
    return bool(entries) and all(is_one_of(entry, setup, truth["jumps"]) for entry in entries)


def described_errors(case, sizes, truth, amounts):
    """Return rms of described minus true amounts over rms of the true ones.

    ``at_stops``: of the readings of the run. ``in_box``: of the displacement along the run's beams
    at places all over the measured box, the rest of the state as at the run's stops; None where the
    hidden effect is no displacement. From both is taken off what nothing can see there: curves of
    the axes, tilts and zero of each setup (``blind_yardstick``).

    Args:
        case: the hidden machine.
        sizes: of what is hidden.
        truth: of the seal.
        amounts: what the description says, m: ``at_stops`` and ``in_box``, each (n,).
    """
    run, shown = _shown(case, sizes)
    (hidden,), (size,) = case.hidden, sizes
    errors = {"at_stops": _error(run, shown, amounts["at_stops"]), "in_box": None}
    if truth["drivers"]["in_box"]:
        travels = replace(run, position=box_places(case.plan.step, case.plan.blocks, len(run.time)))
        action = hidden.act(travels, size)
        moved = np.sum(action.shift.sum(axis=0) * run.beam, axis=1)
        errors["in_box"] = _error(travels, moved, amounts["in_box"])
    return errors


def beyond_names(case, sizes, truth, spanned):
    """Return what is hidden beyond all that the named effects can do, in standard deviations.

    So many has an observer who knows the exact form of what is hidden, and not only its drivers, to
    tell it from the names: for odds of 20 to 1 he needs 2.4 of them at least.

    Args:
        case: the hidden machine.
        sizes: of what is hidden.
        truth: of the seal.
        spanned: what the named effects can do to the readings, m, (k, n).
    """
    run, shown = _shown(case, sizes)
    yardstick = Yardstick(run)
    names = yardstick.signature(np.array(spanned).T)
    names = names / np.linalg.norm(names, axis=0)
    true = yardstick.signature(shown)
    taken, *_ = np.linalg.lstsq(names, true, rcond=1e-6)
    return float(np.linalg.norm(true - names @ taken) / truth["noise"])


def _shown(case, sizes):
    """Return the run of a case and what the hidden effect does to its readings."""
    machine = Machine(case.seed, case.plan)
    machine.approach = np.zeros_like(machine.approach)
    run = machine.run()
    (hidden,), (size,) = case.hidden, sizes
    return run, size * machine.signature(run, hidden)


def _error(run, true, described):
    yardstick = Yardstick(run)
    left = np.linalg.norm(yardstick.signature(np.asarray(described) - true))
    return float(left / np.linalg.norm(yardstick.signature(true)))
