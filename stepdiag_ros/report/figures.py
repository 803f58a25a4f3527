"""The pictures of a report, drawn without any global state of matplotlib.

Colours are those of Okabe and Ito, which people with any colour vision can tell apart; markers and
line styles differ too, so that a black-and-white print can be read.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, ROTATIONS, SQUARENESS, Vector, translation
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors
from stepdiag_ros.report.content import (
    ZERO_BY_DEFINITION,
    Report,
    frame_sentences,
    method_title,
)
from stepdiag_ros.report.numbers import COVERAGE_FACTOR, MICRO, plain, plus_minus
from stepdiag_ros.report.squareness import AXES_OF, SIGN_DEFINITIONS, SignDefinition, sign

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture

_MILLI = 1e3
_DOTS_PER_INCH = 150
_SMALL_PRINT_WIDTH = 170


@dataclass(frozen=True)
class Style:
    """How one method is drawn."""

    colour: str
    marker: str
    line: str


STYLES = {
    "conventional": Style("#CC79A7", "s", "-."),
    "setup_robust": Style("#D55E00", "o", "--"),
    "alternative": Style("#E69F00", "v", "--"),
    "soons": Style("#56B4E9", "P", "-."),
    "rigid_body": Style("#009E73", "D", "-"),
    "least_squares": Style("#0072B2", "^", "-"),
}
OTHER = Style("#666666", "D", "-")
_TRUTH = Style("#000000", "x", ":")


def new_picture(width: float, height: float) -> "Picture":
    """Return an empty picture of a size in inches, without any global state of matplotlib."""
    from matplotlib.figure import Figure as Picture

    return Picture(figsize=(width, height), dpi=_DOTS_PER_INCH, layout="constrained")


def tidy(axes: "Axes") -> None:
    """Give a panel the look of the house: a light grid and no frame above and to the right."""
    axes.grid(True, color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _subtitle(report: Report) -> str:
    parts = [report.plan, f"run {report.run_id}" if report.run_id else ""]
    return ", ".join(part for part in parts if part)


def _draw_curve(axes: "Axes", result: VolumetricErrors, name: str, nodes: Vector) -> bool:
    style = STYLES.get(result.method, OTHER)
    values = result.curves[name] * MICRO
    uncertainty = result.standard_uncertainty[name]
    # What the frame fixes, such as the zero at the first node, says nothing about the machine.
    measured = np.isfinite(values) & ~(uncertainty <= ZERO_BY_DEFINITION)
    if not np.any(measured):
        return False
    band = COVERAGE_FACTOR * uncertainty * MICRO
    axes.fill_between(
        nodes, values - band, values + band, color=style.colour, alpha=0.2, linewidth=0
    )
    axes.plot(
        nodes,
        values,
        color=style.colour,
        linestyle=style.line,
        marker=style.marker,
        markersize=3.5,
        linewidth=1.2,
        label=method_title(result.method),
    )
    return True


def curves_picture(report: Report, with_conventional: bool) -> "Picture":
    """Draw the nine translations with their 95 % bands, and the truth where it is known.

    Columns are the axis that moves, rows the direction of the error.

    Args:
        report: what is drawn.
        with_conventional: the conventional result, which setup errors can make a hundred times
            larger than the rest, is drawn too and sets the scale.
    """
    results = [
        result
        for result in report.ordered_results()
        if with_conventional or result.method != "conventional"
    ]
    return _nine_panels(report, results, rotations=False)


def rotations_picture(report: Report) -> "Picture | None":
    """Draw the nine rotations with their 95 % bands; None if no curve of any method is determined.

    Columns are the axis that moves, rows the axis about which it turns.
    """
    results = [
        result
        for result in report.ordered_results()
        if any(
            name in ROTATIONS and np.all(np.isfinite(curve))
            for name, curve in result.curves.items()
        )
    ]
    return _nine_panels(report, results, rotations=True) if results else None


def _nine_panels(report: Report, results: list[VolumetricErrors], rotations: bool) -> "Picture":
    unit = "µrad" if rotations else "µm"
    results = [
        result
        for result in results
        if any((name in ROTATIONS) == rotations for name in result.curves)
    ]
    picture = new_picture(11.0, 8.6)
    grid = picture.subplots(3, 3, sharex="col", squeeze=False)
    for axis, letter in enumerate(AXES):
        for error, direction in enumerate(AXES):
            axes = grid[error][axis]
            name = ROTATIONS[3 * axis + error] if rotations else translation(error, axis)
            drawn = False
            for result in results:
                if name in result.curves:
                    drawn |= _draw_curve(axes, result, name, result.nodes[axis] * _MILLI)
            if report.truth is not None and results and name in report.truth.curves:
                axes.plot(
                    results[-1].nodes[axis] * _MILLI,
                    np.asarray(report.truth.curves[name]) * MICRO,
                    color=_TRUTH.colour,
                    linestyle=_TRUTH.line,
                    marker=_TRUTH.marker,
                    markersize=4.0,
                    linewidth=1.2,
                    label="Truth (simulated cell)",
                )
            tidy(axes)
            axes.axhline(0.0, color="0.55", linewidth=0.7, zorder=1)
            what = f"rotation about {direction}" if rotations else f"{direction} error"
            axes.set_title(f"{name}: {what} as {letter} moves", fontsize=9)
            if not drawn:
                axes.text(
                    0.5,
                    0.5,
                    "not determined",
                    transform=axes.transAxes,
                    ha="center",
                    va="center",
                    color="0.3",
                    bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85},
                    zorder=5,
                )
            if axis == 0:
                axes.set_ylabel(f"error / {unit}", fontsize=9)
            if error == 2:
                axes.set_xlabel(f"{letter} / mm", fontsize=9)
    kind = "Rotations" if rotations else "Translational errors"
    _title(picture, f"{kind} of the three axes with 95 % bands", report)
    legend_below(picture, grid.ravel(), frame_sentences(results))
    return picture


def _title(picture: "Picture", title: str, report: Report, *more: str) -> None:
    lines = [title, _subtitle(report), *more]
    picture.suptitle("\n".join(line for line in lines if line), fontsize=11)


def legend_below(picture: "Picture", panels: Any, small_print: Sequence[str] = ()) -> None:
    """Put one legend of all panels below them, each label once, with sentences above it."""
    entries: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    if entries:
        picture.legend(
            list(entries.values()),
            list(entries),
            loc="outside lower center",
            ncols=min(4, len(entries)),
            fontsize=9,
            frameon=False,
            title="\n".join(fill(sentence, _SMALL_PRINT_WIDTH) for sentence in small_print),
            title_fontsize=8,
        )


_PLANES = {
    "C0Y": "seen from +Z",
    "B0Z": "seen from −Y",
    "A0Z": "seen from +X",
}
_LEANS_TO_MINUS = {"C0Y": 1.0, "B0Z": -1.0, "A0Z": 1.0}
"""A right-handed rotation leans the drawing's vertical axis to the left (+1) or right (-1)."""
_DRAWN_ANGLE = np.radians(14.0)


def _find(figures: tuple[Figure, ...], name: str) -> Figure | None:
    return next((figure for figure in figures if figure.name == name), None)


def _angles(figures: tuple[Figure, ...]) -> list[float]:
    """Return the sizes of the squareness figures that are known, rad."""
    found = (_find(figures, name) for name in SQUARENESS)
    return [abs(one.value) for one in found if one is not None and np.isfinite(one.value)]


def squareness_picture(report: Report, definition: SignDefinition = "rotation") -> "Picture":
    """Draw the three squareness errors as they are on the machine, the angles greatly exaggerated.

    The conventional result is given in figures but not drawn: its setup errors would hide the rest.
    """
    drawn = [r for r in report.ordered_results() if r.method != "conventional"]
    drawn = drawn or list(report.ordered_results())
    known = [figures for figures in (result.figures for result in drawn) if _angles(figures)]
    if not known and report.truth is not None:
        known = [report.truth.figures]
    largest = max((angle for figures in known for angle in _angles(figures)), default=0.0)
    exaggeration = _DRAWN_ANGLE / largest if largest > 0 else 1.0
    picture = new_picture(11.0, 5.2)
    panels = picture.subplots(1, 3, squeeze=False)[0]
    for axes, name in zip(panels, SQUARENESS, strict=True):
        _draw_square(axes, name)
        for result in drawn:
            figure = _find(result.figures, name)
            if figure is not None and np.isfinite(figure.value):
                lean = _LEANS_TO_MINUS[name] * figure.value * exaggeration
                style = STYLES.get(result.method, OTHER)
                axes.plot(
                    [0.0, -np.sin(lean)],
                    [0.0, np.cos(lean)],
                    color=style.colour,
                    linestyle=style.line,
                    marker=style.marker,
                    markevery=[1],
                    linewidth=1.8,
                    label=method_title(result.method),
                )
        true = None if report.truth is None else _find(report.truth.figures, name)
        if true is not None and np.isfinite(true.value):
            lean = _LEANS_TO_MINUS[name] * true.value * exaggeration
            axes.plot(
                [0.0, -np.sin(lean)],
                [0.0, np.cos(lean)],
                color=_TRUTH.colour,
                linestyle=_TRUTH.line,
                marker=_TRUTH.marker,
                markevery=[1],
                linewidth=1.5,
                label="Truth (simulated cell)",
            )
        axes.text(
            0.5,
            -0.02,
            "\n".join(_squareness_words(report, drawn, name, definition)),
            transform=axes.transAxes,
            ha="center",
            va="top",
            fontsize=8.5,
        )
    _title(
        picture,
        f"Squareness, angles drawn {_round_factor(exaggeration)} times larger",
        report,
        f"sign of the figures: {SIGN_DEFINITIONS[definition]}",
    )
    legend_below(picture, panels, frame_sentences(drawn))
    return picture


def _round_factor(factor: float) -> str:
    return f"{float(f'{factor:.2g}'):,.0f}"


def _draw_square(axes: "Axes", name: str) -> None:
    reference, other = AXES_OF[name]
    black = {"arrowstyle": "-|>", "color": "0.2", "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=(1.05, 0.0), xytext=(0.0, 0.0), arrowprops=black)
    axes.plot([0.0, 0.0], [0.0, 1.1], color="0.6", linewidth=0.8, linestyle=(0, (4, 3)))
    axes.plot([0.0, 0.08, 0.08], [0.08, 0.08, 0.0], color="0.6", linewidth=0.8)
    axes.text(1.1, 0.0, f"+{reference}", ha="left", va="center", fontsize=10)
    axes.text(0.0, 1.13, f"+{other}", ha="center", va="bottom", fontsize=10)
    axes.set_title(f"{name}: {other} to {reference} ({_PLANES[name]})", fontsize=9.5)
    axes.set_xlim(-0.55, 1.3)
    axes.set_ylim(-0.06, 1.22)
    axes.set_aspect("equal")
    axes.set_axis_off()


def _squareness_words(
    report: Report, drawn: list[VolumetricErrors], name: str, definition: SignDefinition
) -> list[str]:
    factor = sign(name, definition)
    lines = []
    for result in report.ordered_results():
        figure = _find(result.figures, name)
        if figure is not None:
            written = plus_minus(factor * figure.value, figure.standard_uncertainty, MICRO)
            unit = " µm/m" if np.isfinite(figure.value) else ""
            hidden = "" if any(result is one for one in drawn) else " (not drawn)"
            lines.append(f"{method_title(result.method)}: {written}{unit}{hidden}")
    true = None if report.truth is None else _find(report.truth.figures, name)
    if true is not None:
        lines.append(f"Truth (simulated cell): {plain(factor * true.value * MICRO)} µm/m")
    return lines


def lines_picture(report: Report) -> "Picture | None":
    """Draw how well the passes of each line repeat; None without lines.

    Each panel is one setup (one alignment and zero): every pass less the mean of all passes at the
    same stop, so that noise, drift, and the difference between forward and backward show alone.
    """
    measurement = report.measurement
    if measurement is None or not measurement.lines:
        return None
    setups = list(dict.fromkeys(line.setup for line in measurement.lines))
    columns = min(4, len(setups))
    rows = -(-len(setups) // columns)
    picture = new_picture(11.0, 1.2 + 2.3 * rows)
    grid = picture.subplots(rows, columns, sharey=True, squeeze=False)
    for number, axes in enumerate(grid.ravel()):
        if number >= len(setups):
            axes.set_visible(False)
            continue
        _draw_setup(axes, [line for line in measurement.lines if line.setup == setups[number]])
        axes.set_title(setups[number], fontsize=9)
        if number % columns == 0:
            axes.set_ylabel("from mean / µm", fontsize=9)
        if number + columns >= len(setups):
            axes.set_xlabel("stop", fontsize=9)
    _title(picture, "Repeatability: every pass less the mean of all passes of its setup", report)
    legend_below(picture, grid.ravel())
    return picture


_FORWARD = Style("#0072B2", "^", "-")
_BACKWARD = Style("#E69F00", "v", "--")


def _draw_setup(axes: "Axes", lines: list[Any]) -> None:
    passes = [
        line.displacement if line.line.direction == "forward" else line.displacement[::-1]
        for line in lines
    ]
    longest = max(len(values) for values in passes)
    table = np.full((len(passes), longest), np.nan)
    for row, values in zip(table, passes, strict=True):
        row[: len(values)] = values
    known = np.isfinite(table)
    counts = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, table, 0.0).sum(axis=0) / counts
    for line, row in zip(lines, table, strict=True):
        forward = line.line.direction == "forward"
        style = _FORWARD if forward else _BACKWARD
        axes.plot(
            np.arange(longest),
            (row - mean) * MICRO,
            color=style.colour,
            linestyle=style.line,
            marker=style.marker,
            markersize=2.0,
            linewidth=0.9,
            label="forward" if forward else "backward",
        )
    tidy(axes)
    axes.axhline(0.0, color="0.55", linewidth=0.7, zorder=1)


def draw_all(report: Report, definition: SignDefinition = "rotation") -> "dict[str, Picture]":
    """Return all pictures of a report by the name of their file without ending."""
    pictures: dict[str, Picture] = {}
    methods = {result.method for result in report.results}
    if methods - {"conventional"}:
        pictures["error_curves"] = curves_picture(report, with_conventional=False)
    if "conventional" in methods:
        pictures["error_curves_with_conventional"] = curves_picture(report, with_conventional=True)
    rotations = rotations_picture(report)
    if rotations is not None:
        pictures["rotations"] = rotations
    if methods:
        pictures["squareness"] = squareness_picture(report, definition)
    repeatability = lines_picture(report)
    if repeatability is not None:
        pictures["repeatability"] = repeatability
    return pictures


def save(picture: "Picture", path: Path) -> None:
    """Write a picture in the format of the path's ending: png, svg or pdf.

    Raises:
        ValueError: another ending.
        OSError: the file cannot be written.
    """
    if path.suffix not in (".png", ".svg", ".pdf"):
        raise ValueError(f"{path.name}: pictures are written as .png, .svg or .pdf")
    picture.savefig(path)
