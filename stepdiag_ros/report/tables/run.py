"""The results as text tables for a terminal (and for ``report.txt`` in the results folder)."""

import math
from collections.abc import Sequence

import numpy as np

from stepdiag_ros.evaluation.lead import RunLead, lead_of
from stepdiag_ros.evaluation.report import (
    Report,
    Truth,
    TruthComparison,
    compare_with_truth,
    frame_sentences,
    method_title,
    robust_to_setup,
    short_title,
    true_largest,
)
from stepdiag_ros.evaluation.single_errors import PEAK_TO_PEAK, with_ranges
from stepdiag_ros.metrology.forward import AXES_OF
from stepdiag_ros.metrology.geometry import AXES, ROTATIONS, SQUARENESS, TRANSLATIONS
from stepdiag_ros.metrology.plausible import ORDINARY
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.metrology.visibility import DETERMINED, VerdictRow, Visibility
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import (
    ARC_SECONDS,
    OF_READINGS,
    UNKNOWN,
    place_in_mm,
    plain,
    plus_minus,
)
from stepdiag_ros.text.table import Table, new_table
from stepdiag_ros.words.lead import (
    coverage_sentences,
    from_here,
    laser_scale,
    next_lines,
    sentences_of,
)
from stepdiag_ros.words.squareness import (
    LEAST_SQUARES_LINES,
    SIGN_DEFINITIONS,
    SignDefinition,
    sign,
)

_MOST_REASONS = 6
"""With more undetermined errors than this, a method is not explained line by line."""
_MICRO_UNITS = {"m": "µm", "rad": "µrad"}


def _find(figures: tuple[Figure, ...], name: str) -> Figure | None:
    return next((figure for figure in figures if figure.name == name), None)


def _squareness_cells(
    figure: Figure | None, scale: float, definition: SignDefinition, name: str
) -> str:
    if figure is None:
        return UNKNOWN
    return plus_minus(
        sign(name, definition) * figure.value, figure.standard_uncertainty, scale=scale
    )


def squareness_table(report: Report, definition: SignDefinition) -> Table:
    """Return squareness by all methods side by side, in µm/m and arc-seconds."""
    results = report.ordered_results()
    columns = [short_title(result.method) for result in results]
    if report.truth is not None:
        columns.append("Truth")
    table = new_table(f"Squareness, {OF_READINGS}", "", "unit", *columns)
    for name in SQUARENESS:
        reference, other = AXES_OF[name]
        for number, (unit, scale) in enumerate((("µm/m", IN_MICRO), ("arcsec", ARC_SECONDS))):
            cells = [
                _squareness_cells(_find(result.figures, name), scale, definition, name)
                for result in results
            ]
            if report.truth is not None:
                true = _find(report.truth.figures, name)
                value = math.nan if true is None else sign(name, definition) * true.value
                cells.append(plain(value * scale, 2 if number == 0 else 3))
            label = f"{name}  {other} to {reference}" if number == 0 else ""
            table.add_row(label, unit, *cells)
    return table


def figure_table(report: Report, prefix: str, title: str, only_known: bool = False) -> Table | None:
    """Return the figures whose names begin with a word, by all methods side by side.

    Lengths are in µm, angles in µrad. None if no method has such a figure.

    Args:
        report: what is printed.
        prefix: first word of the names.
        title: of the table.
        only_known: leave out methods and figures of which nothing is determined: few
            plans determine rotations, and the visibility table says which.
    """
    results: Sequence[VolumetricErrors] = report.ordered_results()
    names: list[str] = []
    if only_known:
        results = [result for result in results if any(_known(result, prefix))]
    for result in results:
        for name in _known(result, prefix) if only_known else _all_named(result, prefix):
            if name not in names:
                names.append(name)
    if not names:
        return None
    columns = [short_title(result.method) for result in results]
    if report.truth is not None:
        columns.append("Truth")
    table = new_table(f"{title}, {OF_READINGS}", "", "unit", *columns)
    for name in names:
        cells = []
        unit = "µm"
        for result in results:
            found = _find(result.figures, name)
            if found is not None:
                unit = _MICRO_UNITS[found.unit]
            cells.append(
                UNKNOWN
                if found is None
                else plus_minus(found.value, found.standard_uncertainty, IN_MICRO)
            )
        if report.truth is not None:
            true = _find(report.truth.figures, name)
            cells.append(UNKNOWN if true is None else plain(true.value * IN_MICRO))
        table.add_row(_words(name), unit, *cells)
    return table


def translation_tables(report: Report) -> list[Table | None]:
    """Return positioning peak to peak and at the end of the travel, and straightness."""
    ranged = with_ranges(report)
    kinds = (
        (PEAK_TO_PEAK, "Positioning error, peak to peak over the travel"),
        ("positioning", "Positioning error at the end of the travel"),
        ("straightness", "Straightness, peak to peak off the least-squares line"),
    )
    return [figure_table(ranged, prefix, title) for prefix, title in kinds]


def _all_named(result: VolumetricErrors, prefix: str) -> list[str]:
    return [figure.name for figure in result.figures if figure.name.split(" ")[0] == prefix]


def _known(result: VolumetricErrors, prefix: str) -> list[str]:
    return [
        figure.name
        for figure in result.figures
        if figure.name.split(" ")[0] == prefix and math.isfinite(figure.value)
    ]


def _words(name: str) -> str:
    """Say what a figure is: ``straightness E_YX`` → ``E_YX  of X in Y``."""
    curve = name.split(" ")[-1]
    if curve not in TRANSLATIONS and curve not in ROTATIONS:
        return name
    error, axis = curve[2], curve[3]
    if curve in ROTATIONS:
        return f"{curve}  of {axis} about {AXES['ABC'.index(error)]}"
    return f"{curve}  of {axis}" if error == axis else f"{curve}  of {axis} in {error}"


def setup_table(result: VolumetricErrors) -> Table | None:
    """Return the setup errors that a method found; None if it has none."""
    common = {"straightness", "positioning", "diagonal", "angular", "angular-shape"}
    others = [
        figure
        for figure in result.figures
        if figure.name not in SQUARENESS and figure.name.split(" ")[0] not in common
    ]
    if not others:
        return None
    table = new_table(f"Setup errors, {method_title(result.method)}", "", "unit", "value ± U")
    for figure in others:
        unit = _MICRO_UNITS[figure.unit]
        table.add_row(
            figure.name, unit, plus_minus(figure.value, figure.standard_uncertainty, IN_MICRO)
        )
    return table


def curve_tables(result: VolumetricErrors, rotations: bool = False) -> list[Table]:
    """Return the translations or rotations of a method: one table an axis, one row a node.

    Translations are in µm, rotations in µrad. Rotations, and nodes of them, that are not determined
    at all are left out; errors that can do the same are named elsewhere.
    """
    tables = []
    for axis, (letter, nodes) in enumerate(zip(AXES, result.nodes, strict=True)):
        group = ROTATIONS if rotations else TRANSLATIONS
        names = [name for name in group[3 * axis : 3 * axis + 3] if name in result.curves]
        if rotations:
            names = [name for name in names if np.any(np.isfinite(result.curves[name][1:]))]
        if not names:
            continue
        what, unit = ("Rotations", "µrad") if rotations else ("Errors", "µm")
        table = new_table(
            f"{what} as {letter} moves, {method_title(result.method)}, {OF_READINGS}",
            f"{letter} / mm",
            *(f"{name} / {unit}" for name in names),
        )
        table.columns[0].number = True
        table.whole_title = True
        for node, position in enumerate(nodes):
            if rotations and not any(np.isfinite(result.curves[name][node]) for name in names):
                continue
            table.add_row(
                plain(position * IN_MILLI, 3),
                *(
                    plus_minus(
                        result.curves[name][node], result.standard_uncertainty[name][node], IN_MICRO
                    )
                    for name in names
                ),
            )
        tables.append(table)
    return tables


def visibility_table(visibility: Visibility) -> Table:
    """Return which errors are determined and how well, with expanded uncertainties."""
    table = new_table(
        f"Visibility, {visibility.readings} stops: {visibility.rank} of {visibility.unknowns} free"
        f" values determined, condition number {visibility.condition_number:.2g}",
        "error",
        "verdict",
        "unit",
        "U at the end",
        "largest U",
        "inflation",
    )
    verdict = table.columns[1]
    verdict.number, verdict.wraps, verdict.widest = False, True, 72
    for row in visibility.rows:
        unit, scale = (
            (_MICRO_UNITS[row.unit], IN_MICRO) if row.unit in _MICRO_UNITS else (row.unit, 1.0)
        )
        table.add_row(
            row.name,
            row.words,
            unit,
            _expanded(row.end * scale),
            _expanded(row.largest * scale),
            _inflation(row),
        )
    return table


def _expanded(standard_uncertainty: float) -> str:
    if not math.isfinite(standard_uncertainty):
        return "-"
    return f"{COVERAGE_FACTOR * standard_uncertainty:.2g}"


def _inflation(row: VerdictRow) -> str:
    return f"{row.condition:.2g}" if math.isfinite(row.condition) else "-"


def visibility_sentences(
    visibility: Visibility, results: Sequence[VolumetricErrors] = ()
) -> list[str]:
    """Say what a visibility table rests on, and which methods give what it calls confounded.

    Args:
        visibility: the table.
        results: of the same lines, in the order in which they are shown.
    """
    chain = (
        f"Visibility for the chain {visibility.chain}: all errors are free at all nodes."
        if visibility.chain
        else "Visibility of translations only, without angular errors: the chain is not known."
    )
    noise = (
        " U: expected expanded uncertainty (95 %) for"
        f" {visibility.stop_uncertainty * IN_MICRO:.2g} µm (standard uncertainty) a stop."
        if math.isfinite(visibility.stop_uncertainty)
        else " The uncertainty of the readings is unknown, and so is the expected uncertainty."
    )
    return [
        chain + noise,
        "Inflation: uncertainty of an error, divided by its uncertainty if all others were known.",
        *_given_all_the_same(visibility, results),
    ]


def _given_all_the_same(visibility: Visibility, results: Sequence[VolumetricErrors]) -> list[str]:
    """Say which errors are given by methods without angular errors, though not determined here."""
    if not visibility.chain:
        return []
    open_rows = [row.name for row in visibility.rows if row.status != DETERMINED]
    given: dict[tuple[str, ...], list[str]] = {}
    for result in results:
        if any(name in result.curves for name in ROTATIONS):
            continue
        squareness = {one.name for one in result.figures if math.isfinite(one.value)}
        names = tuple(
            name
            for name in open_rows
            if name in squareness or bool(np.all(np.isfinite(result.curves.get(name, np.nan))))
        )
        if names:
            given.setdefault(names, []).append(method_title(result.method))
    if not given:
        return []
    methods = "; ".join(
        f"{', '.join(titles)}: {', '.join(names)}" for names, titles in given.items()
    )
    besides = (
        "; the conventional method takes the setup as perfect, too"
        if len(robust_to_setup(results)) < len(results)
        else ""
    )
    return [
        "Rotations may be of any size here. Methods that take them as zero give errors that this"
        f" table calls confounded ({methods}{besides}): their ± contains rotations of plausible"
        " size, not larger ones."
    ]


def fit_table(report: Report, with_equality: bool = True) -> Table:
    """Return the basis of each method, how well it fits and its deviation from the true errors.

    Args:
        report: of a run.
        with_equality: state also whether each result is the recorded one; see ``equality_table``.
    """
    results = report.ordered_results()
    table = new_table("Methods", "", "unit", *(short_title(result.method) for result in results))
    table.add_row("lines used", "", *(str(result.lines) for result in results))
    table.add_row("degrees of freedom", "", *(str(r.degrees_of_freedom) for r in results))
    table.add_row("χ² / degrees of freedom", "", *(_reduced_chi_squared(r) for r in results))
    if report.truth is not None:
        found = [compare_with_truth(result, report.truth) for result in results]
        table.add_row(
            "rms deviation from the true errors", "µm", *(plain(c.rms * IN_MICRO, 3) for c in found)
        )
        table.add_row("largest deviation", "µm", *(plain(c.largest * IN_MICRO, 3) for c in found))
        table.add_row(
            "true value inside the 95 % coverage interval", "points", *(_inside(c) for c in found)
        )
        turned = [compare_with_truth(result, report.truth, rotations=True) for result in results]
        if any(c.points for c in turned):
            table.add_row(
                "rms deviation from the true errors, rotations",
                "µrad",
                *(plain(c.rms * IN_MICRO, 3) for c in turned),
            )
            table.add_row("inside, rotations", "points", *(_inside(c) for c in turned))
    if with_equality and report.equals_recorded:
        table.add_row("same bits as recorded", "", *_equalities(report))
    return table


def equality_table(report: Report) -> Table | None:
    """Return of each method whether it gives the recorded result; None if none was recorded."""
    if not report.equals_recorded:
        return None
    heads = (short_title(result.method) for result in report.ordered_results())
    table = new_table("Solved again from the recording", "", *heads)
    table.add_row("same bits as recorded", *_equalities(report))
    return table


def _equalities(report: Report) -> list[str]:
    return [_equality(report, result.method) for result in report.ordered_results()]


def _reduced_chi_squared(result: VolumetricErrors) -> str:
    if not result.degrees_of_freedom:
        return "none left"
    return plain(result.chi_squared / result.degrees_of_freedom)


def _inside(comparison: TruthComparison) -> str:
    if not comparison.points_with_uncertainty:
        return UNKNOWN
    return f"{comparison.points_inside} of {comparison.points_with_uncertainty}"


def _equality(report: Report, method: str) -> str:
    if method not in report.equals_recorded:
        return "none recorded"
    if report.equals_recorded[method]:
        return "yes"
    return "to rounding" if method in report.rounded else "NO, DIFFERS"


def _sentences(report: Report, definition: SignDefinition) -> list[str]:
    lines = frame_sentences(report.ordered_results())
    if report.visibility is not None:
        lines.extend(visibility_sentences(report.visibility, report.ordered_results()))
    lines.append(f"Squareness sign: {SIGN_DEFINITIONS[definition]}. {LEAST_SQUARES_LINES}")
    lines.append(
        f"±: expanded uncertainty U, {COVERAGE_FACTOR:g} standard uncertainties (95 %), of the"
        f" readings, of plausible rotations and of {laser_scale(ORDINARY)}; stepdiag budget lists"
        " laser, air and setup one by one."
        " Errors are motions of the tool relative to the workpiece."
    )
    lines.extend(f"Run: {remark}" for remark in report.remarks)
    for result in report.ordered_results():
        title = method_title(result.method)
        lines.extend(f"{title}, not determined: {text}" for text in _shortened(result))
        lines.extend(f"{title}: {text}" for text in result.remarks)
    lines.extend(
        f"{method_title(method)}: not solved, {reason}" for method, reason in report.refused.items()
    )
    return lines


def _shortened(result: VolumetricErrors) -> list[str]:
    """Return what a method does not determine; only names where reasons would fill a page."""
    if len(result.not_determined) <= _MOST_REASONS:
        return list(result.not_determined)
    names = ", ".join(text.split(":")[0] for text in result.not_determined)
    return [f"{names}, at least in part. --visibility and results.json give the reasons."]


def _heading(report: Report) -> list[str]:
    rows = [
        ("Run", report.run_id),
        ("Plan", report.plan),
        ("Machine", report.machine + (f" (chain {report.chain})" if report.chain else "")),
        ("Bag", "" if report.bag is None else str(from_here(report.bag))),
    ]
    return [f"{name + ':':<9}{text}" for name, text in rows if text.strip()]


def print_report(
    report: Report,
    console: PlainConsole,
    definition: SignDefinition = "rotation",
    curves: bool = True,
) -> None:
    """Print a report.

    Args:
        report: what is printed.
        console: where to.
        definition: sign definition of the squareness that is printed.
        curves: print the curves of the method to rely on, and all rotations, node by node, too.
    """
    for line in _heading(report):
        console.sentence(line)
    if report.results:
        console.print()
        tables: list[Table | None] = [fit_table(report), squareness_table(report, definition)]
        tables += translation_tables(report)
        tables.append(figure_table(report, "diagonal", "Displacement error over body diagonals"))
        for prefix, title in (
            ("angular", "Angular errors (largest minus smallest)"),
            ("angular-shape", "Angular errors less the slope of their least-squares line"),
        ):
            tables.append(figure_table(report, prefix, title, only_known=True))
        preferred = report.preferred()
        if preferred is not None:
            tables.append(setup_table(preferred))
            if curves:
                tables.extend(curve_tables(preferred))
                for result in report.ordered_results():
                    tables.extend(curve_tables(result, rotations=True))
        if report.visibility is not None:
            tables.append(visibility_table(report.visibility))
        for table in tables:
            if table is not None:
                console.print(table)
                console.print()
    for line in _sentences(report, definition):
        console.sentence(line)
    lead = lead_of(report)
    console.print()
    for line in ("In short:", *sentences_of(lead), *coverage_sentences(lead)):
        console.sentence(line)
    _print_next(lead, console)


def print_summary(report: Report, console: PlainConsole) -> None:
    """Print what fits a screen: the lead, the determined errors, and the commands to run next."""
    lead = lead_of(report)
    summary = [*_heading(report), "", *sentences_of(lead), *coverage_sentences(lead)]
    summary += _determined(report, lead)
    summary += [f"Run: {one}" for one in report.remarks if one not in report.routine]
    for line in (*summary, ""):
        console.sentence(line)
    _print_next(lead, console)


def _print_next(lead: RunLead, console: PlainConsole) -> None:
    for line in next_lines(lead, console.text_width):
        console.print(line, soft_wrap=True)


def _determined(report: Report, lead: RunLead) -> list[str]:
    """Return which errors are determined, and how many of them contain the true value."""
    preferred = report.preferred()
    if preferred is None:
        return []
    names = [name for name in (*TRANSLATIONS, *SQUARENESS) if name not in lead.unknown]
    by = method_title(preferred.method)
    said = [f"Determined, by {by}: {', '.join(names)}."] if names else []
    if report.truth is not None:
        found = compare_with_truth(preferred, report.truth)
        said.append(
            f"Values whose {OF_READINGS} contains the simulated true error: {_inside(found)}"
            f" (expected: 95 %{_why_not_so_many(report, report.truth, found)})."
        )
        true = true_largest(report.truth, report.chain)
        said.append(
            f"True largest error of the simulated cell: {plain(true.value * IN_MICRO, 2)} µm at"
            f" {place_in_mm(true.position)}."
        )
    return said


def _why_not_so_many(report: Report, truth: Truth, found: TruthComparison) -> str:
    """Say why more or fewer true values than expected are within their uncertainty."""
    fewer = found.points_inside < 0.95 * found.points_with_uncertainty
    if fewer and report.verdict.effects and not report.verdict.contained:
        return "; fewer, because an effect acts that these curves do not contain"
    if not fewer and not any(np.any(truth.curves.get(name, 0.0)) for name in ROTATIONS):
        return "; more, because ± contains rotations, and this machine has none"
    return ""
