"""How numbers are written: one rule for every table.

An uncertainty is given to two significant digits and the value to the same place (JCGM 100:2008,
7.2.6). What is not known is written "unknown", never as a number.
"""

import math
from collections.abc import Iterable
from decimal import ROUND_HALF_EVEN, Decimal

from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI

UNKNOWN = "unknown"


OF_READINGS = "± of the readings"
"""In the head of tables whose ± are those of the method: of the readings, of rotations that they
leave open and of the laser's scale, not of the whole uncertainty budget."""

ARC_SECONDS = 180.0 * 3600.0 / math.pi
"""Radians to arc-seconds."""

_SIGNIFICANT_DIGITS = 2
_PLACE_WITHOUT_UNCERTAINTY = -2
_ROUNDING = 1e-9
"""Less than this, in the unit that is shown, is rounding of the computation and written as zero."""


def _place_of(uncertainty: Decimal) -> int:
    """Return the power of ten of the last digit that is written."""
    place = uncertainty.adjusted() - _SIGNIFICANT_DIGITS + 1
    # 0.0996 rounds to 0.100: one digit too many, so one place less.
    rounded = uncertainty.quantize(Decimal(1).scaleb(place), rounding=ROUND_HALF_EVEN)
    return rounded.adjusted() - _SIGNIFICANT_DIGITS + 1


def _written(number: Decimal, place: int) -> str:
    rounded = number.quantize(Decimal(1).scaleb(place), rounding=ROUND_HALF_EVEN)
    if rounded == 0:
        rounded = abs(rounded)
    return f"{rounded:f}"


def with_uncertainty(value: float, uncertainty: float) -> tuple[str, str]:
    """Write a value and its uncertainty, both in the unit in which they are shown.

    Args:
        value: NaN if unknown.
        uncertainty: of the value; NaN if unknown, 0 if the frame fixes the value.

    Returns:
        The two texts. Without a known uncertainty the value is written to two decimals.

    Raises:
        ValueError: the uncertainty is negative.
    """
    if uncertainty < 0:
        raise Refusal(
            f"an uncertainty cannot be negative, but this one is {uncertainty!r}",
            fault="out_of_range",
        )
    known = math.isfinite(uncertainty)
    place = _PLACE_WITHOUT_UNCERTAINTY
    if known and uncertainty > 0:
        place = _place_of(Decimal(repr(float(uncertainty))))
    value_text = _written(Decimal(repr(float(value))), place) if math.isfinite(value) else UNKNOWN
    if not known:
        return value_text, UNKNOWN
    if uncertainty == 0:
        return value_text, "0"
    return value_text, _written(Decimal(repr(float(uncertainty))), place)


def plus_minus(value: float, standard_uncertainty: float, scale: float = 1.0) -> str:
    """Write a value with its expanded uncertainty (95 %), for example ``-1.20 ± 0.13``.

    Args:
        value: in SI; NaN if unknown.
        standard_uncertainty: in SI; NaN if unknown.
        scale: from SI to the unit that is shown.
    """
    return with_expanded(value, COVERAGE_FACTOR * standard_uncertainty, scale)


def with_expanded(value: float, expanded_uncertainty: float, scale: float = 1.0) -> str:
    """Write a value with its expanded uncertainty, whatever its coverage factor is.

    Args:
        value: in SI; NaN if unknown.
        expanded_uncertainty: in SI; NaN if unknown.
        scale: from SI to the unit that is shown.
    """
    if not math.isfinite(value):
        return UNKNOWN
    expanded = expanded_uncertainty * scale
    if abs(expanded) < _ROUNDING:
        expanded = 0.0
        value = 0.0 if abs(value * scale) < _ROUNDING else value
    value_text, uncertainty_text = with_uncertainty(value * scale, expanded)
    if expanded == 0:
        return "0" if value == 0 else value_text
    if uncertainty_text == UNKNOWN:
        return f"{value_text} ± {UNKNOWN}"
    return f"{value_text} ± {uncertainty_text}"


def plain(value: float, decimals: int = 2) -> str:
    """Write a number without uncertainty to fixed decimals, or "unknown"."""
    return _written(Decimal(repr(float(value))), -decimals) if math.isfinite(value) else UNKNOWN


def place_in_mm(position: Iterable[float]) -> str:
    """Write a place of the machine: ``X 30.0, Y 60.0, Z 100.0 mm``.

    Args:
        position: X, Y, Z, m.
    """
    named = zip(AXES, position, strict=True)
    return ", ".join(f"{axis} {plain(value * IN_MILLI, 1)}" for axis, value in named) + " mm"


def in_micro(value: float, unit: str) -> str:
    """Write an uncertainty in millionths of its unit, to two digits: ``0.52 µm``.

    Args:
        value: in the unit; NaN if unknown.
        unit: ``m`` or ``rad``.
    """
    return f"{two_digits(value * IN_MICRO)} µ{unit}" if math.isfinite(value) else UNKNOWN


def two_digits(value: float) -> str:
    """Write a positive number to two significant digits, without an exponent."""
    return f"{float(f'{value:.2g}'):,.10g}" if math.isfinite(value) else UNKNOWN


def time_left(seconds: float) -> str:
    """Write how long something still takes, for a person who waits: 45 s, 12 min, 3 h 05 min."""
    if not math.isfinite(seconds):
        return UNKNOWN
    if seconds < 90.0:
        return f"{round(seconds)} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
