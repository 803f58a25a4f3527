"""``stepdiag changes``: two measurements of one machine, before and after, last year and now."""

import io
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.commands.arguments import Command, Group, add_common, results_folder
from stepdiag_ros.commands.corrections import add_correction_options, corrected
from stepdiag_ros.commands.output import progress_bar, say, warn
from stepdiag_ros.commands.standard_tests import is_bag

if TYPE_CHECKING:
    from stepdiag_ros.compensation.identified import Identified
    from stepdiag_ros.evaluation.changes import ChangesReport, Side

_NAME = "changes"
_WHEN = ("before", "after")


def _add_options(parser: ArgumentParser) -> None:
    for name in _WHEN:
        parser.add_argument(name, type=Path, help="the measurement (.mcap), or its results.json")
    for name in _WHEN:
        parser.add_argument(
            f"--run-{name}",
            metavar="ID",
            help=f"which run of {name.upper()}, where it holds several",
        )
    add_common(
        parser,
        "method",
        help="method of the solver (default: the most reliable one that both suffice for)",
    )
    parser.add_argument(
        "--instrument",
        action="append",
        default=[],
        metavar="NAME|FILE",
        help="instrument file: uncertainties of laser, sensors, material and setup, as for"
        " 'stepdiag budget'; given twice: of BEFORE and of AFTER (default: uncertainties as"
        " in 'stepdiag solve')",
    )
    parser.add_argument(
        "--same-instrument",
        action="store_true",
        help="one laser with its sensors measured both: their calibration cancels in the change",
    )
    add_correction_options(parser)
    add_common(parser, "json")
    parser.add_argument("--html", action="store_true", help="write the page changes.html")
    parser.add_argument("--pdf", action="store_true", help="write the page as changes.pdf")
    add_common(
        parser,
        "output",
        help="folder for the page, changes.json and changes.txt (default, with --html or --pdf:"
        " NAME_changes beside AFTER)",
    )


def run(arguments: Namespace) -> int:
    """Compare; see the module."""
    from stepdiag_ros.report.documents.changes import changes_json
    from stepdiag_ros.report.tables.changes import print_changes
    from stepdiag_ros.text.console import make_console

    report = report_of(arguments)
    if arguments.html or arguments.pdf or arguments.output is not None:
        _write(report, arguments)
    if arguments.json:
        print(changes_json(report))
    else:
        print_changes(report, make_console(sys.stdout))
    return 0


def report_of(arguments: Namespace) -> "ChangesReport":
    """Solve both measurements and compare them.

    Args:
        arguments: parsed.

    Raises:
        ValueError: a file cannot be read or solved, or the two cannot be compared; one sentence.
    """
    from stepdiag_ros.configuration import load_instrument
    from stepdiag_ros.evaluation.changes import ChangesReport, changes_of

    given = arguments.instrument
    if len(given) > 2:
        raise ValueError("--instrument is given more than twice: expected of BEFORE and of AFTER")
    if arguments.same_instrument and len(set(given)) != 1:
        raise ValueError(
            "--same-instrument needs one --instrument, which states what both measurements share"
        )
    before, after = (
        _solved(getattr(arguments, when), getattr(arguments, f"run_{when}"), arguments)
        for when in _WHEN
    )
    _refuse_the_same(before, after)
    loaded = [load_instrument(name)[0] for name in given]
    changes = changes_of(
        before.side,
        after.side,
        instruments=loaded,
        same_instrument=arguments.same_instrument,
        expansion=nan if arguments.expansion is None else arguments.expansion,
        material_temperature=arguments.material_temperature,
    )
    names = (loaded[0].name, loaded[-1].name) if loaded else ("", "")
    method = changes.before.method
    return ChangesReport(before.identified(method), after.identified(method), changes, names)


@dataclass(frozen=True)
class _Solved:
    """One of both measurements with where it comes from.

    Attributes:
        side: as it is compared.
        identity: of the run, or of the file's content where it names no run.
        identified: returns what a method says, with its origin.
    """

    side: "Side"
    identity: str
    identified: "Callable[[str], Identified]"


def _solved(path: Path, run_id: str | None, arguments: Namespace) -> _Solved:
    from stepdiag_ros.bags.digest import sha256_of
    from stepdiag_ros.compensation.identified import require_run
    from stepdiag_ros.evaluation.changes import side_of_results_file

    if is_bag(path):
        return _solved_bag(path, run_id, arguments)
    if arguments.instrument or arguments.expansion is not None:
        raise ValueError(
            f"{path} holds no readings, so that --instrument and --expansion-per-K cannot serve"
            " it: give the bag"
        )
    side, found = side_of_results_file(path, arguments.method, sha256_of(path))
    require_run(found, path, run_id)
    return _Solved(side, found.origin.run_id or found.origin.sha256, lambda _: found)


def _solved_bag(path: Path, run_id: str | None, arguments: Namespace) -> _Solved:
    from stepdiag_ros.bags.run import load_run
    from stepdiag_ros.evaluation.changes import side_of_report
    from stepdiag_ros.evaluation.compensation import identified_of
    from stepdiag_ros.evaluation.recorded_run import report_of_run

    with progress_bar(f"reading {path.name}") as progress:
        recorded = load_run(path, run_id)
        report = report_of_run(
            recorded,
            progress,
            correct=lambda measurement: corrected(measurement, arguments),
            warn=warn,
        )
    # Refuses a bag without a result, and a method that its lines are not enough for.
    preferred = identified_of(report, recorded.start_time, arguments.method)

    def identified(method: str) -> "Identified":
        if method == preferred.origin.method:
            return preferred
        return identified_of(report, recorded.start_time, method, preferred.origin.sha256)

    return _Solved(
        side_of_report(report, arguments.method),
        report.run_id or preferred.origin.sha256,
        identified,
    )


def _refuse_the_same(before: _Solved, after: _Solved) -> None:
    if before.identity and before.identity == after.identity:
        raise ValueError(
            f"{before.side.name} and {after.side.name} hold the same run ({before.identity}): give"
            " two measurements"
        )


def _write(report: "ChangesReport", arguments: Namespace) -> None:
    """Write the page and what it is made of, each file whole or not at all."""
    from stepdiag_ros.report.documents.changes import changes_json
    from stepdiag_ros.report.files import make_folder, whole_file, without_trailing_blanks
    from stepdiag_ros.report.tables.changes import print_changes
    from stepdiag_ros.text.console import make_console

    text = io.StringIO()
    print_changes(report, make_console(text))
    lines = without_trailing_blanks(text.getvalue())
    contents = {
        f"{_NAME}.json": (changes_json(report) + "\n").encode(),
        f"{_NAME}.txt": lines.encode(),
    }
    with progress_bar("writing the page"):
        if arguments.html or arguments.pdf:
            from stepdiag_ros.report.pages.changes import ChangesPage
            from stepdiag_ros.report.pages.pdf import pdf_of

            page = ChangesPage(report)
            if arguments.html:
                contents[f"{_NAME}.html"] = page.html().encode()
            if arguments.pdf:
                contents[f"{_NAME}.pdf"] = pdf_of(page.html(for_print=True), page.pictures.values())
        folder = arguments.output or results_folder(arguments.after, _NAME)
        make_folder(folder)
        for name, content in contents.items():
            with whole_file(folder / name) as partial:
                partial.write_bytes(content)
    say(f"results in {folder}: {', '.join(contents)}")


COMMAND = Command(
    _NAME,
    Group.UNDERSTAND,
    80,
    _add_options,
    run,
    help="what changed between two measurements, with E_n values",
    description="Compare two measurements of the same box, before and after compensation, or"
    " last year and now: positioning, straightness, squareness, the error vectors in the volume"
    " and every curve node by node, each with the uncertainty of its change and E_n; and state"
    " whether the change exceeds the uncertainty of the measurements.",
    epilog="examples:\n"
    "  stepdiag changes before.mcap after.mcap               tables here\n"
    "  stepdiag changes before.mcap after.mcap --html --pdf  a page, in after_changes/\n"
    "  stepdiag changes 2025.mcap 2026.mcap --instrument demo --same-instrument\n"
    "                            --expansion-per-K 11.5e-6   with all sources of uncertainty",
)
