"""Error curves over their axes: of one method, of several, before and after."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stepdiag_ros.evaluation.report import ZERO_BY_DEFINITION, Truth, frame_sentences, method_title
from stepdiag_ros.metrology.curve_set import require_names
from stepdiag_ros.metrology.geometry import AXES, ROTATIONS, TRANSLATIONS, Vector, curve_unit
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.plots.places import here
from stepdiag_ros.plots.style import (
    AFTER,
    BEFORE,
    TRUTH,
    TRUTH_TITLE,
    Sheet,
    Style,
    band,
    curve,
    panel_title,
    say_unknown,
    scales,
    style_of,
    zero_line,
)

_PANEL_HEIGHT = 1.55
BAND_WORDS = "Bands: 95 % (1.96 standard uncertainties)."


def many(results: VolumetricErrors | Sequence[VolumetricErrors]) -> list[VolumetricErrors]:
    """Return one result, or several, as a list."""
    return [results] if isinstance(results, VolumetricErrors) else list(results)


def curve_words(name: str) -> str:
    """Say in words what a curve is: ``E_ZX: Z error as X moves``; its name where all is narrow."""
    if here().narrow:
        return name
    if name in ROTATIONS:
        return f"{name}: rotation about {AXES['ABC'.index(name[2])]} as {name[3]} moves"
    return f"{name}: {name[2]} error as {name[3]} moves"


def shown_unit(name: str) -> str:
    """Return the unit in which a curve is drawn, a millionth of SI."""
    return "µrad" if curve_unit(name) == "rad" else "µm"


def grid_of(names: Sequence[str]) -> list[str]:
    """Return curves in the order of their panels: a column an axis where all nine are asked for.

    Raises:
        ValueError: a name is that of no curve.
    """
    require_names(names)
    for nine in (TRANSLATIONS, ROTATIONS):
        if set(names) == set(nine):
            return [nine[3 * axis + error] for error in range(3) for axis in range(3)]
    return list(names)


def curve_sheet(names: Sequence[str], axes: Any) -> Sheet:
    """Return a sheet with a panel for each curve, titled, its scales named.

    Curves of one unit have one scale in each row, so that their sizes compare at a glance.
    """
    alike = len({curve_unit(name) for name in names}) == 1
    across = 0.2 if alike else 0.5
    sheet = Sheet(len(names), 3, _PANEL_HEIGHT, axes=axes, gap=(across, 0.55), share_rows=alike)
    for number, (panel, name) in enumerate(zip(sheet.panels, names, strict=True)):
        panel_title(panel, curve_words(name))
        up = f"error / {shown_unit(name)}" if sheet.first_in_row(number) else ""
        scales(panel, f"{name[3]} / mm", up)
        zero_line(panel)
    return sheet


def error_curves(
    results: VolumetricErrors | Sequence[VolumetricErrors],
    names: Sequence[str] | None = None,
    *,
    truth: Truth | None = None,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure:
    """Draw error curves with their 95 % bands: of all methods given, and the truth where known.

    Of all nine translations or rotations, columns are the axis that moves, rows the error.

    Args:
        results: of one method or of several, in the order of the legend.
        names: ISO 230-1 names of curves; the nine translations if not given.
        truth: of a simulated cell.
        title: heading; None: one that says what is shown; empty: neither it nor the frame.
        stamp: what the figure was made from.
        axes: to draw in, one for each curve, instead of a new figure.

    Raises:
        ValueError: a name is that of no curve, or there is nothing to draw.
    """
    shown = grid_of(TRANSLATIONS if names is None else names)
    drawn = [one for one in many(results) if any(name in one.curves for name in shown)]
    if not drawn and truth is None:
        raise Refusal(
            f"no result has a curve of {', '.join(shown)}, so nothing can be drawn", fault="too_few"
        )
    sheet = curve_sheet(shown, axes)
    for panel, name in zip(sheet.panels, shown, strict=True):
        known = [
            draw_curve(panel, one, name, style_of(one.method), method_title(one.method))
            for one in drawn
        ]
        if not any(known):
            say_unknown(panel)
        if truth is not None and drawn and name in truth.curves:
            nodes = drawn[-1].nodes_of(name) * IN_MILLI
            curve(panel, nodes, np.asarray(truth.curves[name]) * IN_MICRO, TRUTH, TRUTH_TITLE)
    if title is None:
        kinds = {curve_unit(name) for name in shown}
        what = {"m": "Translational errors", "rad": "Rotations"}.get("".join(kinds), "Errors")
        title = f"{what} of the axes with 95 % coverage intervals"
    said = frame_sentences(drawn) if title else []
    return sheet.finish(title, small_print=said, stamp=stamp)


def draw_curve(
    axes: Axes, result: VolumetricErrors, name: str, style: Style, label: str, **more: Any
) -> bool:
    """Draw a curve of a result with its band, if more of it is known than the frame fixes.

    Returns:
        Whether something was drawn.
    """
    if name not in result.curves:
        return False
    nodes: Vector = result.nodes_of(name) * IN_MILLI
    values = result.curves[name] * IN_MICRO
    uncertainty = result.standard_uncertainty[name]
    # What the frame fixes, such as the zero at the first node, says nothing about the machine.
    if not np.any(np.isfinite(values) & ~(uncertainty <= ZERO_BY_DEFINITION)):
        return False
    band(axes, nodes, values, uncertainty * IN_MICRO, style)
    curve(axes, nodes, values, style, label, **more)
    return True


def curves_before_after(
    before: VolumetricErrors,
    after: VolumetricErrors,
    names: Sequence[str] | None = None,
    *,
    labels: tuple[str, str] = ("before: model as it was", "after: effects taken off"),
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure:
    """Draw the curves of two results over each other: before and after something was taken off.

    Args:
        before: without it.
        after: with it.
        names: ISO 230-1 names of curves; the nine translations if not given.
        labels: of both.
        title: heading; None: one that says what is shown; empty: neither it nor the frame.
        stamp: what the figure was made from.
        axes: to draw in, one for each curve, instead of a new figure.

    Raises:
        ValueError: a name is that of no curve.
    """
    shown = grid_of(TRANSLATIONS if names is None else names)
    sheet = curve_sheet(shown, axes)
    for panel, name in zip(sheet.panels, shown, strict=True):
        known = [
            draw_curve(panel, one, name, style, label)
            for one, style, label in zip((before, after), (BEFORE, AFTER), labels, strict=True)
        ]
        if not any(known):
            say_unknown(panel)
    if title is None:
        title = "What the missing effect did to the error curves"
    method = f"Solved by: {method_title(after.method)}."
    return sheet.finish(title, small_print=[f"{method} {BAND_WORDS}"], stamp=stamp)
