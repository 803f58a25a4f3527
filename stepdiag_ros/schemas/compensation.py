"""The document ``compensation``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from stepdiag_ros.schemas.origin import Origin
from stepdiag_ros.schemas.parts import Count, Uncertainty, Words, means, one_of


@dataclass(frozen=True, kw_only=True)
class File:
    """A table that was written."""

    name: Annotated[str, means("Of the file.")]
    sha256: Annotated[str, Meta(pattern=r"^[0-9a-f]{64}$"), means("Of the file.")]


@dataclass(frozen=True, kw_only=True)
class Change:
    """A figure before and after."""

    name: Annotated[
        str,
        means(
            "For example `positioning E_XX` (peak to peak over the travel, both directions),"
            " `squareness C0Y`, `volume, rms`."
        ),
    ]
    unit: Annotated[str, one_of("m", "rad"), means("Of both values.")]
    before: Annotated[Uncertainty, means("Without the tables, in the unit.")]
    after: Annotated[Uncertainty, means("With the tables, in the unit.")]
    corrected: Annotated[bool, means("Whether the control has a table for it.")]


@dataclass(frozen=True, kw_only=True)
class Document:
    """Compensation tables and what they leave.

    Printed by `stepdiag compensate --json`, and written beside the tables.
    """

    control: Annotated[str, means("Name of the control, as `--for` takes it.")]
    title: Annotated[str, means("Of the control, in words.")]
    format_source: Annotated[
        str, means("Public documents that the format of the tables was taken from.")
    ]
    origin: Annotated[Origin, means("Where the errors come from.")]
    settings: Annotated[
        Mapping[str, str | float],
        means(
            "Settings of the control that the tables were made with, by their names; units as"
            " `stepdiag compensate --help` says."
        ),
    ]
    spacing: Annotated[
        Annotated[float, Meta(gt=0)] | None,
        means("Of the entries that was asked for, m; null: as the control and the nodes suggest."),
    ]
    reference: Annotated[
        Sequence[float],
        Meta(min_length=3, max_length=3),
        means("X, Y, Z where the corrections are zero, m."),
    ]
    on_top_of: Annotated[
        str | None,
        means(
            "Folder of the tables that were at work in the run and are contained in these; null:"
            " none."
        ),
    ]
    files: Annotated[
        Sequence[Annotated[File, means("One file.")]], means("Tables that were written.")
    ]
    corrects: Annotated[Words, means("Errors that the tables correct, by their ISO 230-1 names.")]
    uncorrected: Annotated[Words, means("What the control cannot correct, in words and numbers.")]
    says: Annotated[Words, means("What the user must know, in words.")]
    remarks: Annotated[Words, means("About the result that the tables were made from, in words.")]
    places: Annotated[Count, means("Places of the volume that were looked at.")]
    places_known: Annotated[Count, means("Of these, the ones whose error is known.")]
    rms_standard_uncertainty: Annotated[
        Uncertainty,
        means(
            "Rms over the volume of the standard uncertainty (k = 1) of the error vectors, m; no"
            " compensation can be better."
        ),
    ]
    changes: Annotated[
        Sequence[Annotated[Change, means("One figure.")]],
        means(
            "Figures before and after, computed from the tables as written, both directions of"
            " approach."
        ),
    ]
