"""What lines can tell of each error: one square an error, shaded and marked by its verdict."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from stepdiag_ros.metrology.geometry import ROTATIONS, SQUARENESS, TRANSLATIONS
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.metrology.visibility import (
    CONFOUNDED,
    DETERMINED,
    INVISIBLE,
    PARTLY,
    VerdictRow,
    Visibility,
)
from stepdiag_ros.plots.panel import INK
from stepdiag_ros.plots.style import GREEN, SKY, SMALL_SIZE, Sheet, panel_title

_LOOKS = {
    DETERMINED: (GREEN, ""),
    PARTLY: (SKY, "//"),
    CONFOUNDED: ("#F6C9A0", "\\\\"),
    INVISIBLE: ("0.85", "xx"),
}
"""Verdict → colour and hatch."""
_NOT_ASKED = ("white", "")
_CELL = 0.36


def visibility(
    visibility: Visibility, *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Figure:
    """Draw the verdict on every error: columns the moving axis, rows the error, and squareness.

    In each square stand the name and the standard uncertainty at the last node (of squareness the
    uncertainty itself). Rotations are there where the chain is known.

    Args:
        visibility: of a plan or a measurement.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: one for each block (translations, rotations where asked for, squareness) instead of a
            new figure.
    """
    rows = {row.name: row for row in visibility.rows}
    blocks = [("Translations / µm", [list(TRANSLATIONS[error::3]) for error in range(3)])]
    if any(name in rows for name in ROTATIONS):
        blocks.append(("Rotations / µrad", [list(ROTATIONS[error::3]) for error in range(3)]))
    blocks.append(("Squareness / µm/m", [[name] for name in SQUARENESS]))
    extra = [row for row in visibility.rows if row.name not in (*TRANSLATIONS, *ROTATIONS)]
    extra = [row for row in extra if row.name not in SQUARENESS]
    sheet = Sheet(
        len(blocks), 3, 3 * _CELL, axes=axes, left=0.1, right=0.1, gap=(0.15, 0.3), bottom=0.08
    )
    statuses: dict[str, Any] = {}
    for panel, (words, block) in zip(sheet.panels, blocks, strict=True):
        for up, names in enumerate(block):
            for across, name in enumerate(names):
                row = rows.get(name)
                colour, hatch = _NOT_ASKED if row is None else _LOOKS[row.status]
                square = Rectangle(
                    (across, up), 0.96, 0.92, facecolor=colour, hatch=hatch, edgecolor="white"
                )
                panel.add_patch(square)
                if row is not None:
                    statuses.setdefault(row.status, square)
                panel.text(
                    across + 0.48,
                    up + 0.46,
                    _words(name, row),
                    ha="center",
                    va="center",
                    fontsize=SMALL_SIZE,
                    color=INK,
                    bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.8},
                )
        panel.set_xlim(0.0, max(len(names) for names in block))
        panel.set_ylim(3.0, 0.0)
        panel.set_axis_off()
        panel_title(panel, words)
    said = [
        f"Standard uncertainty at the last node; {visibility.rank} of {visibility.unknowns} free"
        f" values are determined by {visibility.readings} stops.",
        *(f"{row.name}: {row.words}." for row in extra),
    ]
    if not visibility.chain:
        said.append("The kinematic chain is not known: rotations were not looked at.")
    heading = "What these lines determine of each error"
    return sheet.finish(
        heading if title is None else title,
        small_print=said,
        stamp=stamp,
        more=[(statuses[one], one) for one in _LOOKS if one in statuses],
    )


def _words(name: str, row: VerdictRow | None) -> str:
    if row is None:
        return f"{name}\nnot asked"
    size = row.end if np.isfinite(row.end) else row.largest
    return f"{name}\n{size * IN_MICRO:#.2g}" if np.isfinite(size) else f"{name}\nunknown"
