"""The document ``plan``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from msgspec import UNSET, Meta, UnsetType

from stepdiag_ros.schemas.parts import Count, Number, Text, Uncertainty, Words, means, one_of
from stepdiag_ros.schemas.visibility import Visibility


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line of the plan."""

    kind: str
    name: str
    order: Text
    repeat: Count
    direction: Annotated[str, one_of("forward", "backward")]
    offset: Annotated[Sequence[float], Meta(min_length=3, max_length=3), means("m.")]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The plan as it was given."""

    name: str
    origin: Annotated[Sequence[float], Meta(min_length=3, max_length=3), means("m.")]
    step: Annotated[Sequence[float], Meta(min_length=3, max_length=3), means("Of one block, m.")]
    blocks: Count
    feed: Annotated[float, means("m/s.")]
    overrun: Annotated[float, means("m.")]
    one_alignment_per_diagonal: bool
    lines: Sequence[Line]
    measurement: (
        Annotated[
            str,
            one_of("stops", "on_the_fly"),
            means(
                "stops: the machine stays at every stop until it is measured; on_the_fly: each move"
                " is measured while it is made. Documents of earlier versions lack it."
            ),
        ]
        | UnsetType
    ) = UNSET


@dataclass(frozen=True, kw_only=True)
class Assumptions:
    """What the duration takes for granted."""

    linear_alignment: Annotated[float, means("s.")]
    diagonal_alignment: Annotated[float, means("s.")]
    settling: Annotated[float, means("s.")]


@dataclass(frozen=True, kw_only=True)
class LineDuration:
    """How long a line takes."""

    setup: str
    stops: Count
    alignment: Annotated[float, means("s.")]
    positioning: Annotated[float, means("s.")]
    moves: Annotated[float, means("s.")]
    dwells: Annotated[float, means("s.")]


@dataclass(frozen=True, kw_only=True)
class Duration:
    """How long the plan takes."""

    total: Annotated[float, means("s.")]
    running: Annotated[float, means("s.")]
    alignment: Annotated[float, means("s.")]
    stops: Count
    alignments: Count
    assumptions: Assumptions
    lines: Sequence[LineDuration]


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """Standard uncertainties that are expected of a solver."""

    squareness: Annotated[Mapping[str, Uncertainty], means("rad.")]
    straightness: Annotated[Mapping[str, Uncertainty], means("m.")]
    positioning: Annotated[Mapping[str, Uncertainty], means("m.")]
    angular: Annotated[Mapping[str, Uncertainty], means("rad.")]
    volumetric: Annotated[Uncertainty, means("m.")]
    degrees_of_freedom: Count


@dataclass(frozen=True, kw_only=True)
class Expectations:
    """Expected standard uncertainties by solver."""

    least_squares: Annotated[Expectation, means("By the noise of the stops alone.")]
    with_rotations: (
        Annotated[
            Expectation,
            means(
                "As least_squares will print them: also with rotations of the size that is"
                " plausible of the machine, as far as no line shows them, and with the laser's"
                " scale."
            ),
        ]
        | UnsetType
    ) = UNSET
    rigid_body: Annotated[Expectation | None, means("Null if the chain is not known.")]


@dataclass(frozen=True, kw_only=True)
class AxisWithoutLine:
    """An axis whose positioning only step diagonals show."""

    axis: Annotated[str, one_of("X", "Y", "Z")]
    curve: Annotated[str, means("Its positioning, such as E_XX.")]
    standard_uncertainty: Annotated[
        Uncertainty, means("Expected of the curve with rotations, largest over the nodes, m.")
    ]
    standard_uncertainty_with_line: Annotated[
        Uncertainty, means("The same if each of these axes had a linear line, m.")
    ]
    duration_of_line: Annotated[float, means("Alignment included, s.")]


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A plan that would do."""

    lines: Annotated[str, means("In words.")]
    blocks: Count
    passes: Count
    duration: Annotated[float, means("s.")]
    expanded_uncertainty: Annotated[Number, means("95 %, m or rad by the purpose.")]
    expanded_drift: (
        Annotated[
            Number, means("Beside it, by drift at the machine's rate, m or rad; null: not known.")
        ]
        | UnsetType
    ) = UNSET
    limited_by: (
        Annotated[str | None, means("Quantity and cause; null where not known.")] | UnsetType
    ) = UNSET


@dataclass(frozen=True, kw_only=True)
class AssumedRotations:
    """A size of pitch, yaw and roll that nobody has measured, and without which the wish fails."""

    size: Annotated[float, means("Assumed over the measured travel, rad.")]
    usual: Annotated[float, means("Where a machine file says nothing, rad.")]
    quantities: Annotated[Sequence[str], means("Whose wish rests on it.")]
    with_usual: Annotated[
        Number,
        means("Expanded uncertainty (95 %) with the usual size; null where it is not larger."),
    ]
    without: Annotated[
        Number,
        means(
            "Expanded uncertainty (95 %) with all rotations free, by the noise of the stops alone;"
            " null where the lines do not determine it."
        ),
    ]


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """How the plan was chosen."""

    purpose: str
    reason: str
    chosen: Candidate
    alternatives: Sequence[Candidate]
    considered: Count
    not_taken: Words
    assumed_rotations: (
        Annotated[
            AssumedRotations | None,
            means("null: nothing was wished, or the wish is reached without it."),
        ]
        | UnsetType
    ) = UNSET


@dataclass(frozen=True, kw_only=True)
class Document:
    """A test plan: what it costs and what it will determine.

    Printed by `stepdiag plan --json`.
    """

    plan: Plan
    machine: str
    chain: Annotated[str, one_of("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")] | None
    stop_uncertainty: Annotated[
        float, means("Standard uncertainty of a stop, or of a node on the fly, m.")
    ]
    duration: Duration
    expected_standard_uncertainty: Expectations
    visibility: Visibility
    visibility_with_rotations: Visibility | None
    undetermined: (
        Annotated[
            Words,
            means(
                "Names of the error curves (of the nine of positioning and straightness) and of the"
                " squareness errors that the plan's lines do not determine."
            ),
        ]
        | UnsetType
    ) = UNSET
    lines_that_would_tell: (
        Annotated[
            str | None,
            means(
                "Which further lines would determine all of them, in words; null where none is"
                " missing or none was found."
            ),
        ]
        | UnsetType
    ) = UNSET
    axes_without_line: (
        Annotated[
            Sequence[AxisWithoutLine],
            means(
                "Axes along which no linear line runs from the first corner, of a plan with step"
                " diagonals, where such a line would halve U at least."
            ),
        ]
        | UnsetType
    ) = UNSET
    limits: Words
    warnings: Words
    proposal: Annotated[Proposal | None, means("Null if the plan was given.")]
