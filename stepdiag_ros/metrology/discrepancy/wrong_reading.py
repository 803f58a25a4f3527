"""A few wrong readings: a slip of the pen, a reading taken too early, a beam touched at one stop.

None is an effect of the machine, and whatever effects imitate it are false. So they are looked for
before effects, one after another: a reading whose own error stands out by far from all that is left
of the run, beside rotations and zeros that scatter as is plausible. If the rest of the run agrees
with the model, or has effects of the catalogue, these readings are wrong; if they stand out by
thirty standard deviations, they are wrong whatever the rest shows. Another pass must have
read the same stop, so that a machine that is off at one place is not mistaken for a wrong reading.
Neighbours in a pass are not suspected: what acts on several stops in a row is an effect.

Several wrong readings hide each other: each is compared with a rest that holds the others, and what
forward and backward passes differ by is no longer the noise. They are then taken off one after
another, and count if without them the noise is a fraction. Some effects act on single stops, too,
such as a creep on the first after each reversal. So effects come first where more than a few
readings stand out and the noise stays, and readings only where nothing else serves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.discrepancy import findings as verdicts
from stepdiag_ros.metrology.discrepancy.baseline import Baseline, Whitened, whitened
from stepdiag_ros.metrology.discrepancy.chance import tail
from stepdiag_ros.metrology.discrepancy.findings import Diagnosis, Loose
from stepdiag_ros.metrology.discrepancy.locate import gap_map
from stepdiag_ros.metrology.discrepancy.loose import LARGEST_WANDER, loosened
from stepdiag_ros.metrology.discrepancy.noise import Noise
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI

_SEEN = 1e-3
"""Share of a reading's own error beyond which the baseline does not follow it."""
_SAME_STOP = 1e-6
"""m."""
_MOST = 64
"""Readings that are looked at: those with the largest gap."""
FEW_SLIPS = 3
"""Wrong readings of one run that are looked for before effects."""
_SHARE_OF_SLIPS = 0.03
"""Part of all readings that may be wrong; where there are more, the way of reading is wrong."""
_MANY_SLIPS = 12
"""Wrong readings of one run at most: each costs a fit of the whole run."""
_CLEAR = 8.0
"""Standard deviations, by what is left of the run, by which a wrong reading stands out."""
_SURE = 30.0
"""The same, where a reading is wrong whatever else the run shows: an effect that acts on single
stops acts on several, of which none then stands out so far from the others."""
_HIDDEN = 4.5
"""The same, where others that are wrong are left."""
QUIETER = 3.0
"""How much less noise a run has without wrong readings that hid each other."""


@dataclass(frozen=True)
class WrongReading:
    """The reading whose own error would take most of the gap.

    Attributes:
        line: index of its pass in the measurement.
        stop: number of the stop in the pass, from 0.
        size: by how much it is off, m.
        out: by how many standard deviations of all that is left of the run.
    """

    line: int
    stop: int
    size: float
    out: float = np.inf

    @property
    def clear(self) -> bool:
        """Say whether it stands out by far; otherwise others that are wrong may hide it."""
        return self.out > _CLEAR

    @property
    def sure(self) -> bool:
        """Say whether it is wrong whatever else the run shows."""
        return self.out > _SURE

    def without(self, measurement: Measurement) -> Measurement:
        """Return a measurement in which this stop has no reading."""
        line = measurement.lines[self.line]
        displacement = line.displacement.copy()
        displacement[self.stop] = np.nan
        lines = list(measurement.lines)
        lines[self.line] = replace(line, displacement=displacement)
        return replace(measurement, lines=tuple(lines))

    def words(self, measurement: Measurement) -> str:
        """Say which reading it is: ``stop 3 of z forward, repeat 0 (X 0, Y 0, Z 30 mm)``."""
        line = measurement.lines[self.line]
        place = zip(AXES, line.target[self.stop], strict=True)
        where = ", ".join(f"{axis} {value * IN_MILLI:g}" for axis, value in place)
        return f"stop {self.stop} of {line.line} ({where} mm)"


def many_slips(stops: Stops) -> int:
    """Return how many readings of a run may be wrong, if nothing else explains it."""
    return max(FEW_SLIPS, min(round(_SHARE_OF_SLIPS * len(stops.time)), _MANY_SLIPS))


def are_slips(wrong: Sequence[WrongReading], most: int) -> bool:
    """Say whether readings are few, and none beside another of its pass."""
    beside = any(
        one.line == other.line and abs(one.stop - other.stop) == 1
        for one, other in combinations(wrong, 2)
    )
    return len(wrong) <= most and not beside


def most_wrong(
    baseline: Baseline, stops: Stops, noise: Noise, rotation: float
) -> WrongReading | None:
    """Return the reading that stands out most from the rest; None if none does.

    Args:
        baseline: of the run.
        stops: of the run.
        noise: of a reading; a wrong reading that is in it does no harm.
        rotation: plausible size of the rotations, rad.
    """
    plausible = Loose(zero=LARGEST_WANDER, rotation=rotation if stops.chain else 0.0)
    loose = loosened(baseline, stops, plausible)
    problem = whitened(loose, noise.size, noise.correlation)
    good = np.flatnonzero(baseline.good)
    rows = np.argsort(-np.abs(problem.gap[: len(good)]))[:_MOST]
    single = np.zeros((len(good), len(rows)))
    single[rows, np.arange(len(rows))] = 1.0
    own = problem.of(single)
    left = problem.projected(own)
    square = np.sum(left**2, axis=0)
    seen = square > _SEEN * np.sum(own**2, axis=0)
    sizes = np.where(seen, left.T @ problem.gap / np.where(seen, square, 1.0), 0.0)
    gains = sizes**2 * square
    best = int(np.argmax(gains))
    rest = (float(problem.gap @ problem.gap) - gains[best]) / max(problem.freedom - 1, 1)
    stop = int(good[rows[best]])
    out = float(np.sqrt(gains[best] / rest)) if rest > 0.0 else np.inf
    if not out > _HIDDEN or not _repeated(stop, good, stops):
        return None
    where = int(stops.pass_index[stop]), int(stops.number[stop])
    return WrongReading(*where, float(sizes[best]), out)


def _repeated(stop: int, good: NDArray[np.int64], stops: Stops) -> bool:
    """Say whether another pass of the setup has read the same stop."""
    same = (stops.setup[good] == stops.setup[stop]) & (
        stops.pass_index[good] != stops.pass_index[stop]
    )
    away = np.abs(stops.position[good] - stops.position[stop])
    return bool(np.any(same & np.all(away <= _SAME_STOP, axis=1)))


def with_wrong_readings(
    rest: Diagnosis, wrong: Sequence[WrongReading], problem: Whitened, measurement: Measurement
) -> Diagnosis | None:
    """Return the diagnosis of a run of which some readings are wrong; None if more is.

    Args:
        rest: diagnosis of the run without these readings.
        wrong: the readings.
        problem: the whole run, with the noise of the rest.
        measurement: the run.
    """
    explained = rest.verdict in (verdicts.CONSISTENT, verdicts.NAMED, verdicts.AMBIGUOUS)
    if not explained and not all(one.sure for one in wrong):
        return None
    which = tuple(one.words(measurement) for one in wrong)
    squares, none = float(problem.gap @ problem.gap), np.zeros((len(problem.gap), 0))
    chance = tail(np.array(squares), float(problem.freedom), rest.noise_degrees_of_freedom)
    return replace(
        rest,
        verdict=verdicts.UNEXPLAINED,
        sentence=_sentence(rest, wrong, which),
        findings=(),
        partial=rest.findings if explained else rest.partial,
        description=None,
        wrong_readings=which,
        chi_squared_before=squares,
        degrees_of_freedom_before=problem.freedom,
        lack_of_fit_p_before=float(chance),
        residual_before=problem.baseline.spread(problem.readings(problem.gap)),
        where=(f"Mostly at {' and at '.join(which)} alone.",),
        where_after=(),
        map=gap_map(problem, problem.gap, none, rest.stops, rest.noise_degrees_of_freedom),
        patterns=(),
        patterns_after=(),
    )


def _sentence(rest: Diagnosis, wrong: Sequence[WrongReading], which: Sequence[str]) -> str:
    agrees = rest.verdict == verdicts.CONSISTENT
    one = len(wrong) == 1
    count = "one reading" if one else f"{len(wrong)} readings"
    how = (
        f", but agree without {count}"
        if agrees
        else f", and {count} {'is' if one else 'are'} wrong"
    )
    off = "; ".join(
        f"{words} is off by about {float(f'{reading.size * IN_MICRO:.2g}'):+g} µm"
        for words, reading in zip(which, wrong, strict=True)
    )
    return f"Model and run disagree{how}: {off}.{'' if agrees else f' Without: {rest.sentence}'}"
