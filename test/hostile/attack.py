#!/usr/bin/env python3
"""Changes bags by structure and content, and counts what commands make of them.

    python test/hostile/attack.py --cases 2000 --seed 1

Case N of a seed is always the same bag. Exit code 1 if a single case ends in a traceback, a hang,
too much memory, or other numbers without a word.
"""

import argparse
import contextlib
import copy
import random
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from changes import CONTENT, STRUCTURE  # noqa: E402
from forging import (  # noqa: E402
    Anatomy,
    as_older_recorders_wrote,
    as_our_writer_counts,
    taken_apart,
)
from judging import COMMANDS, QUICK, SLOW, Case, differences, examined, warm_up  # noqa: E402
from small_run import write_small_run  # noqa: E402

EVERY_TOPIC = HERE.parent / "data" / "bags" / "schema_1.mcap"


@dataclass
class Tally:
    """What came of all cases.

    Attributes:
        cases: how many.
        ends: (kind of change, how a command ended) → how often.
        faults: of each case that failed, in words.
        seconds: of processor time of the slowest case.
        slowest: number of that case.
        memory: bytes of the largest case beyond what the process had.
    """

    cases: int = 0
    ends: Counter[tuple[str, str]] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    seconds: float = 0.0
    slowest: int = 0
    memory: int = 0


class Attack:
    """The whole bags, what commands make of them, and case after case of changed ones."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        small = write_small_run(folder / "whole" / "victim.mcap")
        warm_up(small, folder / "warm")
        self._bags: list[tuple[Anatomy, tuple[str, ...], Case]] = []
        bags = (
            (taken_apart(small), COMMANDS),
            (as_our_writer_counts(taken_apart(EVERY_TOPIC)), QUICK),
            (as_older_recorders_wrote(taken_apart(small)), SLOW),
        )
        for anatomy, commands in bags:
            again = folder / "victim.mcap"
            again.write_bytes(anatomy.encoded())
            whole = examined(again, folder / "out", commands)
            if whole.fault:
                raise RuntimeError(f"a bag that nobody has changed: {whole.fault}")
            self._bags.append((anatomy, commands, whole))

    def run(self, seed: int, number: int, tally: Tally) -> None:
        """Make a case, examine it and count what came of it."""
        chance = random.Random(f"{seed}/{number}")
        anatomy, commands, whole = chance.choices(self._bags, weights=(7, 2, 3))[0]
        bag = copy.deepcopy(anatomy)
        structure = chance.random() < 0.5
        changes = [chance.choice(STRUCTURE if structure else CONTENT)]
        if structure:
            bag.lies.statistics = None if chance.random() < 0.5 else bag.counted()
        elif chance.random() < 0.3:
            changes.append(chance.choice(STRUCTURE + CONTENT))
        name = f"seed {seed} case {number} ({', '.join(c.__name__ for c in changes)})"
        path = self._folder / "victim.mcap"
        try:
            for change in changes:
                change(chance, bag)
        except (LookupError, ValueError, StopIteration):
            return  # nothing is left to be changed by the second change
        path.write_bytes(bag.encoded())
        slow = [one for one in commands if one in SLOW]
        quick = [one for one in commands if one in QUICK]
        chosen = (*quick, *(chance.sample(slow, 1) if slow else ()))
        case = examined(path, self._folder / "out", chosen)
        fault = case.fault or (differences(case, whole) if structure else "")
        self._count(number, case, "structure" if structure else "content", tally)
        if fault:
            tally.faults.append(f"{name}: {fault}")

    def _count(self, number: int, case: Case, kind: str, tally: Tally) -> None:
        tally.cases += 1
        if case.seconds > tally.seconds:
            tally.seconds, tally.slowest = case.seconds, number
        tally.memory = max(tally.memory, case.memory)
        for outcome in case.outcomes.values():
            if outcome.fault:
                end = "failed"
            elif outcome.code:
                end = "refused"
            else:
                end = "said" if outcome.words else "not said"
            tally.ends[kind, end] += 1


def main() -> int:
    """Run the attack; see the module."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=2000, help="how many (default: 2000)")
    parser.add_argument("--seed", type=int, default=1, help="of all of them (default: 1)")
    parser.add_argument("--only", type=int, help="this case alone")
    arguments = parser.parse_args()
    tally, begin = Tally(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "whole").mkdir()
        attack = Attack(Path(folder))
        numbers = range(arguments.cases) if arguments.only is None else (arguments.only,)
        # Ctrl-C ends it early, with what was found until then.
        with contextlib.suppress(KeyboardInterrupt):
            for number in numbers:
                found = len(tally.faults)
                attack.run(arguments.seed, number, tally)
                for fault in tally.faults[found:]:
                    print(fault, flush=True)
    print(
        f"{tally.cases} cases in {time.monotonic() - begin:.0f} s, {len(tally.faults)} failed; "
        f"slowest {tally.seconds:.1f} s of processor (case {tally.slowest}), "
        f"most memory {tally.memory / 1e6:.0f} MB"
    )
    for (kind, end), count in sorted(tally.ends.items()):
        print(f"{kind}: {end} {count}")
    return 1 if tally.faults else 0


if __name__ == "__main__":
    sys.exit(main())
