"""The document ``volumetric``."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from stepdiag_ros.schemas.parts import Number, Numbers, Text, Uncertainty, Words, means


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """Volumetric accuracy by one method."""

    value: Annotated[Uncertainty, means("Largest error vector in the volume, m.")]
    standard_uncertainty: Annotated[Uncertainty, means("k = 1, m.")]
    position: Annotated[Numbers, means("Where it is, machine coordinates, m.")]
    vector: Annotated[Numbers, means("The error there, m.")]
    frame: str
    remarks: Words


@dataclass(frozen=True, kw_only=True)
class Example:
    """A machine of RL."""

    linear_error: Annotated[Numbers, means("Of X, Y, Z, m.")]
    E_d: Annotated[Number, means("What the diagonals give, m.")]
    volumetric_accuracy: Annotated[Number, means("m.")]


@dataclass(frozen=True, kw_only=True)
class Document:
    """Volumetric accuracy.

    Printed by `stepdiag volumetric --json`.
    """

    source: Text
    run_id: Text
    definition: Annotated[str, means("Of the volumetric accuracy, in words.")]
    methods: Mapping[str, Accuracy]
    examples: Annotated[
        Mapping[str, Example], means("Machines of RL: why diagonals alone do not determine it.")
    ]
