"""Expected uncertainty of the plans that a search found, against the time that they take."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.plots.style import AFTER, GREY, Sheet, scales


def frontier(
    plans: Sequence[tuple[float, float]],
    chosen: tuple[float, float],
    unit: str,
    *,
    small_print: Sequence[str] = ("U: expected expanded uncertainty (95 %) of the plans.",),
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure:
    """Draw the frontier of expanded uncertainty against duration, and the chosen plan.

    Args:
        plans: duration, s, and expanded uncertainty, m or rad, of each plan, by duration.
        chosen: the same of the plan that is proposed.
        unit: of the uncertainties, ``m`` or ``rad``.
        small_print: sentences below: of what the uncertainties are, and why this plan is proposed.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in instead of a new figure.
    """
    sheet = Sheet(1, 1, 2.6, axes=axes)
    panel = sheet.panels[0]
    minutes, sizes = np.array(plans).T * np.array([[1.0 / 60.0], [IN_MICRO]])
    # Between two plans the quicker one is the best that there is.
    panel.step(minutes, sizes, where="post", color=GREY, linewidth=1.0)
    panel.plot(minutes, sizes, "o", color=GREY, markersize=3.0, label="best plan of its duration")
    panel.plot(
        chosen[0] / 60.0,
        chosen[1] * IN_MICRO,
        AFTER.marker,
        color=AFTER.colour,
        markersize=6.0,
        label="proposed",
    )
    panel.set_ylim(bottom=0.0)
    scales(panel, "duration with alignments / min", f"U / {'µm' if unit == 'm' else '(µm/m)'}")
    heading = "Expected uncertainty against duration" if title is None else title
    return sheet.finish(heading, small_print=small_print, stamp=stamp)
