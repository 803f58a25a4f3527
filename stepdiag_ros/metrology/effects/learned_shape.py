"""Learned shape: an effect without a name, written down as a product of plain shapes.

Where no effect of the catalogue closes the gap of a run, the diagnosis describes it as a sum of
such products (``discrepancy.describe``): a displacement of the tool, or a change of the reading,
that depends on a few quantities of the machine's state. Each factor is one word or two, so that a
model file that holds the description can be read:

===================  =============================================================================
factor               value, with u the share of the travel of the axis, 0 to 1
===================  =============================================================================
``x^2``              u², here of X
``x>0.5``            (u - 0.5)/0.5 beyond 0.5 and 0 below
``x<0.5``            (0.5 - u)/0.5 below 0.5 and 0 beyond
``x~0.5``            a spot: exp(-(u - 0.5)²/(2·0.1²))
``sin x/0.25``       sin(2π·u/0.25), here of X; ``cos x/0.25`` its cosine
``path>0.5``         as ``x>0.5``, with u the length of the beam's path over the box's diagonal
``line ppp``         1 on this line, and 0 on all others
``sense x``          sense of the last move of X, -1 or 1
``creep x 40s``      that sense, fading from the first stop after X turned round: exp(-t/40 s)
``t^2``              (hours since the start of the run)²
``start 600s``       exp(-t/600 s), t since the start of the run
``from 60s to 90s``  1 from 60 s to 90 s after the start of the run, and 0 before and after
``sin t/300s``       sin(2π t/300 s); ``cos t/300s`` its cosine
``material^1``       material temperature minus 20 °C, K
``air^1``            air temperature minus 20 °C, K
===================  =============================================================================
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from stepdiag_ros.metrology.effects.domain import PLACES, Domain, since_reversal
from stepdiag_ros.metrology.effects.effect import ActiveEffect, Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.passes import line_name
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.expansion import REFERENCE_TEMPERATURE
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import IN_MILLI

READING = "reading"
"""What a shape acts on that is not a displacement of the tool along X, Y or Z."""
TIMES = " * "
"""Between the factors of a shape."""
SPOT = 0.1
"""Width of a spot as a share of the travel (standard deviation of its bell)."""
HOUR, MINUTE = 3600.0, 60.0
PATH = "path"
THE_LINE = "the line"
"""Words for a shape that acts on some lines only, wherever the machine is."""
_OF = rf"([xyz]|{PATH})"
_NUMBER = r"(\d+(?:\.\d+)?)"
_CREEP = re.compile(rf"creep ([xyz]) {_NUMBER}s")


@dataclass(frozen=True)
class Places:
    """Places alone, for factors that depend on nothing else.

    Attributes:
        share: position over travel of each axis, shape (n, 3).
    """

    share: Vector


def _place(stops: Stops | Places, of: str) -> Vector:
    if of == PATH and isinstance(stops, Stops):
        return np.asarray(stops.along / np.linalg.norm(stops.travel))
    share: Vector = stops.share[:, AXES.index(of.upper())]
    return share


def _line(stops: Stops, name: str) -> Vector:
    named = np.array([line_name(line) == name for line in stops.lines], dtype=np.float64)
    on: Vector = named[stops.pass_index]
    return on


def _sense(stops: Stops, axis: str) -> Vector:
    sense: Vector = stops.last_sense[:, AXES.index(axis.upper())]
    return sense


def _above(stops: Stops | Places, axis: str, bound: str) -> Vector:
    return np.maximum(_place(stops, axis) - float(bound), 0.0) / (1.0 - float(bound))


def _below(stops: Stops | Places, axis: str, bound: str) -> Vector:
    return np.maximum(float(bound) - _place(stops, axis), 0.0) / float(bound)


def _spot(stops: Stops | Places, axis: str, middle: str) -> Vector:
    spot: Vector = np.exp(-0.5 * ((_place(stops, axis) - float(middle)) / SPOT) ** 2)
    return spot


def _creep(stops: Stops, axis: str, constant: str) -> Vector:
    fading: Vector = np.exp(-since_reversal(stops, axis) / float(constant))
    return _sense(stops, axis) * fading


def _start(stops: Stops, constant: str) -> Vector:
    fading: Vector = np.exp(-stops.time / float(constant))
    return fading


def _window(stops: Stops, begin: str, end: str) -> Vector:
    inside: Vector = ((stops.time >= float(begin)) & (stops.time <= float(end))).astype(np.float64)
    return inside


def _wave(stops: Stops, kind: str, period: str) -> Vector:
    return _turn(kind, stops.time / float(period))


def _swing(stops: Stops | Places, kind: str, axis: str, period: str) -> Vector:
    return _turn(kind, _place(stops, axis) / float(period))


def _turn(kind: str, periods: Vector) -> Vector:
    wave: Vector = (np.sin if kind == "sin" else np.cos)(2.0 * np.pi * periods)
    return wave


def _temperature(stops: Stops, of: str, power: str) -> Vector:
    values = stops.material_temperature if of == "material" else stops.air_temperature
    return np.asarray((values - REFERENCE_TEMPERATURE) ** int(power))


_Names = tuple[str, ...]
_Form = tuple[re.Pattern[str], Callable[..., Vector], Callable[..., str], Callable[..., _Names]]


def _forms_of_motion() -> Iterator[_Form]:
    """Yield of each factor of places and senses its pattern, value, words and quantities."""

    def of_place(of: str, *_: str) -> str:
        return "the length of the beam's path" if of == PATH else f"the place of {of.upper()}"

    def place(of: str, *_: str) -> _Names:
        return PLACES if of == PATH else (f"{of.upper()}_m",)

    for pattern, value in (
        (rf"{_OF}\^(\d)", lambda at, of, power: _place(at, of) ** int(power)),
        (rf"{_OF}>{_NUMBER}", _above),
        (rf"{_OF}<{_NUMBER}", _below),
        (rf"{_OF}~{_NUMBER}", _spot),
    ):
        yield re.compile(pattern), value, of_place, place
    yield (
        re.compile(rf"(sin|cos) ([xyz])/{_NUMBER}"),
        _swing,
        lambda _, axis, *__: f"the place of {axis.upper()}, periodically",
        lambda _, axis, *__: place(axis),
    )
    yield re.compile(r"line (.+)"), _line, lambda *_: THE_LINE, lambda *_: ()
    yield (
        re.compile(r"sense ([xyz])"),
        _sense,
        lambda axis: f"the sense of {axis.upper()}'s last move",
        lambda axis: (f"sense_{axis.upper()}",),
    )
    yield (
        _CREEP,
        _creep,
        lambda axis, *_: f"the time since {axis.upper()} turned round",
        lambda axis, *_: (f"sense_{axis.upper()}", f"since_reversal_{axis.upper()}_s"),
    )


def _forms_of_time() -> Iterator[_Form]:
    """Yield the same of each factor of time and temperature."""

    def time(*_: str) -> _Names:
        return ("time_s",)

    for pattern, value, words in (
        (r"t\^(\d)", lambda stops, power: (stops.time / HOUR) ** int(power), "time"),
        (rf"start {_NUMBER}s", _start, "time"),
        (rf"from {_NUMBER}s to {_NUMBER}s", _window, "time, between two jumps"),
        (rf"(sin|cos) t/{_NUMBER}s", _wave, "time, periodically"),
    ):
        yield re.compile(pattern), value, partial(_constant, words), time
    yield (
        re.compile(r"(material|air)\^(\d)"),
        _temperature,
        lambda of, *_: f"the {of} temperature",
        lambda of, *_: (f"{of}_temperature_degC",),
    )


def _constant(words: str, *_: str) -> str:
    return words


_FORMS = (*_forms_of_motion(), *_forms_of_time())


def factor(text: str, stops: Stops | Places) -> Vector:
    """Return the value of one factor at each stop, shape (n,); NaN where the run does not state it.

    Args:
        text: of the factor.
        stops: of a run; places are enough for a factor that depends on nothing else.

    Raises:
        ValueError: there is no such factor.
    """
    value, _, _, groups = _form(text)
    return np.asarray(value(stops, *groups), dtype=np.float64)


def product_of(shape: str, stops: Stops | Places) -> Vector:
    """Return the product of the factors of a shape at each stop, shape (n,).

    Args:
        shape: factors with `` * `` between.
        stops: see ``factor``.

    Raises:
        ValueError: a factor does not exist.
    """
    value: Vector = np.prod([factor(text, stops) for text in factors(shape)], axis=0)
    return value


@lru_cache(maxsize=4096)
def is_of_place(text: str) -> bool:
    """Say whether a factor depends on the place of one axis alone, and not periodically.

    Of what is periodic, the stops show only how it beats with the steps.
    """
    names = quantities(text)
    return len(names) == 1 and names[0] in PLACES and not text.startswith(("sin", "cos"))


@lru_cache(maxsize=4096)
def over_box(shape: str) -> float:
    """Return the rms over a box of what a shape is there beyond curves of single axes.

    Only its factors of places count; with fewer than two of them it is 0.
    """
    share = np.tile(np.linspace(0.0, 1.0, 201)[:, None], (1, 3))
    values = [factor(one, Places(share)) for one in factors(shape) if is_of_place(one)]
    if len(values) < 2:
        return 0.0
    means = np.mean(values, axis=1)
    variances = np.var(values, axis=1)
    curves = [
        variance * np.prod(np.delete(means, axis)) ** 2 for axis, variance in enumerate(variances)
    ]
    beyond = np.prod(variances + means**2) - np.prod(means**2) - sum(curves)
    return float(np.sqrt(max(beyond, 0.0)))


def driver(text: str) -> str:
    """Say on what a factor depends, for example ``the place of X``.

    Raises:
        ValueError: there is no such factor.
    """
    _, words, _, groups = _form(text)
    return words(*groups)


def factors(shape: str) -> list[str]:
    """Return the factors of a shape."""
    return [text.strip() for text in shape.split(TIMES.strip())]


def fading_time(shape: str) -> float:
    """Return the longest time constant of what fades after a reversal, s; 0 if nothing does."""
    creeps = [_CREEP.fullmatch(text) for text in factors(shape)]
    return max((float(creep[2]) for creep in creeps if creep), default=0.0)


def quantities(shape: str) -> tuple[str, ...]:
    """Return the quantities on which a shape depends, by their names in ``domain.QUANTITIES``.

    Raises:
        ValueError: a factor does not exist.
    """
    found: dict[str, None] = {}
    for text in factors(shape):
        _, _, names, groups = _form(text)
        found |= dict.fromkeys(names(*groups))
    return tuple(found)


def quantity(shape: str, place: int, stops: Stops) -> tuple[Vector, str]:
    """Return the quantity behind one factor of a shape at each stop, and its unit for a reader.

    Args:
        shape: product of factors.
        place: of the factor, from 0.
        stops: of a run.

    Raises:
        ValueError: there is no such factor.
    """
    text = shape.split(TIMES)[place]
    words = driver(text)
    if words.startswith("the length"):
        return stops.along * IN_MILLI, "mm"
    if words == THE_LINE:
        return stops.pass_index.astype(np.float64), "number of the pass"
    axis = next((letter for letter in AXES if f" {letter}" in words), "")
    if words.startswith("the place"):
        return stops.position[:, AXES.index(axis)] * IN_MILLI, "mm"
    if words.startswith("the sense"):
        return _sense(stops, axis), ""
    if words.startswith("the time since"):
        return since_reversal(stops, axis), "s"
    if words.startswith("time"):
        return stops.time / MINUTE, "min"
    return stops.material_temperature if "material" in words else stops.air_temperature, "°C"


def _form(
    text: str,
) -> tuple[Callable[..., Vector], Callable[..., str], Callable[..., _Names], _Names]:
    for pattern, value, words, names in _FORMS:
        if found := pattern.fullmatch(text.strip()):
            return value, words, names, found.groups()
    raise Refusal(
        f"'{text.strip()}' is not a factor of a learned shape; expected for example x^2, x>0.5,"
        " sense x, creep x 40s, t^1, start 600s, sin t/300s or material^1",
        fault="unknown",
        about="shape",
    )


@dataclass(frozen=True)
class Learned(Effect):
    """Something that was described by a product of plain shapes, with one amplitude.

    Attributes:
        domain: where it was seen; the shapes of places count over its box. None if not known:
            they then count over the box of each run.
    """

    domain: Domain | None = None

    source = "learned from runs of the machine (docs/diagnose.md)"
    learned = True
    depends_on_sense = True

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield nothing: what is learned is described, not tried."""
        del stops
        return iter(())

    def amount(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Vector:
        """Return amplitude times the product of the factors at each stop, shape (n,).

        Raises:
            ValueError: a factor does not exist.
        """
        seen = stops if self.domain is None else self.domain.counted(stops)
        amount: Vector = sizes["amplitude"] * product_of(str(setting["shape"]), seen)
        return amount


class LearnedShape(Learned):
    """A displacement of the tool, or a change of the reading, by a product of plain shapes."""

    name = "learned shape"
    sentence = "Something acts that has no name yet; it was described by what it depends on."
    keys = (Key("acts_on", (*AXES, READING)), Key("shape", str))
    sizes = (Size("amplitude", "m", -100e-6, 100e-6, "where the product of the shapes is 1"),)

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return the displacement along an axis, or the change of the reading.

        Raises:
            ValueError: a factor does not exist.
        """
        change = self.amount(setting, sizes, stops)
        if setting["acts_on"] == READING:
            return Change(reading=change)
        return Change.along(setting["acts_on"], change)

    def label(self, setting: Setting) -> str:
        """Say for example ``learned shape along Y: x>0.5 * z>0.5``."""
        where = "in the reading" if setting["acts_on"] == READING else f"along {setting['acts_on']}"
        return f"{self.name} {where}: {setting['shape']}"


def outside(effects: Iterable[ActiveEffect], stops: Stops) -> tuple[str, ...]:
    """Say which learned effects a run takes beyond the domain in which they were learned.

    Args:
        effects: of a model or a cell; those that were not learned are passed over.
        stops: of the run.
    """
    said = []
    for one in effects:
        domain = one.effect.domain if isinstance(one.effect, Learned) else None
        beyond = () if domain is None else domain.left_by(stops)
        if beyond:
            learned = ", ".join(seen.words for seen, _ in beyond)
            here = ", ".join(run.words for _, run in beyond)
            said.append(
                f"'{one.effect.label(one.setting)}' is used outside its domain: it was learned over"
                f" {learned}, and this run covers {here}."
            )
    return tuple(said)


def without_domain(effects: Iterable[ActiveEffect]) -> tuple[str, ...]:
    """Say of which learned effects it is not known where they were learned."""
    return tuple(
        f"'{one.effect.label(one.setting)}' states no domain: it counts over the box of this run,"
        " and whether it was learned there is not known."
        for one in effects
        if isinstance(one.effect, Learned) and one.effect.domain is None
    )


EFFECT = LearnedShape()
