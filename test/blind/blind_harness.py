"""The blind test: prepare cases, seal their truth, ask the workflow, then open the seals.

Each case passes through files of one folder, so that a stopped test goes on where it was:

- ``cases/NAME/`` run.csv and case.yaml, all that the workflow is shown;
- ``again/NAME/`` the same machine measured a second time, for the held-out figure;
- ``seals/NAME`` the truth, and ``laid/NAME.json`` the hash of the seal;
- ``verdicts/NAME.json``; the seals are opened only when every case has one.

Sizes are told in detection limits. The limit is the one that the workflow states itself, asked on a
null run of the same plan on the same machine with other noise; if it states none, that of the
generator's yardstick (``truth["scaled_by"]`` says which). Those null runs are judged too.
"""

import json
import os
import signal
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from blind_cases import LARGEST, LEVELS, Machine, draw_case, own_limits, seal, unseal, write_case
from blind_figures import NO_ANSWER, outcome
from blind_words import Entry, means

NULL_NOISE, SECOND_NOISE = 1, 2
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


LONGEST = 120
"""Seconds after which a workflow has no answer; the issue allows 20 in the middle."""


class NoAnswerError(Exception):
    """The workflow has not come to a verdict in time."""


@contextmanager
def limited(seconds):
    """Give up after some seconds; acts in the main thread of a process."""

    def give_up(_number, _frame):
        raise NoAnswerError

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def imported(folder):
    """Import a run table into a bag as ``stepdiag import`` does, and read the bag."""
    from stepdiag_ros.bags.run import load_run
    from stepdiag_ros.bags.table import import_table

    bag = Path(folder) / "run.mcap"
    if not bag.exists():
        import_table(Path(folder) / "run.csv", None, bag)
    return load_run(bag).measurement


def asked(folder, **further):
    """Ask the workflow; return its diagnosis and the document that is kept of it."""
    from stepdiag_ros.metrology.discrepancy.diagnose import diagnose

    measurement = imported(folder)
    begin = time.perf_counter()
    with limited(LONGEST):
        found = diagnose(measurement, **further)
    seconds = time.perf_counter() - begin
    return found, {
        "verdict": found.verdict,
        "sentence": found.sentence,
        "findings": [_finding(one) for one in found.findings],
        "partial": [_finding(one) for one in found.partial],
        "noise": found.noise,
        "correlation": found.noise_correlation,
        "chi_squared": [found.chi_squared_before, found.chi_squared_after],
        "degrees_of_freedom": [found.degrees_of_freedom_before, found.degrees_of_freedom_after],
        "lack_of_fit_p": [found.lack_of_fit_p_before, found.lack_of_fit_p_after],
        "tested": found.tested,
        "readings": len(found.residual_before),
        "seconds": seconds,
    }


def _no_answer():
    return {"verdict": NO_ANSWER, "findings": [], "readings": 0, "seconds": LONGEST}


def _finding(one):
    return {
        "label": one.label,
        "effect": one.candidate.effect.name,
        "sizes": dict(one.sizes),
        "band": {name: list(ends) for name, ends in one.band.items()},
        "gain": one.gain,
        "p_value": one.p_value,
        "probability": one.probability,
        "group": list(one.group),
        "ambiguous": list(one.ambiguous),
        "runners_up": [[other.label, other.probability] for other in one.runners_up[:5]],
    }


def catalogue_entries(stops):
    """Every candidate of the catalogue in a run: entry → (effect, setting)."""
    from stepdiag_ros.metrology.effects import catalogue

    entries = []
    for effect in catalogue().values():
        for setting in effect.settings(stops):
            entry = Entry(effect.name, dict(setting), effect.label(setting))
            entries.append((entry, effect, setting))
    return entries


def sizes_in_their_words(change, effect, setting, stops, run):
    """Express a change of the readings in a candidate's own sizes, or None if it is another one."""
    columns = effect.columns(setting, stops)
    setups = np.eye(int(run.setup.max()) + 1)[run.setup]
    both = np.column_stack([columns, setups])
    lengths = np.linalg.norm(both, axis=0)
    lengths[lengths == 0.0] = 1.0
    values, *_ = np.linalg.lstsq(both / lengths, change, rcond=1e-10)
    left = np.linalg.norm(change - both / lengths @ values)
    if left > 0.02 * np.linalg.norm(change - change.mean()):
        return None
    names = [size.name for size in effect.sizes]
    sizes = (values / lengths)[: len(names)]
    return dict(zip(names, (float(value) for value in sizes), strict=True))


def prepare(root, kind, seed, level=None, largest=LARGEST):
    """Draw a case, find its scale, write what the workflow will see, seal the truth."""
    root = Path(root)
    case = draw_case(kind, seed, level, largest)
    if (root / "laid" / f"{case.name}.json").exists():
        return case.name
    machine = Machine(seed, case.plan)
    run = machine.run()
    limits, scaled_by, labels, expected, largest_levels = [], "workflow", [], [], []
    stated, entries, stops = {}, [], None
    if kind != "none":
        null = root / "null" / case.name
        write_case(null, replace(case, hidden=()), (), NULL_NOISE)
        try:
            diagnosis, document = asked(null)
            stops, stated = diagnosis.stops, diagnosis.detection_limits
            entries = catalogue_entries(stops)
        except NoAnswerError:
            document = _no_answer()
        _keep(root / "null" / f"{case.name}.json", document)
    setups = [(one.kind, one.line, one.order) for one in case.plan.setups]
    # How the axes came to a setup is no part of any effect, though it moves a few stops.
    machine.approach = np.zeros_like(machine.approach)
    run = machine.run()
    for hidden, own in zip(case.hidden, own_limits(case), strict=True):
        change = machine.signature(run, hidden)
        meant = [
            entry_of
            for entry_of in entries
            if means(entry_of[0], hidden.kind, hidden.setting, setups)
        ]
        in_words = {
            entry.label: sizes_in_their_words(change, effect, setting, stops, run)
            for entry, effect, setting in meant
        }
        in_words = {label: sizes for label, sizes in in_words.items() if sizes}
        ways = [
            stated[label] / _first(sizes)
            for label, sizes in in_words.items()
            if label in stated and _first(sizes)
        ]
        if not ways:
            scaled_by = "yardstick"
        limits.append((min(ways) if ways else own, own))
        labels.append([entry.label for entry, _, _ in meant])
        expected.append(in_words)
        most = [
            max(abs(effect.sizes[0].low), abs(effect.sizes[0].high)) / _first(in_words[entry.label])
            for entry, effect, _ in meant
            if _first(in_words.get(entry.label, {}))
        ]
        largest_levels.append(max(most) / limits[-1][0] if most else np.inf)
    # What lies beyond its plausible range is rightly ruled out: such a size comes down a level.
    fitting = [one for one in LEVELS if one <= min([case.level, *largest_levels])]
    case = replace(case, level=max(fitting, default=min(LEVELS)))
    sizes = [sign * case.level * limit for sign, (limit, _) in zip(case.signs, limits, strict=True)]
    write_case(root / "cases" / case.name, case, sizes)
    write_case(root / "again" / case.name, case, sizes, SECOND_NOISE)
    facts = {
        "scaled_by": scaled_by,
        "limit_over_yardstick": [limit / own for limit, own in limits],
        "labels": labels,
        "expected": [
            {
                label: {name: size * value for name, value in values.items()}
                for label, values in of_one.items()
            }
            for size, of_one in zip(sizes, expected, strict=True)
        ],
    }
    (root / "seals").mkdir(parents=True, exist_ok=True)
    digest = seal(root / "seals" / case.name, case, sizes, facts)
    _keep(root / "laid" / f"{case.name}.json", {"seal": digest})
    return case.name


def _first(sizes):
    return abs(next(iter(sizes.values()), 0.0))


def judge_blindly(root, name):
    """Ask the workflow for the verdict on one case; it sees the case's folder, no seal."""
    root = Path(root)
    kept = root / "verdicts" / f"{name}.json"
    if kept.exists():
        return name
    try:
        found, document = asked(root / "cases" / name)
        if found.verdict == "NAMED":
            # The same machine measured again: effects as found, nothing of them fitted to it.
            known = [one.active for one in found.findings]
            _, again = asked(root / "again" / name, known=known)
            document["held_out"] = again["chi_squared"][0] / again["degrees_of_freedom"][0]
    except NoAnswerError:
        document = _no_answer()
    _keep(kept, document)
    return name


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
        "held_out": verdict.get("held_out"),
    }


def blind_test(root, wanted, processes=2, largest=LARGEST, progress: Callable[[str], None] = print):
    """Run the blind test on cases (class, seed, level or None); return what was judged.

    All cases are prepared and sealed first, then all are put to the workflow, then the seals are
    opened.
    """
    root = Path(root)
    arguments = [(root, *one, largest) for one in wanted]
    names = _all(prepare, arguments, processes, progress, "prepared")
    _all(judge_blindly, [(root, name) for name in names], processes, progress, "judged")
    return opened(root, names)


def _all(task, arguments, processes, progress, word):
    if processes <= 1:
        return [task(*one) for one in arguments]
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    with ProcessPoolExecutor(processes, initializer=_path_of_parent, initargs=(sys.path,)) as pool:
        waiting = {pool.submit(task, *one): place for place, one in enumerate(arguments)}
        names = {}
        for done in as_completed(waiting):
            names[waiting[done]] = done.result()
            progress(f"{word} {len(names)}/{len(arguments)}: {done.result()}")
    return [names[place] for place in range(len(arguments))]


def _path_of_parent(path):
    sys.path[:] = path
