"""The evaluation of Ibaraki & Hata 2010, section 4, as text tables."""

import numpy as np

from stepdiag_ros.evaluation.experiment import Experiment
from stepdiag_ros.evaluation.report import method_title, short_title
from stepdiag_ros.metrology.comparison import DirectComparison
from stepdiag_ros.metrology.plausible import ORDINARY
from stepdiag_ros.metrology.table_one import TableOneRow
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import OF_READINGS, UNKNOWN, plain, plus_minus
from stepdiag_ros.text.table import Table, new_table
from stepdiag_ros.words.lead import laser_scale
from stepdiag_ros.words.squareness import SIGN_DEFINITIONS, SignDefinition, angle_of, sign

_TILT = 100e-6
"""rad: size of a setup error for which the sensitivity is shown."""


def table_one_table(experiment: Experiment) -> Table:
    """Return Table 1: over the travel, in µm, with expanded uncertainties."""
    methods = list(experiment.table[0].estimated)
    columns = [*(["Measured"] if experiment.direct else []), *map(short_title, methods)]
    table = new_table(
        f"Table 1 (Ibaraki & Hata 2010), over the travel, in µm, {OF_READINGS}", "", *columns
    )
    for row in experiment.table:
        cells = []
        if experiment.direct:
            measured = row.measured
            cells.append(
                "–"
                if measured is None
                else plus_minus(measured.value, measured.standard_uncertainty, IN_MICRO)
            )
        for method in methods:
            entry = row.estimated[method]
            cells.append(plus_minus(entry.value, entry.standard_uncertainty, IN_MICRO))
        table.add_row(_short_label(row), *cells)
    return table


def _short_label(row: TableOneRow) -> str:
    """Return a row's label in so few letters that every number has room."""
    if row.name[0] != "E":
        return row.label.replace("of ", "")
    error, axis = row.name[2], row.name[3]
    return f"Positioning {axis}, at end" if error == axis else f"Straightness {axis} in {error}"


def squareness_by_definition_table(experiment: Experiment) -> Table:
    """Return the squareness of Table 1 as angles, in both sign definitions."""
    methods = list(experiment.table[0].estimated)
    columns = [*(["Measured"] if experiment.direct else []), *map(short_title, methods)]
    table = new_table("Squareness as an angle, in µrad", "", "sign", *columns)
    for row in experiment.table:
        if row.name[0] == "E":
            continue
        for number, definition in enumerate(SIGN_DEFINITIONS):
            entries = [row.estimated[method] for method in methods]
            if experiment.direct:
                entries = [*([row.measured] if row.measured else []), *entries]
            cells = [
                plus_minus(
                    sign(row.name, definition) * angle_of(row, entry),
                    entry.standard_uncertainty / row.travel,
                    IN_MICRO,
                )
                for entry in entries
            ]
            if experiment.direct and row.measured is None:
                cells.insert(0, "–")
            table.add_row(row.name if number == 0 else "", definition, *cells)
    return table


def setup_table(experiment: Experiment) -> Table:
    """Return δR of every move and both angles of the effective direction of each diagonal."""
    table = new_table(
        "Setup errors: δR per block, angles of the effective direction",
        "",
        "X / µm",
        "Y / µm",
        "Z / µm",
        "angle 1 / µrad",
        "angle 2 / µrad",
    )
    for setup in experiment.setups:
        name = setup.line + (f" (mean of {setup.setups})" if setup.setups > 1 else "")
        table.add_row(
            name,
            *(
                plus_minus(value, uncertainty, IN_MICRO)
                for value, uncertainty in (
                    *zip(setup.displacement, setup.displacement_uncertainty, strict=True),
                    *zip(setup.angles, setup.angle_uncertainty, strict=True),
                )
            ),
        )
    return table


def sensitivity_table(experiment: Experiment) -> Table:
    """Return what a setup error of 100 µrad does to the conventional result at its last node."""
    table = new_table(
        f"Conventional: error at last node for {_TILT * IN_MICRO:g} µrad, in µm",
        "",
        "‖a‖/(2a)",
        "one diagonal",
        "both, at worst",
        "diagonals",
    )
    for one in experiment.sensitivity:
        table.add_row(
            one.curve,
            plain(one.gain, 3),
            plain(max(one.by_line.values()) * _TILT * IN_MICRO),
            plain(one.worst * _TILT * IN_MICRO),
            " ".join(one.by_line),
        )
    return table


def angle_table(experiment: Experiment) -> Table:
    """Return the angular errors of Soons' equations with the uncertainty of IH eq. (29)."""
    table = new_table(
        "Angular errors over the travel by eqs. (24)-(28), in µrad",
        "",
        "value ± U",
        "spread of repeats",
        "worst, a block",
        "worst, travel",
        "by chance, a block",
        "travel",
    )
    result = next(r for r in experiment.report.results if r.method == "soons")
    for name, size in experiment.angles.items():
        value, uncertainty = result.curves[name][-1], result.standard_uncertainty[name][-1]
        spread = UNKNOWN
        if "soons" in experiment.repeats:
            deviation = experiment.repeats["soons"].spread(name).standard_deviation[-1]
            spread = plain(deviation * IN_MICRO, 1)
        table.add_row(
            name,
            plus_minus(value, uncertainty, IN_MICRO),
            spread,
            plain(size.worst_per_block * IN_MICRO, 1),
            plain(size.worst_over_travel * IN_MICRO, 0),
            plain(size.standard_per_block * IN_MICRO, 1),
            plain(size.standard_over_travel * IN_MICRO, 0),
        )
    return table


def comparison_table(comparison: DirectComparison, definition: SignDefinition) -> Table:
    """Return one method beside the direct measurement: ranges, differences and E_n."""
    table = new_table(
        f"{method_title(comparison.method)} beside the direct measurement",
        "",
        "unit",
        "identified",
        "direct",
        "largest difference",
        "largest |E_n|",
        "|E_n| ≤ 1",
    )
    for curve in comparison.curves:
        errors = np.abs(curve.normalised_error)
        known = errors[np.isfinite(errors)]
        straightness = curve.reference != "from the first position"
        first = curve.range_identified if straightness else float(curve.identified[-1])
        second = curve.range_direct if straightness else float(curve.direct[-1])
        table.add_row(
            f"{curve.name}  {'straightness' if straightness else 'over the travel'}",
            "µrad" if curve.unit == "rad" else "µm",
            plain(first * IN_MICRO),
            plain(second * IN_MICRO),
            plain(float(np.max(np.abs(curve.difference))) * IN_MICRO),
            plain(float(np.max(known))) if known.size else UNKNOWN,
            f"{np.count_nonzero(known <= 1.0)} of {known.size}" if known.size else UNKNOWN,
        )
    for angle in comparison.squareness:
        factor = sign(angle.name, definition)
        error = abs(angle.normalised_error)
        table.add_row(
            f"{angle.name}  squareness",
            "µrad",
            plus_minus(factor * angle.identified, angle.identified_uncertainty, IN_MICRO),
            plus_minus(factor * angle.direct, angle.direct_uncertainty, IN_MICRO),
            plain(abs(angle.difference) * IN_MICRO),
            plain(error),
            (f"{int(error <= 1.0)} of 1" if np.isfinite(error) else UNKNOWN),
        )
    return table


def print_experiment(
    experiment: Experiment, console: PlainConsole, definition: SignDefinition = "rotation"
) -> None:
    """Print the whole evaluation.

    Args:
        experiment: what is printed.
        console: where to.
        definition: sign definition of squareness in the comparison; Table 1 gives both.
    """
    tables = [table_one_table(experiment), squareness_by_definition_table(experiment)]
    if experiment.setups:
        tables.append(setup_table(experiment))
    tables.append(sensitivity_table(experiment))
    if experiment.angles:
        tables.append(angle_table(experiment))
    tables.extend(comparison_table(one, definition) for one in experiment.comparisons)
    for table in tables:
        console.print(table)
        console.print()
    for text in _sentences(experiment, definition):
        console.sentence(text)


def _sentences(experiment: Experiment, definition: SignDefinition) -> list[str]:
    lines = [
        "Table 1: positioning is the error at the end of the travel; straightness is the largest "
        "variation from the least-squares line; squareness is the sum of the slopes of the two "
        "least-squares lines over the travel, positive where the angle between the positive axes "
        "is smaller than 90°.",
        *(f"Sign '{name}': {text}." for name, text in SIGN_DEFINITIONS.items()),
        f"±: expanded uncertainty U, {COVERAGE_FACTOR:g} standard uncertainties (95 %), of the "
        f"readings, of plausible rotations and of {laser_scale(ORDINARY)}; for the conventional "
        "formulation also of the tilts that least squares finds in the same readings.",
        "Setup errors: to first order a reading depends on the tilt of the mirror's normal only; "
        "the beam's own tilt is a second-order scale, which these figures do not show. Angle 1 "
        "lies in the XY plane; both are in the frame of the results. They follow from the setup-"
        "robust formulation; least squares uses further lines, so its tilts have a smaller ±.",
    ]
    count = len(next(iter(experiment.repeats.values())).results) if experiment.repeats else 0
    if count:
        lines.append(f"Spread: {count} repeats, each solved alone.")
    if experiment.angles:
        lines.append(
            "Angular errors: worst is every displacement off by its standard uncertainty "
            f"({experiment.displacement_uncertainty * IN_MICRO:.2g} µm, one pass) in the worst "
            "direction, as Ibaraki & Hata 2010, eq. 29, count; by chance is the standard "
            "uncertainty of one pass; U is that of all repeats together."
        )
    for comparison in experiment.comparisons:
        title = short_title(comparison.method)
        by_reason: dict[str, list[str]] = {}
        for name, reason in comparison.not_compared.items():
            by_reason.setdefault(reason, []).append(name)
        lines.extend(
            f"{title}: {', '.join(names)} not compared, {reason}."
            for reason, names in by_reason.items()
        )
    if experiment.direct is not None:
        lines.append(
            "E_n: difference over its expanded uncertainty (k = 2); within ±1 both agree. Curves "
            "are compared as deviations from their least-squares lines (straightness) or from the "
            f"first position. Sign of squareness in the comparison: {definition}."
        )
        lines.extend(f"Direct measurement: {note}" for note in experiment.direct.notes if note)
    return lines
