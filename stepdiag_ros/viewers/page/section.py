"""What all sections of the live page share: how one is made, and how numbers get into it."""

import math
from abc import ABC, abstractmethod
from typing import Any, ClassVar

from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.text.numbers import UNKNOWN, plain, with_expanded
from stepdiag_ros.viewers.page.items import RunBegin

_DIGITS = 6
"""Significant digits of a number that is only drawn."""


class PageSection(ABC):
    """A part of the page: folds messages into one small document.

    Its size does not grow with the length of the run, so that neither node nor browser does.
    """

    name: ClassVar[str]
    of_run: ClassVar[bool] = True
    """It is about one run and starts again with the next."""

    def __init__(self) -> None:
        self.begin(None)

    @abstractmethod
    def begin(self, run: RunBegin | None) -> None:
        """Forget all; take up a run, or wait for one (None)."""

    @abstractmethod
    def take(self, item: object) -> bool:
        """Take a message; return whether the document has changed."""

    @abstractmethod
    def document(self) -> dict[str, Any]:
        """Return what the page shows; numbers that are not known are None."""


def drawn(value: float, scale: float = 1.0) -> float | None:
    """Return a number for a drawing, in the unit that is shown; None if it is not known."""
    if not math.isfinite(value):
        return None
    return float(f"{value * scale:.{_DIGITS}g}")


def micrometres(value: float, expanded_uncertainty: float = math.nan) -> str:
    """Write a length in µm, with its expanded uncertainty (95 %) where that is known.

    Args:
        value: m; NaN if not known.
        expanded_uncertainty: m; NaN if not known.
    """
    if not math.isfinite(value):
        return UNKNOWN
    if not math.isfinite(expanded_uncertainty):
        return f"{plain(value * IN_MICRO, 3)} µm"
    return f"{with_expanded(value, expanded_uncertainty, IN_MICRO)} µm"


def measured(value: float, unit: str, decimals: int, scale: float = 1.0) -> str:
    """Write a number to fixed decimals with its unit, or that it is not known."""
    text = plain(value * scale, decimals)
    return text if text == UNKNOWN else f"{text} {unit}"
