"""Runs all cases of a blind test on several processes, and tells how long it will still take."""

import os
import sys
import time
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from blind_cases import LARGEST
from blind_harness import judge_blindly, opened, prepare

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
LEVELS_IN_TURN = {
    "one": (2.0, 5.0, 2.0, 1.0, 2.0, 0.5),
    "pair": (2.0, 5.0, 2.0, 5.0, 1.0),
    "outside": (3.0, 3.0, 5.0, 3.0, 3.0, 5.0, 3.0),
}
"""Class → levels of its sizes, in turn: most runs at the size where the issue asks."""
COST = {
    "none": (0.1, 1.5),
    "one": (1.5, 9.0),
    "two": (1.5, 5.0),
    "outside": (0.4, 6.0),
    "pair": (2.0, 13.0),
    "unseen": (0.2, 1.5),
    "gross": (0.1, 0.4),
}
"""Class → seconds of one processor to prepare and to judge a case, before any was measured."""


def wanted_cases(runs, seed=0, repeats=0):
    """Return (class, seed, level, repeats) of each case, classes mixed so that time passes evenly.

    Args:
        runs: class → number of cases.
        seed: of the first case of each class.
        repeats: that the plans have at least; 0: a few.
    """
    cases = []
    for kind, count in runs.items():
        levels = LEVELS_IN_TURN.get(kind, (None,))
        for number in range(count):
            level = levels[number % len(levels)]
            cases.append(((number + 0.5) / count, (kind, seed + number, level, repeats)))
    return [case for _, case in sorted(cases, key=lambda one: one[0])]


def processor_time(wanted):
    """Return the seconds of one processor that cases will take, as far as can be said before."""
    return sum(sum(COST[kind]) for kind, *_ in wanted)


class _TimeLeft:
    """Estimates from the cases done how long the others take."""

    def __init__(self, wanted, processes):
        self._processes = processes
        self._left = {(phase, one): None for phase in (0, 1) for one in wanted}
        self._spent = defaultdict(list)

    def done(self, phase, case, seconds):
        del self._left[phase, case]
        # What was done in an earlier start takes no time, and tells nothing.
        if seconds > 0.05:
            self._spent[phase, case[0]].append(seconds)

    def minutes(self):
        total = 0.0
        for phase, (kind, *_) in self._left:
            spent = self._spent[phase, kind]
            # The expected cost counts as two cases.
            total += (sum(spent) + 2.0 * COST[kind][phase]) / (len(spent) + 2.0)
        return total / self._processes / 60.0


def blind_test(root, wanted, processes=2, largest=LARGEST, progress=print):
    """Run the blind test on cases (class, seed, level or None, repeats); return what was judged.

    All cases are prepared and sealed first, then all are put to the workflow, then the seals are
    opened.
    """
    root = Path(root)
    left = _TimeLeft(wanted, max(processes, 1))
    prepared = [(root, *one[:3], largest, one[3]) for one in wanted]
    names = _all(prepare, prepared, wanted, processes, progress, (left, 0, "prepared"))
    judged = [(root, name) for name in names]
    _all(judge_blindly, judged, wanted, processes, progress, (left, 1, "judged"))
    return opened(root, names)


def _all(task, arguments, wanted, processes, progress, telling):
    left, phase, word = telling
    names = [""] * len(arguments)

    def tell(place, result, number):
        names[place], seconds, processor = result
        left.done(phase, wanted[place], seconds)
        progress(
            f"{word} {number}/{len(arguments)}: {names[place]} in {seconds:.1f} s "
            f"({processor:.1f} s of processor), about {left.minutes():.0f} min left"
        )

    if processes <= 1:
        for place, one in enumerate(arguments):
            tell(place, _timed(task, one), place + 1)
        return names
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    with ProcessPoolExecutor(processes, initializer=_path_of_parent, initargs=(sys.path,)) as pool:
        waiting = {pool.submit(_timed, task, one): place for place, one in enumerate(arguments)}
        for number, done in enumerate(as_completed(waiting), 1):
            tell(waiting[done], done.result(), number)
    return names


def _timed(task, arguments):
    begin, processor = time.perf_counter(), time.process_time()
    name = task(*arguments)
    return name, time.perf_counter() - begin, time.process_time() - processor


def _path_of_parent(path):
    sys.path[:] = path
