"""The document ``comparison``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from msgspec import UNSET, UnsetType

from stepdiag_ros.schemas.parts import Count, Number, Numbers, Text, Uncertainty, means, one_of


@dataclass(frozen=True, kw_only=True)
class Value:
    """An error with its uncertainty."""

    value: Annotated[
        Number, means("m over the travel, for squareness too: the definition of Table 1.")
    ]
    standard_uncertainty: Annotated[Uncertainty, means("k = 1, same unit.")]


@dataclass(frozen=True, kw_only=True)
class Angles:
    """Angle in one sign definition."""

    measured: Annotated[Number, means("rad.")]
    estimated: Annotated[Mapping[str, Number], means("Method to angle, rad.")]


@dataclass(frozen=True, kw_only=True)
class Row:
    """A row of Table 1."""

    label: Annotated[str, means("As printed.")]
    name: Annotated[str, means("ISO 230-1.")]
    travel: Annotated[float, means("m.")]
    measured: Annotated[Value | None, means("Null if not directly measured.")]
    estimated: Annotated[Mapping[str, Value], means("Method to its value.")]
    by_definition_rad: (
        Annotated[Mapping[str, Angles], means("Squareness only: sign definition to angles.")]
        | UnsetType
    ) = UNSET


@dataclass(frozen=True, kw_only=True)
class SetupError:
    """How a diagonal was set up, by its blocks."""

    displacement_per_block: Annotated[Numbers, means("δR of the moves along X, Y, Z, m.")]
    displacement_uncertainty: Annotated[Numbers, means("Standard, m.")]
    angles: Annotated[Numbers, means("Of the effective direction, rad.")]
    angle_uncertainty: Annotated[Numbers, means("Standard, rad.")]
    setups: Annotated[Count, means("Alignments that this is the mean of.")]


@dataclass(frozen=True, kw_only=True)
class Sensitivity:
    """How much a conventional result errs with the setups."""

    gain: Annotated[float, means("‖a‖/(2a_j).")]
    by_diagonal_m_per_rad: Mapping[str, float]
    worst_m_per_rad: Annotated[float, means("Both diagonals tilted in their worst directions.")]


@dataclass(frozen=True, kw_only=True)
class AngleUncertainty:
    """What the displacements' uncertainty does to an angle."""

    worst_per_block: Annotated[float, means("rad.")]
    standard_per_block: Annotated[float, means("rad.")]
    worst_over_travel: Annotated[float, means("rad.")]
    standard_over_travel: Annotated[float, means("rad.")]


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Spread of a curve over the repeats, at the nodes."""

    mean: Annotated[Numbers, means("m or rad.")]
    low: Numbers
    high: Numbers
    standard_deviation: Numbers


@dataclass(frozen=True, kw_only=True)
class Curve:
    """An identified curve beside the directly measured one."""

    unit: Annotated[str, one_of("m", "rad")]
    reference: Annotated[str, means("How both curves are brought to one frame.")]
    positions: Annotated[Numbers, means("Of the moving axis, m.")]
    identified: Annotated[Numbers, means("By the step diagonals, in the unit.")]
    identified_uncertainty: Annotated[Numbers, means("Expanded.")]
    direct: Annotated[Numbers, means("Directly measured.")]
    direct_uncertainty: Annotated[Numbers, means("Expanded.")]
    difference: Annotated[Numbers, means("Identified minus direct.")]
    normalised_error: Annotated[Numbers, means("E_n (ISO 13528).")]


@dataclass(frozen=True, kw_only=True)
class Angle:
    """An identified squareness beside the directly measured one."""

    identified: Annotated[Number, means("rad.")]
    identified_uncertainty: Annotated[Number, means("Expanded, rad.")]
    direct: Annotated[Number, means("rad.")]
    direct_uncertainty: Annotated[Number, means("Expanded, rad.")]
    difference: Annotated[Number, means("rad.")]
    normalised_error: Annotated[Number, means("E_n.")]


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One method beside what was directly measured."""

    method: str
    coverage_factor: float
    curves: Mapping[str, Curve]
    squareness: Mapping[str, Angle]
    not_compared: Annotated[Mapping[str, str], means("What could not be compared, and why.")]


@dataclass(frozen=True, kw_only=True)
class Document:
    """Evaluation as in Ibaraki & Hata 2010, beside directly measured errors.

    Printed by `stepdiag compare --json`, written as table_1.json.
    """

    run_id: Text
    squareness_definitions: Annotated[
        Mapping[str, str], means("Name of each sign definition to its words.")
    ]
    table_1: Sequence[Row]
    setup_errors: Annotated[Mapping[str, SetupError], means("By diagonal.")]
    conventional_sensitivity: Annotated[
        Mapping[str, Sensitivity],
        means("Curve to how much the conventional result errs with the setups."),
    ]
    displacement_uncertainty: Annotated[
        Uncertainty, means("Standard, of the difference of two stops, m.")
    ]
    angle_uncertainty: Annotated[
        Mapping[str, AngleUncertainty],
        means("Angle to what the displacements' uncertainty does to it (IH eq. 29)."),
    ]
    repeats: Annotated[
        Mapping[
            str,
            Annotated[
                Mapping[str, Spread], means("Curve to its spread over the repeats, at the nodes.")
            ],
        ],
        means("By method; empty with few repeats."),
    ]
    comparisons: Sequence[Comparison]
