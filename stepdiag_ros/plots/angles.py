"""Squareness as it is on the machine: two axes, the angle between them greatly exaggerated."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Wedge

from stepdiag_ros.evaluation.report import (
    Truth,
    frame_sentences,
    method_title,
    robust_to_setup,
    short_title,
)
from stepdiag_ros.metrology.forward import AXES_OF
from stepdiag_ros.metrology.geometry import SQUARENESS
from stepdiag_ros.metrology.solvers.result import Figure as Number
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.diagonal_squareness import (
    SHIFTS_OF_RL,
    squareness_error_of_shift,
)
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.plots.curves import many
from stepdiag_ros.plots.panel import INK, LABEL_SIZE
from stepdiag_ros.plots.style import (
    BLUE,
    TRUTH,
    TRUTH_TITLE,
    VERMILION,
    Sheet,
    Style,
    panel_title,
    scales,
    style_of,
    zero_line,
)
from stepdiag_ros.text.numbers import ARC_SECONDS, plain, plus_minus
from stepdiag_ros.words.squareness import SIGN_DEFINITIONS, SignDefinition, sign

_PLANES = {"C0Y": "seen from +Z", "B0Z": "seen from −Y", "A0Z": "seen from +X"}
_LEANS_TO_MINUS = {"C0Y": 1.0, "B0Z": -1.0, "A0Z": 1.0}
"""A right-handed rotation leans the drawing's vertical axis to the left (+1) or right (-1)."""
_DRAWN_ANGLE = np.radians(14.0)
_WIDEST_DRAWN = np.radians(75.0)
"""To which an interval is cut off, on either side."""
_WHY_NOT_DRAWN = (
    "Not drawn: a method that takes the alignment of laser and mirror as perfect; its angles"
    " contain the errors of the alignment."
)
_WHAT_IS_TRUE = (
    "Truth: angles between straight lines fitted to the true motions: those of the cell file plus"
    " the slopes of its curves."
)
_ROW_OF_WORDS = 0.12
"""Height of a row of numbers below a drawing, inches."""


def squareness(
    results: VolumetricErrors | Sequence[VolumetricErrors],
    *,
    truth: Truth | None = None,
    definition: SignDefinition = "rotation",
    numbers: bool = True,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure:
    """Draw the three squareness errors with their sign, the angles greatly exaggerated.

    The result of a method that takes the setup as perfect is given in figures but, beside others,
    not drawn: it contains the errors of the setup, which may hide the rest.

    Args:
        results: of one method or of several.
        truth: of a simulated cell.
        definition: of the sign of the numbers; the drawing is the same in both.
        numbers: write the values below the drawings.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: three to draw in instead of a new figure.
    """
    given = many(results)
    drawn = robust_to_setup(given) or given
    sizes = [abs(one.value) for result in drawn for one in _known(result.figures)]
    if not sizes and truth is not None:
        sizes = [abs(one.value) for one in _known(truth.figures)]
    largest = max(sizes, default=0.0)
    exaggeration = _DRAWN_ANGLE / largest if largest > 0.0 else 1.0
    words = {name: _words(given, drawn, truth, name, definition) for name in SQUARENESS}
    rows = max(map(len, words.values())) if numbers else 0
    sheet = Sheet(
        3, 3, 1.9, axes=axes, left=0.1, right=0.1, gap=(0.1, 0.1), bottom=0.1 + _ROW_OF_WORDS * rows
    )
    for panel, name in zip(sheet.panels, SQUARENESS, strict=True):
        _draw_square(panel, name)
        for result in drawn:
            style = style_of(result.method)
            _lean(panel, result.figures, name, exaggeration, style, method_title(result.method))
        if truth is not None:
            _lean(panel, truth.figures, name, exaggeration, TRUTH, TRUTH_TITLE)
        if numbers:
            panel.text(
                0.5,
                -0.02,
                "\n".join(words[name]),
                transform=panel.transAxes,
                ha="center",
                va="top",
                fontsize=6.8,
                color=INK,
                linespacing=1.25,
            )
    factor = f"{float(f'{exaggeration:.2g}'):,.0f}"
    heading = f"Squareness, angles drawn {factor} times larger"
    under = [f"sign of the figures: {SIGN_DEFINITIONS[definition]}"] if numbers else []
    said = ["A shaded angle is the interval of ± U (95 %)."]
    if numbers and len(drawn) < len(given):
        said.append(_WHY_NOT_DRAWN)
    if title != "":
        said += frame_sentences(drawn)
    if truth is not None:
        said.append(_WHAT_IS_TRUE)
    if title is not None:
        said = [f"Angles drawn {factor} times larger.", *said]
    return sheet.finish(
        heading if title is None else title,
        under=under if title is None else (),
        small_print=said,
        stamp=stamp,
    )


def _known(figures: Sequence[Number]) -> list[Number]:
    return [one for one in figures if one.name in SQUARENESS and np.isfinite(one.value)]


def _lean(
    axes: Axes,
    figures: Sequence[Number],
    name: str,
    exaggeration: float,
    style: Style,
    label: str,
) -> None:
    for one in _known(figures):
        if one.name != name:
            continue
        angle = _LEANS_TO_MINUS[name] * one.value * exaggeration
        spread = COVERAGE_FACTOR * one.standard_uncertainty * exaggeration
        if np.isfinite(spread):
            low, high = (
                90.0 + np.degrees(np.clip(angle + way, -_WIDEST_DRAWN, _WIDEST_DRAWN))
                for way in (-spread, spread)
            )
            axes.add_patch(
                Wedge((0.0, 0.0), 1.0, low, high, color=style.colour, alpha=0.12, linewidth=0.0)
            )
        axes.plot(
            [0.0, -np.sin(angle)],
            [0.0, np.cos(angle)],
            color=style.colour,
            linestyle=style.line,
            marker=style.marker,
            markersize=4.0,
            markevery=[1],
            linewidth=1.6,
            label=label,
        )


def _draw_square(axes: Axes, name: str) -> None:
    reference, other = AXES_OF[name]
    black = {"arrowstyle": "-|>", "color": "0.2", "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=(1.05, 0.0), xytext=(0.0, 0.0), arrowprops=black)
    axes.plot([0.0, 0.0], [0.0, 1.1], color="0.6", linewidth=0.8, linestyle=(0, (4, 3)))
    axes.plot([0.0, 0.08, 0.08], [0.08, 0.08, 0.0], color="0.6", linewidth=0.8)
    axes.text(1.1, 0.0, f"+{reference}", ha="left", va="center", fontsize=LABEL_SIZE)
    axes.text(0.0, 1.13, f"+{other}", ha="center", va="bottom", fontsize=LABEL_SIZE)
    panel_title(axes, f"{name}: {other} to {reference} ({_PLANES[name]})")
    axes.set_xlim(-0.55, 1.3)
    axes.set_ylim(-0.06, 1.3)
    axes.set_aspect("equal")
    axes.set_axis_off()


def _words(
    results: Sequence[VolumetricErrors],
    drawn: Sequence[VolumetricErrors],
    truth: Truth | None,
    name: str,
    definition: SignDefinition,
) -> list[str]:
    factor = sign(name, definition)
    lines = []
    for result in results:
        for one in result.figures:
            if one.name == name:
                written = plus_minus(factor * one.value, one.standard_uncertainty, IN_MICRO)
                unit = " µm/m" if np.isfinite(one.value) else ""
                hidden = "" if any(result is other for other in drawn) else " (not drawn)"
                lines.append(f"{short_title(result.method)}: {written}{unit}{hidden}")
    for one in () if truth is None else truth.figures:
        if one.name == name:
            lines.append(f"Truth: {plain(factor * one.value * IN_MICRO)} µm/m")
    return lines


def squareness_sensitivity(
    *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Figure:
    """Draw the graph of RL: squareness uncertainty over aspect ratio for ±1 and ±5 ppm.

    Args:
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in instead of a new figure.
    """
    sheet = Sheet(1, 1, 3.2, axes=axes)
    (panel,) = sheet.panels
    ratio = np.linspace(1.0, 10.0, 181)
    for shift, colour, line in zip(SHIFTS_OF_RL, (BLUE, VERMILION), ("-", "--"), strict=True):
        error = squareness_error_of_shift(shift, ratio) * ARC_SECONDS
        for sense in (1.0, -1.0):
            panel.plot(
                ratio,
                sense * error,
                color=colour,
                linestyle=line,
                linewidth=1.4,
                label=f"±{shift * IN_MICRO:g} ppm between the two diagonals",
            )
    zero_line(panel)
    scales(panel, "aspect ratio of the axes (longer : shorter)", "error of squareness / arcsec")
    heading = "Squareness from face diagonals: effect of a shift in laser reading"
    return sheet.finish(heading if title is None else title, stamp=stamp)
