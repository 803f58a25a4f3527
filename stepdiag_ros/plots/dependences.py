"""A gap without a name: the formula that closes it, over each quantity on which it depends."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stepdiag_ros.metrology.discrepancy.findings import Dependence, Diagnosis, Finding
from stepdiag_ros.metrology.effects.learned_rotation import learned
from stepdiag_ros.metrology.effects.learned_shape import READING, product_of, quantity
from stepdiag_ros.metrology.geometry import ROTATIONS, Vector
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.plots.style import AFTER, GREY, Sheet, panel_title, scales, zero_line

_LEAST_SHARE = 0.3
"""Of a displacement, that a beam must see for a reading to be drawn as one."""
_MOST_DOTS = 1500


def gap_dependences(
    diagnosis: Diagnosis, *, title: str | None = None, stamp: str = "", axes: Any = None
) -> Figure | None:
    """Draw the displacement of each dependence at the stops, with what the readings show beside it.

    None where the gap is not described by a formula.

    Args:
        diagnosis: of a run.
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: one for each quantity of each dependence instead of a new figure.
    """
    described = diagnosis.description
    found = {one.label: one for one in diagnosis.findings}
    dependences = [] if described is None or not found else list(described.dependences)
    shown = [(one, place, words) for one in dependences for place, words in enumerate(one.drivers)]
    if not shown:
        return None
    sheet = Sheet(len(shown), 3, 1.9, axes=axes, gap=(0.6, 0.75))
    for panel, (one, place, words) in zip(sheet.panels, shown, strict=True):
        values, unit = quantity(one.shapes[0], place, diagnosis.stops)
        formula, expanded = _displacement(one, list(found.values()), diagnosis)
        seen = _seen(one, diagnosis)
        direction = np.where(seen, _direction(one, diagnosis), 1.0)
        measured = formula + diagnosis.residual_after / direction
        rows = np.flatnonzero(seen & np.isfinite(measured))
        rows = rows[:: len(rows) // _MOST_DOTS + 1]
        panel.plot(
            values[rows],
            measured[rows] * IN_MICRO,
            linestyle="none",
            marker="o",
            markersize=1.6,
            color=GREY,
            label="readings, less all else",
        )
        panel.errorbar(
            values[rows],
            formula[rows] * IN_MICRO,
            yerr=expanded[rows] * IN_MICRO,
            fmt=AFTER.marker,
            markersize=2.0,
            linewidth=0.6,
            color=AFTER.colour,
            label="formula ± U (95 %)",
        )
        zero_line(panel)
        panel_title(panel, _ordinate(one))
        scales(panel, f"{words}{f' / {unit}' if unit else ''}")
    heading = "On what the gap depends: the formula, and the readings beside it"
    return sheet.finish(heading if title is None else title, stamp=stamp)


def _ordinate(one: Dependence) -> str:
    if one.acts_on == READING:
        return "reading / µm"
    if one.acts_on in ROTATIONS:
        return f"rotation {one.acts_on} / µrad"
    return f"displacement along {one.acts_on} / µm"


def _direction(one: Dependence, diagnosis: Diagnosis) -> Vector:
    """Return the change of each reading for a unit amplitude: 1, a direction cosine, or m/rad."""
    stops = diagnosis.stops
    effect = learned(one.acts_on)
    # A power of 0 of a place is 1 everywhere.
    unit = {"acts_on": one.acts_on, "shape": "x^0"}
    return effect.change(unit, {"amplitude": 1.0}, stops).readings(stops)


def _seen(one: Dependence, diagnosis: Diagnosis) -> Any:
    seen = np.abs(_direction(one, diagnosis))
    return seen > _LEAST_SHARE * (np.max(seen) if one.acts_on in ROTATIONS else 1.0)


def _displacement(
    one: Dependence, findings: list[Finding], diagnosis: Diagnosis
) -> tuple[Vector, Vector]:
    """Return the displacement by the shapes of a dependence, and its U (95 %), m, (n,) each."""
    own = [
        place
        for place, finding in enumerate(findings)
        if finding.candidate.setting.get("shape") in one.shapes
        and finding.candidate.setting.get("acts_on") == one.acts_on
    ]
    ends = np.cumsum([len(finding.candidate.effect.sizes) for finding in findings])
    shapes = np.column_stack(
        [product_of(findings[place].candidate.setting["shape"], diagnosis.stops) for place in own]
    )
    sizes = np.array([findings[place].sizes["amplitude"] for place in own])
    where = ends[own] - 1
    covariance = diagnosis.covariance[np.ix_(where, where)]
    low, high = findings[own[0]].band["amplitude"]
    factor = 0.5 * (high - low) / findings[own[0]].standard_uncertainty["amplitude"]
    variance = np.einsum("ni,ij,nj->n", shapes, covariance, shapes)
    return shapes @ sizes, factor * np.sqrt(np.maximum(variance, 0.0))
