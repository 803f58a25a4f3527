"""The space in which a gap without a name is described: families of shapes of the machine's state.

A family says on what the tool's displacement along an axis, or the reading itself, depends: on one
quantity of the machine's state or on the product of two or three. Its shapes (products of the
factors of ``effects.learned_shape``) span what is plausible for such a dependence. The coarse ones
are few and are used to find on what the gap depends; the fine ones to write it down.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import combinations, product

import numpy as np

from stepdiag_ros.metrology.effects.domain import since_reversal
from stepdiag_ros.metrology.effects.learned_shape import (
    PATH,
    READING,
    TIMES,
    driver,
    factor,
    quantities,
)
from stepdiag_ros.metrology.effects.passes import line_name
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES, ROTATIONS, Vector, moving_axis

_LEAST_WARMING = 0.05
"""K: a temperature that changes by less is not tried as a cause."""
_PERIODS = 80
"""Periods of a periodic change that are tried, from the duration of the run down."""
_EACH_QUANTITY = float(np.log(3.0))
"""Evidence that each quantity costs a family, beside the number of such families."""
_UNUSUAL = float(np.log(20.0))
"""Evidence that it costs a reading to depend on a place, a sense or the material's temperature
otherwise than by a displacement, and a displacement or a rotation to depend on the temperature of
the air: a structure follows its own temperature, and the air acts on the beam."""
RATIO_OF_CONSTANTS = 2.0**0.5
"""Of one time constant to the next, where what fades is written down."""
FADING = float(np.log(60.0))
"""Evidence that it costs a sense to fade: every machine has backlash, which lasts. For odds of 1
to 20, readings must favour what fades by 3 to 1 ("positive evidence", Kass & Raftery 1995, J. Am.
Stat. Assoc. 90, 773)."""
_LEAST_SWING = 0.1
"""By how much a swing of amplitude 1 must change from stop to stop: with two stops in a period, the
sine is zero at all of them, and readings would give it any size."""
_LEAST_STOPS = 2.5
"""Stops in the shortest period that shows."""


@dataclass(frozen=True)
class Family:
    """What a gap may depend on, with the shapes by which that is tried.

    Attributes:
        acts_on: X, Y, Z for a displacement of the tool, E_AX to E_CZ for a rotation of an axis, or
            ``reading``.
        drivers: on what it depends, in words, in order.
        shapes: products of factors.
        factors: of which the fine shapes are made, one group for each quantity.
        price: evidence that it costs, since such a dependence is less common than others.
    """

    acts_on: str
    drivers: tuple[str, ...]
    shapes: tuple[str, ...]
    factors: tuple[tuple[str, ...], ...]
    price: float = 0.0

    @cached_property
    def senses(self) -> tuple[int, ...]:
        """Return the axes of whose last move the sense counts."""
        names = quantities(self.shapes[0])
        return tuple(axis for axis, letter in enumerate(AXES) if f"sense_{letter}" in names)

    @property
    def fine(self) -> tuple[str, ...]:
        """Return shapes at more places and with more constants."""
        return _products(self.factors)


@dataclass(frozen=True)
class _Driver:
    """A quantity of the machine's state with few, some and many factors that depend on it."""

    kind: str
    few: tuple[str, ...]
    some: tuple[str, ...]
    many: tuple[str, ...]

    @property
    def words(self) -> str:
        return driver(self.some[0])


def _place(axis: str) -> _Driver:
    few = (f"{axis}^1", f"{axis}^2", f"{axis}>0.5")
    spots = tuple(f"{axis}~{place:g}" for place in (0.2, 0.4, 0.6, 0.8))
    some = (*few, f"{axis}^3", f"{axis}<0.5", *spots)
    bounds = [f"{bound:g}" for bound in np.arange(1, 10) / 10]
    many = (
        *(f"{axis}^{power}" for power in (1, 2, 3, 4)),
        *(f"{axis}{side}{bound}" for side in "><~" for bound in bounds),
    )
    return _Driver("place", few, some, many)


def _constants(low: float, high: float, ratio: float) -> tuple[str, ...]:
    """Return time constants from the lowest to the highest, at most a ratio apart."""
    count = max(int(np.ceil(np.log(high / low) / np.log(ratio) - 1e-9)) + 1, 1)
    return tuple(_plain(float(one)) for one in np.geomspace(low, high, count))


def window(begin: float, end: float) -> Family:
    """Return the family of a reading that is shifted between two times, s."""
    shape = f"from {begin:.1f}s to {end:.1f}s"
    return Family(READING, (driver(shape),), (shape,), ((shape,),), _EACH_QUANTITY)


def _plain(value: float) -> str:
    """Return a number with four digits and no exponent, as a factor has it."""
    return np.format_float_positional(value, 4, fractional=False, trim="-")


def _pause(stops: Stops) -> float:
    """Return the usual time from stop to stop, s; NaN where the run does not state its times."""
    if not np.all(np.isfinite(stops.time)):
        return float("nan")
    steps = np.diff(np.unique(stops.time))
    return float(np.median(steps)) if steps.size else float("nan")


def _drivers(stops: Stops) -> list[_Driver]:
    """Return what varies in a run."""
    letters = [letter.lower() for letter in stops.moving_axes]
    made = [_place(letter) for letter in letters]
    pause = _pause(stops)
    timed = bool(np.isfinite(pause))
    duration = max(stops.duration, 2.0 * pause) if timed else pause
    for letter in letters:
        senses = stops.last_sense[:, AXES.index(letter.upper())]
        if {-1.0, 1.0} <= {*senses.tolist()}:
            sense = (f"sense {letter}",)
            made.append(_Driver("sense", sense, sense, sense))
            if timed:
                # What hardly fades before the axis turns round again depends on the sense alone.
                longest = float(np.max(since_reversal(stops, letter)))
                coarse = creeps(letter, stops, 4.0, longest)
                fine = creeps(letter, stops, RATIO_OF_CONSTANTS, 2.0 * longest)
                made.append(_Driver("creep", coarse, coarse, fine))
    if timed:
        made.append(_time(duration))
    for of in ("material", "air"):
        values = getattr(stops, f"{of}_temperature")
        if np.all(np.isfinite(values)) and np.ptp(values) > _LEAST_WARMING:
            powers = (f"{of}^1", f"{of}^2")
            made.append(_Driver("temperature", powers[:1], powers, powers))
    return made


def creeps(axis: str, stops: Stops, ratio: float, longest: float) -> tuple[str, ...]:
    """Return factors of what fades after an axis turned round.

    Args:
        axis: x, y or z.
        stops: of a run that states its times.
        ratio: of one time constant to the next, at most.
        longest: time constant, s; the shortest is the time from stop to stop.
    """
    pause = _pause(stops)
    return tuple(f"creep {axis} {one}s" for one in _constants(pause, max(longest, pause), ratio))


def _time(duration: float) -> _Driver:
    few = ("t^1", "t^2")
    starts, more = (
        tuple(f"start {one}s" for one in _constants(duration / 30, duration, ratio))
        for ratio in (3.0, RATIO_OF_CONSTANTS)
    )
    return _Driver("time", few, (*few, "t^3", *starts), (*few, "t^3", "t^4", *more))


_TURNING = ("temperature", "time")
"""Kinds of quantities by which the rotation of an axis along its way may grow."""
_TOGETHER = (
    ("place", "place"),
    ("place", "sense"),
    ("place", "creep"),
    ("place", "time"),
    ("place", "temperature"),
    ("sense", "temperature"),
    ("sense", "time"),
    ("place", "place", "place"),
    ("place", "place", "sense"),
    ("place", "place", "time"),
    ("place", "place", "temperature"),
)
"""Kinds of quantities of which a product is tried."""


def families(stops: Stops) -> Iterator[Family]:
    """Yield every family that a run could show: of one quantity, of two, of three."""
    seen = [axis for axis in range(len(AXES)) if np.any(stops.direction[:, axis])]
    drivers = _drivers(stops)
    for acts_on in (*(AXES[axis] for axis in seen), READING):
        for count in (1, 2, 3):
            for some in combinations(drivers, count):
                if count == 1 or tuple(one.kind for one in some) in _TOGETHER:
                    yield from _of(acts_on, some)
        yield from _periodic(acts_on, stops)
        yield from _swings(acts_on, stops)
    yield from _paths(stops)
    for error in ROTATIONS if stops.chain else ():
        yield from _turns(error, drivers)


def _of(acts_on: str, drivers: tuple[_Driver, ...]) -> Iterator[Family]:
    """Yield the families of a product of quantities: plain, and of one or two also less plain.

    What is plain is likelier for less. Without it, a product with a third quantity that hardly
    changes would stand for the plain one of two.
    """
    several = len(drivers) > 2
    fading = sum(one.kind == "creep" for one in drivers)
    price = _EACH_QUANTITY * len(drivers) + FADING * fading + _unusual(acts_on, drivers)
    words = tuple(one.words for one in drivers)
    finer = tuple(one.some if several else one.many for one in drivers)
    plain = _products([one.few for one in drivers])
    yield Family(acts_on, words, plain, finer, price)
    less_plain = _products([one.some for one in drivers])
    if not several and less_plain != plain:
        yield Family(acts_on, words, less_plain, finer, price)


def _unusual(acts_on: str, drivers: Iterable[_Driver]) -> float:
    """Return the evidence that a dependence costs because physics has few reasons for it."""
    moving = ("the place", "the sense", "the time since", "the material")
    odd = moving if acts_on == READING else ("the air",)
    return _UNUSUAL * any(one.words.startswith(odd) for one in drivers)


def _swings(acts_on: str, stops: Stops) -> Iterator[Family]:
    """Yield families of an axis whose scale swings within a period, the more by another place.

    Stops show a period longer than two steps, or how a shorter one beats with the steps.
    """
    for other in stops.moving_axes if acts_on in stops.moving_axes else ():
        if other == acts_on:
            continue
        letter, axis = acts_on.lower(), AXES.index(acts_on)
        steps = len(np.unique(np.round(stops.position[:, axis], 6))) - 1
        for waves in np.arange(1.0, 0.5 * steps + 0.25, 0.5):
            period = _plain(1.0 / waves)
            both = (f"{kind} {letter}/{period}" for kind in ("sin", "cos"))
            waving = tuple(one for one in both if np.ptp(factor(one, stops)) > _LEAST_SWING)
            shapes = _products((waving, (f"{other.lower()}^1",)))
            names = (driver(waving[0]), driver(f"{other.lower()}^1"))
            factors = (waving, _place(other.lower()).some)
            yield Family(acts_on, names, shapes, factors, 2.0 * _EACH_QUANTITY)


def _paths(stops: Stops) -> Iterator[Family]:
    """Yield the family of a reading that is changed by what the beam passes on one line or more."""
    lines = tuple(dict.fromkeys(f"line {line_name(line)}" for line in stops.lines))
    path = _place(PATH)
    names = (driver(lines[0]), path.words)
    shapes = _products((lines, path.some))
    yield Family(READING, names, shapes, (lines, path.many), 2.0 * _EACH_QUANTITY)


def _turns(error: str, drivers: Sequence[_Driver]) -> Iterator[Family]:
    """Yield families of an axis that turns along its way, the more by another quantity."""
    way = [one for one in drivers if one.kind == "place" and one.words.endswith(error[3])]
    for place, other in product(way, drivers):
        if other.kind in _TURNING:
            few = tuple(one for one in place.few if "^" in one)
            shapes = _products((few, other.few))
            names = (place.words, other.words)
            groups = (place.some, other.some)
            price = 2.0 * _EACH_QUANTITY + _unusual(error, (other,))
            yield Family(error, names, shapes, groups, price)


def _products(factors: Iterable[tuple[str, ...]]) -> tuple[str, ...]:
    return tuple(TIMES.join(some) for some in product(*factors))


def _periodic(acts_on: str, stops: Stops) -> Iterator[Family]:
    """Yield a family for each period, of a sine and a cosine."""
    pause = _pause(stops)
    # Written so that unknown times are no time at all.
    if not stops.duration >= 2.0 * _LEAST_STOPS * pause:
        return
    highest = min(0.5 * _PERIODS, stops.duration / (_LEAST_STOPS * pause))
    for waves in np.arange(2.0, highest, 0.5):
        period = _plain(stops.duration / waves)
        shapes = (f"sin t/{period}s", f"cos t/{period}s")
        yield Family(acts_on, (driver(shapes[0]),), shapes, (shapes,), _EACH_QUANTITY)


def factors_of(stops: Stops) -> Mapping[str, Vector]:
    """Return the factors of a run by their names, each made when it is first asked for."""

    class Factors(dict[str, Vector]):
        def __missing__(self, text: str) -> Vector:
            self[text] = made = factor(text, stops)
            return made

    return Factors()


def columns_of(
    acts_on: str, shapes: Sequence[str], stops: Stops, factors: Mapping[str, Vector]
) -> Vector:
    """Return what shapes add to the readings, m per m or rad of amplitude, shape (n, shapes).

    Args:
        acts_on: as of a family.
        shapes: products of factors.
        stops: of the run.
        factors: of the same run (``factors_of``).
    """
    made = np.empty((len(stops.time), len(shapes)))
    for place, shape in enumerate(shapes):
        made[:, place] = reduce(np.multiply, [factors[one] for one in shape.split(TIMES)])
    if acts_on in ROTATIONS:
        axis = moving_axis(acts_on)
        turned = np.cross(np.eye(3)["ABC".index(acts_on[2])], stops.direction)
        made *= np.sum(turned * stops.arms[axis], axis=1)[:, None]
    elif acts_on != READING:
        made *= stops.direction[:, AXES.index(acts_on)][:, None]
    return made
