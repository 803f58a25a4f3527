"""Accuracy and repeatability of positioning of an axis: ISO 230-2.

With x_ij the positional deviations (m targets i, n runs j), ↑ and ↓ the directions of approach:

    mean x̄_i↑, x̄_i↓, x̄_i = (x̄_i↑ + x̄_i↓)/2;  reversal B_i = x̄_i↑ - x̄_i↓, B = max |B_i|, mean
    B estimator of repeatability s_i↑, s_i↓ = √(Σ (x_ij - x̄_i)² / (n - 1)) R_i↑ = 4 s_i↑;  R_i =
    max(2 s_i↑ + 2 s_i↓ + |B_i|; R_i↑; R_i↓);  R↑ = max R_i↑, R = max R_i E↑ = max x̄_i↑ - min
    x̄_i↑;  E = max(x̄_i↑; x̄_i↓) - min(x̄_i↑; x̄_i↓);  M = max x̄_i - min x̄_i A↑ = max(x̄_i↑ + 2
    s_i↑) - min(x̄_i↑ - 2 s_i↑);  A the same over both directions

s from a single run is not known, and neither is anything that is made of it; without runs in both
directions, what compares them is not known.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.standards.axis_test import BidirectionalRuns, is_diagonal
from stepdiag_ros.metrology.standards.positioning_uncertainty import (
    UncertaintyDescription,
    expanded_uncertainties,
)

RUNS_OF_THE_STANDARD = 5
TARGETS_OF_THE_STANDARD = 5
"""At least as many targets a metre, and five in all, up to 2 m (ISO 230-2)."""

PARAMETERS = ("A", "A↑", "A↓", "R", "R↑", "R↓", "E", "E↑", "E↓", "M", "B", "mean B")
"""In the order in which they are shown."""


@dataclass(frozen=True)
class PositioningTest:
    """What one test says; all values in m, NaN where not known.

    Attributes:
        name: axis (X, Y, Z) or diagonal.
        kind: of the line, see ``BidirectionalRuns``.
        setup: identity of alignment and zero.
        target: positions of the targets, m, shape (m,).
        runs: number of runs forward and backward.
        mean_forward: x̄_i↑, shape (m,).
        mean_backward: x̄_i↓, shape (m,).
        deviation_forward: s_i↑, the estimator of unidirectional repeatability, shape (m,).
        deviation_backward: s_i↓, shape (m,).
        parameters: by name, see ``PARAMETERS``.
        expanded_uncertainty: U (k = 2) by the same names.
        remarks: what the reader must know, in words.
    """

    name: str
    kind: str
    setup: str
    target: Vector
    runs: tuple[int, int]
    mean_forward: Vector
    mean_backward: Vector
    deviation_forward: Vector
    deviation_backward: Vector
    parameters: dict[str, float]
    expanded_uncertainty: dict[str, float]
    remarks: tuple[str, ...] = ()

    @property
    def standard(self) -> str:
        """Return the standard that the test belongs to."""
        return "ISO 230-6" if is_diagonal(self.kind) else "ISO 230-2"

    @property
    def label(self) -> str:
        """Return what the test is called beside others: its setup where that says more."""
        return self.name if self.setup.lower() in ("", self.name.lower()) else self.setup

    @property
    def mean(self) -> Vector:
        """Return x̄_i: mean bidirectional deviations, m, shape (m,)."""
        made: Vector = 0.5 * (self.mean_forward + self.mean_backward)
        return made

    @property
    def reversal(self) -> Vector:
        """Return B_i = x̄_i↑ - x̄_i↓, m, shape (m,)."""
        made: Vector = self.mean_forward - self.mean_backward
        return made

    @property
    def repeatability(self) -> Vector:
        """Return R_i, the bidirectional repeatability of positioning at each target, m, (m,)."""
        return _repeatability(self.deviation_forward, self.deviation_backward, self.reversal)


def _mean(runs: Vector) -> Vector:
    made: Vector = runs.mean(axis=0) if len(runs) else np.full(runs.shape[1], np.nan)
    return made


def _deviation(runs: Vector) -> Vector:
    made: Vector = runs.std(axis=0, ddof=1) if len(runs) > 1 else np.full(runs.shape[1], np.nan)
    return made


def _repeatability(forward: Vector, backward: Vector, reversal: Vector) -> Vector:
    both = 2.0 * forward + 2.0 * backward + np.abs(reversal)
    made: Vector = np.maximum(both, 4.0 * np.maximum(forward, backward))
    return made


def _span(high: Vector, low: Vector) -> float:
    # max and min of numpy hand NaN on: what contains something unknown is unknown.
    return float(np.max(high) - np.min(low))


def evaluate(
    runs: BidirectionalRuns, description: UncertaintyDescription | None = None
) -> PositioningTest:
    """Evaluate a test of positioning (ISO 230-2); see the module.

    Args:
        runs: deviations of one line.
        description: of the measuring conditions; without one every U is unknown.

    Returns:
        the parameters with their expanded uncertainty.
    """
    up, down = _mean(runs.forward), _mean(runs.backward)
    s_up, s_down = _deviation(runs.forward), _deviation(runs.backward)
    counts = (len(runs.forward), len(runs.backward))
    reversal = up - down
    mean = 0.5 * (up + down)
    highest = np.maximum(up + 2 * s_up, down + 2 * s_down)
    lowest = np.minimum(up - 2 * s_up, down - 2 * s_down)
    parameters = {
        "A": _span(highest, lowest),
        "A↑": _span(up + 2 * s_up, up - 2 * s_up),
        "A↓": _span(down + 2 * s_down, down - 2 * s_down),
        "R": float(np.max(_repeatability(s_up, s_down, reversal))),
        "R↑": float(np.max(4.0 * s_up)),
        "R↓": float(np.max(4.0 * s_down)),
        "E": _span(np.maximum(up, down), np.minimum(up, down)),
        "E↑": _span(up, up),
        "E↓": _span(down, down),
        "M": _span(mean, mean),
        "B": float(np.max(np.abs(reversal))),
        "mean B": float(np.mean(reversal)),
    }
    # The fewer runs decide: the other direction is known better than U says.
    fewest = min(count for count in counts if count)
    uncertainty = expanded_uncertainties(
        description or UncertaintyDescription(), runs.length, fewest
    )
    return PositioningTest(
        name=runs.name,
        kind=runs.kind,
        setup=runs.setup,
        target=runs.target,
        runs=counts,
        mean_forward=up,
        mean_backward=down,
        deviation_forward=s_up,
        deviation_backward=s_down,
        parameters=parameters,
        expanded_uncertainty={
            name: uncertainty[name] if np.isfinite(parameters[name]) else float("nan")
            for name in PARAMETERS
        },
        remarks=(*runs.remarks, *_departures(runs)),
    )


def _departures(runs: BidirectionalRuns) -> list[str]:
    """Say in which ways the data are not what the standard asks for."""
    said = []
    forward, backward = len(runs.forward), len(runs.backward)
    if not forward or not backward:
        missing = "backward" if forward else "forward"
        said.append(f"there is no {missing} run: reversal and bidirectional figures are unknown")
    elif min(forward, backward) < RUNS_OF_THE_STANDARD:
        said.append(
            f"{forward} forward and {backward} backward runs; the standards ask for"
            f" {RUNS_OF_THE_STANDARD} each"
        )
    if max(forward, backward) == 1:
        said.append("a single run shows no repeatability: s, R and A are unknown")
    if not is_diagonal(runs.kind) and len(runs.target) < TARGETS_OF_THE_STANDARD:
        said.append(
            f"{len(runs.target)} targets; ISO 230-2 asks for at least {TARGETS_OF_THE_STANDARD}"
        )
    return said
