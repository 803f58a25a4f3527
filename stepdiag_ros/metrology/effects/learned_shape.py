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
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
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
_NUMBER = r"(\d+(?:\.\d+)?)"


def _place(stops: Stops, axis: str) -> Vector:
    share: Vector = stops.share[:, AXES.index(axis.upper())]
    return share


def _sense(stops: Stops, axis: str) -> Vector:
    sense: Vector = stops.last_sense[:, AXES.index(axis.upper())]
    return sense


def _above(stops: Stops, axis: str, bound: str) -> Vector:
    return np.maximum(_place(stops, axis) - float(bound), 0.0) / (1.0 - float(bound))


def _below(stops: Stops, axis: str, bound: str) -> Vector:
    return np.maximum(float(bound) - _place(stops, axis), 0.0) / float(bound)


def _spot(stops: Stops, axis: str, middle: str) -> Vector:
    spot: Vector = np.exp(-0.5 * ((_place(stops, axis) - float(middle)) / SPOT) ** 2)
    return spot


def since_reversal(stops: Stops, axis: str) -> Vector:
    """Return s since the first stop after the last reversal of an axis in its setup, shape (n,)."""
    since: Vector = np.zeros(len(stops.time))
    sense = _sense(stops, axis)
    for setup in range(len(stops.setups)):
        rows = np.flatnonzero(stops.setup == setup)
        rows = rows[np.argsort(stops.time[rows], kind="stable")]
        turned = np.diff(sense[rows], prepend=np.inf) != 0.0
        last = np.maximum.accumulate(np.where(turned, np.arange(len(rows)), 0))
        since[rows] = stops.time[rows] - stops.time[rows[last]]
    return since


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
    angle = 2.0 * np.pi * stops.time / float(period)
    wave: Vector = np.sin(angle) if kind == "sin" else np.cos(angle)
    return wave


def _temperature(stops: Stops, of: str, power: str) -> Vector:
    values = stops.material_temperature if of == "material" else stops.air_temperature
    return np.asarray((values - REFERENCE_TEMPERATURE) ** int(power))


_FORMS: tuple[tuple[re.Pattern[str], Callable[..., Vector], Callable[..., str]], ...] = tuple(
    (re.compile(pattern), value, words)
    for pattern, value, words in (
        (
            r"([xyz])\^(\d)",
            lambda stops, axis, power: _place(stops, axis) ** int(power),
            lambda axis, *_: f"the place of {axis.upper()}",
        ),
        (rf"([xyz])>{_NUMBER}", _above, lambda axis, *_: f"the place of {axis.upper()}"),
        (rf"([xyz])<{_NUMBER}", _below, lambda axis, *_: f"the place of {axis.upper()}"),
        (rf"([xyz])~{_NUMBER}", _spot, lambda axis, *_: f"the place of {axis.upper()}"),
        (r"sense ([xyz])", _sense, lambda axis: f"the sense of {axis.upper()}'s last move"),
        (
            rf"creep ([xyz]) {_NUMBER}s",
            _creep,
            lambda axis, *_: f"the time since {axis.upper()} turned round",
        ),
        (
            r"t\^(\d)",
            lambda stops, power: (stops.time / HOUR) ** int(power),
            lambda *_: "time",
        ),
        (rf"start {_NUMBER}s", _start, lambda *_: "time"),
        (rf"from {_NUMBER}s to {_NUMBER}s", _window, lambda *_: "time"),
        (rf"(sin|cos) t/{_NUMBER}s", _wave, lambda *_: "time, periodically"),
        (
            r"(material|air)\^(\d)",
            _temperature,
            lambda of, *_: f"the {of} temperature",
        ),
    )
)


def factor(text: str, stops: Stops) -> Vector:
    """Return the value of one factor at each stop, shape (n,); NaN where the run does not state it.

    Raises:
        ValueError: there is no such factor.
    """
    value, _, groups = _form(text)
    return np.asarray(value(stops, *groups), dtype=np.float64)


def product_of(shape: str, stops: Stops) -> Vector:
    """Return the value of a product of factors at each stop, shape (n,).

    Raises:
        ValueError: a factor does not exist.
    """
    value: Vector = np.prod([factor(one, stops) for one in shape.split(TIMES.strip())], axis=0)
    return value


def driver(text: str) -> str:
    """Say on what a factor depends, for example ``the place of X``.

    Raises:
        ValueError: there is no such factor.
    """
    _, words, groups = _form(text)
    return words(*groups)


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


def _form(text: str) -> tuple[Callable[..., Vector], Callable[..., str], tuple[str, ...]]:
    for pattern, value, words in _FORMS:
        if found := pattern.fullmatch(text.strip()):
            return value, words, found.groups()
    raise Refusal(
        f"'{text.strip()}' is not a factor of a learned shape; expected for example x^2, x>0.5,"
        " sense x, creep x 40s, t^1, start 600s, sin t/300s or material^1",
        fault="unknown",
        about="shape",
    )


class LearnedShape(Effect):
    """A displacement of the tool, or a change of the reading, by a product of plain shapes."""

    name = "learned shape"
    sentence = "Something acts that has no name yet; it was described by what it depends on."
    source = "learned from runs of the machine (docs/diagnose.md)"
    keys = (Key("acts_on", (*AXES, READING)), Key("shape", str))
    sizes = (Size("amplitude", "m", -100e-6, 100e-6, "where the product of the shapes is 1"),)
    learned = True

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield nothing: a learned shape is described, not tried."""
        del stops
        return iter(())

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return amplitude times the product of the factors, along an axis or in the reading.

        Raises:
            ValueError: a factor does not exist.
        """
        change = sizes["amplitude"] * product_of(setting["shape"], stops)
        if setting["acts_on"] == READING:
            return Change(reading=change)
        return Change.along(setting["acts_on"], change)

    def label(self, setting: Setting) -> str:
        """Say for example ``learned shape along Y: x>0.5 * z>0.5``."""
        where = "in the reading" if setting["acts_on"] == READING else f"along {setting['acts_on']}"
        return f"{self.name} {where}: {setting['shape']}"


EFFECT = LearnedShape()
