"""Volumetric accuracy as a person and a program read it, with the examples of RL beside it."""

import math
from collections.abc import Sequence

from stepdiag_ros.evaluation.report import method_title
from stepdiag_ros.evaluation.volumetric import VolumetricReport
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.standards.iso230_6 import DIAGONALS_ALONE
from stepdiag_ros.metrology.standards.volumetric import (
    MACHINES_OF_RL,
    PLANAR_MACHINE_OF_RL,
    volumetric_accuracy,
)
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import OF_READINGS, UNKNOWN, plain, plus_minus
from stepdiag_ros.text.table import Table, new_table
from stepdiag_ros.words.volumetric import DEFINITION, NO_ERROR_ABOVE


def _vector(values: Sequence[float], scale: float, decimals: int) -> str:
    if not all(map(math.isfinite, values)):
        return UNKNOWN
    return ", ".join(plain(value * scale, decimals) for value in values)


def accuracy_table(report: VolumetricReport) -> Table:
    """Return the volumetric accuracy by every method."""
    table = new_table(
        f"Volumetric accuracy, {OF_READINGS}",
        "",
        "value ± U / µm",
        "at X, Y, Z / mm",
        "error vector X, Y, Z / µm",
    )
    for method, found in report.accuracies.items():
        table.add_row(
            method_title(method),
            plus_minus(found.value, found.standard_uncertainty, IN_MICRO),
            _vector(found.position, IN_MILLI, 1),
            _vector(found.vector, IN_MICRO, 2),
        )
    return table


def example_tables() -> list[Table]:
    """Return the 2D and the 3D example of RL, computed."""
    machines = new_table(
        "Why diagonals alone are not enough: three machines of 1 m³ (RL, 3D example)",
        "",
        *(machine.name for machine in MACHINES_OF_RL),
    )
    for axis, letter in enumerate(AXES):
        machines.add_row(
            f"{letter} axis linear error, µm/m",
            *(plain(one.linear_error[axis] * IN_MICRO, 0) for one in MACHINES_OF_RL),
        )
    machines.add_row(
        "diagonal test result E_d, µm",
        *(plain(one.diagonal_result * IN_MICRO, 1) for one in MACHINES_OF_RL),
    )
    machines.add_row(
        "volumetric accuracy, µm",
        *(plain(volumetric_accuracy(one.errors).value * IN_MICRO, 1) for one in MACHINES_OF_RL),
    )
    planar = new_table(
        "A planar machine of 1 m × 1 m (RL, 2D example): X +25 µm/m, Y -25 µm/m", "", "value"
    )
    machine = PLANAR_MACHINE_OF_RL
    for name, error in machine.length_errors(("pp0", "np0")).items():
        planar.add_row(f"diagonal {name} longer than nominal, µm", plain(error * IN_MICRO, 5))
    found = volumetric_accuracy(machine.errors)
    planar.add_row("worst position error, µm", plain(found.value * IN_MICRO, 2))
    return [machines, planar]


def print_volumetric(report: VolumetricReport, console: PlainConsole) -> None:
    """Print the volumetric accuracy and the examples."""
    tables = []
    if report.accuracies:
        console.sentence(f"Source: {report.source} (run {report.run_id})")
        console.print()
        tables.append(accuracy_table(report))
    else:
        tables.extend(example_tables())
    for table in tables:
        console.print(table)
        console.print()
    console.sentence(DEFINITION)
    remarks: dict[str, list[str]] = {}
    frames: dict[str, list[str]] = {}
    for method, found in report.accuracies.items():
        for remark in found.remarks:
            remarks.setdefault(remark, []).append(method_title(method))
        frames.setdefault(found.frame, []).append(method_title(method))
    for remark, methods in remarks.items():
        console.sentence(f"{', '.join(methods)}: {remark}.")
    for frame, methods in frames.items():
        console.sentence(f"Frame of {', '.join(methods)}: {frame}.")
    if report.accuracies:
        console.sentence(
            f"±: {COVERAGE_FACTOR:g} standard uncertainties (95 %) of the largest error, wherever"
            " it is: from the readings, plausible rotations and the laser's scale. stepdiag report"
            " states U of the uncertainty budget instead where that is larger."
        )
        console.sentence(NO_ERROR_ABOVE)
    else:
        console.sentence(f"Warning: {DIAGONALS_ALONE}.")
