"""The document ``changes``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from stepdiag_ros.schemas.origin import Origin
from stepdiag_ros.schemas.parts import (
    Chance,
    Count,
    Number,
    Numbers,
    Uncertainty,
    Words,
    means,
    one_of,
)


@dataclass(frozen=True, kw_only=True)
class Nodes:
    """Nodes that both measurements have."""

    X: Annotated[Sequence[float], means("Of axis X, m.")]
    Y: Annotated[Sequence[float], means("Of axis Y, m.")]
    Z: Annotated[Sequence[float], means("Of axis Z, m.")]


@dataclass(frozen=True, kw_only=True)
class Sources:
    """What the uncertainties hold."""

    words: Annotated[Words, means("What they hold and what is taken as independent.")]
    instrument_before: Annotated[
        str | None, means("Name of the instrument file for the first measurement.")
    ]
    instrument_after: Annotated[str | None, means("Name of the instrument file for the second.")]
    shared: Annotated[
        Words,
        means(
            "Sources that are the same in both measurements, so that they cancel in a difference."
        ),
    ]
    lower_bound: Annotated[
        bool, means("A source that acts is not known: uncertainties are lower bounds.")
    ]


@dataclass(frozen=True, kw_only=True)
class Family:
    """Numbers of one kind."""

    name: Annotated[str, means("Of the kind.")]
    members: Annotated[int, Meta(ge=1), means("How many numbers it has.")]
    probability: Annotated[
        float,
        Meta(ge=0, le=1),
        means("Bound of the probability that chance makes any of them differ as much."),
    ]
    changed: Annotated[
        bool, means("Whether chance does not explain it, although there are many families.")
    ]
    named: Annotated[
        Words,
        means(
            "Members that changed: names of figures or curves, or a curve with the number of its"
            " node, from 0."
        ),
    ]


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """Whether anything has changed, by every number of all tables."""

    probability: Annotated[
        Chance,
        means(
            "Bound of the probability that chance alone makes all this: the smallest p of a family"
            " times the number of families."
        ),
    ]
    families: Annotated[
        Sequence[Family],
        means(
            "Kinds of numbers: all nodes together, single curves, single nodes, and the kinds of"
            " figures."
        ),
    ]


@dataclass(frozen=True, kw_only=True)
class Joint:
    """What all differences together say."""

    chi_squared: Annotated[Uncertainty, means("Of the differences with their covariance.")]
    degrees_of_freedom: Annotated[Count, means("Independent differences in it.")]
    probability: Annotated[
        Chance, means("Of so large a chi squared, or a larger one, where nothing has changed.")
    ]


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One figure of both measurements."""

    name: Annotated[
        str,
        means(
            "For example `positioning E_XX`, `C0Y` (squareness, right-handed rotation), `mean"
            " reversal X`, `volume, rms`."
        ),
    ]
    unit: Annotated[str, one_of("m", "rad"), means("Of all values but E_n.")]
    before: Annotated[Number, means("Of the first measurement, in the unit.")]
    before_standard_uncertainty: Annotated[
        Uncertainty, means("Standard uncertainty (k = 1) of the same, in the unit.")
    ]
    after: Annotated[Number, means("Of the second measurement, in the unit.")]
    after_standard_uncertainty: Annotated[
        Uncertainty, means("Standard uncertainty (k = 1) of the same, in the unit.")
    ]
    difference: Annotated[Number, means("After minus before, in the unit.")]
    difference_standard_uncertainty: Annotated[
        Uncertainty,
        means(
            "Standard uncertainty (k = 1) of the difference, without what both measurements share,"
            " in the unit."
        ),
    ]
    normalised_error: Annotated[
        Number, means("E_n (ISO 13528): the difference by its expanded uncertainty, k = 2.")
    ]
    probability: Annotated[Chance, means("That chance alone makes as large a difference.")]
    changed: Annotated[
        bool | None,
        means(
            "Whether chance does not explain the difference, although there are many figures"
            " (Holm); null where that is undetermined."
        ),
    ]


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where the error vector changed most."""

    position: Annotated[Numbers, means("Machine coordinates X, Y, Z, m.")]
    before: Annotated[Numbers, means("Error vector X, Y, Z of the first measurement, m.")]
    after: Annotated[Numbers, means("Error vector X, Y, Z of the second measurement, m.")]
    difference_standard_uncertainty: Annotated[
        Numbers, means("Standard uncertainties (k = 1) of X, Y, Z of after minus before, m.")
    ]
    length: Annotated[Uncertainty, means("Of after minus before, m.")]
    length_standard_uncertainty: Annotated[
        Uncertainty, means("Standard uncertainty (k = 1) of that length, m.")
    ]


@dataclass(frozen=True, kw_only=True)
class Volume:
    """The error vectors in the volume."""

    rms: Annotated[Figure, means("Rms of their lengths over the nodes.")]
    worst: Annotated[Figure, means("Length of the longest (volumetric accuracy).")]
    worst_place_before: Annotated[
        Numbers, means("Machine coordinates X, Y, Z of the longest error vector, m.")
    ]
    worst_place_after: Annotated[
        Numbers, means("Machine coordinates X, Y, Z of the longest error vector, m.")
    ]
    rms_standard_uncertainty_before: Annotated[
        Uncertainty,
        means(
            "Rms over the volume of the standard uncertainty (k = 1) of the first measurement's"
            " error vectors, m."
        ),
    ]
    rms_standard_uncertainty_after: Annotated[
        Uncertainty, means("The same of the second measurement, m.")
    ]
    moved_most: Annotated[
        Annotated[Place, means("The place.")] | None,
        means("Where the error vector changed most; null where the volume is not known."),
    ]


@dataclass(frozen=True, kw_only=True)
class Curve:
    """One error curve of both measurements."""

    unit: Annotated[str, one_of("m", "rad"), means("Of all values but positions and E_n.")]
    positions: Annotated[
        Numbers, means("Machine coordinates of the moving axis at the common nodes, m.")
    ]
    before: Annotated[Numbers, means("Of the first measurement, in the unit.")]
    before_standard_uncertainty: Annotated[
        Numbers,
        means("Standard uncertainties (k = 1), in the unit; 0 where the frame fixes the value."),
    ]
    after: Annotated[Numbers, means("Of the second measurement, in the unit.")]
    after_standard_uncertainty: Annotated[
        Numbers,
        means("Standard uncertainties (k = 1), in the unit; 0 where the frame fixes the value."),
    ]
    difference: Annotated[Numbers, means("After minus before, in the unit.")]
    difference_standard_uncertainty: Annotated[
        Numbers,
        means(
            "Standard uncertainties (k = 1) of the differences, without what both measurements"
            " share, in the unit."
        ),
    ]
    normalised_error: Annotated[
        Numbers,
        means(
            "E_n at each node (ISO 13528, k = 2); null where the frame fixes the value, or its"
            " uncertainty is not known."
        ),
    ]
    joint: Joint
    changed: Annotated[
        bool | None,
        means(
            "Whether chance does not explain its change, or that of one of its nodes, although"
            " there are many (Holm); null where that is undetermined."
        ),
    ]


@dataclass(frozen=True, kw_only=True)
class Document:
    """What changed between two measurements of a machine.

    Printed by `stepdiag changes --json`.
    """

    before: Annotated[Origin, means("The first measurement.")]
    after: Annotated[Origin, means("The second measurement.")]
    verdict: Annotated[
        str,
        one_of("better", "worse", "same", "other", "unknown"),
        means(
            "Of the volume: better, worse, same (no change beyond the uncertainty of these"
            " measurements), other (changed, but neither better nor worse), unknown."
        ),
    ]
    words: Annotated[Words, means("What changed, in sentences.")]
    meaning: Annotated[Words, means("Of figures, E_n and p, in words.")]
    frame: Annotated[str, means("Of the error curves of both, in words.")]
    chain: Annotated[str | None, means("Order of the machine's axes from workpiece to tool.")]
    nodes: Annotated[Nodes, means("Machine coordinates of the common nodes, m.")]
    uncertainty: Annotated[Sources, means("What the uncertainties hold.")]
    judgement: Annotated[
        Judgement,
        means(
            "Whether anything has changed, by every number of all tables: p of a family is the"
            " smallest of its members times their number; families are named by Holm's method at 5"
            " %."
        ),
    ]
    joint: Annotated[Joint, means("Of all nodes of all curves together.")]
    volume: Annotated[
        Volume, means("The error vectors in the volume, counted from its first corner.")
    ]
    figures: Annotated[Sequence[Figure], means("The same figures of both.")]
    curves: Annotated[
        Mapping[Annotated[str, Meta(pattern=r"^E_[XYZABC][XYZ]$")], Curve],
        means("ISO 230-1 name of each curve that both measurements have."),
    ]
    remarks: Annotated[Words, means("What a reader must know beside.")]
