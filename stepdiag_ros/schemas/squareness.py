"""The document ``squareness``."""

from dataclasses import dataclass
from typing import Annotated

from stepdiag_ros.metrology.geometry import SQUARENESS
from stepdiag_ros.schemas.parts import Number, Uncertainty, Words, means, one_of


@dataclass(frozen=True, kw_only=True)
class Angle:
    """Squareness of one pair of axes."""

    name: Annotated[str, one_of(*SQUARENESS)]
    diagonals: Words
    rotation: Annotated[Number, means("Right-handed rotation, rad.")]
    angle: Annotated[Number, means("Positive where the angle is larger than 90°, rad.")]
    theta: Annotated[Number, means("As RL defines it, rad.")]
    standard_uncertainty: Annotated[Uncertainty, means("k = 1, rad.")]


@dataclass(frozen=True, kw_only=True)
class Document:
    """Squareness from diagonals.

    Printed by `stepdiag squareness --json`.
    """

    source: str
    sign_definitions: Annotated[
        dict[str, dict[str, Annotated[float, one_of(-1, 1)]]],
        means(
            "Name of each sign definition to the factor of each squareness from the right-handed"
            " rotation."
        ),
    ]
    squareness: tuple[Angle, ...]
    mean_length_error: Annotated[Number, means("Common to the diagonals, relative.")]
    mean_length_standard_uncertainty: Uncertainty
    closure: Annotated[Number, means("Disagreement of four body diagonals, m.")]
    closure_standard_uncertainty: Annotated[Uncertainty, means("m.")]
    remarks: Words
    warnings: Words
