"""The volume as its errors bend it, greatly exaggerated, with the worst place."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stepdiag_ros.evaluation.report import method_title
from stepdiag_ros.metrology.geometry import ROTATIONS, Vector
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.volumetric import (
    MACHINES_OF_RL,
    of_result,
    volumetric_accuracy,
)
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.metrology.volumetric_map import VolumetricMap
from stepdiag_ros.plots.space import add_wires, frame_box, project
from stepdiag_ros.plots.style import BLUE, VERMILION, Sheet, scales
from stepdiag_ros.text.numbers import plain, plus_minus

_DRAWN_SHARE = 0.1
"""The longest error vector is drawn as this share of the box's longest side."""
_MOST_PLANES = 4
"""Nodes of an axis that are drawn; of more, evenly spread ones with both ends."""


def wire_nodes(nodes: Vector) -> Vector:
    """Return the nodes of an axis through which wires are drawn."""
    count = min(len(nodes), _MOST_PLANES)
    chosen: Vector = nodes[np.unique(np.rint(np.linspace(0, len(nodes) - 1, count)).astype(int))]
    return chosen


def wires_of(error_map: VolumetricMap) -> list[Vector]:
    """Return the wires of the box's outer faces, each through all nodes of its axis, m.

    Returns:
        Polylines of shape (nodes of the axis, 3).
    """
    across = [wire_nodes(nodes) for nodes in error_map.nodes]
    wires = []
    for axis in range(3):
        one, other = (index for index in range(3) if index != axis)
        for first in across[one]:
            for second in across[other]:
                ends = (across[one][[0, -1]], across[other][[0, -1]])
                if first not in ends[0] and second not in ends[1]:
                    continue
                wire = np.empty((len(error_map.nodes[axis]), 3))
                wire[:, axis] = error_map.nodes[axis]
                wire[:, one], wire[:, other] = first, second
                wires.append(wire)
    return wires


def exaggeration_of(longest: float, sides: Vector) -> float:
    """Return by how much errors are enlarged: to a round factor of one digit, 1, 2 or 5.

    Args:
        longest: error vector, m.
        sides: of the box, m.
    """
    if not longest > 0.0:
        return 1.0
    wanted = _DRAWN_SHARE * float(np.max(sides)) / longest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted))


def volume(
    result: VolumetricErrors,
    chain: str = "",
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure | None:
    """Draw the measured box as the machine makes it, exaggerated, and the longest error vector.

    None where a curve is not determined: what is not known has no shape.

    Args:
        result: of a solver.
        chain: order of the axes from workpiece to tool; needed where the result has rotations.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in instead of a new figure.

    Raises:
        ValueError: the result has rotations and no chain is given.
    """
    worst = of_result(result, chain)
    if not np.isfinite(worst.value):
        return None
    error_map = VolumetricMap.of_result(result, chain)
    low, high = error_map.low, error_map.high
    factor = exaggeration_of(worst.value, high - low)
    sheet = Sheet(1, 1, 4.1, axes=axes, left=0.1, right=0.1, bottom=0.05)
    (panel,) = sheet.panels
    wires = wires_of(error_map)
    lengths = [len(wire) for wire in wires]
    errors = error_map.errors(np.concatenate(wires))
    bent = np.split(np.concatenate(wires) + factor * errors, np.cumsum(lengths)[:-1])
    add_wires(panel, wires, "as it should be", colors="0.65", linewidths=0.6, linestyles="--")
    add_wires(panel, bent, "as it is, exaggerated", colors=BLUE, linewidths=0.9)
    place = np.asarray(worst.position)
    end = place + factor * np.asarray(worst.vector)
    add_wires(
        panel, [np.stack([place, end])], "longest error vector", colors=VERMILION, linewidths=2.2
    )
    panel.plot(*project(end), marker="o", markersize=5.0, color=VERMILION, linestyle="none")
    frame_box(panel, low, high)
    times = f"Errors are drawn {factor:,.0f} times larger than they are."
    where = ", ".join(plain(value * IN_MILLI, 1) for value in worst.position)
    said = [
        times,
        f"Worst: {plus_minus(worst.value, worst.standard_uncertainty, IN_MICRO)} µm at"
        " X, Y, Z"
        f" = {where} mm; rms over the volume {plain(worst.rms * IN_MICRO)} µm.",
        f"Frame: {worst.frame}; zero at the first corner.",
        *(f"{one[:1].upper()}{one[1:]}." for one in worst.remarks),
    ]
    turned = any(name in result.curves for name in ROTATIONS)
    what = "with angular errors" if turned else "translations alone"
    heading = f"The measured volume as it is ({method_title(result.method)}, {what})"
    return sheet.finish(
        heading if title is None else title,
        small_print=said[:1] if title == "" else said,
        stamp=stamp,
    )


def diagonals_alone(*, title: str | None = None, stamp: str = "", axes: Any = None) -> Figure:
    """Draw E_d beside the volumetric accuracy of RL's three machines.

    Args:
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in instead of a new figure.
    """
    sheet = Sheet(1, 1, 2.8, axes=axes)
    (panel,) = sheet.panels
    places = np.arange(len(MACHINES_OF_RL))
    diagonal = [one.diagonal_result * IN_MICRO for one in MACHINES_OF_RL]
    whole = [volumetric_accuracy(one.errors).value * IN_MICRO for one in MACHINES_OF_RL]
    for shift, values, colour, hatch, label in (
        (-0.2, diagonal, BLUE, "", "diagonal test result E_d"),
        (+0.2, whole, VERMILION, "//", "volumetric accuracy"),
    ):
        bars = panel.bar(
            places + shift, values, width=0.38, color=colour, hatch=hatch, alpha=0.85, label=label
        )
        panel.bar_label(bars, [plain(value, 0) for value in values], fontsize=8, padding=2)
    panel.set_xticks(places, [one.name for one in MACHINES_OF_RL])
    panel.margins(y=0.12)
    scales(panel, up="µm")
    heading = "Diagonal tests alone do not determine volumetric accuracy (RL, 3D example)"
    return sheet.finish(heading if title is None else title, stamp=stamp)
