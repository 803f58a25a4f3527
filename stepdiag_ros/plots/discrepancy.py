"""A diagnosis: where the gap between run and model is, what was tried, the gap before and after."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stepdiag_ros.evaluation.diagnosis import rms_and_largest
from stepdiag_ros.metrology.discrepancy.findings import Diagnosis, Finding, Share, in_order
from stepdiag_ros.metrology.discrepancy.held_out import HeldOut
from stepdiag_ros.metrology.discrepancy.summary import DiagnosisSummary, FoundEffect, GapFigures
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.plots.lines import add_lines, sample
from stepdiag_ros.plots.panel import INK, LABEL_SIZE
from stepdiag_ros.plots.places import here
from stepdiag_ros.plots.style import (
    AFTER,
    BEFORE,
    GREY,
    ORANGE,
    SMALL_SIZE,
    Sheet,
    panel_title,
    scales,
    zero_line,
)
from stepdiag_ros.text.numbers import plain

_ARROWS = {FORWARD: "→", BACKWARD: "←"}
_SIGNIFICANT = 0.001
_MOST_BARS = 12
_MOST_PARTS = 14
_NOT_DRAWN = ("pass",)
"""Ways of splitting that the map of the gap shows already."""
_FEW_PARTS = 3
_LETTERS_OF_A_PANEL = 22
_LABEL_INCHES = 0.1
"""Between two labels in small print."""
_COLUMNS = 4
_SCALE_QUANTILE = 0.995
_MARKED, _DARK = 0.25, 0.65
"""Shares of the scale of colours beyond which a negative stop is marked, and marked in white."""


def found_in(diagnosis: Diagnosis | DiagnosisSummary) -> tuple[Finding | FoundEffect, ...]:
    """Return what was found, or where the gap is unexplained what closes a part of it."""
    return tuple(diagnosis.findings or diagnosis.partial)


def gap_map(
    diagnosis: Diagnosis, *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Figure:
    """Draw the gap at every stop of every pass, before and after, in one scale of colours.

    Args:
        diagnosis: of a run; where nothing was found there is no after.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: one (before) or two (before and after) instead of a new figure.
    """
    stops = diagnosis.stops
    gaps = [("before", diagnosis.residual_before)]
    if found_in(diagnosis):
        gaps.append(("after", diagnosis.residual_after))
    rows = len(stops.lines)
    height = float(np.clip(0.6 + 0.1 * rows, 2.2, 7.5))
    sheet = Sheet(
        len(gaps), 2, height, axes=axes, left=1.15, right=0.95, gap=(0.15, 0.3), share_up=True
    )
    reach = _reach(diagnosis.residual_before, diagnosis.noise)
    mesh: Any = None
    for panel, (when, gap) in zip(sheet.panels, gaps, strict=True):
        shown = np.full((rows, int(stops.number.max()) + 1), np.nan)
        shown[stops.pass_index, stops.number] = gap * IN_MICRO
        panel.set_facecolor("0.88")
        mesh = panel.pcolormesh(
            np.arange(shown.shape[1] + 1) - 0.5,
            np.arange(rows + 1) - 0.5,
            np.ma.masked_invalid(shown),
            cmap="RdBu_r",
            vmin=-reach,
            vmax=reach,
        )
        _mark_negative(panel, shown, reach)
        rms, largest = rms_and_largest(gap)
        sizes = f"rms {rms * IN_MICRO:.3f} µm, largest {largest * IN_MICRO:.2f} µm"
        panel_title(panel, f"{when}: {sizes}" if len(gaps) > 1 else sizes)
        scales(panel, "stop along the pass")
        panel.xaxis.get_major_locator().set_params(integer=True)
        for border in np.flatnonzero(np.diff(_setups_of_passes(stops))):
            panel.axhline(border + 0.5, color="0.35", linewidth=0.5)
        panel.set_ylim(rows - 0.5, -0.5)
    ticks, labels = _pass_ticks(stops, int(here().flatness * height / _LABEL_INCHES))
    sheet.panels[0].set_yticks(ticks, labels)
    sheet.panels[0].tick_params(axis="y", labelsize=SMALL_SIZE)
    for panel in sheet.panels:
        if hasattr(panel.yaxis, "gridded"):
            panel.yaxis.gridded = panel.xaxis.gridded = False
    heading = "The gap at every stop (passes in the order of measurement)"
    said = [f"A dash: below {-_MARKED * reach:.2g} µm, as opposed to above, for a print in grey."]
    if not np.all(np.isfinite(gaps[0][1])):
        said.append("Grey without a dash: rejected or missing stops.")
    figure = sheet.finish(heading if title is None else title, small_print=said, stamp=stamp)
    if axes is None:
        _draw_scale(figure, sheet.panels[-1], mesh, reach)
    return figure


def _mark_negative(axes: Axes, shown: Vector, reach: float) -> None:
    """Put a dash on the clearly negative stops, which without colour look like positive ones."""
    for low, high, colour in ((-np.inf, -_DARK, "1.0"), (-_DARK, -_MARKED, "0.2")):
        rows, columns = np.nonzero((shown >= low * reach) & (shown < high * reach))
        axes.plot(
            columns, rows, color=colour, marker="_", markersize=2.6, linestyle="none", linewidth=0.0
        )


def _draw_scale(figure: Figure, beside: Axes, mesh: Any, reach: float) -> None:
    place = beside.get_position()
    width = float(figure.get_figwidth())
    axes = figure.add_axes(
        (place.x1 + 0.12 / width, place.y0 + 0.1 * place.height, 0.13 / width, 0.8 * place.height)
    )
    bar = figure.colorbar(mesh, cax=axes, extend="both")
    bar.set_label("reading minus model / µm", fontsize=LABEL_SIZE)
    bar.set_ticks([-reach, -0.5 * reach, 0.0, 0.5 * reach, reach])
    bar.ax.set_yticklabels([f"{share * reach:.2g}" for share in (-1.0, -0.5, 0.0, 0.5, 1.0)])
    bar.ax.tick_params(labelsize=SMALL_SIZE)


def _reach(gap: Vector, noise: float) -> float:
    """Return the end of the scale of colours, µm: most of the gap, and at least the noise."""
    known = np.abs(gap[np.isfinite(gap)])
    largest = float(np.quantile(known, _SCALE_QUANTILE)) if known.size else 0.0
    least = 3.0 * noise if np.isfinite(noise) else 0.0
    return max(largest, least, 1e-12) * IN_MICRO


def _setups_of_passes(stops: Stops) -> NDArray[np.int64]:
    first = np.unique(stops.pass_index, return_index=True)[1]
    return stops.setup[first]


def _pass_ticks(stops: Stops, most: int) -> tuple[list[int], list[str]]:
    """Return where passes are labelled: each one, or where they are many the first of a setup."""
    words = [
        " ".join(
            part
            for part in (line.name, line.order, _ARROWS[line.direction], str(line.repeat))
            if part
        )
        for line in stops.lines
    ]
    places = list(range(len(words)))
    if len(words) > most:
        setups = _setups_of_passes(stops)
        places = [place for place in places if place == 0 or setups[place] != setups[place - 1]]
    return places, [words[place] for place in places]


def gap_where(
    diagnosis: Diagnosis | DiagnosisSummary,
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure | None:
    """Draw the rms of the gap over every way of splitting it, beside the noise; None without any.

    Args:
        diagnosis: of a run, computed or as recorded.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in, one for each way of splitting, instead of a new figure.
    """
    splits: dict[str, list[Share]] = {}
    for share in diagnosis.map:
        if share.split not in _NOT_DRAWN:
            splits.setdefault(share.split, []).append(share)
    splits = {name: _clearest(shares) for name, shares in splits.items() if len(shares) > 1}
    if not splits:
        return None
    sheet = Sheet(len(splits), _COLUMNS, 1.25, axes=axes, gap=(0.42, 0.95), bottom=0.75)
    for number, (panel, (name, shares)) in enumerate(
        zip(sheet.panels, splits.items(), strict=True)
    ):
        _draw_shares(panel, name, shares, diagnosis.noise)
        if sheet.first_in_row(number):
            scales(panel, up="rms of the gap / µm")
    said = "What the free values of the model take up of the noise makes the gap smaller than it."
    added = ", before anything was added to the model" if found_in(diagnosis) else ""
    heading = f"Where the gap is{added}"
    return sheet.finish(heading if title is None else title, small_print=[said], stamp=stamp)


def _clearest(shares: list[Share]) -> list[Share]:
    """Return the parts in their order, of many only those that are farthest from noise."""
    kept = sorted(shares, key=lambda share: share.p_value)[:_MOST_PARTS]
    return [share for share in shares if share in kept]


def _draw_shares(axes: Axes, name: str, shares: Sequence[Share], noise: float) -> None:
    for clear, colour, hatch, label in (
        (True, BEFORE.colour, "//", f"more than noise (p < {_SIGNIFICANT:g})"),
        (False, GREY, "", "as noise"),
    ):
        places = [
            place for place, share in enumerate(shares) if (share.p_value < _SIGNIFICANT) == clear
        ]
        if places:
            heights = [shares[place].rms * IN_MICRO for place in places]
            axes.bar(
                places,
                heights,
                color=colour,
                hatch=hatch,
                edgecolor="white",
                linewidth=0.3,
                label=label,
                width=0.75,
            )
    if np.isfinite(noise):
        axes.axhline(
            noise * IN_MICRO,
            color="black",
            linestyle="--",
            linewidth=1.0,
            label="noise of a stop",
        )
    labels = [share.part for share in shares]
    if len(labels) <= _FEW_PARTS:
        labels = [label.replace(" ", "\n") for label in labels]
    longest = max(len(line) for label in labels for line in label.split("\n"))
    # Between two labels there is room for a letter.
    upright = (longest + 1) * len(labels) > _LETTERS_OF_A_PANEL
    axes.set_xticks(range(len(labels)), labels)
    axes.tick_params(axis="x", labelsize=SMALL_SIZE, labelrotation=90 if upright else 0)
    panel_title(axes, f"by {name}")


def gap_candidates(
    diagnosis: Diagnosis | DiagnosisSummary,
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure | None:
    """Draw what each candidate closes of the gap, the named ones and those that lost.

    None where nothing was found.

    Args:
        diagnosis: of a run, computed or as recorded.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in instead of a new figure.
    """
    bars: list[tuple[str, float, str]] = []
    for finding in found_in(diagnosis):
        rivals = _not_ruled_out(finding)
        bars.append((finding.label, finding.gain, "found"))
        for other in in_order(finding.runners_up)[:_MOST_BARS]:
            kind = "not ruled out" if other.ambiguous or other.label in rivals else "lost"
            bars.append((other.label, other.gain, kind))
    if not bars:
        return None
    looks = {"found": (AFTER.colour, ""), "not ruled out": (ORANGE, "//"), "lost": (GREY, "")}
    longest = max(len(bar[0]) for bar in bars)
    sheet = Sheet(
        1, 1, 0.2 + 0.19 * len(bars), axes=axes, left=min(0.25 + 0.066 * longest, 3.2), right=0.3
    )
    (panel,) = sheet.panels
    for kind, (colour, hatch) in looks.items():
        places = [place for place, bar in enumerate(bars) if bar[2] == kind]
        if places:
            panel.barh(
                places,
                [max(bars[place][1], 0.0) for place in places],
                color=colour,
                hatch=hatch,
                edgecolor="white",
                linewidth=0.3,
                label=kind,
                height=0.7,
            )
    panel.set_yticks(range(len(bars)), [bar[0] for bar in bars])
    panel.set_ylim(len(bars) - 0.4, -0.6)
    for place, bar in enumerate(bars):
        panel.annotate(
            f"{bar[1]:,.0f}",
            (max(bar[1], 0.0), place),
            xytext=(3, 0),
            textcoords="offset points",
            va="center",
            fontsize=SMALL_SIZE,
            color=INK,
        )
    panel.set_xlim(0.0, 1.12 * max(1e-12, *(bar[1] for bar in bars)))
    scales(panel, "part of χ² that the candidate closes, Δχ²")
    heading = (
        f"Candidates ranked: below each found effect, what lost against it"
        f" ({diagnosis.tested:,} tried)"
    )
    return sheet.finish(heading if title is None else title, stamp=stamp)


def _not_ruled_out(finding: Finding | FoundEffect) -> tuple[str, ...]:
    """Return the labels of other names; a recorded diagnosis tells them of the finding alone."""
    return finding.ambiguous_with if isinstance(finding, FoundEffect) else finding.ambiguous


def gap_along_lines(
    diagnosis: Diagnosis, *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Figure:
    """Draw the gap of every pass along its line, before and after.

    Args:
        diagnosis: of a run; where nothing was found there is no after.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in, one for each line, instead of a new figure.
    """
    stops = diagnosis.stops
    names = list(dict.fromkeys(line.name for line in stops.lines))
    sheet = Sheet(len(names), _COLUMNS, 1.3, axes=axes, share_up=True, gap=(0.2, 0.55))
    way = np.sum(stops.direction * (stops.position - stops.start), axis=1) * IN_MILLI
    shown = [(BEFORE, diagnosis.residual_before)]
    more = []
    if found_in(diagnosis):
        shown.append((AFTER, diagnosis.residual_after))
        more = [(sample(BEFORE), "before"), (sample(AFTER), "after")]
    for number, (panel, name) in enumerate(zip(sheet.panels, names, strict=True)):
        own = [index for index, line in enumerate(stops.lines) if line.name == name]
        for style, gap in shown:
            rows = [stops.pass_index == index for index in own]
            passes = [np.column_stack([way[row], gap[row] * IN_MICRO]) for row in rows]
            add_lines(panel, passes, style, width=0.7)
        if np.isfinite(diagnosis.noise):
            half = COVERAGE_FACTOR * diagnosis.noise * IN_MICRO
            panel.axhspan(-half, half, color="0.85", zorder=0, label="95 % of the noise")
        panel_title(panel, name)
        up = "reading - model / µm" if sheet.first_in_row(number) else ""
        scales(panel, "along the beam / mm" if sheet.last_in_column(number) else "", up)
    heading = "The gap along every line, one trace a pass"
    return sheet.finish(heading if title is None else title, more=more, stamp=stamp)


def gap_figures(
    diagnosis: Diagnosis | DiagnosisSummary,
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure | None:
    """Draw how large the gap is before and after, and how well noise alone would explain it.

    None where nothing was found: there is no after.

    Args:
        diagnosis: of a run, computed or as recorded.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: three to draw in instead of a new figure.
    """
    if not found_in(diagnosis):
        return None
    before, after = _both(diagnosis)
    noise = diagnosis.noise * IN_MICRO
    sheet = Sheet(3, 3, 1.35, axes=axes, gap=(0.65, 0.5), bottom=0.3)
    for panel, words, unit, values, line in (
        (sheet.panels[0], "rms of the gap", "µm", (before.rms, after.rms), noise),
        (sheet.panels[1], "largest gap", "µm", (before.largest, after.largest), np.nan),
        (sheet.panels[2], "χ² per degree of freedom", "", _reduced(before, after), 1.0),
    ):
        factor = IN_MICRO if unit else 1.0
        _two_bars(panel, [value * factor for value in values], ("before", "after"))
        if np.isfinite(line):
            label = "noise of a stop" if unit else "nothing is missing"
            style = "--" if unit else ":"
            panel.axhline(line, color="black", linestyle=style, linewidth=1.0, label=label)
        panel_title(panel, f"{words} / {unit}" if unit else words)
    heading = "The gap before and after what was found"
    return sheet.finish(heading if title is None else title, stamp=stamp)


def _both(diagnosis: Diagnosis | DiagnosisSummary) -> tuple[GapFigures, GapFigures]:
    if isinstance(diagnosis, DiagnosisSummary):
        return diagnosis.before, diagnosis.after
    return (
        GapFigures(
            diagnosis.chi_squared_before,
            diagnosis.degrees_of_freedom_before,
            diagnosis.lack_of_fit_p_before,
            *rms_and_largest(diagnosis.residual_before),
        ),
        GapFigures(
            diagnosis.chi_squared_after,
            diagnosis.degrees_of_freedom_after,
            diagnosis.lack_of_fit_p_after,
            *rms_and_largest(diagnosis.residual_after),
        ),
    )


def _reduced(*gaps: GapFigures) -> tuple[float, ...]:
    return tuple(
        one.chi_squared / one.degrees_of_freedom if one.degrees_of_freedom > 0 else np.nan
        for one in gaps
    )


def _two_bars(axes: Axes, values: Sequence[float], labels: tuple[str, str]) -> None:
    for place, (value, style, hatch) in enumerate(
        zip(values, (BEFORE, AFTER), ("//", ""), strict=True)
    ):
        if np.isfinite(value):
            axes.bar(
                [place],
                [value],
                width=0.6,
                color=style.colour,
                hatch=hatch,
                edgecolor="white",
                linewidth=0.3,
            )
        axes.annotate(
            plain(value),
            (place, value if np.isfinite(value) else 0.0),
            ha="center",
            va="bottom",
            xytext=(0, 1.5),
            textcoords="offset points",
            fontsize=LABEL_SIZE - 0.5,
            color=INK,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 0.5},
        )
    axes.set_xticks([0, 1], labels)
    axes.set_xlim(-0.6, 1.6)
    axes.margins(y=0.15)


def held_out(
    proof: HeldOut, *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Figure:
    """Draw how well readings that took no part in the fit were predicted, before and after.

    Args:
        proof: of what was named.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: two to draw in instead of a new figure.
    """
    sheet = Sheet(2, 2, 2.0, axes=axes, gap=(0.65, 0.5))
    left, right = sheet.panels
    for part, style, label in (
        (proof.before, BEFORE, "predicted without the effect"),
        (proof.after, AFTER, "predicted with it"),
    ):
        held = np.isfinite(part.residual)
        left.plot(
            np.arange(np.count_nonzero(held)),
            part.residual[held] * IN_MICRO,
            color=style.colour,
            marker=style.marker,
            markersize=2.2,
            linestyle="none",
            label=label,
        )
    zero_line(left)
    scales(left, "held-out stop, in the order of measurement", "measured - predicted / µm")
    _two_bars(right, [proof.before.reduced, proof.after.reduced], ("without", "with"))
    right.axhline(1.0, color="black", linestyle="--", linewidth=1.0, label="nothing is missing")
    scales(right, up="χ² per degree of freedom")
    heading = f"What took no part in the fit: {proof.split}"
    return sheet.finish(heading if title is None else title, stamp=stamp)
