"""``stepdiag iso230``: positioning of axes (ISO 230-2) and along diagonals (ISO 230-6)."""

from argparse import ArgumentParser, Namespace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.commands.arguments import Command, Group, add_bag, add_common, results_folder
from stepdiag_ros.commands.corrections import add_correction_options, corrected
from stepdiag_ros.commands.output import progress_bar, warn_of_flaws
from stepdiag_ros.commands.standard_tests import (
    add_output_options,
    is_bag,
    refuse_for_table,
    show,
)
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.text.intake import refusals_of

if TYPE_CHECKING:
    from stepdiag_ros.evaluation.positioning import PositioningReport, Published
    from stepdiag_ros.evaluation.recorded_run import Correct
    from stepdiag_ros.metrology.standards.positioning_uncertainty import UncertaintyDescription

_FORM = """\
a table is CSV, one row a reading:
  cycle        number of the run
  direction    forward (targets ascending) or backward
  target_mm    commanded position
  position_mm  measured position

--uncertainty names a YAML file; missing values are unknown:
  device_U_m_per_m             of the calibrated laser, k = 2
  misalignment_m               deviation of beam from axis over the length
  temperature_range_K          of the error of the machine temperature
  expansion_coefficient_per_K  of the machine's scale or the workpiece
  expansion_range_per_K        of the error of that coefficient
  temperature_difference_K     of the machine from 20 degrees C
  environmental_variation_m    range of readings at standstill (EVE)

--published names a YAML file: 'unit: mm' and 'parameters: {A: 8.881e-05, ...}'.

examples:
  stepdiag iso230 run.mcap                              every test in the bag
  stepdiag iso230 run.mcap --pictures pdf               pages for print
  stepdiag iso230 run.mcap --expansion-per-K 11.5e-6    corrected to 20 °C
  stepdiag iso230 axis.csv --axis X --json              from a table
  stepdiag iso230 axis.csv --published their_report.yaml"""
_UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9}


def _add_options(parser: ArgumentParser) -> None:
    add_bag(parser, "a bag (.mcap), or a table (.csv)")
    add_common(parser, "run")
    parser.add_argument("--axis", default="", help="name of the axis in a table")
    parser.add_argument(
        "--uncertainty",
        type=Path,
        metavar="FILE",
        help="measuring conditions, see below",
    )
    parser.add_argument(
        "--published", type=Path, metavar="FILE", help="figures to compare with, see below"
    )
    add_correction_options(parser)
    add_output_options(parser, "NAME_iso230 beside the source")


def run(arguments: Namespace) -> int:
    """Evaluate; see the module."""
    from stepdiag_ros.plots.files.positioning import draw_positioning
    from stepdiag_ros.report.documents.positioning import positioning_json
    from stepdiag_ros.report.tables.positioning import print_positioning

    of_bags = {
        "--run": arguments.run_id,
        "--expansion-per-K": arguments.expansion,
        "--material-temperature": arguments.material_temperature,
    }
    refuse_for_table(arguments.bag, of_bags)
    report = report_of(
        arguments.bag,
        arguments.axis,
        arguments.uncertainty,
        arguments.published,
        arguments.run_id,
        partial(corrected, arguments=arguments),
    )
    return show(
        "iso230",
        positioning_json(report),
        lambda console: print_positioning(report, console),
        lambda: draw_positioning(report),
        arguments,
        results_folder(arguments.bag, "iso230"),
        ("iso230_2_*", "iso230_6_*"),
    )


def report_of(
    source: Path,
    axis: str = "",
    uncertainty: Path | None = None,
    published: Path | None = None,
    run_id: str | None = None,
    correct: "Correct | None" = None,
) -> "PositioningReport":
    """Evaluate all tests in a bag or the one in a table.

    Args:
        source: the file.
        axis: name of the axis in a table.
        uncertainty: file that describes the measuring conditions.
        published: file of figures to compare with.
        run_id: which run, where a bag holds several.
        correct: see ``positioning_of``; the readings of a table have no temperature.

    Raises:
        ValueError: a file cannot be read, or there is no test in it; one sentence.
    """
    from stepdiag_ros.evaluation.positioning import PositioningReport, positioning_of
    from stepdiag_ros.metrology.standards.iso230_2 import evaluate

    description = _description(uncertainty)
    figures = None if published is None else _published(published)
    if is_bag(source):
        if axis:
            raise Refusal(
                f"{source}: --axis names the axis of a table, and a bag names its own axes. Leave"
                " out --axis",
                fault="mismatch",
                about="--axis",
                where=str(source),
            )
        from stepdiag_ros.bags.run import load_run
        from stepdiag_ros.evaluation.recorded_run import require_standing_beam

        with progress_bar(f"reading {source.name}"):
            recorded = load_run(source, run_id)
        warn_of_flaws(recorded)
        require_standing_beam(recorded)
        with refusals_of(source):
            return positioning_of(recorded, description, figures, correct)
    from stepdiag_ros.bags.axis_table import read_axis_table

    return PositioningReport(
        tests=(evaluate(read_axis_table(source, axis), description),),
        source=str(source),
        unknown=description.unknown(),
        published=figures,
    )


def _description(path: Path | None) -> "UncertaintyDescription":
    from stepdiag_ros.configuration import read_yaml
    from stepdiag_ros.metrology.standards.positioning_uncertainty import UncertaintyDescription

    if path is None:
        return UncertaintyDescription()
    return UncertaintyDescription.from_mapping(read_yaml(path), str(path))


def _published(path: Path) -> "Published":
    from stepdiag_ros.configuration import read_yaml
    from stepdiag_ros.evaluation.positioning import Published
    from stepdiag_ros.metrology.checking import Section

    section = Section(read_yaml(path), str(path))
    unit = _UNITS[section.names("unit", tuple(_UNITS))[0]]
    parameters = section.section("parameters")
    numbers = {name: parameters.number(name) for name in parameters.keys()}  # noqa: SIM118
    section.finish()
    return Published.from_numbers(str(path), numbers, unit)


COMMAND = Command(
    "iso230",
    Group.UNDERSTAND,
    30,
    _add_options,
    run,
    help="positioning of axes (ISO 230-2) and along diagonals (ISO 230-6)",
    description="Evaluate bidirectional tests: accuracy A, repeatability R, systematic error"
    " E, mean error M and reversal error B of every axis by ISO 230-2 with their measurement"
    " uncertainty, and E and B of every diagonal with E_d and B_d of the machine and of each"
    " face by ISO 230-6.",
    epilog=_FORM,
)
