"""The blind test: prepare cases, seal their truth, ask the workflow, then open the seals.

Each case passes through files of one folder, so that a stopped test goes on where it was:

- ``cases/NAME/`` run.csv and case.yaml, all that the workflow is shown;
- ``again/NAME/`` the same machine measured a second time, for the held-out figure;
- ``machines/NAME`` the machine, which measures a proposed plan, and tells at every place what is
  hidden when the seals are open; ``further/NAME/`` what it measured;
- ``seals/NAME`` the truth, and ``laid/NAME.json`` the hash of the seal;
- ``verdicts/NAME.json``; the seals are opened only when every case has one.

Sizes are told in detection limits. The limit is the one that the workflow states itself, asked on a
null run of the same plan on the same machine with other noise; if it states none, that of the
generator's yardstick (``truth["scaled_by"]`` says which). Those null runs are judged too.
"""

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
from blind_asking import (
    NoAnswerError,
    asked,
    crashed,
    diagnosed_together,
    entries_of,
    further_plan,
    held_out,
    no_answer,
)
from blind_cases import (
    LARGEST,
    LARGEST_OF_MANY,
    LEVELS,
    draw_case,
    own_limits,
    seal,
    unseal,
    write_case,
    write_further,
    write_gross,
)
from blind_descriptions import beyond_names, described_errors
from blind_drivers import facts_of
from blind_judging import after_plan, outcome
from blind_machine import Machine
from blind_words import means
from blind_yardstick import Yardstick

NULL_NOISE, SECOND_NOISE = 1, 2
SCALED = ("one", "two", "pair")
"""Classes whose sizes are told in the workflow's own detection limits, asked on a null run."""
_SAME = 0.005
"""Part of a change of the readings that may be left over where two effects count as one."""


def sizes_in_their_words(change, effect, setting, stops, run):
    """Express a change of the readings in a candidate's own sizes, or None if it is another one."""
    columns = effect.columns(setting, stops)
    setups = np.eye(int(run.setup.max()) + 1)[run.setup]
    both = np.column_stack([columns, setups])
    lengths = np.linalg.norm(both, axis=0)
    lengths[lengths == 0.0] = 1.0
    values, *_ = np.linalg.lstsq(both / lengths, change, rcond=1e-10)
    left = np.linalg.norm(change - both / lengths @ values)
    if left > _SAME * np.linalg.norm(change - change.mean()):
        return None
    names = [size.name for size in effect.sizes]
    sizes = (values / lengths)[: len(names)]
    return dict(zip(names, (float(value) for value in sizes), strict=True))


def prepare(root, kind, seed, level=None, largest=LARGEST, repeats=0):
    """Draw a case, find its scale, write what the workflow will see, seal the truth."""
    root = Path(root)
    case = draw_case(kind, seed, level, LARGEST_OF_MANY if repeats else largest, repeats)
    if (root / "laid" / f"{case.name}.json").exists():
        return case.name
    setups = [(one.kind, one.line, one.order) for one in case.plan.setups]
    facts, sizes = {"setups": setups, "scaled_by": "yardstick", "expected": []}, []
    if kind == "gross":
        write_gross(root / "cases" / case.name, case)
    else:
        case, sizes, told = _scaled(root, case, setups)
        facts.update(told)
        write_case(root / "cases" / case.name, case, sizes)
    if kind == "outside":
        facts.update(facts_of(case.hidden[0], Machine(seed, case.plan).run()))
    # What is random, or belongs to one alignment, does not come again.
    if kind in SCALED or (kind == "outside" and facts["drivers"]["lasting"]):
        write_case(root / "again" / case.name, case, sizes, SECOND_NOISE)
    if kind in (*SCALED, "outside"):
        (root / "machines").mkdir(parents=True, exist_ok=True)
        (root / "machines" / case.name).write_bytes(pickle.dumps((case, sizes)))
    (root / "seals").mkdir(parents=True, exist_ok=True)
    digest = seal(root / "seals" / case.name, case, sizes, facts)
    _keep(root / "laid" / f"{case.name}.json", {"seal": digest})
    return case.name


def _scaled(root, case, setups):
    """Find the sizes of a case; return it with the level that they have, and what is sealed."""
    stated, entries, stops = {}, [], None
    if case.kind in SCALED:
        null = root / "null" / case.name
        write_case(null, replace(case, hidden=()), (), NULL_NOISE)
        try:
            diagnosis, document = asked(null)
            stops, stated = diagnosis.stops, diagnosis.detection_limits
            entries = entries_of(stops)
        except NoAnswerError:
            document = no_answer()
        except Exception as error:  # A crash of the workflow is a result, not the test's end.
            document = crashed(error)
        _keep(root / "null" / f"{case.name}.json", document)
    machine = Machine(case.seed, case.plan)
    # How the axes came to a setup is no part of any effect, though it moves a few stops.
    machine.approach = np.zeros_like(machine.approach)
    run = machine.run()
    yardstick = Yardstick(run)
    limits, scaled_by, in_words, highest = [], "workflow", [], []
    for hidden, own in zip(case.hidden, own_limits(case), strict=True):
        change = machine.signature(run, hidden)
        seen = np.linalg.norm(yardstick.signature(change))
        ways, words, most = [], {}, []
        for entry, effect, setting in entries:
            if not means(entry, hidden.kind, hidden.setting, setups):
                continue
            if entry.label in stated:
                # The size at which the hidden effect is as large in this run as the stated one.
                first = effect.columns(setting, stops)[:, 0]
                alike = float(np.linalg.norm(yardstick.signature(first))) / seen
                ways.append(stated[entry.label] * alike)
                most.append(max(abs(effect.sizes[0].low), abs(effect.sizes[0].high)) * alike)
            sizes = sizes_in_their_words(change, effect, setting, stops, run)
            if sizes:
                words[entry.label] = sizes
                most.append(_most(effect, sizes))
        scaled_by = scaled_by if ways else "yardstick"
        limits.append((float(min(ways)) if ways else own, own))
        highest.append(max(most, default=np.inf) / limits[-1][0])
        in_words.append(words)
    # What lies beyond its plausible range is rightly ruled out: such a size comes down a level.
    fitting = [one for one in {*LEVELS, case.level} if one <= min([case.level, *highest])]
    case = replace(case, level=max(fitting, default=min(LEVELS)))
    sizes = [sign * case.level * limit for sign, (limit, _) in zip(case.signs, limits, strict=True)]
    return (
        case,
        sizes,
        {
            "scaled_by": scaled_by,
            "limit_over_yardstick": [limit / own for limit, own in limits],
            "expected": [
                {
                    label: {name: size * value for name, value in values.items()}
                    for label, values in of_one.items()
                }
                for size, of_one in zip(sizes, in_words, strict=True)
            ],
        },
    )


def _most(effect, sizes):
    """Size of the hidden effect at which the first of the catalogue's leaves its range."""
    largest = max(abs(value) for value in sizes.values())
    return min(
        max(abs(size.low), abs(size.high)) / abs(sizes[size.name])
        for size in effect.sizes
        if abs(sizes[size.name]) > 1e-3 * largest
    )


def judge_blindly(root, name):
    """Ask the workflow for the verdict on one case; it sees the case's folder, no seal.

    If it says that it cannot tell by what the gap closes, it is asked for an extra plan, the
    machine is measured by it, and both runs are put to the workflow together.
    """
    root = Path(root)
    kept = root / "verdicts" / f"{name}.json"
    if kept.exists():
        return name
    folder = root / "cases" / name
    diagnosis = None
    try:
        diagnosis, document = asked(folder)
        if document["verdict"] in ("NAMED", "DESCRIBED") and (root / "again" / name).exists():
            document["held_out"] = held_out(root / "again" / name, diagnosis)
    except NoAnswerError:
        document = no_answer()
    except Exception as error:  # A crash of the workflow is a result, not the test's end.
        document = crashed(error)
    if _is_open(name.split("-")[0], document):
        document["further"] = _further(root, name, diagnosis)
    _keep(kept, document)
    return name


def _is_open(kind, document):
    """Tell whether the verdict states what else may be the cause, so that a plan is asked for."""
    named = document["verdict"] in ("NAMED", "AMBIGUOUS") and kind in (*SCALED, "outside")
    described = document["verdict"] == "DESCRIBED" and kind == "outside"
    dependences = document["description"]["dependences"] if described else ()
    return any(one["ambiguous"] for one in document["findings"] if named) or any(
        one["rivals"] for one in dependences
    )


def _further(root, name, diagnosis):
    """Have a plan proposed, measured and diagnosed together with the first run."""
    folder = root / "cases" / name
    try:
        text, proposal = further_plan(folder, diagnosis)
        if not text:
            return {"proposal": proposal, "verdict": None}
        case, sizes = pickle.loads((root / "machines" / name).read_bytes())
        conditions = proposal["conditions"]
        measured = write_further(root / "further" / name, case, sizes, text, conditions=conditions)
        (measured / "plan.yaml").write_text(text)
        return {"proposal": proposal, "verdict": diagnosed_together([folder, measured])}
    except NoAnswerError:
        return {"proposal": {"sentence": "no answer"}, "verdict": no_answer()}
    except Exception as error:
        return {"proposal": {"sentence": "crash"}, "verdict": crashed(error)}


def _keep(path, document):
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(document))
    partial.rename(path)


def opened(root, names):
    """Open the seals of cases that all have verdicts; return what was judged.

    Raises:
        RuntimeError: a verdict is missing, so that no seal may be opened.
        ValueError: a seal was changed.
    """
    root = Path(root)
    missing = [name for name in names if not (root / "verdicts" / f"{name}.json").exists()]
    if missing:
        raise RuntimeError(f"no seal is opened before all verdicts are in; missing: {missing}")
    judged = []
    for name in names:
        laid = json.loads((root / "laid" / f"{name}.json").read_text())
        truth = unseal(root / "seals" / name, laid["seal"])
        verdict = json.loads((root / "verdicts" / f"{name}.json").read_text())
        judged.append(_judged(name, truth, verdict))
        if truth["class"] == "outside":
            case, sizes = pickle.loads((root / "machines" / name).read_bytes())
            if verdict["verdict"] == "DESCRIBED":
                errors = described_errors(case, sizes, truth, verdict["amounts"])
                judged[-1]["described_errors"] = errors
            elif verdict.get("spanned"):
                beyond = beyond_names(case, sizes, truth, verdict["spanned"])
                judged[-1]["beyond_names"] = beyond
        null = root / "null" / f"{name}.json"
        if null.exists():
            nothing = {**truth, "class": "none", "hidden": [], "sizes": [], "expected": []}
            judged.append(_judged(f"{name} null", nothing, json.loads(null.read_text())))
    return judged


def _judged(name, truth, verdict):
    return {
        "name": name,
        "truth": truth,
        "verdict": verdict,
        "outcome": outcome(truth, verdict),
        "after_plan": after_plan(truth, verdict),
        "held_out": verdict.get("held_out"),
        "described_errors": None,
        "beyond_names": None,
    }
