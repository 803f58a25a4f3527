"""The document ``volumetric_map``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from msgspec import UNSET, Meta, UnsetType

from stepdiag_ros.schemas.origin import Origin
from stepdiag_ros.schemas.parts import Numbers, Words, means, one_of


@dataclass(frozen=True, kw_only=True)
class Nodes:
    """Machine coordinates of the nodes."""

    X: Annotated[Sequence[float], Meta(min_length=2), means("Of axis X, m.")]
    Y: Annotated[Sequence[float], Meta(min_length=2), means("Of axis Y, m.")]
    Z: Annotated[Sequence[float], Meta(min_length=2), means("Of axis Z, m.")]


@dataclass(frozen=True, kw_only=True)
class LearnedPart:
    """A displacement of the tool that depends on places, beside the curves."""

    acts_on: Annotated[str, one_of("X", "Y", "Z"), means("Axis along which the tool is displaced.")]
    shape: Annotated[
        str, means("Product of factors, as the factors of a learned shape (`docs/diagnose.md`).")
    ]
    amplitude: Annotated[float, means("Displacement where the product is 1, m.")]
    box: Annotated[
        Mapping[Annotated[str, one_of("X", "Y", "Z")], Sequence[float]],
        means(
            "Axis to the two machine coordinates, m, between which its factors count from 0 to 1;"
            " axes on which the displacement does not depend are not there."
        ),
    ]


@dataclass(frozen=True, kw_only=True)
class Document:
    """Volumetric error map.

    Written by `stepdiag compensate --for generic`; taken by the parameter `correction` of the
    bridge.
    """

    definition: Annotated[str, means("What an error is and how it is taken off, in words.")]
    origin: Annotated[Origin, means("Where the errors come from.")]
    chain: Annotated[
        Annotated[str, Meta(pattern=r"^[XYZ]{3}$")] | None,
        means("Order of the axes from workpiece to tool, such as YXZ."),
    ]
    frame: Annotated[str, means("Of the curves, in words.")]
    reference_point: Annotated[str, means("What the curves speak of, in words.")]
    nodes: Annotated[
        Nodes,
        means(
            "Machine coordinates of the nodes, m, ascending; the map holds from the first to the"
            " last ones."
        ),
    ]
    curves: Annotated[
        Mapping[Annotated[str, Meta(pattern=r"^E_[XYZABC][XYZ]$")], Numbers],
        means(
            "ISO 230-1 name to errors at the nodes of its axis: m for E_XX to E_ZZ, rad for E_AX to"
            " E_CZ; null where not determined. Linear between nodes."
        ),
    ]
    standard_uncertainty: Annotated[
        Mapping[Annotated[str, Meta(pattern=r"^E_[XYZABC][XYZ]$")], Numbers],
        means(
            "Standard uncertainty (k = 1) of the curves, same names, units and shape; null where"
            " not known."
        ),
    ]
    reversal: Annotated[
        Mapping[Annotated[str, one_of("X", "Y", "Z")], Numbers],
        means(
            "Axis to its reversal error of positioning at the nodes (forward less backward, ISO"
            " 230-2), m; an axis whose reversal is not known is not there."
        ),
    ]
    not_estimated: Annotated[
        Words, means("Rotations that the method did not estimate; they are not in the map.")
    ]
    not_determined: Annotated[Words, means("What the measured lines do not determine, in words.")]
    remarks: Annotated[Words, means("Remarks for the reader, in words.")]
    learned: (
        Annotated[
            Sequence[LearnedPart],
            means(
                "What was learned of the machine and is in no curve; each counts from the first"
                " corner of the box, where the error is zero."
            ),
        ]
        | UnsetType
    ) = UNSET
    learned_covariance: (
        Annotated[
            Sequence[Numbers],
            means(
                "Covariance of the amplitudes of `learned`, m², row by row; null where not known."
            ),
        ]
        | UnsetType
    ) = UNSET
