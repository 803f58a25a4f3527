"""How the figures of a diagnosis are written, and the meaning of its verdicts."""

import math
import re

from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    CONSISTENT,
    DESCRIBED,
    NAMED,
    NOT_TESTABLE,
    UNEXPLAINED,
    Finding,
)
from stepdiag_ros.metrology.effects.effect import Size
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.text.numbers import UNKNOWN, with_uncertainty

_SMALL = 0.01
"""A number without unit that is plausible up to this is relative: it is read in µm/m."""
_TINY = 1e-4
"""U that is smaller in a unit is written in another one."""
_PER_HOUR, _PER_HECTOPASCAL = 3600.0, 100.0
_READABLE = {
    "1/K": ("µm/(m K)", IN_MICRO),
    "1/s": ("µm/(m h)", IN_MICRO * _PER_HOUR),
    "m/s": ("µm/h", IN_MICRO * _PER_HOUR),
    "1/Pa": ("µm/(m hPa)", IN_MICRO * _PER_HECTOPASCAL),
    "m/Pa": ("µm/hPa", IN_MICRO * _PER_HECTOPASCAL),
    "s": ("ms", IN_MILLI),
}
MEANING = {
    CONSISTENT: "The model explains this run to within its noise. Each effect has a smallest size"
    " that would have been seen; the run says nothing of a smaller one.",
    NAMED: "The run shows more than the model explains. Of all effects in the catalogue, only those"
    " named here close the gap.",
    AMBIGUOUS: "The run shows more than the model explains. Several effects would close the gap,"
    " and this run alone does not show which one acts.",
    DESCRIBED: "The run shows more than the model explains, and no effect of the catalogue closes"
    " the gap. A formula does: it states on what the cause depends, not what the cause is. Find the"
    " cause before you correct the machine by this run.",
    UNEXPLAINED: "The run shows more than the model explains, and no effect of the catalogue"
    " closes the gap. Find the cause before you correct the machine by this run.",
    NOT_TESTABLE: "No reading of this run could contradict the model. That is neither a"
    " confirmation nor a fault. To test the model, measure the machine differently.",
}
"""The meaning of a verdict, for a reader of nothing else."""


def readable(size: Size) -> tuple[str, float]:
    """Return the unit in which people read a size, and the factor from SI."""
    if size.unit == "1":
        relative = size.largest <= _SMALL
        return ("µm/m", IN_MICRO) if relative else ("", 1.0)
    return readable_unit(size.unit)


def readable_unit(unit: str) -> tuple[str, float]:
    """Return the unit in which people read what is in a unit of SI, and the factor from it."""
    if unit in _READABLE:
        return _READABLE[unit]
    unit = re.sub(r"\^(\d)", lambda power: "⁰¹²³⁴⁵⁶⁷⁸⁹"[int(power[1])], unit)
    if unit in ("m", "rad") or unit.startswith(("m/", "rad/")):
        return f"µ{unit}", IN_MICRO
    return ("", 1.0) if unit == "1" else (unit, 1.0)


def _prefixed(unit: str, factor: float, half: float) -> tuple[str, float]:
    """Return a unit with a smaller prefix, and its factor, where U would be tiny in it."""
    if not unit.startswith("µ") or not 0.0 < half * factor < _TINY:
        return unit, factor
    steps = next((n for n in (1, 2) if half * factor * 1e3**n >= _TINY), 3)
    return f"{'npf'[steps - 1]}{unit[1:]}", factor * 1e3**steps


def size_words(finding: Finding, size: Size) -> str:
    """Write a size with its 95 % coverage interval, for example ``0.800 ± 0.021 µm``."""
    value = finding.sizes[size.name]
    low, high = finding.band[size.name]
    unit, factor = _prefixed(*readable(size), 0.5 * (high - low))
    half = 0.5 * (high - low) * factor
    if not math.isfinite(half) or half <= 0.0:
        return f"{value * factor:.4g} {unit} ± {UNKNOWN}".rstrip()
    written, uncertainty = with_uncertainty(value * factor, half)
    return f"{written} ± {uncertainty} {unit}".rstrip()


def sizes_words(finding: Finding) -> str:
    """Write all sizes of a finding in one line."""
    return ", ".join(size_rows(finding))


def size_rows(finding: Finding) -> list[str]:
    """Write each size of a finding in a line of its own."""
    sizes = finding.candidate.effect.sizes
    if len(sizes) == 1:
        return [size_words(finding, sizes[0])]
    rows = [f"{size.name.replace('_', ' ')} {size_words(finding, size)}" for size in sizes]
    over_travel = finding.over_travel
    if over_travel is not None:
        value, _, expanded = over_travel
        unit, factor = readable(sizes[0])
        written, uncertainty = with_uncertainty(value * factor, expanded * factor)
        rows.append(f"over the travel {written} ± {uncertainty} {unit}")
    return rows


def chance(probability: float) -> str:
    """Write a probability: never as 0 or 1, which no evidence gives."""
    if not math.isfinite(probability):
        return UNKNOWN
    if probability < 1e-4:
        return "< 0.0001"
    if probability > 0.9999:
        return "> 0.9999"
    return f"{probability:.2g}" if probability < 0.01 else f"{probability:.4f}".rstrip("0")
