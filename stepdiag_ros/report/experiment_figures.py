"""The figures of Ibaraki & Hata 2010 (7 to 10) and of KIMM (2 to 4), drawn from a measurement.

Marks are the mean over the repeats, short lines above and below the smallest and the largest value
of a repeat, each repeat solved alone.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from stepdiag_ros.metrology.comparison import CurveComparison, DirectComparison, in_result_frame
from stepdiag_ros.metrology.geometry import AXES, Vector, moving_axis, translation
from stepdiag_ros.metrology.repeats import Spread, line_errors
from stepdiag_ros.report.content import frame_sentences, method_title
from stepdiag_ros.report.experiment import Experiment
from stepdiag_ros.report.figures import OTHER, STYLES, Style, legend_below, new_picture, tidy
from stepdiag_ros.report.numbers import COVERAGE_FACTOR, MICRO

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture

_MILLI = 1e3
_DIRECT = Style("#000000", "D", "-")
_TRUTH = Style("#666666", "x", ":")
_FIGURE_OF_AXIS = {"X": 7, "Y": 8, "Z": 9}
_BESIDE = 0.12
"""Shift between the methods' marks, in node distances, so that they do not hide one another."""
_COLUMNS = 3


def draw_experiment(experiment: Experiment) -> "dict[str, Picture]":
    """Return the pictures by the name of their file without ending."""
    pictures: dict[str, Picture] = {}
    if experiment.repeats:
        for letter in AXES:
            name = f"figure_{_FIGURE_OF_AXIS[letter]}_motion_of_{letter.lower()}"
            pictures[name] = motion_picture(experiment, letter)
        angles = angles_picture(experiment)
        if angles is not None:
            pictures["figure_10_angles"] = angles
        pictures["line_errors"] = line_errors_picture(experiment)
    chosen = experiment.comparison_to_draw()
    if chosen is not None:
        pictures["direct_comparison"] = comparison_picture(chosen)
    return pictures


def motion_picture(experiment: Experiment, letter: str) -> "Picture":
    """Draw the three errors as one axis moves, as Figs. 7 to 9 do (a column each).

    Above with the conventional estimate, which setup errors may carry far away; below without it.
    """
    axis = AXES.index(letter)
    picture = new_picture(11.0, 7.6)
    grid = picture.subplots(2, 3, sharex=True, squeeze=False)
    methods = [
        result.method
        for result in experiment.translational()
        if result.method in experiment.repeats
    ]
    direct = {} if experiment.direct is None else in_result_frame(experiment.direct)
    truth = experiment.report.truth
    nodes = experiment.translational()[0].nodes[axis]
    for error, direction in enumerate(AXES):
        name = translation(error, axis)
        for row, shown in enumerate((methods, [m for m in methods if m != "conventional"])):
            axes = grid[row][error]
            for number, method in enumerate(shown):
                shift = (number - 0.5 * (len(shown) - 1)) * _BESIDE * (nodes[1] - nodes[0])
                _draw_spread(
                    axes,
                    nodes + shift,
                    experiment.repeats[method].spread(name),
                    STYLES.get(method, OTHER),
                    method_title(method),
                )
            if name in direct:
                positions = experiment.direct.curves[name].positions  # type: ignore[union-attr]
                _draw_spread(
                    axes, positions, Spread(direct[name]), _DIRECT, "Measured by using artefact"
                )
            if truth is not None:
                _draw_truth(axes, nodes, np.asarray(truth.curves[name]))
            _finish(axes)
            if row == 0:
                axes.set_title(
                    f"({'abc'[error]}) {name}: {direction} error as {letter} moves", fontsize=9
                )
            else:
                axes.set_xlabel(f"{letter} / mm", fontsize=9)
            if error == 0:
                axes.set_ylabel("error / µm", fontsize=9)
    picture.suptitle(
        f"Estimated and measured errors as {letter} moves"
        f" (Ibaraki & Hata 2010, Fig. {_FIGURE_OF_AXIS[letter]})\n"
        "mean and extremes of the repeats; above all methods, below without the conventional one",
        fontsize=11,
    )
    legend_below(picture, grid.ravel(), frame_sentences(experiment.translational()))
    return picture


def angles_picture(experiment: Experiment) -> "Picture | None":
    """Draw the five angles of eqs. (24)-(28) with their uncertainty, as Fig. 10 does not.

    None where the angles are not determined: no three move orders in one alignment.
    """
    if "soons" not in experiment.repeats:
        return None
    result = next(one for one in experiment.report.results if one.method == "soons")
    if not all(np.all(np.isfinite(curve)) for curve in result.curves.values()):
        return None
    others = [
        one
        for one in experiment.report.ordered_results()
        if one.method != "soons" and any(name in one.curves for name in result.curves)
    ]
    picture = new_picture(11.0, 7.2)
    grid = picture.subplots(2, 3, squeeze=False, sharey=True)
    style = STYLES["soons"]
    for axes, name in zip(grid.ravel(), result.curves, strict=False):
        nodes = result.nodes[moving_axis(name)]
        band = COVERAGE_FACTOR * result.standard_uncertainty[name] * MICRO
        value = result.curves[name] * MICRO
        axes.fill_between(
            nodes * _MILLI,
            value - band,
            value + band,
            color=style.colour,
            alpha=0.25,
            linewidth=0,
            label="95 % of the mean",
        )
        spread = experiment.repeats["soons"].spread(name)
        _draw_spread(axes, nodes, spread, style, method_title("soons"))
        for other in others:
            if name in other.curves and np.any(np.isfinite(other.curves[name])):
                drawn = STYLES.get(other.method, OTHER)
                axes.plot(
                    nodes * _MILLI,
                    other.curves[name] * MICRO,
                    color=drawn.colour,
                    linestyle=drawn.line,
                    linewidth=1.2,
                    label=method_title(other.method),
                )
        if experiment.direct is not None and name in experiment.direct.curves:
            curve = experiment.direct.curves[name]
            values = Spread(curve.values - curve.values[:, :1])
            _draw_spread(axes, curve.positions, values, _DIRECT, "Measured directly")
        truth = experiment.report.truth
        if truth is not None and name in truth.curves:
            _draw_truth(axes, nodes, np.asarray(truth.curves[name]))
        _finish(axes)
        title = f"{name}: rotation about {'XYZ'['ABC'.index(name[2])]} as {name[3]} moves"
        if name in experiment.angles:
            size = experiment.angles[name]
            title += (
                f"\none pass, travel: worst ±{size.worst_over_travel * MICRO:.0f}, standard"
                f" ±{size.standard_over_travel * MICRO:.0f} µrad"
            )
        axes.set_title(title, fontsize=8.5)
        axes.set_xlabel(f"{name[3]} / mm", fontsize=9)
    for row in grid:
        row[0].set_ylabel("angle / µrad", fontsize=9)
    grid[1][2].set_axis_off()
    grid[1][2].text(
        0.0,
        0.95,
        "Not seen by step diagonals:\n"
        + result.not_determined[-1].split(":")[0]
        + f"\n\nDisplacement of one move: {experiment.displacement_uncertainty * MICRO:.2g} µm"
        + "\n(standard uncertainty, one pass)"
        + "\n\nworst: all in the worst directions,"
        + "\nas Ibaraki & Hata, eq. (29), count",
        va="top",
        fontsize=9,
        transform=grid[1][2].transAxes,
    )
    picture.suptitle(
        "Angular errors from three orders of the moves (Ibaraki & Hata 2010, Fig. 10)\n"
        "mean and extremes of the repeats",
        fontsize=11,
    )
    legend_below(picture, grid.ravel()[:5])
    return picture


def line_errors_picture(experiment: Experiment) -> "Picture":
    """Draw what every line reads beyond its nominal displacement, as KIMM Fig. 2 does."""
    lines = line_errors(experiment.measurement)
    rows = -(-len(lines) // 4)
    picture = new_picture(11.0, 1.4 + 2.3 * rows)
    grid = picture.subplots(rows, min(4, len(lines)), squeeze=False)
    for number, axes in enumerate(grid.ravel()):
        if number >= len(lines):
            axes.set_visible(False)
            continue
        line = lines[number]
        for errors in line.errors:
            axes.plot(line.path * _MILLI, errors * MICRO, color="#0072B2", linewidth=0.7)
        axes.plot(
            line.path * _MILLI,
            np.mean(line.errors, axis=0) * MICRO,
            color="#000000",
            linewidth=1.2,
            label="mean of all passes",
        )
        _finish(axes)
        axes.set_title(line.name, fontsize=9)
        if number % 4 == 0:
            axes.set_ylabel("error / µm", fontsize=9)
        if number + 4 >= len(lines):
            axes.set_xlabel("along the beam / mm", fontsize=9)
    picture.suptitle(
        "What each line reads beyond its nominal displacement, setup errors included\n"
        "(KIMM, Fig. 2; each pass from its first stop)",
        fontsize=11,
    )
    legend_below(picture, grid.ravel())
    return picture


def comparison_picture(comparison: DirectComparison) -> "Picture":
    """Draw identified and directly measured curves with their 95 % bands, as KIMM Figs. 3 and 4."""
    count = len(comparison.curves)
    columns = min(_COLUMNS, count)
    rows = -(-count // columns)
    picture = new_picture(max(4.0 * columns, 6.5), 1.6 + 2.9 * rows)
    grid = picture.subplots(rows, columns, squeeze=False)
    for number, axes in enumerate(grid.ravel()):
        if number >= count:
            axes.set_visible(False)
            continue
        _draw_comparison(axes, comparison.curves[number], comparison.method)
    picture.suptitle(
        f"{method_title(comparison.method)} beside the direct measurement, 95 % bands", fontsize=11
    )
    legend_below(picture, grid.ravel())
    return picture


def _draw_comparison(axes: "Axes", curve: CurveComparison, method: str) -> None:
    style = STYLES.get(method, OTHER)
    path = curve.positions * _MILLI
    value = curve.identified * MICRO
    band = COVERAGE_FACTOR * curve.identified_uncertainty * MICRO
    axes.fill_between(path, value - band, value + band, color=style.colour, alpha=0.2, linewidth=0)
    axes.plot(
        path,
        value,
        color=style.colour,
        marker=style.marker,
        markersize=3.5,
        linewidth=1.2,
        label="identified",
    )
    axes.errorbar(
        path,
        curve.direct * MICRO,
        yerr=np.nan_to_num(COVERAGE_FACTOR * curve.direct_uncertainty * MICRO),
        color=_DIRECT.colour,
        marker=_DIRECT.marker,
        markersize=3.0,
        linewidth=0.9,
        linestyle="--",
        capsize=2.0,
        label="measured directly",
    )
    _finish(axes)
    known = np.abs(curve.normalised_error)
    known = known[np.isfinite(known)]
    agreement = f"largest |E_n| {np.max(known):.2f}" if known.size else "uncertainty unknown"
    axes.set_title(f"{curve.name}, {agreement}", fontsize=9)
    axes.set_xlabel(f"{curve.name[3]} / mm, {curve.reference}", fontsize=8)
    axes.set_ylabel("µrad" if curve.unit == "rad" else "µm", fontsize=9)


def _draw_spread(axes: "Axes", nodes: Vector, spread: Spread, style: Style, label: str) -> None:
    mean = spread.mean * MICRO
    reach = np.stack([spread.mean - spread.low, spread.high - spread.mean]) * MICRO
    marks: dict[str, Any] = {"color": style.colour, "marker": style.marker}
    axes.errorbar(
        nodes * _MILLI,
        mean,
        yerr=np.maximum(reach, 0.0),
        **marks,
        markersize=3.5,
        markerfacecolor="none",
        linestyle="none",
        elinewidth=0.0,
        capsize=2.5,
        capthick=0.9,
        label=label,
    )
    axes.plot(nodes * _MILLI, mean, color=style.colour, linestyle=style.line, linewidth=0.7)


def _draw_truth(axes: "Axes", nodes: Vector, values: Vector) -> None:
    axes.plot(
        nodes * _MILLI,
        values * MICRO,
        color=_TRUTH.colour,
        linestyle=_TRUTH.line,
        marker=_TRUTH.marker,
        markersize=4.0,
        linewidth=1.2,
        label="Truth (simulated cell)",
    )


def _finish(axes: "Axes") -> None:
    tidy(axes)
    axes.axhline(0.0, color="0.55", linewidth=0.7, zorder=1)
