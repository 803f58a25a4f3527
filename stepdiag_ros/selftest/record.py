"""The record of a self-test: every comparison with its limit, and on what it was made."""

import math
import platform
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

from stepdiag_ros import __version__, schemas
from stepdiag_ros.schemas import selftest
from stepdiag_ros.schemas.parts import part_of

PASSED, FAILED = "pass", "FAIL"


@dataclass(frozen=True)
class Check:
    """One comparison with a known answer.

    Attributes:
        what: quantity, and whose answer.
        deviation: the largest one found, in the unit; NaN: there was no number where one was due.
        limit: that it may reach.
        unit: m, rad, … or ``σ``: what a deviation of so many standard deviations would be for a
            normal quantity; or 1 for counts and pure numbers.
        why: why this limit.
    """

    what: str
    deviation: float
    limit: float
    unit: str
    why: str

    @property
    def passed(self) -> bool:
        """Say whether the deviation is a number within the limit."""
        return self.deviation <= self.limit


@dataclass(frozen=True)
class SolvedProblem:
    """A problem and what came of it.

    Attributes:
        number: from 1.
        kind: of problem.
        description: the drawn numbers in short.
        checks: comparisons.
        failure: why there is no answer; empty if there is.
    """

    number: int
    kind: str
    description: str
    checks: tuple[Check, ...]
    failure: str = ""

    @property
    def passed(self) -> bool:
        """Say whether there was an answer and all of it was right."""
        return not self.failure and bool(self.checks) and all(c.passed for c in self.checks)


@dataclass(frozen=True)
class SelftestRecord:
    """A whole self-test.

    Attributes:
        seed: from which all problems are drawn.
        problems: with what came of them.
        platform: name → version or description.
        date: of the test, ISO 8601, UTC.
        seconds: that it took.
        false_alarm: probability that right software fails by chance, at most.
    """

    seed: int
    problems: tuple[SolvedProblem, ...]
    platform: dict[str, str]
    date: str
    seconds: float
    false_alarm: float

    @property
    def passed(self) -> bool:
        """Say whether there was a problem and every one was solved right."""
        return bool(self.problems) and all(problem.passed for problem in self.problems)

    def document(self) -> dict[str, Any]:
        """Return the record as a mapping for JSON; what is not a number is ``null``."""
        content = part_of(
            selftest.Document,
            self,
            seconds=round(self.seconds, 3),
            false_alarm_probability=self.false_alarm,
            problems=[
                part_of(
                    selftest.Problem,
                    problem,
                    failure=problem.failure or None,
                    checks=[part_of(selftest.Check, check) for check in problem.checks],
                )
                for problem in self.problems
            ],
        )
        return schemas.document("selftest", content)

    def json(self) -> str:
        """Return the record as JSON text."""
        return schemas.json_text(self.document())


def now() -> str:
    """Return date and time, ISO 8601, UTC."""
    return datetime.now(timezone.utc).isoformat(timespec="seconds")


def describe_platform() -> dict[str, str]:
    """Return the versions of all that takes part in the numbers."""
    import numpy
    import scipy
    from threadpoolctl import threadpool_info

    libraries = [
        " ".join(
            str(pool[key])
            for key in ("internal_api", "version", "architecture")
            if pool.get(key) is not None
        )
        for pool in threadpool_info()
        if pool.get("user_api") == "blas"
    ]
    return {
        "stepdiag": __version__,
        "Python": f"{platform.python_implementation()} {platform.python_version()}",
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
        "BLAS": ", ".join(dict.fromkeys(libraries)) or "unknown",
        "platform": platform.platform(),
        "machine": platform.machine() or "unknown",
        "floating point": f"{sys.float_info.mant_dig} bit mantissa, {sys.byteorder} endian",
    }


def worst(checks: Sequence[Check]) -> Check | None:
    """Return the check that is nearest to its limit, or beyond it."""

    def share(check: Check) -> float:
        if not math.isfinite(check.deviation):
            return math.inf
        if check.limit <= 0.0:
            return 0.0 if check.deviation <= check.limit else math.inf
        return check.deviation / check.limit

    return max(checks, key=share, default=None)
