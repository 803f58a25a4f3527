"""The document ``selftest``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from stepdiag_ros.schemas.parts import Count, Number, Text, means


@dataclass(frozen=True, kw_only=True)
class Check:
    """One comparison with a known answer."""

    what: Annotated[str, means("Quantity, and whose answer.")]
    deviation: Annotated[
        Number, means("Largest found, in the unit; null: no number where one was due.")
    ]
    limit: Annotated[Number, means("It may reach.")]
    unit: Annotated[str, means("m, rad, …, σ for standard deviations, or 1.")]
    why: Annotated[str, means("This limit.")]
    passed: bool


@dataclass(frozen=True, kw_only=True)
class Problem:
    """A problem and what came of it."""

    number: Count
    kind: str
    description: str
    passed: bool
    failure: Annotated[Text, means("Why it could not be solved.")]
    checks: Sequence[Check]


@dataclass(frozen=True, kw_only=True)
class Document:
    """Record of a self-test.

    Printed by `stepdiag selftest --json`.
    """

    passed: Annotated[bool, means("Every problem was solved right.")]
    date: Annotated[str, means("ISO 8601.")]
    seed: Count
    seconds: Annotated[float, Meta(ge=0), means("s.")]
    false_alarm_probability: Annotated[
        float, Meta(ge=0, le=1), means("Of the whole, with right software.")
    ]
    platform: Annotated[
        Mapping[str, str], means("On what it was made: name to version or description.")
    ]
    problems: Sequence[Problem]
