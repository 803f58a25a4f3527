"""A seven-line test with a tracker as tables, sentences and JSON."""

import math
from typing import Any

import numpy as np
from rich.table import Table

from stepdiag_ros.evaluation.tracker import TrackerReport
from stepdiag_ros.metrology.forward import OVER_90_DEGREES, RIGHT_HANDED
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.tracker.document_figures import FigureFive, FigureFour
from stepdiag_ros.metrology.tracker.evaluation import LineEvaluation, SevenLineResult
from stepdiag_ros.metrology.tracker.joint import NAMES, JointEstimate
from stepdiag_ros.metrology.tracker.location import Location
from stepdiag_ros.metrology.tracker.separation import Separation
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.report.positioning import decimals_of, target_table, written
from stepdiag_ros.report.tables import PlainConsole, new_table
from stepdiag_ros.text.numbers import ARC_SECONDS, MICRO, UNKNOWN, plain, with_uncertainty

_MILLI = 1e3
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
            name, "mm", plain(linear * _MILLI, 4), _value(value, factor * spread, _MILLI, 4)
        )
    fit = location.adjustment
    table.add_row("largest residual", "µm", "", plain(np.max(np.abs(fit.residuals)) * MICRO))
    table.add_row("degrees of freedom", "", "", str(fit.degrees_of_freedom))
    table.add_row("condition number", "", "", f"{fit.condition:.3g}")
    table.add_row("u(position) / u(length)", "", "", f"{location.dilution:.3g}")
    return table


def joint_table(joint: JointEstimate, truth: Vector | None = None) -> Table:
    """Return scales and squareness from all readings together, beside the truth if it is known."""
    heads = ["", "unit", "value ± U"] if truth is None else ["", "unit", "value ± U", "truth"]
    table = new_table(
        "Positioning and squareness from all readings, with the tracker's place", *heads
    )
    table.min_width = len(str(table.title))
    for index, name in enumerate(NAMES):
        spread = COVERAGE_FACTOR * joint.standard_uncertainty[index]
        for unit, scale, decimals in (("µm/m", MICRO, 2), ("arcsec", ARC_SECONDS, 3)):
            if unit == "arcsec" and name.startswith("scale"):
                continue
            row = [_value(joint.values[index], spread, scale, decimals)]
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
    table.min_width = len(title)
    for one in shown:
        table.add_row(
            str(one),
            str(one.degrees_of_freedom),
            plain(one.rms * MICRO, 3),
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
    table.columns[1].justify = "left"
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
                _value(slope.slope, COVERAGE_FACTOR * slope.standard_uncertainty, MICRO, 2),
            )
    return table


def _written_short(test: Any, name: str, decimals: int) -> str:
    value, spread = test.parameters[name], test.expanded_uncertainty[name]
    if math.isfinite(spread) or not math.isfinite(value):
        return written(value, spread, decimals)
    return plain(value * MICRO, decimals)


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
    table.min_width = len(str(table.title))
    table.columns[1].justify = "left"
    for title, one in rows:
        table.add_row(
            one.name, title, _value(one.value, COVERAGE_FACTOR * one.standard_uncertainty, MICRO, 2)
        )
    for title, lines in closures:
        written_closure = _value(
            lines.closure, COVERAGE_FACTOR * lines.closure_uncertainty, MICRO, 2
        )
        table.add_row("closure of xyz", title, written_closure)
    return table


def separation_table(separations: "dict[str, Separation | str]") -> Table | None:
    """Return positioning and squareness from single lines; None where no line tells them."""
    found = {name: one for name, one in separations.items() if isinstance(one, Separation)}
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
            _value(one.scale, factor * spread[0], MICRO, 2),
            _value(one.lean, factor * spread[1], MICRO, 2),
            "({:.2f}, {:.2f}, {:.2f})".format(*(one.towards + 0.0)),
            plain(one.offset * _MILLI, 2),
            plain(one.correlation, 3),
        )
    return table


def sentences_of(report: TrackerReport) -> list[str]:
    """Return what the reader must know, in words, each once."""
    location = report.location
    said = [*report.remarks, *(f"{text}." for text in report.left_out)]
    said += [*(f"Warning: {text}" for text in location.warnings)]
    said += location.remarks
    result = report.result
    if result is None or result.joint is None:
        said.append(
            "U of the place: 95 %, of the lengths alone; Student's factor where their uncertainty"
            " was taken from the residuals."
        )
    if result is not None:
        if result.joint is not None:
            said += _joint_sentences(result.joint)
        said.append(
            f"Squareness sign: {RIGHT_HANDED}. By the other definition ({OVER_90_DEGREES}) B0Z has"
            " the other sign, C0Y and A0Z the same."
        )
        said += result.remarks
        for name, one in result.separations.items():
            if isinstance(one, str):
                said.append(f"Line {name} alone: {one}.")
            else:
                said += one.remarks
        for test in result.located.tests:
            said += [f"Line {test.name}: {text}." for text in test.remarks]
    return list(dict.fromkeys(said))


def _joint_sentences(joint: JointEstimate) -> list[str]:
    said = [
        f"U: 95 %, with what the machine's curves may do; {joint.machine.place}.",
        f"Frame of the tracker's place: {joint.machine.frame}.",
        "Sizes of what repeats and of what differs between passes, as the readings tell them with"
        " what is usual: "
        + "; ".join(f"{name}: {size:.2g}" for name, size in joint.sizes.items())
        + ".",
    ]
    if not joint.machine.chain:
        said.append(
            "U is unknown, because the order of the machine's axes was not told (--chain): through"
            " which levers angular errors act depends on it."
        )
    return said + [f"Warning, joint estimate: {text}" for text in joint.warnings]


def lead_sentences(report: TrackerReport) -> list[str]:
    """Return what is said first: whether the readings agree, and the errors that they tell."""
    if report.result is None:
        return []
    said = [f"{report.verdict.name}: {report.verdict.sentence}"]
    joint = report.result.joint
    if joint is not None:
        said.append("; ".join(" ".join(pair) for pair in joint_values(joint)) + ".")
    return said


def joint_values(joint: JointEstimate) -> list[tuple[str, str]]:
    """Return name and value ± U with its unit of each scale and squareness."""
    made = []
    for index, name in enumerate(NAMES):
        unit = "µm/m" if name.startswith("scale") else "µrad"
        spread = COVERAGE_FACTOR * joint.standard_uncertainty[index]
        made.append((name, f"{_value(joint.values[index], spread, MICRO, 2)} {unit}"))
    return made


def print_tracker(report: TrackerReport, console: PlainConsole) -> None:
    """Print a report: tables, then sentences."""
    console.print(f"Source: {report.source}, station {report.station}")
    for text in lead_sentences(report):
        console.print(text, width=console.text_width, soft_wrap=console.text_width is None)
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
        console.print(text, width=console.text_width, soft_wrap=console.text_width is None)


def figure_sentences(four: FigureFour, five: FigureFive) -> list[str]:
    """Say what the curves of ATLI Figs. 4 and 5 show, and which geometry gives them."""
    towards, away = four.towards.deviation * MICRO, four.away.deviation * MICRO
    half = towards[len(towards) // 2]
    located = five.located.deviation * MICRO
    lowest = int(np.argmin(located))
    scatter = five.location.adjustment.uncertainty[0] * MICRO
    shift = five.shift * _MILLI
    return [
        f"Fig. 4: squareness {np.degrees(four.gamma):.2g}° alone, tracker on the nominal line"
        f" {four.distance:.3g} m ahead of its start: the deviation is {half:.2f} µm at half the"
        f" length and {towards[-1]:.2f} µm at its end, so it grows faster than the length. With the"
        f" tracker as far behind the start it is {away[-1]:.2f} µm at the end and grows more slowly"
        " than the length.",
        f"Fig. 5: squareness {np.degrees(five.errors.gamma):.2g}°, positioning"
        f" {five.errors.scale * MICRO:.3g} µm/m, tracker located from six places that the same"
        f" machine reached: it is ({shift[0]:+.2f}, {shift[1]:+.2f}, {shift[2]:+.2f}) mm away from"
        f" its estimated place. The deviation begins at {located[0]:.1f} µm, falls to"
        f" {located[lowest]:.1f} µm at {five.located.distance[lowest]:.2f} m from the tracker and"
        f" rises to {located[-1]:.1f} µm.",
        f"The residuals of these six places are {scatter:.0f} µm in size, of the order of the 13 µm"
        " that the document expected. They say nothing of the millimetres by which the place is"
        " wrong: the fit has taken these up.",
        "Reckoned from the tracker's true place the same line shows its positioning error and no"
        " offset: squareness changes next to nothing along a line that runs away from the tracker.",
    ]


def _value(value: float, expanded: float, scale: float, decimals: int) -> str:
    if not math.isfinite(value):
        return UNKNOWN
    if not math.isfinite(expanded):
        return f"{plain(value * scale, decimals)} ± {UNKNOWN}"
    text, spread = with_uncertainty(value * scale, expanded * scale)
    return f"{text} ± {spread}"
