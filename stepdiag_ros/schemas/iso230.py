"""The document ``iso230``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from stepdiag_ros.schemas.parts import (
    Count,
    Number,
    Numbers,
    Text,
    Uncertainty,
    Words,
    means,
    one_of,
)


@dataclass(frozen=True, kw_only=True)
class Runs:
    """Numbers of runs."""

    forward: Count
    backward: Count


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A parameter of the standard."""

    value: Annotated[Number, means("m.")]
    expanded_uncertainty: Annotated[Uncertainty, means("k = 2, m.")]


@dataclass(frozen=True, kw_only=True)
class Published:
    """A published figure to compare with."""

    value: Annotated[Number, means("m.")]
    agrees: Annotated[bool | None, means("To every digit that was published.")]


@dataclass(frozen=True, kw_only=True)
class Test:
    """The test of one axis or diagonal."""

    standard: Annotated[str, one_of("ISO 230-2", "ISO 230-6")]
    name: Annotated[str, means("Axis or diagonal.")]
    kind: Annotated[str, means("Of the line.")]
    setup: Annotated[str, means("Alignment that it was measured in.")]
    runs: Runs
    target: Annotated[Numbers, means("Target positions along the line, m.")]
    mean_forward: Annotated[Numbers, means("Mean deviation in forward direction, m.")]
    mean_backward: Annotated[Numbers, means("In backward direction, m.")]
    reversal: Annotated[Numbers, means("Reversal error at each target, m.")]
    s_forward: Annotated[Numbers, means("Standard deviation, m.")]
    s_backward: Annotated[Numbers, means("Standard deviation, m.")]
    repeatability: Annotated[Numbers, means("Bidirectional, at each target, m.")]
    parameters: Annotated[
        Mapping[str, Parameter], means("Parameter of the standard (A, E, M, R, B, …) to its value.")
    ]
    published: Annotated[
        Mapping[str, Published] | None, means("Figures to compare with; null if none were given.")
    ]
    equals_recorded: Annotated[
        bool | None,
        means(
            "Whether the result is bit-identical to the one in the bag; null if the bag has none."
        ),
    ]
    remarks: Words


@dataclass(frozen=True, kw_only=True)
class Label:
    """A diagonal with its label."""

    label: Annotated[str, means("D1 …")]
    diagonal: str
    setup: str


@dataclass(frozen=True, kw_only=True)
class Diagonals:
    """The figures of a group of diagonals."""

    place: Annotated[str, means("Body diagonals, or the face.")]
    E_d: Annotated[Number, means("Systematic deviation of the diagonals, m.")]
    B_d: Annotated[Number, means("Reversal value, m.")]
    expanded_uncertainty_E_d: Annotated[Uncertainty, means("m.")]  # noqa: N815
    expanded_uncertainty_B_d: Annotated[Uncertainty, means("m.")]  # noqa: N815
    tests: Sequence[Label]
    remarks: Words


@dataclass(frozen=True, kw_only=True)
class Document:
    """Tests of positioning by ISO 230-2 and ISO 230-6.

    Printed by `stepdiag iso230 --json`, written as iso230.json.
    """

    source: Annotated[str, means("File.")]
    run_id: Text
    coverage_factor: Annotated[float, means("Of the expanded uncertainties.")]
    tests: Sequence[Test]
    diagonals: Sequence[Diagonals]
    uncertainty_not_known: Annotated[Words, means("What keeps an uncertainty from being known.")]
    warnings: Words
