"""Where errors come from, as a part of several documents."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from msgspec import UNSET, Meta, UnsetType

from stepdiag_ros.schemas.parts import means


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Which measurement errors come from, and what made it."""

    file: Annotated[str | None, means("Name of the bag or document.")]
    sha256: Annotated[
        Annotated[str, Meta(pattern=r"^[0-9a-f]{64}$")] | None, means("Of that file.")
    ]
    run_id: Annotated[str | None, means("Identity of the run.")]
    run_time: Annotated[str | None, means("When the run began, ISO 8601, UTC.")]
    plan: Annotated[str | None, means("Name of the test plan.")]
    machine: Annotated[str | None, means("Name of the machine.")]
    method: Annotated[str | None, means("Of the solver.")]
    software_version: Annotated[str | None, means("Of stepdiag_ros that made the run.")]
    verdict: (
        Annotated[
            str | None,
            means(
                "Of the diagnosis of the run, with the effects that act; null or absent if not"
                " known."
            ),
        ]
        | UnsetType
    ) = UNSET
    despite_verdict: (
        Annotated[
            str | None,
            means(
                "The verdict that the user has overruled with --despite-verdict; null or absent if"
                " none was."
            ),
        ]
        | UnsetType
    ) = UNSET


def origin_of(stated: Mapping[str, str]) -> Origin:
    """Return an origin from its texts; what is empty is not known."""
    return Origin(**{name: text or None for name, text in stated.items()})
