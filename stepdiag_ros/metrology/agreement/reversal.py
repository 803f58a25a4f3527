"""The mean reversal error of each axis in both measurements, at targets that determine it in both.

    B̄ = mean over the targets of B_i = x̄_i↑ - x̄_i↓      (ISO 230-2:2014, 3.15 to 3.17)

B_i is only determined by a target that was approached in the sense of the run, from below and from
above. A run that does not begin beyond its end target (no overrun) comes to this from elsewhere,
mostly from the same side as the run before: B_i would be about 0 there, whatever the axis does. So
such ends are left out, of both measurements, since the reversal may differ along the axis.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

import numpy as np

from stepdiag_ros.metrology.agreement.values import REVERSAL, FigureChange
from stepdiag_ros.metrology.geometry import AXES, EDGE, Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD, LINEAR
from stepdiag_ros.metrology.solvers.observations import Integers
from stepdiag_ros.metrology.standards.axis_test import BidirectionalRuns, all_runs


@dataclass(frozen=True)
class ReversedAxis:
    """Runs along an axis, in both directions.

    Attributes:
        runs: in both directions.
        spread: standard uncertainties of the stops, m, one row a run, forward runs first, in the
            order of the targets, shape (runs, targets).
    """

    runs: BidirectionalRuns
    spread: Vector

    @property
    def told(self) -> Vector:
        """Return the targets that determine a reversal error, m."""
        return self.runs.target[self._tell]

    @property
    def errors(self) -> Vector:
        """Return the reversal errors B_i at these targets, m; empty without any."""
        up, down = self.runs.forward.mean(axis=0), self.runs.backward.mean(axis=0)
        made: Vector = (up - down)[self._tell]
        return made

    @property
    def runs_each_way(self) -> int:
        """Return how many runs there are in the sense that has fewer."""
        return min(len(self.runs.forward), len(self.runs.backward))

    @property
    def _tell(self) -> slice:
        return slice(1, -1) if self.runs.ends_in_doubt else slice(None)

    def mean(self, rows: Integers) -> tuple[float, float, float]:
        """Return B̄ at some targets, its standard uncertainty, m, and the degrees of freedom of it.

        The uncertainty is that of the stops, or that of runs that do not repeat where this is
        larger: the spread of the runs' means, pooled over both senses.
        """
        forward, backward = (
            one[:, rows].mean(axis=1) for one in (self.runs.forward, self.runs.backward)
        )
        counts = np.array([len(forward), len(backward)])
        each = np.repeat(1.0 / (counts * len(rows)), counts)
        by_stops = float(np.sum((self.spread[:, rows] * each[:, None]) ** 2))
        freedom = int(np.sum(counts)) - 2
        squares = float(sum(np.sum((one - one.mean()) ** 2) for one in (forward, backward)))
        by_runs = squares / freedom * float(np.sum(1.0 / counts)) if freedom else 0.0
        value = float(forward.mean() - backward.mean())
        if freedom and not by_runs <= by_stops:
            return value, by_runs**0.5, float(freedom)
        return value, by_stops**0.5, inf


def reversals(
    before: Measurement | None, after: Measurement | None
) -> tuple[list[FigureChange], list[str]]:
    """Return the mean reversal errors of the axes that both determine, and remarks on them.

    Args:
        before: the lines of the first; None if they are not at hand.
        after: of the second.
    """
    if before is None or after is None:
        return [], [
            f"{REVERSAL}: not compared, since the lines of both are needed for it (the bags)"
        ]
    first, second = reversed_axes(before), reversed_axes(after)
    made, lacking, shortened, fewer, single = [], [], [], [], []
    for name in (name for name in first if name in second):
        both = first[name], second[name]
        rows = _common(both[0].runs.target, both[1].runs.target, both[0].told, both[1].told)
        if not len(rows[0]):
            lacking.append(name)
            continue
        if any(len(one.told) < len(one.runs.target) for one in both):
            shortened.append(name)
        if len(rows[0]) < max(len(one.told) for one in both):
            fewer.append(name)
        if any(one.runs_each_way == 1 for one in both):
            single.append(name)
        told = [one.mean(row) for one, row in zip(both, rows, strict=True)]
        made.append(
            FigureChange.of(
                f"{REVERSAL} {name}",
                "m",
                (told[0][0], told[1][0]),
                (told[0][1], told[1][1]),
                degrees_of_freedom=(told[0][2], told[1][2]),
            )
        )
    remarks = []
    alone = [name for name in AXES if (name in first) != (name in second)]
    if alone:
        remarks.append(
            f"{REVERSAL} of {', '.join(alone)}: in both directions in one measurement only, not"
            " compared"
        )
    if single:
        remarks.append(
            f"{REVERSAL} of {', '.join(single)}: there is one run each way, so what drifts between"
            " the two is in no U; with repeats it is"
        )
    if shortened:
        remarks.append(
            f"{REVERSAL} of {', '.join(shortened)}: without the end targets, in both. Nothing says"
            f" that {_which(first, second, shortened)} begin beyond them (overrun), so these do"
            " not determine a reversal error ('stepdiag iso230' counts them, and says so)"
        )
    if fewer:
        remarks.append(
            f"{REVERSAL} of {', '.join(fewer)}: at the targets that determine it in both"
        )
    if lacking:
        remarks.append(
            f"{REVERSAL} of {', '.join(lacking)}: not compared, no target determines it in both."
            " Measure with overrun_m, at the same targets"
        )
    return made, remarks


def reversed_axes(measurement: Measurement) -> dict[str, ReversedAxis]:
    """Return the axes that were measured in both directions."""
    found = {}
    for runs in all_runs(measurement):
        if runs.kind != LINEAR or not len(runs.forward) or not len(runs.backward):
            continue
        spread: dict[str, list[Vector]] = {}
        for line in measurement.lines:
            if (line.setup, line.line.kind) == (runs.setup, LINEAR) and line.complete:
                order = slice(None) if line.line.direction == FORWARD else slice(None, None, -1)
                spread.setdefault(line.line.direction, []).append(line.standard_uncertainty[order])
        found[runs.name] = ReversedAxis(runs, np.array([*spread[FORWARD], *spread[BACKWARD]]))
    return found


def _common(
    first: Vector, second: Vector, first_told: Vector, second_told: Vector
) -> tuple[Integers, Integers]:
    """Return the places in both of the targets that determine a reversal error in both."""
    same = np.abs(first[:, None] - second[None, :]) <= EDGE
    told = np.outer(_among(first, first_told), _among(second, second_told)) > 0.0
    rows, columns = np.nonzero(same & told)
    return rows, columns


def _among(targets: Vector, told: Vector) -> Vector:
    """Return 1 for each target that determines it, else 0."""
    near = np.abs(targets[:, None] - told[None, :]) <= EDGE
    made: Vector = np.sum(near, axis=1, dtype=float)
    return made


def _which(
    first: Mapping[str, ReversedAxis], second: Mapping[str, ReversedAxis], names: list[str]
) -> str:
    """Say the runs of which measurement are not known to begin beyond the ends."""
    lack = [any(axes[name].runs.ends_in_doubt for name in names) for axes in (first, second)]
    if all(lack):
        return "the runs"
    return "the runs before" if lack[0] else "the runs after"
