"""``stepdiag volumetric``: the longest error vector in the machine's volume."""

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.commands.arguments import Command, Group, add_common, results_folder
from stepdiag_ros.commands.standard_tests import add_output_options, show

if TYPE_CHECKING:
    from stepdiag_ros.evaluation.volumetric import VolumetricReport


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument("bag", type=Path, nargs="?", help="the measurement (.mcap)")
    add_common(parser, "run")
    add_output_options(parser, "NAME_volumetric beside the bag; without one: ./volumetric_examples")


def run(arguments: Namespace) -> int:
    """Evaluate; see the module."""
    from stepdiag_ros.plots.files.volumetric import examples_picture
    from stepdiag_ros.report.documents.volumetric import volumetric_json
    from stepdiag_ros.report.tables.volumetric import print_volumetric

    report = report_of(arguments.bag, arguments.run_id)
    folder = Path("volumetric_examples")
    if arguments.bag is not None:
        folder = results_folder(arguments.bag, "volumetric")
    return show(
        "volumetric",
        volumetric_json(report),
        lambda console: print_volumetric(report, console),
        lambda: {} if report.accuracies else {"diagonals_and_volume": examples_picture()},
        arguments,
        folder,
        ("diagonals_and_volume",),
    )


def report_of(bag: Path | None, run_id: str | None = None) -> "VolumetricReport":
    """Find the volumetric accuracy of a bag's error maps; without a bag there are the examples.

    Args:
        bag: the measurement.
        run_id: which run, where the bag holds several.

    Raises:
        ValueError: the bag cannot be read or solved; one sentence.
    """
    from stepdiag_ros.evaluation.volumetric import VolumetricReport, accuracies_of

    if bag is None:
        return VolumetricReport({})
    from stepdiag_ros.commands.solve import report_of as solved

    report = solved(bag, run_id=run_id)
    if not report.results:
        raise ValueError(f"{bag}: its lines are not enough for any method; see 'stepdiag solve'")
    return VolumetricReport(accuracies_of(report), str(bag), report.run_id)


COMMAND = Command(
    "volumetric",
    Group.UNDERSTAND,
    50,
    _add_options,
    run,
    help="volumetric accuracy: the longest error vector in the volume",
    description="Solve a bag and find the longest error vector between target and actual"
    " position anywhere in the measured volume, by every method that its lines suffice for."
    " Without a bag, the command shows examples of why diagonal tests alone do not determine the"
    " volumetric error.",
    epilog="examples:\n"
    "  stepdiag volumetric run.mcap   of the machine in the bag\n"
    "  stepdiag volumetric            three machines: E_d 0, 29, 14 µm; 122, 50, 115 µm",
)
