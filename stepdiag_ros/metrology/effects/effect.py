"""What an effect is: a small piece of physics that changes readings, with a name and a size."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.registry import raised

Setting = Mapping[str, Any]
"""Where and how an effect acts: names → a name of an axis or line, or a number that shapes it."""
_LARGEST_CHANGE = 0.1
"""m: what changes a reading by more is not in SI units, in a box of up to ``_USUAL_TRAVEL``; in a
larger one as much more as an effect may change that grows with the cube of the places."""
_USUAL_TRAVEL = 0.5
"""m."""


@dataclass(frozen=True)
class Key:
    """One value of a setting.

    Attributes:
        name: for example ``axis``; a number's ends in its unit, for example ``period_m``.
        kind: the names that it may be, or ``str``, ``int`` (from 0) or ``float`` (above 0).
    """

    name: str
    kind: type | tuple[str, ...]


@dataclass(frozen=True)
class Size:
    """One linear size of an effect.

    Attributes:
        name: for example ``lost_motion``.
        unit: SI, for example ``m`` or ``rad``.
        low: smallest plausible value.
        high: largest plausible value.
        meaning: in a few words.
    """

    name: str
    unit: str
    low: float
    high: float
    meaning: str

    @property
    def largest(self) -> float:
        """Return the largest plausible magnitude."""
        return max(abs(self.low), abs(self.high))


@dataclass(frozen=True)
class Change:
    """What an effect does at each stop.

    Attributes:
        translation: of the tool relative to the workpiece, m, shape (n, 3), or None.
        rotations: rotation vectors that axis X, Y, Z adds, rad, each shape (n, 3); axes that turn
            by nothing are left out.
        reading: of the interferometer itself, m, shape (n,), or None.
    """

    translation: Vector | None = None
    rotations: Mapping[int, Vector] = field(default_factory=dict)
    reading: Vector | None = None

    @classmethod
    def along(cls, axis: str, distance: Vector) -> "Change":
        """Return a translation along X, Y or Z alone; distance in m, shape (n,).

        Raises:
            LookupError: there is no such axis.
            TypeError: there is not one distance a stop.
        """
        if axis not in AXES:
            raise LookupError(f"'{axis}' is not an axis; use one of {', '.join(AXES)}")
        _check_shape("the distance", distance, (len(distance),))
        translation = np.zeros((len(distance), 3))
        translation[:, AXES.index(axis)] = distance
        return cls(translation=translation)

    def readings(self, stops: Stops) -> Vector:
        """Return what that adds to the readings, to first order, m, shape (n,).

        n·t + Σ (ε_i × n)·v_i + the reading's own change (``forward``, first order).

        Raises:
            Refusal: an axis turns, but the chain is not known.
            LookupError: a rotation is of no axis.
            TypeError: a part does not have one row a stop.
        """
        count = len(stops.time)
        total = np.zeros(count)
        for what, part, shape in (
            ("the translation", self.translation, (count, 3)),
            ("the reading", self.reading, (count,)),
            *((f"the rotation of axis {n}", one, (count, 3)) for n, one in self.rotations.items()),
        ):
            if part is not None:
                _check_shape(what, part, shape)
        if not set(self.rotations) <= set(range(len(AXES))):
            keys = ", ".join(map(repr, self.rotations))
            raise LookupError(f"the rotations are of axis {keys}; use 0, 1, 2 for X, Y, Z")
        if self.translation is not None:
            total += np.sum(stops.direction * self.translation, axis=1)
        if self.rotations:
            arms = stops.arms
            for axis, rotation in self.rotations.items():
                total += np.sum(np.cross(rotation, stops.direction) * arms[axis], axis=1)
        if self.reading is not None:
            total += self.reading
        return total


def _check_shape(what: str, part: Vector, shape: tuple[int, ...]) -> None:
    if np.shape(part) != shape:
        raise TypeError(f"{what} has the shape {np.shape(part)}, not {shape}: one row a stop")


class Effect(ABC):
    """One entry of the catalogue.

    Attributes:
        name: short, in words, for example ``backlash``.
        sentence: what happens in the machine, for an engineer.
        source: where this is described.
        sizes: linear sizes; the change of the readings is proportional to each.
        keys: of a setting, in their order in a label.
        needs: columns of ``Stops`` that must be known at some stop for the effect to be seen; see
            ``known``.
        typical: its one size is the typical size of many unknown values (``loose``), which no
            column shows and no simulation can have.
        depends_on_sense: its change depends on ``Stops.last_sense``; see ``unknown``.
        learned: it is described after a run, not tried on one.
    """

    name: ClassVar[str]
    sentence: ClassVar[str]
    source: ClassVar[str]
    sizes: ClassVar[tuple[Size, ...]]
    keys: ClassVar[tuple[Key, ...]] = ()
    needs: ClassVar[tuple[str, ...]] = ()
    typical: ClassVar[bool] = False
    depends_on_sense: ClassVar[bool] = False
    learned: ClassVar[bool] = False

    @abstractmethod
    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield every setting in which the effect could act in a run, to be tried one by one."""

    @abstractmethod
    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return what the effect of these sizes does at each stop.

        Raises:
            Refusal: the run lacks what the effect needs. Any other exception is a fault of the
                effect.
        """

    def unknown(self, setting: Setting, stops: Stops) -> Vector:
        """Return the part of this effect that no run determines, as columns to fit with it, (n, m).

        In which sense an axis came to the stops of a setup before its first move there is not known
        (``Stops.last_sense``): a column holds what the other sense would change at those stops.
        """
        free = [np.zeros((len(stops.time), 0))]
        if not self.depends_on_sense:
            return free[0]
        untold = stops.last_sense == 0.0
        forward = replace(stops, last_sense=np.where(untold, 1.0, stops.last_sense))
        one = self.columns(setting, forward)
        for axis in map(int, np.flatnonzero(np.any(untold, axis=0))):
            turned = forward.last_sense.copy()
            turned[untold[:, axis], axis] = -1.0
            change = one - self.columns(setting, replace(forward, last_sense=turned))
            for at_them in stops.before_first_move(axis).T:
                part = change * at_them[:, None]
                free.append(part[:, np.any(part, axis=0)])
        return np.column_stack(free)

    def label(self, setting: Setting) -> str:
        """Say which effect this is, for example ``backlash of X``."""
        words = ", ".join(
            f"{name.rsplit('_', 1)[0].replace('_', ' ')} {value:g} {name.rsplit('_', 1)[-1]}"
            if isinstance(value, float)
            else str(value)
            for name, value in setting.items()
        )
        return f"{self.name} of {words}" if words else self.name

    def known(self, stops: Stops) -> bool:
        """Return whether the run has, at any stop, every column that the effect needs."""
        return all(bool(np.any(np.isfinite(getattr(stops, name)))) for name in self.needs)

    def columns(self, setting: Setting, stops: Stops) -> Vector:
        """Return what a unit of each size adds to each reading, shape (n, sizes)."""
        names = [size.name for size in self.sizes]
        return np.column_stack(
            [
                self.change(setting, {name: float(name == one) for name in names}, stops).readings(
                    stops
                )
                for one in names
            ]
        )

    def check(self, setting: Setting) -> None:
        """Check that a setting holds the declared keys, with names that they may have.

        Raises:
            LookupError: it does not.
        """
        if set(setting) != {key.name for key in self.keys}:
            raise LookupError(
                f"'settings' yields the keys {', '.join(setting) or 'none'}, 'keys' declares"
                f" {', '.join(key.name for key in self.keys) or 'none'}"
            )
        for key in self.keys:
            if isinstance(key.kind, tuple) and setting[key.name] not in key.kind:
                raise LookupError(
                    f"'settings' yields '{setting[key.name]}' as {key.name}, 'keys' declares"
                    f" {', '.join(key.kind)}"
                )

    def check_change(self, setting: Setting, stops: Stops) -> None:
        """Check what an effect states: units, change in proportion to sizes, dependence on senses.

        Raises:
            ArithmeticError: sizes are not in SI units, twice the size does not change twice as
                much, or the change depends on senses and ``depends_on_sense`` is not stated.
            Refusal: the run lacks what the effect needs.
        """
        sizes = {
            size.name: size.largest if np.isfinite(size.largest) else 1.0 for size in self.sizes
        }
        twice = {name: 2.0 * value for name, value in sizes.items()}
        one = ActiveEffect(self, setting, sizes).readings(stops)
        most = _LARGEST_CHANGE * max(1.0, float(np.max(stops.travel)) / _USUAL_TRAVEL) ** 3
        if np.nanmax(np.abs(one), initial=0.0) > most:
            raise ArithmeticError(
                f"its largest sizes change a reading by {np.nanmax(np.abs(one)):.3g} m, more than"
                f" the {most:.3g} m that are plausible in this box; give 'low' and 'high' in SI"
                " units: m and rad, not µm and µrad"
            )
        two = ActiveEffect(self, setting, twice).readings(stops)
        if not np.allclose(two, 2.0 * one, rtol=1e-6, atol=1e-12, equal_nan=True):
            raise ArithmeticError(
                "its change is not proportional to its sizes; a value to which it is not"
                " proportional must be a key"
            )
        senses = np.random.default_rng(0).choice([-1.0, 1.0], stops.last_sense.shape)
        others = ActiveEffect(self, setting, sizes).readings(replace(stops, last_sense=senses))
        if not self.depends_on_sense and not np.array_equal(one, others, equal_nan=True):
            raise ArithmeticError(
                "its change depends on 'last_sense', which is not known before an axis's first"
                " move in a setup; state depends_on_sense = True, and it is free there"
            )


@contextmanager
def fault_named(effect: Effect) -> Iterator[None]:
    """Name the effect where its code fails. A refusal is an answer about the run, not a fault.

    Raises:
        Refusal: the code of the effect fails.
    """
    try:
        yield
    except Refusal:
        raise
    except Exception as error:  # whatever the code of somebody else does
        module = type(effect).__module__
        own = module.startswith(__name__.rpartition(".")[0])
        raise Refusal(
            f"the effect '{effect.name}' ({module}) fails: {raised(error)}. Correct its module"
            f"{'' if own else ', or uninstall its package'}",
            fault="failed",
            about=effect.name,
        ) from error


@dataclass(frozen=True)
class ActiveEffect:
    """An effect with its setting and sizes, as it acts in a simulated cell or a model.

    Attributes:
        effect: of the catalogue.
        setting: where and how.
        sizes: name → value, SI.
    """

    effect: Effect
    setting: Setting
    sizes: Mapping[str, float]

    def readings(self, stops: Stops) -> Vector:
        """Return what it adds to each reading, m, shape (n,)."""
        return self.effect.change(self.setting, self.sizes, stops).readings(stops)
