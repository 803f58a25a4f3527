#!/usr/bin/env python3
"""Makes the picture of the front page: ``python docs/drawings/front.py RUN.mcap``.

The run is one of a simulated machine that has backlash of X beside its error curves:
``stepdiag run --cell hidden_backlash --factor 30``. The gap map and the error curves are those of
``stepdiag diagnose``; the true curves are those of the cell, which no estimator sees.
"""

import io
import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from stepdiag_ros import diagnose, open_run, plots
from stepdiag_ros.configuration import load_cell
from stepdiag_ros.evaluation.diagnosis import DiagnosisReport
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.plots.panel import Panel
from stepdiag_ros.plots.style import AFTER, BEFORE

PICTURE = Path(__file__).parents[1] / "_static" / "front.png"
CELL = "hidden_backlash"
WIDTH, HEIGHT = 7.4, 5.5
"""Inches."""
DOTS_PER_INCH = 200
CURVES = ("E_XX", "E_YX", "E_ZX")


def panel(figure: Figure, left: float, low: float, width: float, height: float) -> Axes:
    """Return an empty panel at a place in inches."""
    place = (left / WIDTH, low / HEIGHT, width / WIDTH, height / HEIGHT)
    return figure.add_axes(place, axes_class=Panel)


def heading(figure: Figure, low: float, text: str) -> None:
    """Write a heading at a height in inches."""
    figure.text(0.1 / WIDTH, low / HEIGHT, text, fontsize=9.5, fontweight="bold")


def draw_gap(figure: Figure, report: DiagnosisReport) -> None:
    """Draw what the model does not explain, stop by stop, before and after."""
    left, right = panel(figure, 0.85, 2.75, 2.75, 2.1), panel(figure, 3.75, 2.75, 2.75, 2.1)
    right.sharey(left)
    plots.gap_map(report.diagnosis, title="", axes=[left, right])
    stops = report.diagnosis.stops
    names = [line.name for line in stops.lines]
    firsts = [row for row, name in enumerate(names) if row == 0 or names[row - 1] != name]
    left.set_yticks(
        [row + names.count(names[row]) / 2 - 0.5 for row in firsts], [names[row] for row in firsts]
    )
    left.tick_params(axis="y", labelsize=8.0)
    right.tick_params(labelleft=False)
    mesh = left.collections[0]
    low, high = mesh.get_clim()
    scale = figure.add_axes((6.62 / WIDTH, 2.85 / HEIGHT, 0.12 / WIDTH, 1.9 / HEIGHT))
    bar = figure.colorbar(mesh, cax=scale, extend="both", ticks=[low, 0.0, high])
    # With the minus of the scales beside it.
    labels = [f"{value:.1f}".replace("-", "−") for value in (low, 0.0, high)]
    bar.ax.set_yticklabels(labels, fontsize=7.5)
    bar.set_label("gap / µm", fontsize=8.0)


def draw_curves(figure: Figure, report: DiagnosisReport, plan: Plan) -> None:
    """Draw error curves with the effect left out and with it, beside the true ones."""
    assert report.curves is not None
    before, after = report.curves
    axes = [panel(figure, 0.55 + 2.33 * count, 0.7, 1.9, 1.2) for count in range(len(CURVES))]
    plots.curves_before_after(before, after, CURVES, title="", axes=axes)
    truth = load_cell(CELL)[0].truth(plan.volume)
    for one, name in zip(axes, CURVES, strict=True):
        nodes = after.nodes_of(name) * 1e3
        one.plot(nodes, np.asarray(truth[name]) * 1e6, "x", color="black", ms=4.5, zorder=9)
    labels = (
        (BEFORE.colour, BEFORE.marker, BEFORE.line, "backlash left out"),
        (AFTER.colour, AFTER.marker, AFTER.line, "backlash in the model, with 95 % bands"),
        ("black", "x", "none", "true error of the simulated machine"),
    )
    lines = [
        axes[0].plot([], [], color=colour, marker=marker, ms=4.5, ls=style, label=label)[0]
        for colour, marker, style, label in labels
    ]
    place = (0.5, 0.02 / HEIGHT)
    figure.legend(
        handles=lines,
        loc="lower center",
        bbox_to_anchor=place,
        ncols=3,
        fontsize=7.5,
        frameon=False,
    )


def main(bag: Path) -> int:
    """Write the picture of a run."""
    run = open_run(bag)
    report = diagnose(run)
    figure = Figure(figsize=(WIDTH, HEIGHT), facecolor="white")
    heading(
        figure,
        5.25,
        "Gap map (measured minus modelled), before and after the diagnosis names backlash of X",
    )
    draw_gap(figure, report)
    heading(figure, 2.22, "Error curves of the same run, before and after")
    draw_curves(figure, report, run.plan)
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=DOTS_PER_INCH)
    with Image.open(drawn) as image:
        image.convert("RGB").save(PICTURE, optimize=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
