#!/usr/bin/env python3
"""Makes the drawings of the explanation: ``python docs/drawings/draw.py`` writes the SVG files.

The drawings with figures in them are computed by the package; nothing is drawn by eye. Colours can
be told apart by the colour-blind, and line styles in grey print.
"""

import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Polygon, Rectangle

from stepdiag_ros.configuration import load_cell, load_plan, plan_from_text
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.solvers.verdicts import CONFOUNDED, DETERMINED, INVISIBLE, PARTLY
from stepdiag_ros.metrology.visibility import visibility

FOLDER = Path(__file__).parent
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"
COLOURS = {"X": BLUE, "Y": ORANGE, "Z": GREEN}
STYLES = {"X": "-", "Y": "--", "Z": ":"}
LOOK = {
    "font.family": "sans-serif",
    "font.size": 11.0,
    "svg.fonttype": "none",
    "svg.hashsalt": "stepdiag_ros",
    "axes.spines.top": False,
    "axes.spines.right": False,
}


def sheet(width: float, height: float, columns: int = 1) -> tuple[Figure, list[Axes]]:
    """Return a figure with empty panels of equal scale in both directions.

    Args:
        width: of the figure, inches.
        height: of the figure, inches.
        columns: number of panels, side by side.
    """
    figure = Figure(figsize=(width, height), facecolor="white")
    panels = [
        figure.add_axes(((column + 0.01) / columns, 0.02, 0.98 / columns, 0.96))
        for column in range(columns)
    ]
    for panel in panels:
        panel.set_axis_off()
        panel.set_aspect("equal")
    return figure, panels


def arrow(
    axes: Axes,
    start: tuple[float, float],
    end: tuple[float, float],
    colour: str = "black",
    style: str = "-",
    width: float = 2.0,
    heads: str = "-|>",
) -> None:
    """Draw an arrow."""
    axes.add_patch(
        FancyArrowPatch(
            start,
            end,
            arrowstyle=heads,
            mutation_scale=14,
            color=colour,
            linestyle=style,
            linewidth=width,
            shrinkA=0,
            shrinkB=0,
        )
    )


def words(axes: Axes, x: float, y: float, text: str, colour: str = "black", **more: object) -> None:
    """Write a text, in the middle of its place unless said otherwise."""
    axes.text(x, y, text, color=colour, **{"ha": "center", "va": "center", **more})


def plate(axes: Axes, x: float, y: float, normal: tuple[float, float], half: float) -> None:
    """Draw a flat mirror that looks against its normal.

    Args:
        axes: on which.
        x: of its middle.
        y: of its middle.
        normal: unit vector away from the laser.
        half: half of its length.
    """
    along = np.array([-normal[1], normal[0]]) * half
    depth = np.array(normal) * half * 0.16
    middle = np.array([x, y])
    corners = [middle - along, middle + along, middle + along + depth, middle - along + depth]
    axes.add_patch(Polygon(corners, facecolor="#D9D9D9", edgecolor="black", linewidth=1.2))


def laser(axes: Axes, x: float, y: float, angle: float) -> None:
    """Draw a laser head whose beam leaves at a place under an angle (degrees)."""
    turned = mpl.transforms.Affine2D().rotate_deg_around(x, y, angle) + axes.transData
    body = Rectangle((x - 1.1, y - 0.25), 1.1, 0.5, facecolor="#444444", edgecolor="black")
    body.set_transform(turned)
    axes.add_patch(body)


def staircase(steps: int, a: float, b: float, order: str = "XY") -> np.ndarray:
    """Return the corners of a step diagonal in a plane, shape (2 steps + 1, 2)."""
    corners = [np.zeros(2)]
    moves = {"X": np.array([a, 0.0]), "Y": np.array([0.0, b])}
    for _ in range(steps):
        for axis in order:
            corners.append(corners[-1] + moves[axis])
    return np.array(corners)


def six_errors() -> Figure:
    """The six error motions of one axis."""
    figure, (left, right) = sheet(9.6, 3.3, 2)
    for panel in (left, right):
        panel.set_xlim(-3.9, 3.7)
        panel.set_ylim(-2.2, 2.6)
        arrow(panel, (-3.0, -1.3), (3.2, -1.3), GREY, width=1.2)
        words(panel, 3.4, -1.3, "X", GREY)
        panel.add_patch(Rectangle((-0.9, -0.9), 1.8, 1.3, facecolor="#EFEFEF", edgecolor="black"))
        words(panel, 0.0, -1.75, "the carriage of X, moved along X", GREY)
    arrow(left, (0.9, -0.25), (2.3, -0.25), BLUE)
    words(left, 2.4, 0.1, "E_XX", BLUE)
    words(left, 2.4, -0.62, "positioning", BLUE)
    arrow(left, (0.0, 0.4), (0.0, 1.7), GREEN, ":")
    words(left, 0.0, 2.15, "E_ZX  straightness, up", GREEN)
    arrow(left, (-0.5, 0.05), (-1.5, 0.75), ORANGE, "--")
    words(left, -2.1, 1.15, "E_YX  straightness,\naway from you", ORANGE)
    for x, y, text, colour, style in (
        (2.0, -0.25, "E_AX\nroll", BLUE, "-"),
        (-1.85, 0.55, "E_BX\npitch", ORANGE, "--"),
        (0.0, 1.25, "E_CX\nyaw", GREEN, ":"),
    ):
        right.add_patch(
            FancyArrowPatch(
                (x - 0.42, y - 0.3),
                (x + 0.42, y - 0.3),
                connectionstyle="arc3,rad=-1.3",
                arrowstyle="-|>",
                mutation_scale=13,
                color=colour,
                linestyle=style,
                linewidth=2.0,
            )
        )
        words(right, x, y + 0.75, text, colour)
    return figure


def two_ways() -> Figure:
    """A diagonal in one move, and the same diagonal in steps."""
    figure, panels = sheet(9.0, 4.3, 2)
    steps, a, b = 4, 1.15, 0.85
    path = staircase(steps, a, b)
    beam = path[-1] / np.linalg.norm(path[-1])
    angle = np.degrees(np.arctan2(beam[1], beam[0]))
    for panel, title in zip(
        panels, ("Diagonal: all axes at once", "Step diagonal: one axis at a time"), strict=True
    ):
        panel.set_xlim(-2.0, 7.4)
        panel.set_ylim(-1.5, 5.6)
        panel.add_patch(
            Rectangle((0, 0), steps * a, steps * b, fill=False, edgecolor=GREY, linewidth=1.0)
        )
        laser(panel, -0.5 * beam[0], -0.5 * beam[1], angle)
        panel.plot(
            [-0.5 * beam[0], path[-1, 0]], [-0.5 * beam[1], path[-1, 1]], color="#CC0000", lw=1.2
        )
        words(panel, 2.1, 5.2, title, weight="bold")
        words(panel, 2.1, -1.2, "laser beam", "#CC0000")
    for k in range(steps + 1):
        panels[0].plot(*(k * np.array([a, b])), "o", color="black", ms=6)
    plate(panels[0], path[-1, 0], path[-1, 1], tuple(beam), 0.5)
    words(panels[0], 5.1, 2.9, "mirror", ha="left", fontsize=9)
    panel = panels[1]
    for k, (one, two) in enumerate(pairwise(path)):
        axis = "XY"[k % 2]
        arrow(panel, tuple(one), tuple(two), COLOURS[axis], STYLES[axis])
    panel.plot(path[:, 0], path[:, 1], "o", color="black", ms=6)
    plate(panel, path[-1, 0], path[-1, 1], tuple(beam), 1.1)
    words(panel, 4.8, 1.8, "a larger mirror:\nit moves across\nthe beam", ha="left", fontsize=9)
    words(panel, 0.55, -0.35, "X", BLUE)
    words(panel, 1.45, 0.42, "Y", ORANGE)
    return figure


def one_move() -> Figure:
    """What the laser reads of one move of X."""
    figure, (panel,) = sheet(8.0, 3.9)
    panel.set_xlim(-1.2, 9.4)
    panel.set_ylim(-1.4, 4.0)
    direction = np.array([0.8, 0.6])
    panel.plot([-1.0, 8.6 * 0.8 + 1.0], [-0.75, 8.6 * 0.6 + 0.75 - 1.4], alpha=0.0)
    panel.plot([-0.8, 5.2], [-0.6, 3.9], color="#CC0000", lw=1.2)
    words(panel, 4.6, 3.85, "beam", "#CC0000", ha="right")
    nominal, actual = np.array([4.0, 0.0]), np.array([4.7, 0.75])
    arrow(panel, (0, 0), tuple(nominal), BLUE)
    words(panel, 2.1, -0.35, "the move that was asked for,  a", BLUE)
    arrow(panel, tuple(nominal), (4.7, 0.0), BLUE, "-", 3.0)
    words(panel, 4.85, -0.35, "ΔE_XX", BLUE, ha="left")
    arrow(panel, (4.7, 0.0), tuple(actual), ORANGE, "--", 3.0)
    words(panel, 4.9, 0.4, "ΔE_YX", ORANGE, ha="left")
    panel.plot(*actual, "o", color="black", ms=6)
    read = direction * float(actual @ direction)
    panel.plot([actual[0], read[0]], [actual[1], read[1]], color=GREY, lw=1.2, ls="--")
    shift = np.array([-0.18, 0.24])
    arrow(panel, tuple(shift), tuple(read + shift), "black", heads="<|-|>")
    words(panel, 1.15, 2.2, "what the laser reads", rotation=36.87)
    words(
        panel,
        6.0,
        2.2,
        "reading of a move of X\n= cos · (a + ΔE_XX)\n+ sin · ΔE_YX",
        ha="left",
    )
    return figure


def two_signs() -> Figure:
    """Two diagonals see the same straightness with opposite signs."""
    figure, panels = sheet(9.0, 3.9, 2)
    for panel, sign in zip(panels, (1.0, -1.0), strict=True):
        panel.set_xlim(-0.9, 5.9)
        panel.set_ylim(-1.2, 4.1)
        direction = np.array([0.8 * sign, 0.6])
        start = np.array([0.6 if sign > 0 else 4.4, 0.0])
        end = start + 4.9 * direction
        arrow(panel, tuple(start), tuple(end), "#CC0000", width=1.4)
        x = 1.2 if sign > 0 else 3.8
        arrow(panel, (x, -0.1), (x + 2.2 * sign, -0.1), BLUE)
        arrow(panel, (x + 2.2 * sign, -0.1), (x + 2.2 * sign, 0.75), ORANGE, "--", 3.0)
        words(panel, x + 1.1 * sign, -0.5, "X moves " + ("forward" if sign > 0 else "back"), BLUE)
        words(panel, 2.5, 3.8, "beam " + ("pp" if sign > 0 else "np"), weight="bold")
        words(panel, x + 2.35 * sign, 0.42, "ΔE_YX", ORANGE, ha="left" if sign > 0 else "right")
        words(
            panel,
            2.5,
            -1.0,
            "reads  " + ("+ cos ΔE_XX  + sin ΔE_YX" if sign > 0 else "+ cos ΔE_XX  − sin ΔE_YX"),
        )
    return figure


def tilted_mirror() -> Figure:
    """What a tilted mirror does to the readings of the moves, and to those of a block."""
    figure, (left, right) = sheet(9.0, 3.9, 2)
    step = 1.9
    for panel, title, tilt in ((left, "mirror square to the beam", 0.0), (right, "tilted", 14.0)):
        panel.set_xlim(-1.4, 6.9)
        panel.set_ylim(-1.4, 3.9)
        angle = np.radians(45.0 + tilt)
        normal = np.array([np.cos(angle), np.sin(angle)])
        middle = np.array([step, step])
        panel.plot([-1.1, 2.9], [-1.1, 2.9], color="#CC0000", lw=1.2)
        arrow(panel, (0, 0), (step, 0), BLUE)
        arrow(panel, (step, 0), (step, step), ORANGE, "--")
        plate(panel, *middle, tuple(normal), 1.35)
        words(panel, 1.0, 3.6, title, weight="bold", ha="center")
        x, y = step * normal / (normal @ np.array([1, 1]) / np.sqrt(2))
        words(panel, 3.2, 1.3, f"move of X reads {x:.2f}", BLUE, ha="left")
        words(panel, 3.2, 0.75, f"move of Y reads {y:.2f}", ORANGE, ha="left")
        words(panel, 3.2, 0.1, f"both together {x + y:.2f}", ha="left", weight="bold")
        words(panel, 0.95, -0.4, "X", BLUE)
        words(panel, 2.15, 0.75, "Y", ORANGE)
    return figure


def lines() -> Figure:
    """The lines of a measurement in the volume: three linear axes and four diagonals."""
    figure, (left, right) = sheet(9.0, 4.2, 2)

    def seen(x: float, y: float, z: float) -> tuple[float, float]:
        """Return where a corner of the cube is drawn."""
        return 0.95 * x + 0.5 * y, 0.28 * y - 0.1 * x + z

    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    for panel in (left, right):
        panel.set_xlim(-0.35, 1.8)
        panel.set_ylim(-0.35, 1.7)
        for one in corners:
            for two in corners:
                if sum(abs(np.subtract(one, two))) == 1:
                    panel.plot(*zip(seen(*one), seen(*two), strict=True), color="#BBBBBB", lw=1.0)
    words(left, 0.7, 1.6, "linear lines", weight="bold")
    words(right, 0.7, 1.6, "step diagonals", weight="bold")
    for axis, end in (("X", (1, 0, 0)), ("Y", (0, 1, 0)), ("Z", (0, 0, 1))):
        arrow(left, seen(0, 0, 0), seen(*end), COLOURS[axis], STYLES[axis], 3.0)
        x, y = seen(*(1.13 * value for value in end))
        words(left, x, y, axis.lower(), COLOURS[axis], weight="bold")
    for name, colour, style in (
        ("ppp", BLUE, "-"),
        ("npp", ORANGE, "--"),
        ("pnp", GREEN, ":"),
        ("ppn", "black", "-."),
    ):
        start = np.array([0 if sign == "p" else 1 for sign in name])
        end = 1 - start
        arrow(right, seen(*start), seen(*end), colour, style, 2.2)
        x, y = seen(*(start + 1.09 * (end - start)))
        words(right, x, y, name, colour, weight="bold")
    return figure


def stop() -> Figure:
    """From readings in time to one value with its uncertainty (simulated readings)."""
    figure = Figure(figsize=(8.5, 3.6), facecolor="white")
    axes = figure.add_axes((0.1, 0.19, 0.86, 0.74))
    random = np.random.default_rng(4)
    time = np.linspace(0.0, 1.4, 141)
    move = np.clip((time - 0.15) / 0.3, 0.0, 1.0)
    after = np.clip(time - 0.45, 0.0, None)
    ringing = np.where(time > 0.45, 0.9 * np.exp(-after / 0.08) * np.cos(after / 0.012), 0.0)
    reading = 5.77 * move * move * (3 - 2 * move) + ringing + random.normal(0.0, 0.1, time.size)
    axes.plot(time, reading, ".", color=GREY, ms=4)
    for begin, end, colour, text in (
        (0.15, 0.45, "#E8E8E8", "move"),
        (0.45, 0.85, "#F5E6D8", "settles"),
        (0.85, 1.25, "#D6E6F2", "window"),
    ):
        axes.axvspan(begin, end, color=colour, zorder=0)
        words(axes, (begin + end) / 2, 7.3, text)
    inside = (time >= 0.85) & (time <= 1.25)
    mean = float(reading[inside].mean())
    axes.plot([0.85, 1.25], [mean, mean], color=BLUE, lw=3)
    axes.annotate(
        "mean of the window:\nthe value of the stop,\nits scatter the uncertainty",
        (1.05, mean - 0.15),
        (0.98, 2.2),
        ha="center",
        arrowprops={"arrowstyle": "->", "color": BLUE},
        color=BLUE,
    )
    axes.set_ylim(-0.8, 8.0)
    axes.set_xlabel("time")
    axes.set_ylabel("reading (not to scale)")
    axes.set_xticks([])
    axes.set_yticks([])
    return figure


def setups() -> Figure:
    """Conventional and setup-robust results of one simulated run, beside the truth."""
    plan, _ = load_plan("demo")
    cell, _ = load_cell("demo")
    measurement = simulate(plan, cell, seed=1, readings_per_stop=30)
    results = [
        (solve(measurement, "conventional"), "conventional (Wang)", ORANGE, "--"),
        (solve(measurement, "setup_robust"), "setup-robust (Ibaraki & Hata)", BLUE, "-"),
    ]
    truth = cell.truth(plan.volume)
    figure = Figure(figsize=(9.0, 3.6), facecolor="white")
    for count, name in enumerate(("E_XX", "E_YY", "E_ZZ")):
        axes = figure.add_axes((0.07 + 0.315 * count, 0.17, 0.27, 0.6))
        nodes = plan.volume.nodes(count) * 1e3
        for result, label, colour, style in results:
            values = result.curves[name] * 1e6
            axes.plot(nodes, values, style, color=colour, lw=2.2, label=label)
        axes.plot(nodes, truth[name] * 1e6, "o", color="black", ms=4, label="truth")
        axes.set_ylim(-7.0, 22.0)
        axes.set_title(f"{name} / µm", fontsize=11)
        axes.set_xlabel(f"{'XYZ'[count]} / mm")
        axes.axhline(0.0, color=GREY, lw=0.6)
    figure.legend(*axes.get_legend_handles_labels(), loc="upper center", ncols=3, frameon=False)
    return figure


def told() -> Figure:
    """What some sets of lines tell of each error, of a machine of the chain YXZ."""
    looks = {
        DETERMINED: (BLUE, "●", "told"),
        PARTLY: ("#9CC9E3", "◐", "told in part"),
        CONFOUNDED: ("#F3D9C4", "≈", "not told apart from others"),
        INVISIBLE: ("#F4F4F4", "–", "not seen"),
    }
    figure = Figure(figsize=(10.5, 4.0), facecolor="white")
    axes = figure.add_axes((0.25, 0.14, 0.74, 0.7))
    columns: list[str] = []
    for row, (label, chain, text) in reversed(list(enumerate(SETS))):
        found = visibility(plan_from_text(BOX + text, label), chain, 0.02e-6)
        # The set with all errors comes first, and gives the columns.
        columns = columns or [error.name for error in found.rows]
        for error in found.rows:
            colour, sign, _ = looks[error.status]
            x = columns.index(error.name)
            axes.add_patch(Rectangle((x, -row), 1, 1, facecolor=colour, edgecolor="white", lw=1.5))
            dark = "white" if error.status == DETERMINED else "black"
            words(axes, x + 0.5, 0.5 - row, sign, dark)
        words(axes, -0.3, 0.5 - row, label, ha="right", fontsize=10)
    for x, name in enumerate(columns):
        words(axes, x + 0.5, 1.6, name, rotation=90, fontsize=9)
    axes.set_xlim(0, len(columns))
    axes.set_ylim(1 - len(SETS), 2.2)
    axes.set_axis_off()
    for (colour, sign, meaning), x in zip(looks.values(), (0.1, 0.24, 0.42, 0.74), strict=True):
        figure.text(x, 0.05, f" {sign} ", bbox={"facecolor": colour, "edgecolor": GREY})
        figure.text(x + 0.035, 0.05, meaning)
    return figure


BOX = """\
name: a 120 mm cube
origin_m: [0.0, 0.0, 0.0]
step_m: [0.010, 0.010, 0.010]
blocks: 12
directions: [forward, backward]
repeats: 2
feed_m_per_s: 0.033
one_alignment_per_diagonal: true
lines:
"""
LINEAR = "  - {kind: linear, names: [x, y, z]}\n"
THREE = "  - {kind: step_diagonal, names: [ppp, npp, pnp]}\n"
FOUR = "  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn]}\n"
ORDERS = "  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn], orders: [XYZ, YZX, ZXY]}\n"
SETS = (
    ("nothing turns: x y z", "", LINEAR),
    ("nothing turns: ppp npp pnp", "", THREE),
    ("nothing turns: x y z ppp npp pnp", "", LINEAR + THREE),
    ("x y z, four diagonals", "YXZ", LINEAR + FOUR),
    ("the same in three orders", "YXZ", LINEAR + ORDERS),
)
"""Label, chain (empty: translations alone are in question) and lines of a plan."""


def way(stations: tuple[tuple[str, str, str], ...]) -> Figure:
    """Return the way of a value through the code: what it is, how it is called, and where.

    Args:
        stations: floor, what the value is there, and the module, in the order of the way.
    """
    width, height, columns = 3.0, 1.5, 4
    rows = -(-len(stations) // columns)
    figure, (axes,) = sheet(11.0, 1.9 * rows)
    for number, (floor, what, module) in enumerate(stations):
        row, place = divmod(number, columns)
        # Every second row runs back, so that each arrow goes to a neighbour.
        column = place if row % 2 == 0 else columns - 1 - place
        x, y = 3.8 * column, -2.2 * row
        box = Rectangle((x, y), width, height, facecolor="#F2F6FA", edgecolor=BLUE, linewidth=1.2)
        axes.add_patch(box)
        words(axes, x + 0.5 * width, y + 1.24, floor, BLUE, fontsize=9)
        words(axes, x + 0.5 * width, y + 0.75, what, fontsize=10, fontweight="bold")
        words(axes, x + 0.5 * width, y + 0.25, module, GREY, fontsize=8, family="monospace")
        if number + 1 == len(stations):
            break
        if place + 1 == columns:
            arrow(axes, (x + 0.5 * width, y), (x + 0.5 * width, y - 0.7))
        elif row % 2 == 0:
            arrow(axes, (x + width, y + 0.75), (x + 3.8, y + 0.75))
        else:
            arrow(axes, (x, y + 0.75), (x - 0.8, y + 0.75))
    axes.set_xlim(-0.1, 3.8 * (columns - 1) + width + 0.1)
    axes.set_ylim(-2.2 * (rows - 1) - 0.1, height + 0.1)
    return figure


def one_reading() -> Figure:
    """The way of one reading, from the laser to the first sentence of the report."""
    return way(
        (
            ("devices", "a count of fringes", "interferometer/simulated"),
            ("run", "a reading in this air", "reading_source"),
            ("nodes", "a message", "interferometer"),
            ("metrology", "a settled stop", "assembly, window"),
            ("metrology", "a block displacement", "assembly"),
            ("metrology", "a row of equations", "solvers/design"),
            ("evaluation", "a report of the run", "recorded_run, build"),
            ("words", "a sentence", "lead"),
        )
    )


def one_error() -> Figure:
    """The way of one error, from the file of a simulated machine to the table that corrects it."""
    return way(
        (
            ("config", "errors: of a cell", "cells/demo.yaml"),
            ("metrology", "a curve over an axis", "cell, forward"),
            ("devices", "a part of a reading", "interferometer/simulated"),
            ("metrology", "unknowns of the fit", "solvers/design"),
            ("metrology", "E_XX with its ±", "solvers/result"),
            ("compensation", "may be corrected?", "identified, permission"),
            ("compensation", "x.comp", "linuxcnc"),
            ("compensation", "what remains", "remaining"),
        )
    )


DRAWINGS: tuple[Callable[[], Figure], ...] = (
    six_errors,
    two_ways,
    one_move,
    two_signs,
    tilted_mirror,
    lines,
    stop,
    setups,
    told,
    one_reading,
    one_error,
)


def main(folder: Path = FOLDER) -> int:
    """Write every drawing as an SVG file into a folder."""
    with mpl.rc_context(LOOK):
        for drawing in DRAWINGS:
            path = folder / f"{drawing.__name__}.svg"
            drawing().savefig(path, metadata={"Date": None, "Creator": None})
            print(path.name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
