"""How commands talk: results on standard output, everything else on standard error."""

import argparse
import math
import re
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from stepdiag_ros.commands.arguments import add_common, picture_formats
from stepdiag_ros.text.controls import printable
from stepdiag_ros.text.terminal import columns, fitted

if TYPE_CHECKING:
    from stepdiag_ros.bags.run import RecordedRun
    from stepdiag_ros.evaluation.report import Report
    from stepdiag_ros.metrology.plan import Plan

_BAR_WIDTH = 20
"""Columns of a progress bar; the text beside it needs the rest."""


def methods_help(replicable: bool = False) -> str:
    """Return the methods for the end of a help: name and summary, a line each.

    Args:
        replicable: of those alone that a budget can be made for.
    """
    from stepdiag_ros.metrology.solvers import methods, solvers

    chosen = [methods()[name] for name in solvers()]
    lines = [
        f"  {one.name:14} {one.summary}\n"
        for one in chosen
        if one.estimator is not None or not replicable
    ]
    return "\nmethods:\n" + "".join(lines)


def number(text: str, low: float, high: float) -> float:
    """Return the number that an option was given.

    Raises:
        argparse.ArgumentTypeError: it is not a number, or not within [low, high].
    """
    value = _parsed(text)
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(_beyond(text, low, high))
    return value


def metres(text: str, low: float, high: float) -> float:
    """Return the length that an option was given, m.

    Raises:
        argparse.ArgumentTypeError: it is not a number, or not within [low, high]; says what it
            would be if it was meant in millimetres.
    """
    value = _parsed(text)
    if low <= value <= high:
        return value
    said, meant = _beyond(text, low, high), value * 1e-3
    if math.isfinite(value):
        said += " m; lengths are in metres"
    if low <= meant <= high and meant:
        said += f": did you mean {meant:.6g}?"
    raise argparse.ArgumentTypeError(said)


_TOLERANCES = (0.1, 5000.0)
"""µm: what a volumetric error may be held to, from the finest machine to the coarsest."""


def tolerance(text: str) -> float:
    """Return the largest permissible error that an option was given, µm.

    A tolerance in another unit would release a machine, or condemn it.

    Raises:
        argparse.ArgumentTypeError: it is not a number, or no plausible tolerance; says what it
            would be if it was meant in nanometres, millimetres or metres.
    """
    value = _parsed(text)
    low, high = _TOLERANCES
    if low <= value <= high:
        return value
    said = f"{_beyond(text, low, high)} µm; a tolerance is in micrometres"
    meant = [value * factor for factor in (1e-3, 1e3, 1e6) if low <= value * factor <= high]
    if meant:
        said += f": did you mean {meant[0]:.6g}?"
    raise argparse.ArgumentTypeError(said)


def _parsed(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        point = "; write a decimal point, not a comma" if "," in text else ""
        raise argparse.ArgumentTypeError(f"'{text}' is not a number{point}") from None


def _beyond(text: str, low: float, high: float) -> str:
    return f"{text} is not between {low:.15g} and {high:.15g}"


def say(text: str) -> None:
    """Print information that is not the result."""
    # With its line end in one piece, so that a bar beside it comes after the whole text.
    print(f"{fitted(printable(text), columns(sys.stderr))}\n", end="", file=sys.stderr)


def warn(text: str) -> None:
    """Print a warning."""
    say(f"stepdiag: warning: {text}")


def warn_of_flaws(recorded: "RecordedRun") -> None:
    """Say on standard error what is wrong with a recording."""
    for flaw in recorded.flaws:
        warn(flaw.sentence)


def warn_of_undetermined(plan: "Plan") -> None:
    """Warn of the errors that a plan's lines do not determine, before they are measured.

    Args:
        plan: that is to be measured.
    """
    from stepdiag_ros.planning.undetermined import undetermined

    if plan.tracker is not None:
        return
    try:
        sentence = undetermined(plan).sentence
    except ValueError as error:
        sentence = str(error)
    if sentence:
        warn(f"plan '{plan.name}': {sentence}")


def run_of(document: str) -> str:
    """Return the identity of the run in the JSON of a result; empty without a run."""
    found = re.search(r'"run_id": "([^"]*)"', document)
    return "" if found is None else found[1]


def warn_of_replaced(file: Path, run_id: str) -> None:
    """Say that an earlier result is replaced, and warn if it is of another run.

    Args:
        file: JSON of the result in its folder.
        run_id: of the result that replaces it.
    """
    if not file.is_file():
        return
    before = run_of(file.read_text(encoding="utf-8", errors="replace"))
    if before == run_id:
        say(f"stepdiag: the earlier results in {file.parent} are replaced")
    else:
        old, new = (
            f"run '{one}'" if one else "a file without a run identity" for one in (before, run_id)
        )
        warn(
            f"{file.parent} holds results of {old}; those of {new} replace them."
            " To keep both, name another folder with --output"
        )


class Progress(Protocol):
    """Callback for the progress of a piece of work."""

    def __call__(self, done: float, text: str = "") -> None:
        """Say that ``done`` (0..1) of the work is done, and what is being done."""


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """Show a progress bar on standard error while the block runs, if that is a terminal.

    Args:
        title: what is being done; empty where the callback is given whole sentences.
    """
    if not sys.stderr.isatty():

        def ignore(done: float, text: str = "") -> None:
            del done, text

        yield ignore
        return
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar
    from rich.table import Column

    # A text that is too long goes on in the next line: what a run waits for stands at its end.
    with Bar(
        TextColumn("{task.description}", markup=False, table_column=Column(overflow="fold")),
        BarColumn(_BAR_WIDTH),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    ) as bar:
        task = bar.add_task(title, total=1.0)

        def show(done: float, text: str = "") -> None:
            bar.update(task, completed=done, description=f"{title} {text}".strip())

        yield show


def add_result_options(
    parser: ArgumentParser,
    default_folder: str,
    holds: str = "pictures, results.json and report.txt",
) -> None:
    """Add the options of every command that prints a result.

    Args:
        parser: of the command.
        default_folder: where results go if ``--output`` is not given, in words.
        holds: what goes into the folder, in words.
    """
    add_common(
        parser,
        "json",
        help="print JSON (SI units, curves under their ISO 230-1 names) instead of tables",
    )
    add_common(parser, "output", help=f"folder for {holds} (default: {default_folder})")
    add_common(parser, "pictures")
    parser.add_argument(
        "--squareness-sign",
        choices=("rotation", "angle"),
        default="rotation",
        help="rotation: right-handed, as ISO 230-1 names it (default);"
        " angle: positive where the angle between the positive axes is larger than 90 degrees;"
        " JSON always holds the rotation",
    )


def show_report(
    report: "Report",
    arguments: Namespace,
    default_folder: Path,
    details: bool = True,
    pictures: "Callable[[], Mapping[str, bytes]] | None" = None,
) -> int:
    """Write a report into its folder and print it as the user asked; return the exit code.

    Args:
        report: what is shown.
        arguments: parsed, with the options of ``add_result_options``.
        default_folder: where results go if the user named no folder.
        details: print all tables, not just what fits a screen, and draw all methods.
        pictures: as of ``publish``.

    Returns:
        0; 1 if the lines were not enough for any method, or a result differs from the recorded one.
    """
    from stepdiag_ros.report.documents.run import report_json
    from stepdiag_ros.report.publish import publish
    from stepdiag_ros.report.tables.run import print_report, print_summary
    from stepdiag_ros.text.console import make_console
    from stepdiag_ros.words.lead import from_here

    folder = arguments.output or default_folder
    formats = picture_formats(arguments)
    warn_of_replaced(folder / "results.json", report.run_id)
    with progress_bar("writing results") as progress:
        files = publish(
            report,
            folder,
            formats,
            arguments.squareness_sign,
            progress,
            all_methods=details,
            pictures=pictures,
        )
    if arguments.json:
        print(report_json(report))
    elif details:
        print_report(report, make_console(sys.stdout), arguments.squareness_sign)
    else:
        print_summary(report, make_console(sys.stdout))
    say(f"results in {from_here(folder)}: {', '.join(path.name for path in files)}")
    if not (arguments.json or details):
        say("all tables: --details, or report.txt")
    if not report.results:
        source = f"{report.bag}: " if report.bag is not None else ""
        raise ValueError(
            f"{source}the measured lines are not enough for any method; the reasons are above"
        )
    differing = [
        method
        for method, same in report.equals_recorded.items()
        if not same and method not in report.rounded
    ]
    if differing:
        warn(f"{', '.join(differing)}: the numbers differ from the result recorded in the bag")
    return 0
