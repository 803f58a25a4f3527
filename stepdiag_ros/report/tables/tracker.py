"""A seven-line test with a tracker as tables, sentences and JSON."""

import math
from typing import Any

import numpy as np

from stepdiag_ros.evaluation.tracker import TrackerReport
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.tracker.evaluation import LineEvaluation, SevenLineResult
from stepdiag_ros.metrology.tracker.joint import NAMES, JointEstimate
from stepdiag_ros.metrology.tracker.location import Location
from stepdiag_ros.metrology.tracker.separation import AxisSeparation
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.report.tables.positioning import target_table
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import ARC_SECONDS, plain
from stepdiag_ros.text.table import Table, new_table
from stepdiag_ros.words.positioning import decimals_of, written
from stepdiag_ros.words.tracker import lead_sentences, sentences_of, with_u

_PARAMETERS = ("E", "B", "M", "R", "A")
_MOST_DEPARTURES = 5
"""Passes in a terminal; a page and the JSON document have all."""


def location_table(location: Location) -> Table:
    """Return where the tracker is: eq. 1 and refined, with U (95 %)."""
    factor = location.adjustment.coverage_factor
    table = new_table(
        "Tracker (machine coordinates of the reflector that would meet it)",
        "",
        "unit",
        "linear, ATLI eq. 1",
        "refined ± U",
    )
    values = np.append(location.position, location.start_length)
    spreads = location.standard_uncertainty
    names = ("X", "Y", "Z", "L0, length at the zero")
    for name, value, spread, linear in zip(names, values, spreads, location.linear, strict=True):
        table.add_row(
            name,
            "mm",
            plain(linear * IN_MILLI, 4),
            with_u(value, factor * spread, IN_MILLI, 4),
        )
    fit = location.adjustment
    table.add_row("largest residual", "µm", "", plain(np.max(np.abs(fit.residuals)) * IN_MICRO))
    table.add_row("degrees of freedom", "", "", str(fit.degrees_of_freedom))
    table.add_row("condition number", "", "", f"{fit.condition:.3g}")
    table.add_row("u(position) / u(length)", "", "", f"{location.dilution:.3g}")
    return table


def joint_table(joint: JointEstimate, truth: Vector | None = None) -> Table:
    """Return scales and squareness from all readings together, beside the true values if known."""
    heads = ["", "unit", "value ± U"] if truth is None else ["", "unit", "value ± U", "truth"]
    table = new_table(
        "Positioning and squareness from all readings, with the tracker's place", *heads
    )
    table.whole_title = True
    for index, name in enumerate(NAMES):
        spread = COVERAGE_FACTOR * joint.standard_uncertainty[index]
        for unit, scale, decimals in (("µm/m", IN_MICRO, 2), ("arcsec", ARC_SECONDS, 3)):
            if unit == "arcsec" and name.startswith("scale"):
                continue
            row = [with_u(joint.values[index], spread, scale, decimals)]
            if truth is not None:
                row.append(plain(truth[index] * scale, decimals))
            table.add_row(name if unit == "µm/m" else "", unit, *row)
    return table


def departures_table(joint: JointEstimate, most: int | None = None) -> Table | None:
    """Return how far each pass departs from what all others say of it; None without passes.

    Args:
        joint: with its passes.
        most: show so many, those that chance explains least first; None: all, as measured.
    """
    shown = list(joint.passes)
    title = "Each pass against all others"
    if most is not None and len(shown) > most:
        shown = sorted(shown, key=lambda one: one.p_value)[:most]
        title += f": the {most} of {len(joint.passes)} that depart most"
    if not shown:
        return None
    table = new_table(title, "pass", "readings", "departure, rms / µm", "χ² / readings", "p")
    table.whole_title = True
    for one in shown:
        table.add_row(
            str(one),
            str(one.degrees_of_freedom),
            plain(one.rms * IN_MICRO, 3),
            plain(one.chi_squared / one.degrees_of_freedom),
            f"{one.p_value:.2g}",
        )
    return table


def lines_table(result: SevenLineResult) -> Table:
    """Return the parameters of the standards for each line, by both places of the tracker."""
    table = new_table(
        "Lines by ISO 230-2 (X, Y, Z) and ISO 230-6, µm",
        "line",
        "tracker from",
        *_PARAMETERS,
        "slope / µm/m ± U",
    )
    table.columns[1].number = False
    both = [("places alone", result.located), ("all readings", result.corrected)]
    for index in range(len(result.located.tests)):
        for title, lines in both:
            if lines is None:
                continue
            test, slope = lines.tests[index], lines.slopes[index]
            decimals = decimals_of([test])
            table.add_row(
                test.name if lines is result.located else "",
                title,
                *(_written_short(test, name, decimals) for name in _PARAMETERS),
                with_u(slope.slope, COVERAGE_FACTOR * slope.standard_uncertainty, IN_MICRO, 2),
            )
    return table


def _written_short(test: Any, name: str, decimals: int) -> str:
    value, spread = test.parameters[name], test.expanded_uncertainty[name]
    if math.isfinite(spread) or not math.isfinite(value):
        return written(value, spread, decimals)
    return plain(value * IN_MICRO, decimals)


def squareness_rows(result: SevenLineResult) -> Table | None:
    """Return squareness from the face lines' slopes beside the joint estimate; None without."""
    sources: list[tuple[str, LineEvaluation]] = [("slopes, tracker from places", result.located)]
    if result.corrected is not None:
        sources.append(("slopes, tracker from all", result.corrected))
    rows = [(title, one) for title, lines in sources for one in lines.squareness]
    closures = [(title, lines) for title, lines in sources if math.isfinite(lines.closure)]
    if not rows and not closures:
        return None
    table = new_table("Squareness from the face lines", "", "from", "µm/m ± U")
    table.whole_title = True
    table.columns[1].number = False
    for title, one in rows:
        table.add_row(
            one.name,
            title,
            with_u(one.value, COVERAGE_FACTOR * one.standard_uncertainty, IN_MICRO, 2),
        )
    for title, lines in closures:
        written_closure = with_u(
            lines.closure, COVERAGE_FACTOR * lines.closure_uncertainty, IN_MICRO, 2
        )
        table.add_row("closure of xyz", title, written_closure)
    return table


def separation_table(separations: "dict[str, AxisSeparation | str]") -> Table | None:
    """Return positioning and squareness from single lines; None where no line determines them."""
    found = {name: one for name, one in separations.items() if isinstance(one, AxisSeparation)}
    if not found:
        return None
    table = new_table(
        "Separated from the readings of one line, tracker from places alone",
        "line",
        "scale / µm/m ± U",
        "lean to the tracker / µm/m ± U",
        "direction of the lean",
        "offset / mm",
        "correlation",
    )
    for name, one in found.items():
        factor = one.adjustment.coverage_factor
        spread = one.standard_uncertainty
        table.add_row(
            name,
            with_u(one.scale, factor * spread[0], IN_MICRO, 2),
            with_u(one.lean, factor * spread[1], IN_MICRO, 2),
            "({:.2f}, {:.2f}, {:.2f})".format(*(one.towards + 0.0)),
            plain(one.offset * IN_MILLI, 2),
            plain(one.correlation, 3),
        )
    return table


def print_tracker(report: TrackerReport, console: PlainConsole) -> None:
    """Print a report: tables, then sentences."""
    console.print(f"Source: {report.source}, station {report.station}")
    for text in lead_sentences(report):
        console.sentence(text)
    console.print()
    tables = [location_table(report.location)]
    result = report.result
    if result is not None:
        if result.joint is not None:
            tables.append(joint_table(result.joint, report.truth))
            departed = departures_table(result.joint, _MOST_DEPARTURES)
            if departed is not None:
                tables.append(departed)
        tables.append(lines_table(result))
        for made in (squareness_rows(result), separation_table(result.separations)):
            if made is not None:
                tables.append(made)
        best = result.corrected or result.located
        tables += [target_table(test, decimals_of([test])) for test in best.tests]
    for table in tables:
        console.print(table)
    for text in sentences_of(report):
        console.sentence(text)
