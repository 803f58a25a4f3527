"""The document ``tracker_figures``."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from stepdiag_ros.schemas.parts import Count, Number, Numbers, Uncertainty, Words, means


@dataclass(frozen=True, kw_only=True)
class Location:
    """The place of the tracker as estimated."""

    position: Annotated[Numbers, means("Of the tracker, m.")]
    start_length: Annotated[Number, means("m.")]
    covariance: Annotated[Sequence[Numbers], means("Of position and start length, m².")]
    linear: Annotated[Numbers, means("Linear estimate, m.")]
    residuals: Annotated[Numbers, means("m.")]
    standardised_residuals: Numbers
    degrees_of_freedom: Count
    chi_squared: Uncertainty
    coverage_factor: Uncertainty
    condition: Number
    dilution: Annotated[Number, means("Of precision.")]
    warnings: Words


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A curve of a figure."""

    label: str
    distance: Annotated[Numbers, means("m.")]
    deviation: Annotated[Numbers, means("m.")]


@dataclass(frozen=True, kw_only=True)
class Document:
    """Figs. 4 and 5 of Chen et al. 2018.

    Printed by `stepdiag tracker figures --json`.
    """

    location_of_figure_5: Location
    shift_of_figure_5: Annotated[Numbers, means("Estimated minus true place, m.")]
    figure_4: Annotated[Sequence[Curve], means("Two curves.")]
    figure_5: Annotated[Sequence[Curve], means("Two curves.")]
