"""A figure of a machine as its runs measured it, and what is known of each run beside it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import nan

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Fault, Refusal


@dataclass(frozen=True)
class Series:
    """A figure over time; all arrays have one entry a run.

    Attributes:
        years: when each run was made, years since any date, in order.
        values: of the figure, in its unit.
        uncertainty: standard uncertainty of each value, of what differs from run to run; NaN where
            not known.
        temperature: of the machine, °C; NaN where not known.
        temperature_uncertainty: standard uncertainty of it, K; NaN where not known.
        instruments: name of the instrument of each run. Runs with one name share its error.
        instrument_uncertainty: standard uncertainty of the figure by the error that the runs of an
            instrument share; NaN if not known, 0 if they share nothing.
        systematic: standard uncertainty of each value by what is the same in all runs of one
            layout, such as rotations that no reading shows; NaN or none: nothing.
        layouts: name of the box and lines of each run; none: all have the same.

    Raises:
        ValueError: arrays differ in length, a value or time is not finite, times are not in order,
            or an uncertainty is negative.
    """

    years: Vector
    values: Vector
    uncertainty: Vector
    temperature: Vector
    temperature_uncertainty: Vector
    instruments: Sequence[str]
    instrument_uncertainty: float = nan
    systematic: Vector = field(default_factory=lambda: np.empty(0))
    layouts: Sequence[str] = ()

    def __post_init__(self) -> None:
        if not len(self.systematic):
            object.__setattr__(self, "systematic", np.zeros(len(self)))
        if not self.layouts:
            object.__setattr__(self, "layouts", [""] * len(self))
        arrays = {
            name: np.asarray(getattr(self, name), float)
            for name in (
                "years",
                "values",
                "uncertainty",
                "temperature",
                "temperature_uncertainty",
                "systematic",
            )
        }
        for name, array in arrays.items():
            object.__setattr__(self, name, array)
            if array.shape != (len(self.instruments),):
                raise _refusal(f"{name} has not one entry a run", "mismatch", name)
        for name in ("years", "values"):
            if not np.all(np.isfinite(arrays[name])):
                raise _refusal(f"{name} has an entry that is not finite", "out_of_range", name)
        if len(self.layouts) != len(self):
            raise _refusal("it has not one entry a run", "mismatch", "layouts")
        for name in ("uncertainty", "temperature_uncertainty", "systematic"):
            if np.any(arrays[name] < 0.0):
                raise _refusal(f"{name} has a negative entry", "out_of_range", name)
        if np.any(np.diff(arrays["years"]) < 0.0):
            raise _refusal("the runs are not in the order of their dates", "out_of_order", "years")
        if self.instrument_uncertainty < 0.0:
            raise _refusal("it is negative", "out_of_range", "instrument_uncertainty")

    def __len__(self) -> int:
        return len(self.instruments)

    @property
    def whole_uncertainty(self) -> Vector:
        """Return the standard uncertainty of each value, NaN where not known."""
        whole: Vector = np.hypot(self.uncertainty, np.nan_to_num(self.systematic))
        return whole

    def first(self, runs: int) -> "Series":
        """Return the series as it was after some runs."""
        return Series(
            self.years[:runs],
            self.values[:runs],
            self.uncertainty[:runs],
            self.temperature[:runs],
            self.temperature_uncertainty[:runs],
            self.instruments[:runs],
            self.instrument_uncertainty,
            self.systematic[:runs],
            self.layouts[:runs],
        )


def _refusal(why: str, fault: Fault, about: str) -> Refusal:
    return Refusal(f"a series of a figure: {about}: {why}", fault=fault, about=about)
