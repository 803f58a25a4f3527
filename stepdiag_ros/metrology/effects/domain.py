"""Where a learned effect was seen: the ranges of the quantities on which it depends.

What is learned from a run is known as far as the run went, and no farther. A place is a machine
coordinate, and its range is the measured box, over which the shapes count (``learned_shape``).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES, EDGE, Vector
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import IN_MILLI

SLACK = 0.02
"""Share of a range by which other quantities than places may exceed it."""


def since_reversal(stops: Stops, axis: str) -> Vector:
    """Return s since the first stop after the last reversal of an axis in its setup, shape (n,)."""
    since: Vector = np.zeros(len(stops.time))
    sense = stops.last_sense[:, AXES.index(axis.upper())]
    for setup in range(len(stops.setups)):
        rows = np.flatnonzero(stops.setup == setup)
        rows = rows[np.argsort(stops.time[rows], kind="stable")]
        turned = np.diff(sense[rows], prepend=np.inf) != 0.0
        last = np.maximum.accumulate(np.where(turned, np.arange(len(rows)), 0))
        since[rows] = stops.time[rows] - stops.time[rows[last]]
    return since


class Quantity(NamedTuple):
    """What a shape may depend on.

    Attributes:
        words: for a reader.
        unit: for a reader.
        values: returns it at each stop in SI (temperatures in degC), shape (n,).
        scale: to the unit.
    """

    words: str
    unit: str
    values: Callable[[Stops], Vector]
    scale: float = 1.0


def _place(stops: Stops, axis: int) -> Vector:
    """Return both ends of the box besides: over it the shapes count."""
    ends = (0.0, stops.travel[axis])
    place: Vector = stops.corner[axis] + np.concatenate([stops.position[:, axis], ends])
    return place


def _sense(stops: Stops, axis: int) -> Vector:
    sense: Vector = stops.last_sense[:, axis]
    return sense


QUANTITIES: Mapping[str, Quantity] = {
    **{
        f"{letter}_m": Quantity(letter, "mm", partial(_place, axis=axis), IN_MILLI)
        for axis, letter in enumerate(AXES)
    },
    **{
        f"sense_{letter}": Quantity(f"the sense of {letter}", "", partial(_sense, axis=axis))
        for axis, letter in enumerate(AXES)
    },
    **{
        f"since_reversal_{letter}_s": Quantity(
            f"the time since {letter} turned round", "s", partial(since_reversal, axis=letter)
        )
        for letter in AXES
    },
    "time_s": Quantity("time", "s", lambda stops: stops.time),
    "material_temperature_degC": Quantity(
        "the material temperature", "°C", lambda stops: stops.material_temperature
    ),
    "air_temperature_degC": Quantity(
        "the air temperature", "°C", lambda stops: stops.air_temperature
    ),
}
"""Name in a file → what it is of."""
PLACES = tuple(f"{letter}_m" for letter in AXES)


class Range(NamedTuple):
    """Range of one quantity, SI; temperatures in degC."""

    name: str
    low: float
    high: float

    @property
    def words(self) -> str:
        """Return for example ``X 0 to 120 mm``."""
        what = QUANTITIES[self.name]
        low, high = (f"{value * what.scale:.4g}" for value in (self.low, self.high))
        return f"{what.words} {low} to {high} {what.unit}".rstrip()

    def holds(self, other: "Range") -> bool:
        """Say whether another range lies within this one."""
        slack = EDGE if self.name in PLACES else SLACK * (self.high - self.low)
        return other.low >= self.low - slack and other.high <= self.high + slack


@dataclass(frozen=True)
class Domain:
    """Where a learned effect was seen.

    Attributes:
        ranges: of the quantities on which it depends, and of no others.
    """

    ranges: tuple[Range, ...]

    @classmethod
    def of(cls, names: Sequence[str], stops: Stops) -> "Domain":
        """Return the domain that a run covers.

        Args:
            names: of the quantities; those that the run does not state are left out.
            stops: of the run.
        """
        made = []
        for name in names:
            values = QUANTITIES[name].values(stops)
            known = values[np.isfinite(values)]
            if known.size:
                made.append(Range(name, float(np.min(known)), float(np.max(known))))
        return cls(tuple(made))

    @classmethod
    def from_section(cls, section: Section, names: Sequence[str]) -> "Domain":
        """Read a domain: a list of two numbers for each quantity.

        Raises:
            ValueError: another quantity than those named is there, or a range is not one.
        """
        made = []
        for name in names:
            if section.unknown(name):
                if name in PLACES:
                    raise Refusal(
                        f"{section.source}: '{name}' is missing: the shape depends on it",
                        fault="missing",
                        about=name,
                    )
                continue
            low, high = section.numbers(name, count=2)
            if low > high or (low == high and name in PLACES):
                raise Refusal(
                    f"{section.source}: '{name}' is [{low:g}, {high:g}]; expected a range, its"
                    " lower end first",
                    fault="malformed",
                    about=name,
                )
            made.append(Range(name, low, high))
        section.finish()
        return cls(tuple(made))

    def to_mapping(self) -> dict[str, list[float]]:
        """Return what ``from_section`` reads the same domain from; YAML and JSON can write it."""
        return {one.name: [one.low, one.high] for one in self.ranges}

    def box(self) -> dict[int, tuple[float, float]]:
        """Return axis → first and last machine coordinate, m, of the places on which it depends."""
        return {
            PLACES.index(one.name): (one.low, one.high) for one in self.ranges if one.name in PLACES
        }

    def counted(self, stops: Stops) -> Stops:
        """Return stops whose share of the travel is counted over this domain."""
        corner, travel = stops.corner.copy(), stops.travel.copy()
        for axis, (low, high) in self.box().items():
            corner[axis], travel[axis] = low, high - low
        shift = stops.corner - corner
        position, start = stops.position + shift, stops.start + shift
        return replace(stops, corner=corner, travel=travel, position=position, start=start)

    def left_by(self, stops: Stops) -> tuple[tuple[Range, Range], ...]:
        """Return the ranges that a run exceeds, each with that of the run."""
        run = {one.name: one for one in Domain.of([one.name for one in self.ranges], stops).ranges}
        return tuple(
            (one, run[one.name])
            for one in self.ranges
            if one.name in run and not one.holds(run[one.name])
        )
