"""The figures of Ibaraki & Hata 2010 (7 to 10) and of KIMM (3 and 4), drawn from a measurement.

Marks are the mean over the repeats, short lines above and below the smallest and the largest value
of a repeat, each repeat solved alone.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stepdiag_ros.evaluation.experiment import Experiment
from stepdiag_ros.evaluation.report import frame_sentences, method_title, robust_to_setup
from stepdiag_ros.metrology.comparison import CurveComparison, DirectComparison, in_result_frame
from stepdiag_ros.metrology.geometry import AXES, Vector, translation
from stepdiag_ros.metrology.repeats import RepeatSpread
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.plots.curves import BAND_WORDS, curve_words, shown_unit
from stepdiag_ros.plots.panel import LABEL_SIZE
from stepdiag_ros.plots.style import (
    DIRECT,
    TRUTH,
    TRUTH_TITLE,
    Sheet,
    Style,
    band,
    curve,
    panel_title,
    scales,
    style_of,
    zero_line,
)

FIGURE_OF_AXIS = {"X": 7, "Y": 8, "Z": 9}
_BESIDE = 0.12
"""Shift between the methods' marks, in node distances, so that they do not hide one another."""
_COLUMNS = 3


def motion_with_repeats(
    experiment: Experiment,
    letter: str,
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure:
    """Draw the three errors as one axis moves, as Figs. 7 to 9 do (a column each).

    Above with the conventional estimate, which setup errors may carry far away; below without it.

    Args:
        experiment: with repeats.
        letter: of the axis that moves.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: six to draw in instead of a new figure.
    """
    axis = AXES.index(letter)
    sheet = Sheet(6, 3, 2.0, axes=axes, gap=(0.5, 0.4))
    results = [one for one in experiment.translational() if one.method in experiment.repeats]
    direct = {} if experiment.direct is None else in_result_frame(experiment.direct)
    truth = experiment.report.truth
    nodes = experiment.translational()[0].nodes[axis]
    for error, direction in enumerate(AXES):
        name = translation(error, axis)
        for row, shown in enumerate((results, robust_to_setup(results))):
            panel = sheet.panels[3 * row + error]
            for number, result in enumerate(shown):
                shift = (number - 0.5 * (len(shown) - 1)) * _BESIDE * (nodes[1] - nodes[0])
                _draw_spread(
                    panel,
                    nodes + shift,
                    experiment.repeats[result.method].spread(name),
                    style_of(result.method),
                    method_title(result.method),
                )
            if name in direct:
                positions = experiment.direct.curves[name].positions  # type: ignore[union-attr]
                _draw_spread(
                    panel,
                    positions,
                    RepeatSpread(direct[name]),
                    DIRECT,
                    "Measured by using artefact",
                )
            if truth is not None:
                values = np.asarray(truth.curves[name]) * IN_MICRO
                curve(panel, nodes * IN_MILLI, values, TRUTH, TRUTH_TITLE)
            zero_line(panel)
            if row == 0:
                panel_title(panel, f"({'abc'[error]}) {name}: {direction} error as {letter} moves")
            scales(panel, f"{letter} / mm" if row == 1 else "", "error / µm" if error == 0 else "")
    heading = (
        f"Estimated and measured errors as {letter} moves"
        f" (Ibaraki & Hata 2010, Fig. {FIGURE_OF_AXIS[letter]})"
    )
    return sheet.finish(
        heading if title is None else title,
        under=[
            "mean and extremes of the repeats; above all methods, below without the conventional"
        ],
        small_print=frame_sentences(experiment.translational()),
        stamp=stamp,
    )


def angles_with_repeats(
    experiment: Experiment, *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Figure | None:
    """Draw the five angles of eqs. (24)-(28) with their uncertainty, as Fig. 10 does not.

    None where the angles are not determined: no three move orders in one alignment.

    Args:
        experiment: with repeats.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: six to draw in instead of a new figure; words stand in the last.
    """
    if "soons" not in experiment.repeats:
        return None
    result = next(one for one in experiment.report.results if one.method == "soons")
    if not all(np.all(np.isfinite(values)) for values in result.curves.values()):
        return None
    others = [
        one
        for one in experiment.report.ordered_results()
        if one.method != "soons" and any(name in one.curves for name in result.curves)
    ]
    sheet = Sheet(6, 3, 1.7, axes=axes, share_up=True, gap=(0.25, 0.95))
    style = style_of("soons")
    truth = experiment.report.truth
    for panel, name in zip(sheet.panels, result.curves, strict=False):
        nodes = result.nodes_of(name)
        values = result.curves[name] * IN_MICRO
        band(panel, nodes * IN_MILLI, values, result.standard_uncertainty[name] * IN_MICRO, style)
        spread = experiment.repeats["soons"].spread(name)
        _draw_spread(panel, nodes, spread, style, method_title("soons"))
        for other in others:
            if name in other.curves and np.any(np.isfinite(other.curves[name])):
                look = style_of(other.method)
                drawn = other.curves[name] * IN_MICRO
                curve(panel, nodes * IN_MILLI, drawn, look, method_title(other.method))
        if experiment.direct is not None and name in experiment.direct.curves:
            measured = experiment.direct.curves[name]
            from_first = RepeatSpread(measured.values - measured.values[:, :1])
            _draw_spread(panel, measured.positions, from_first, DIRECT, "Measured directly")
        if truth is not None and name in truth.curves:
            drawn = np.asarray(truth.curves[name]) * IN_MICRO
            curve(panel, nodes * IN_MILLI, drawn, TRUTH, TRUTH_TITLE)
        zero_line(panel)
        words = curve_words(name)
        if name in experiment.angles:
            size = experiment.angles[name]
            words += (
                f"\none pass over the travel:\nworst ±{size.worst_over_travel * IN_MICRO:.0f},"
                f" standard ±{size.standard_over_travel * IN_MICRO:.0f} µrad"
            )
        panel_title(panel, words)
        panel.title.set_fontsize(6.8)
        scales(panel, f"{name[3]} / mm")
    for row in (0, 3):
        scales(sheet.panels[row], up="angle / µrad")
    _not_seen(sheet.panels[5], experiment, result.not_determined[-1].split(":")[0])
    heading = "Angular errors from three orders of the moves (Ibaraki & Hata 2010, Fig. 10)"
    return sheet.finish(
        heading if title is None else title,
        under=["mean and extremes of the repeats"],
        small_print=[BAND_WORDS],
        stamp=stamp,
    )


def _not_seen(axes: Axes, experiment: Experiment, names: str) -> None:
    axes.set_axis_off()
    axes.text(
        0.0,
        0.95,
        "Not seen by step diagonals:\n"
        f"{names}\n\nDisplacement of one move:"
        f" {experiment.displacement_uncertainty * IN_MICRO:.2g} µm"
        "\n(standard uncertainty, one pass)"
        "\n\nworst: all in the worst directions,"
        "\nas Ibaraki & Hata, eq. (29), count",
        va="top",
        fontsize=LABEL_SIZE - 0.5,
        transform=axes.transAxes,
    )


def direct_comparison(
    comparison: DirectComparison, *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Figure:
    """Draw identified and directly measured curves with their 95 % bands, as KIMM Figs. 3 and 4.

    Args:
        comparison: of a result with direct measurements.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in, one for each curve, instead of a new figure.
    """
    sheet = Sheet(len(comparison.curves), _COLUMNS, 1.6, axes=axes, gap=(0.6, 0.6))
    for panel, one in zip(sheet.panels, comparison.curves, strict=True):
        _draw_comparison(panel, one, style_of(comparison.method))
    heading = (
        f"{method_title(comparison.method)} beside the direct measurement, 95 % coverage intervals"
    )
    return sheet.finish(heading if title is None else title, stamp=stamp)


def _draw_comparison(axes: Axes, one: CurveComparison, style: Style) -> None:
    path = one.positions * IN_MILLI
    band(axes, path, one.identified * IN_MICRO, one.identified_uncertainty * IN_MICRO, style)
    curve(axes, path, one.identified * IN_MICRO, style, "identified", linestyle="-")
    axes.errorbar(
        path,
        one.direct * IN_MICRO,
        yerr=np.nan_to_num(COVERAGE_FACTOR * one.direct_uncertainty * IN_MICRO),
        color=DIRECT.colour,
        marker=DIRECT.marker,
        markersize=2.6,
        linewidth=0.9,
        linestyle="--",
        capsize=2.0,
        label="measured directly",
    )
    zero_line(axes)
    known = np.abs(one.normalised_error)
    known = known[np.isfinite(known)]
    agreement = f"largest |E_n| {np.max(known):.2f}" if known.size else "uncertainty unknown"
    panel_title(axes, f"{one.name}, {agreement}")
    scales(axes, f"{one.name[3]} / mm, {one.reference}", shown_unit(one.name))
    axes.xaxis.label.set_fontsize(LABEL_SIZE - 1.0)


def _draw_spread(axes: Axes, nodes: Vector, spread: RepeatSpread, style: Style, label: str) -> None:
    """Draw the mean of repeats, and the smallest and largest value as short lines."""
    mean = spread.mean * IN_MICRO
    curve(axes, nodes * IN_MILLI, mean, style, label, linewidth=0.7, markerfacecolor="none")
    for extreme in (spread.low, spread.high):
        axes.plot(
            nodes * IN_MILLI,
            extreme * IN_MICRO,
            color=style.colour,
            marker="_",
            markersize=4.5,
            linestyle="none",
            label="_extremes",
        )
