"""What the picture of a result says in words."""

import textwrap
from collections.abc import Sequence
from math import isfinite

import numpy as np

from stepdiag_ros.evaluation.report import short_title
from stepdiag_ros.metrology.geometry import ROTATIONS
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.text.numbers import UNKNOWN, plain, plus_minus, with_uncertainty
from stepdiag_ros.viewers.scene.error_map import Extremes

WIDTH = 72
"""Characters in a line."""
_TIED = "\u00a0"
"""A space at which no line is broken."""


def unknown_curves(result: VolumetricErrors) -> list[str]:
    """Return the curves that a method estimates, but these lines do not fully determine."""
    return [name for name, values in result.curves.items() if not np.all(np.isfinite(values))]


def largest(found: Extremes) -> str:
    """Say how large the largest error is, how sure that is, and where."""
    accuracy = found.accuracy
    if not isfinite(accuracy.value):
        return f"largest error {UNKNOWN}"
    bound = "" if isfinite(accuracy.standard_uncertainty) else "at most "
    spread = accuracy.uncertainty_limit if bound else accuracy.standard_uncertainty
    value, expanded = with_uncertainty(
        accuracy.value * IN_MICRO, COVERAGE_FACTOR * spread * IN_MICRO
    )
    known = f"U {bound}{expanded} µm of the readings, 95 %"
    uncertainty = known if isfinite(spread) else f"U {UNKNOWN}"
    place = ", ".join(
        f"{axis}{_TIED}{plain(where * 1e3, 1)}"
        for axis, where in zip("XYZ", accuracy.position, strict=True)
    )
    return f"largest error {value} µm ({uncertainty}) at {place} mm"


def statement(
    result: VolumetricErrors, found: Extremes, exaggeration: float, angles: float = 0.0
) -> str:
    """Return the text beside the picture of a result, in lines.

    Args:
        result: that is shown.
        found: how large its errors are.
        exaggeration: by which error vectors are drawn longer than they are; 0 if none is drawn.
        angles: by which rotations are drawn larger than they are; 0 if none is drawn.
    """
    lines = [f"{short_title(result.method)}, from {result.lines} lines"]
    if not result.curves:
        # Of a tracker's seven lines there are figures alone, and no error map.
        lines += [
            f"{one.name} {plus_minus(one.value, one.standard_uncertainty, IN_MICRO)} µ{one.unit}"
            for one in result.figures
        ]
        return _wrapped([*lines, f"frame: {result.frame}"])
    if exaggeration:
        lines[0] += f": errors drawn {exaggeration:,.0f} times as long".replace(",", " ")
    partly = exaggeration and not isfinite(found.accuracy.value)
    lines.append(largest(found) + (", drawn where the errors are known" if partly else ""))
    if isfinite(found.accuracy.rms):
        over = "all nodes" if found.every == 1 else f"every {found.every}. node of an axis, about"
        lines.append(f"rms {plain(found.accuracy.rms * IN_MICRO)} µm over {over}")
    if angles:
        lines.append(f"rotations of each axis drawn {angles:,.0f} times as large".replace(",", " "))
    unknown = unknown_curves(result)
    if unknown:
        lines.append(f"{UNKNOWN}: {_few(unknown)}")
    elif not isfinite(found.accuracy.value):
        lines.extend(found.accuracy.remarks)
    if not any(name in ROTATIONS for name in result.curves):
        lines.append("angular errors not estimated, not in it")
    lines.append("tool relative to the workpiece, zero at the first corner of the box")
    lines.append(f"frame: {result.frame}")
    return _wrapped(lines)


def _wrapped(lines: Sequence[str]) -> str:
    wrapped = [part for line in lines for part in textwrap.wrap(line, WIDTH)]
    return "\n".join(wrapped).replace(_TIED, " ")


def _few(names: Sequence[str], most: int = 9) -> str:
    left = len(names) - most
    return ", ".join(names[:most]) + (f" and {left} more" if left > 0 else "")
