"""What compensation tables leave: the nine translations before and after, computed."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stepdiag_ros.compensation.control import Control
from stepdiag_ros.compensation.remaining import COMPUTED, Remainder
from stepdiag_ros.metrology.geometry import translation
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.plots.curves import curve_sheet, curve_words
from stepdiag_ros.plots.style import AFTER, BEFORE, panel_title, say_unknown
from stepdiag_ros.text.numbers import plain

_DECIMALS = 3
_BOTH_WAYS = "Positioning: full line forward, dashed backward; straightness: mean of both."


def compensation(
    remainder: Remainder,
    control: Control,
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure:
    """Draw the nine translations before and after, positioning in both directions of approach.

    Without any reversal error both are one curve. Columns are the axis that moves, rows the
    direction of the error.

    Args:
        remainder: what the tables leave.
        control: that they are for.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: nine to draw in instead of a new figure.
    """
    reverses = _reverses(remainder)
    names = [translation(error, axis) for error in range(3) for axis in range(3)]
    sheet = curve_sheet(names, axes)
    for number, panel in enumerate(sheet.panels):
        error, axis = divmod(number, 3)
        one = remainder.axes[axis]
        name = names[number]
        known = False
        for values, style, label in (
            (one.before, BEFORE, "before"),
            (one.after, AFTER, "after (computed)"),
        ):
            own = error == axis
            both = own and reverses
            curves = values[..., error] if both else np.mean(values, axis=0)[None, :, error]
            for way, values_of_way in enumerate(curves):
                known |= bool(np.any(np.isfinite(values_of_way)))
                panel.plot(
                    one.positions * IN_MILLI,
                    values_of_way * IN_MICRO,
                    color=style.colour,
                    linestyle="-" if way == 0 else "--",
                    marker=style.marker,
                    markersize=2.5,
                    markevery=max(1, len(one.positions) // 6),
                    # What no table corrects is the same after: it must not hide what was before.
                    linewidth=2.4 if style is BEFORE else 1.1,
                    label=label if way == 0 else f"{label}, backward",
                )
        if not known:
            say_unknown(panel)
        corrected = "" if name in control.corrects else " (no table)"
        panel_title(panel, f"{curve_words(name)}{corrected}")
    rms, largest = (remainder.change(f"volume, {what}") for what in ("rms", "largest"))
    volume = (
        f"volume: rms {_micrometres(rms.before)} → {_micrometres(rms.after)}, largest"
        f" {_micrometres(largest.before)} → {_micrometres(largest.after)}"
    )
    return sheet.finish(
        f"What remains with tables for {control.title}" if title is None else title,
        under=[] if title == "" else [volume],
        small_print=[_BOTH_WAYS] * reverses + [COMPUTED] * (title != ""),
        stamp=stamp,
    )


def _reverses(remainder: Remainder) -> bool:
    """Say whether an axis errs otherwise on its way back."""
    return any(
        not np.array_equal(part[0, :, one.axis], part[1, :, one.axis], equal_nan=True)
        for one in remainder.axes
        for part in (one.before, one.after)
    )


def _micrometres(value: float) -> str:
    words = plain(value * IN_MICRO, _DECIMALS)
    return f"{words} µm" if np.isfinite(value) else words
