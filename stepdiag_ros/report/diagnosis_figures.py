"""The pictures of a diagnosis: where the gap is, what was tried, the gap before and after."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.discrepancy.findings import Diagnosis, Share
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES, Vector, translation
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD
from stepdiag_ros.report.diagnosis import DiagnosisReport, gap_figures
from stepdiag_ros.report.figures import legend_below, new_picture, tidy
from stepdiag_ros.report.numbers import COVERAGE_FACTOR, MICRO

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture

_MILLI = 1e3
_BEFORE, _AFTER, _QUIET = "#D55E00", "#0072B2", "#999999"
_ARROWS = {FORWARD: "→", BACKWARD: "←"}
_SIGNIFICANT = 0.001
_MOST_BARS = 12
_MOST_PARTS = 14
_NOT_DRAWN = ("pass",)
"""Ways of splitting that the map of the gap shows already."""
_FEW_PARTS = 3
_LETTERS_OF_A_PANEL = 26
_MOST_LABELS = 60
_COLUMNS = 4
_SCALE_QUANTILE = 0.995


def draw_diagnosis(report: DiagnosisReport) -> "dict[str, Picture]":
    """Draw all pictures that the diagnosis has something for, by the names of their files."""
    drawn = {
        "gap_map": map_picture(report),
        "gap_where": where_picture(report.diagnosis),
        "candidates": ranking_picture(report),
        "gap_traces": traces_picture(report),
        "held_out": held_out_picture(report),
        "curves": curves_picture(report),
    }
    return {name: picture for name, picture in drawn.items() if picture is not None}


def map_picture(report: DiagnosisReport) -> "Picture":
    """Draw the gap at every stop of every pass, before and after, in one scale of colours."""
    diagnosis = report.diagnosis
    stops = diagnosis.stops
    gaps = [("before", diagnosis.residual_before)]
    if report.findings:
        gaps.append(("after", diagnosis.residual_after))
    rows = len(stops.lines)
    picture = new_picture(11.0, float(np.clip(1.8 + 0.13 * rows, 4.0, 14.0)))
    panels = picture.subplots(1, len(gaps), squeeze=False, sharey=True)[0]
    reach = _reach(diagnosis.residual_before, diagnosis.noise)
    for axes, (when, gap) in zip(panels, gaps, strict=True):
        shown = np.full((rows, int(stops.number.max()) + 1), np.nan)
        shown[stops.pass_index, stops.number] = gap * MICRO
        axes.set_facecolor("0.88")
        mesh = axes.pcolormesh(
            np.arange(shown.shape[1] + 1) - 0.5,
            np.arange(rows + 1) - 0.5,
            np.ma.masked_invalid(shown),
            cmap="RdBu_r",
            vmin=-reach,
            vmax=reach,
        )
        rms, largest = gap_figures(gap)
        axes.set_title(
            f"{when}: rms {rms * MICRO:.3f} µm, largest {largest * MICRO:.2f} µm", fontsize=9
        )
        axes.set_xlabel("stop along the pass", fontsize=9)
        axes.tick_params(labelsize=7)
        axes.locator_params(axis="x", integer=True)
        for border in np.flatnonzero(np.diff(_setups_of_passes(stops))):
            axes.axhline(border + 0.5, color="0.35", linewidth=0.5)
    ticks, labels = _pass_ticks(stops)
    panels[0].set_yticks(ticks, labels, fontsize=6 if len(ticks) > 30 else 7)
    panels[0].invert_yaxis()
    bar = picture.colorbar(mesh, ax=list(panels), shrink=0.7, extend="both")
    bar.set_label("measured minus simulated / µm", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    picture.suptitle("The gap at every stop (passes in the order of measurement)", fontsize=11)
    return picture


def _reach(gap: Vector, noise: float) -> float:
    """Return the end of the scale of colours, µm: most of the gap, and at least the noise."""
    known = np.abs(gap[np.isfinite(gap)])
    largest = float(np.quantile(known, _SCALE_QUANTILE)) if known.size else 0.0
    least = 3.0 * noise if np.isfinite(noise) else 0.0
    return max(largest, least, 1e-12) * MICRO


def _setups_of_passes(stops: Stops) -> NDArray[np.int64]:
    first = np.unique(stops.pass_index, return_index=True)[1]
    return stops.setup[first]


def _pass_ticks(stops: Stops) -> tuple[list[int], list[str]]:
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
    if len(words) > _MOST_LABELS:
        setups = _setups_of_passes(stops)
        places = [place for place in places if place == 0 or setups[place] != setups[place - 1]]
    return places, [words[place] for place in places]


def where_picture(diagnosis: Diagnosis) -> "Picture | None":
    """Draw the rms of the gap over every way of splitting it, beside the noise."""
    splits: dict[str, list[Share]] = {}
    for share in diagnosis.map:
        if share.split not in _NOT_DRAWN:
            splits.setdefault(share.split, []).append(share)
    splits = {name: _clearest(shares) for name, shares in splits.items() if len(shares) > 1}
    if not splits:
        return None
    rows = -(-len(splits) // _COLUMNS)
    picture = new_picture(11.0, 1.2 + 2.9 * rows)
    grid = picture.subplots(rows, min(_COLUMNS, len(splits)), squeeze=False)
    for axes in grid.ravel()[len(splits) :]:
        axes.set_visible(False)
    for axes, (name, shares) in zip(grid.ravel(), splits.items(), strict=False):
        _draw_shares(axes, name, shares, diagnosis.noise)
    for row in grid:
        row[0].set_ylabel("rms of the gap / µm", fontsize=9)
    picture.suptitle("Where the gap is, before anything was added to the model", fontsize=11)
    legend_below(
        picture,
        grid.ravel(),
        ["What the free values of the model take up of the noise makes the gap smaller than it."],
    )
    return picture


def _clearest(shares: list[Share]) -> list[Share]:
    """Return the parts in their order, of many only those that are farthest from noise."""
    kept = sorted(shares, key=lambda share: share.p_value)[:_MOST_PARTS]
    return [share for share in shares if share in kept]


def _draw_shares(axes: "Axes", name: str, shares: Sequence[Share], noise: float) -> None:
    for clear, colour, label in (
        (True, _BEFORE, f"more than noise (p < {_SIGNIFICANT:g})"),
        (False, _QUIET, "as noise"),
    ):
        places = [
            place for place, share in enumerate(shares) if (share.p_value < _SIGNIFICANT) == clear
        ]
        if places:
            heights = [shares[place].rms * MICRO for place in places]
            axes.bar(places, heights, color=colour, label=label, width=0.75)
    if np.isfinite(noise):
        axes.axhline(
            noise * MICRO, color="black", linestyle="--", linewidth=1.0, label="noise of a reading"
        )
    labels = [share.part for share in shares]
    if len(labels) <= _FEW_PARTS:
        labels = [label.replace(" ", "\n") for label in labels]
    longest = max(len(line) for label in labels for line in label.split("\n"))
    upright = longest * len(labels) > _LETTERS_OF_A_PANEL
    axes.set_xticks(range(len(labels)), labels, rotation=90 if upright else 0)
    axes.set_title(f"by {name}", fontsize=9)
    tidy(axes)
    axes.tick_params(axis="x", labelsize=7)


def ranking_picture(report: DiagnosisReport) -> "Picture | None":
    """Draw what each candidate closes of the gap, the named ones and those that lost."""
    bars = []
    for finding in report.findings:
        bars.append((finding.label, finding.gain, "found"))
        for other in finding.runners_up[:_MOST_BARS]:
            kind = "not ruled out" if other.ambiguous else "lost"
            bars.append((f"{other.label}", other.gain, kind))
    if not bars:
        return None
    colours = {"found": _AFTER, "not ruled out": "#E69F00", "lost": _QUIET}
    picture = new_picture(10.0, 1.6 + 0.26 * len(bars))
    axes = picture.subplots()
    for kind, colour in colours.items():
        places = [place for place, bar in enumerate(bars) if bar[2] == kind]
        if places:
            axes.barh(
                places,
                [max(bars[place][1], 0.0) for place in places],
                color=colour,
                label=kind,
                height=0.7,
            )
    axes.set_yticks(range(len(bars)), [bar[0] for bar in bars], fontsize=8)
    axes.invert_yaxis()
    for place, bar in enumerate(bars):
        axes.annotate(
            f"{bar[1]:,.0f}",
            (max(bar[1], 0.0), place),
            xytext=(3, 0),
            textcoords="offset points",
            va="center",
            fontsize=7,
        )
    axes.margins(x=0.08)
    tidy(axes)
    axes.tick_params(axis="y", labelsize=8)
    axes.set_xlabel("part of χ² that the candidate closes, Δχ²", fontsize=9)
    picture.suptitle(
        f"Candidates ranked: below each found effect, what lost against it"
        f" ({report.diagnosis.tested:,} tried)",
        fontsize=11,
    )
    legend_below(picture, [axes])
    return picture


def traces_picture(report: DiagnosisReport) -> "Picture":
    """Draw the gap of every pass along its line, before and after."""
    diagnosis = report.diagnosis
    stops = diagnosis.stops
    names = list(dict.fromkeys(line.name for line in stops.lines))
    columns = min(_COLUMNS, len(names))
    rows = -(-len(names) // columns)
    picture = new_picture(11.0, 1.4 + 2.5 * rows)
    grid = picture.subplots(rows, columns, squeeze=False, sharey=True)
    for axes in grid.ravel()[len(names) :]:
        axes.set_visible(False)
    way = np.sum(stops.direction * (stops.position - stops.start), axis=1) * _MILLI
    for axes, name in zip(grid.ravel(), names, strict=False):
        own = [index for index, line in enumerate(stops.lines) if line.name == name]
        _draw_passes(axes, own, way, diagnosis.residual_before, stops, _BEFORE, "before")
        if report.findings:
            _draw_passes(axes, own, way, diagnosis.residual_after, stops, _AFTER, "after")
        if np.isfinite(diagnosis.noise):
            band = COVERAGE_FACTOR * diagnosis.noise * MICRO
            axes.axhspan(-band, band, color="0.85", zorder=0, label="95 % of the noise")
        axes.set_title(name, fontsize=9)
        tidy(axes)
    for row in grid:
        row[0].set_ylabel("measured - simulated / µm", fontsize=9)
    for axes in grid[-1]:
        axes.set_xlabel("along the beam / mm", fontsize=9)
    picture.suptitle("The gap along every line, one trace a pass", fontsize=11)
    legend_below(picture, grid.ravel())
    return picture


def _draw_passes(
    axes: "Axes",
    own: Sequence[int],
    way: Vector,
    gap: Vector,
    stops: Stops,
    colour: str,
    label: str,
) -> None:
    for number, index in enumerate(own):
        rows = stops.pass_index == index
        axes.plot(
            way[rows],
            gap[rows] * MICRO,
            color=colour,
            linewidth=0.7,
            # Told apart by the kind of line too: not every printer and eye has colours.
            linestyle="--" if colour == _BEFORE else "-",
            alpha=0.8,
            label=label if number == 0 else None,
        )


def held_out_picture(report: DiagnosisReport) -> "Picture | None":
    """Draw how well readings that took no part in the fit were predicted, before and after."""
    proof = report.held_out
    if proof is None:
        return None
    picture = new_picture(11.0, 4.4)
    left, right = picture.subplots(1, 2, width_ratios=[3.0, 1.0])
    for part, colour, label in (
        (proof.before, _BEFORE, "predicted without the effect"),
        (proof.after, _AFTER, "predicted with it"),
    ):
        held = np.isfinite(part.residual)
        left.plot(
            np.arange(np.count_nonzero(held)),
            part.residual[held] * MICRO,
            color=colour,
            marker="." if colour == _AFTER else "o",
            markersize=2.5,
            linestyle="none",
            label=label,
        )
    left.axhline(0.0, color="0.4", linewidth=0.7)
    left.set_xlabel("held-out reading, in the order of measurement", fontsize=9)
    left.set_ylabel("measured - predicted / µm", fontsize=9)
    tidy(left)
    heights = [proof.before.reduced, proof.after.reduced]
    right.bar([0, 1], heights, color=[_BEFORE, _AFTER], width=0.6)
    for place, height in enumerate(heights):
        right.annotate(f"{height:.2f}", (place, height), ha="center", va="bottom", fontsize=9)
    right.axhline(1.0, color="black", linestyle="--", linewidth=1.0, label="nothing is missing")
    right.set_xticks([0, 1], ["without", "with"])
    right.set_ylabel("χ² per degree of freedom", fontsize=9)
    right.margins(y=0.12)
    tidy(right)
    picture.suptitle(f"What took no part in the fit: {proof.split}", fontsize=11)
    legend_below(picture, [left, right])
    return picture


def curves_picture(report: DiagnosisReport) -> "Picture | None":
    """Draw the nine translations solved from the run as it is and without the effects."""
    if report.curves is None:
        return None
    picture = new_picture(11.0, 8.4)
    grid = picture.subplots(3, 3, sharex="col", squeeze=False)
    for axis, letter in enumerate(AXES):
        for error in range(3):
            axes = grid[error][axis]
            name = translation(error, axis)
            for result, colour, label, line in (
                (report.curves[0], _BEFORE, "before: model as it was", "--"),
                (report.curves[1], _AFTER, "after: effects taken off", "-"),
            ):
                nodes = result.nodes[axis] * _MILLI
                value = result.curves[name] * MICRO
                band = COVERAGE_FACTOR * result.standard_uncertainty[name] * MICRO
                axes.fill_between(
                    nodes, value - band, value + band, color=colour, alpha=0.18, linewidth=0
                )
                axes.plot(nodes, value, color=colour, linestyle=line, linewidth=1.2, label=label)
            tidy(axes)
            axes.set_title(name, fontsize=9)
            if axis == 0:
                axes.set_ylabel("error / µm", fontsize=9)
            if error == 2:
                axes.set_xlabel(f"{letter} / mm", fontsize=9)
    picture.suptitle(
        "What the missing effect did to the error curves (least squares, 95 % bands)", fontsize=11
    )
    legend_below(picture, grid.ravel())
    return picture
