"""The document ``budget``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from msgspec import UNSET, Meta, UnsetType

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
class Source:
    """A source of uncertainty."""

    name: str
    group: Annotated[str, means("Environment, alignment, readings, …")]
    standard_uncertainty: Annotated[Uncertainty, means("In the unit; null if unknown.")]
    unit: str
    evaluation: Annotated[str, means("Type A or B.")]
    distribution: str
    degrees_of_freedom: Annotated[Uncertainty, means("null: infinite.")]
    correlation: Annotated[str, means("Among which readings it is common.")]
    note: Annotated[str, means("Where it comes from.")]


@dataclass(frozen=True, kw_only=True)
class Trial:
    """The check of one quantity by JCGM 101."""

    estimate: Annotated[Number, means("In the unit.")]
    standard_uncertainty: Annotated[Uncertainty, means("In the unit.")]
    interval: Annotated[
        Numbers,
        Meta(min_length=2, max_length=2),
        means("Probabilistically symmetric coverage interval, in the unit."),
    ]
    shortest_interval: Annotated[
        Numbers, Meta(min_length=2, max_length=2), means("Shortest coverage interval, in the unit.")
    ]
    settled: Annotated[bool, means("Stable by JCGM 101, 7.9.")]
    d_low: Annotated[Uncertainty, means("Difference of the lower ends (JCGM 101, 8.1).")]
    d_high: Annotated[Uncertainty, means("Of the upper ends.")]
    tolerance: Annotated[Uncertainty, means("Numerical tolerance δ.")]
    gum_validated: Annotated[bool, means("Both differences are within the tolerance.")]


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A figure of the result with its uncertainty."""

    name: Annotated[str, means("For example `E_XX` or `C0Y`.")]
    unit: Annotated[str, one_of("m", "rad")]
    value: Annotated[Number, means("In the unit.")]
    contributions: Annotated[
        Mapping[str, Number], means("Source to its standard contribution, in the unit.")
    ]
    standard_uncertainty: Annotated[Uncertainty, means("k = 1, in the unit.")]
    lower_bound_only: Annotated[
        bool, means("A source is not known, so that the uncertainty is at least this.")
    ]
    degrees_of_freedom: Annotated[
        Uncertainty, means("Effective, Welch-Satterthwaite; null: infinite.")
    ]
    coverage_factor: Uncertainty
    expanded_uncertainty: Annotated[Uncertainty, means("In the unit.")]
    monte_carlo: (
        Annotated[Trial, means("Check by JCGM 101; absent if it was not asked for.")] | UnsetType
    ) = UNSET


@dataclass(frozen=True, kw_only=True)
class MonteCarlo:
    """The check by JCGM 101."""

    trials: Count
    blocks: Count
    significant_digits: Count
    settled: Annotated[bool, means("All quantities are stable.")]
    gum_validated: Annotated[bool, means("The GUM budget is validated for all quantities.")]


@dataclass(frozen=True, kw_only=True)
class Document:
    """Uncertainty budget by the GUM.

    Printed by `stepdiag budget --json`, written as budget.json.
    """

    run_id: Text
    bag: Text
    method: Annotated[str, means("Of the result that the budget is for.")]
    instrument: Annotated[str, means("Description of the interferometer.")]
    coverage_probability: Annotated[float, Meta(ge=0, le=1)]
    sources: Sequence[Source]
    quantities: Annotated[Sequence[Quantity], means("One entry for every figure of the result.")]
    covariance: Annotated[
        Sequence[Sequence[float]],
        means("Of the quantities in their order, product of their units."),
    ]
    monte_carlo: Annotated[MonteCarlo | None, means("Null if it was not asked for.")]
    remarks: Words
