"""``stepdiag compensate``: tables for a machine's control from an identified result."""

import io
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from stepdiag_ros.commands.arguments import Command, Controls, Group, add_common
from stepdiag_ros.commands.output import progress_bar, say, warn
from stepdiag_ros.commands.standard_tests import is_bag
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import MILLI

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

    from stepdiag_ros.compensation.applied import TableSet
    from stepdiag_ros.compensation.control import Control, Files
    from stepdiag_ros.compensation.identified import Identified
    from stepdiag_ros.evaluation.compensation import CompensationReport, Learned

Key = TypeVar("Key")
Value = TypeVar("Value")
_TEXT, _DOCUMENT = "compensation.txt", "compensation.json"
_EPILOG = """\
settings of each control, given as --set NAME=VALUE:  stepdiag compensate --for CONTROL --settings

the command installs nothing and overwrites no file. How to load the tables, what they
do not correct and how to undo them: docs/compensation.md

examples:
  stepdiag compensate run.mcap --for linuxcnc
  stepdiag compensate run.mcap --for siemens --set axes=MX1,MY1,MZ1 --set tables=12 --output tables
  stepdiag compensate run_results/results.json --for fanuc --spacing 10 --reference 500 0 300
  stepdiag compensate run.mcap --for generic     the error map, for target correction by the bridge
  stepdiag compensate run.mcap --for generic --model mill.yaml    with what was learned beside it
  stepdiag compensate second.mcap --for linuxcnc --on-top-of first_for_linuxcnc"""


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument(
        "result",
        type=Path,
        nargs="?",
        help="the measurement (.mcap), or results.json of 'stepdiag solve'",
    )
    parser.add_argument(
        "--for",
        dest="control",
        choices=Controls(),
        metavar="CONTROL",
        required=True,
        help="the control: %(choices)s",
    )
    add_common(
        parser,
        "output",
        help="a new folder for the tables (default: NAME_for_CONTROL beside the result)",
    )
    add_common(parser, "method")
    add_common(parser, "run")
    parser.add_argument(
        "--model",
        metavar="MODEL",
        help="model of the machine (YAML), by path or name: its learned displacements are"
        " compensated too, as far as the control can hold them",
    )
    _add_table_options(parser)
    parser.add_argument(
        "--on-top-of",
        type=Path,
        metavar="FOLDER",
        help="tables that were active during the run: the new ones contain them",
    )
    add_seal_option(parser)
    add_despite_option(parser)
    add_common(parser, "json")
    add_common(parser, "pictures", help="format of the picture, or none (default: png)")


def _add_table_options(parser: ArgumentParser) -> None:
    """Add the options that say how the tables of a control are made."""
    parser.add_argument(
        "--spacing",
        type=float,
        default=0.0,
        metavar="MM",
        help="distance between entries of a table (default: as the nodes of the measurement;"
        " fanuc: finer)",
    )
    parser.add_argument(
        "--reference",
        type=float,
        nargs=3,
        default=(0.0, 0.0, 0.0),
        metavar=("X", "Y", "Z"),
        help="reference point, machine coordinates, mm: corrections are zero there (default: 0)",
    )
    parser.add_argument(
        "--set",
        dest="settings",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a setting of the control; may be given several times",
    )
    parser.add_argument(
        "--settings", dest="list_settings", action="store_true", help="list the control's settings"
    )


def add_seal_option(parser: ArgumentParser) -> None:
    """Add the option that refuses a measurement without a seal.

    Args:
        parser: of a command that compensates.
    """
    parser.add_argument(
        "--require-seal",
        type=Path,
        metavar="KEY.pub",
        help="refuse a measurement without a seal by this public key: see 'stepdiag seal'",
    )


def refuse_unsealed(arguments: Namespace, path: Path) -> None:
    """Refuse a file without the seal that the user requires; see ``add_seal_option``.

    Raises:
        ValueError: it has none, a wrong one, or one by another key; one sentence.
    """
    if arguments.require_seal is not None:
        from stepdiag_ros.bags.seal import require_seal

        require_seal(path, arguments.require_seal)


def add_despite_option(parser: ArgumentParser) -> None:
    """Add the option that overrules a verdict by which a run's errors must not be compensated.

    Args:
        parser: of a command that compensates.
    """
    parser.add_argument(
        "--despite-verdict",
        action="store_true",
        help="compensate even if the diagnosis finds an effect that the tables would not"
        " compensate; every file written states this",
    )


def permitted(
    identified: "Identified",
    source: Path,
    despite: bool,
    control: "Control | None" = None,
    settings: "dict[str, Any] | None" = None,
) -> "Identified":
    """Return errors that may be compensated by what the diagnosis of their run says.

    Args:
        identified: the errors.
        source: file that they come from.
        despite: the user overrules the verdict, which is then in the origin.
        control: that tables are made for; None: targets are corrected.
        settings: of the control, checked.

    Raises:
        ValueError: they must not, and the user does not overrule it; one sentence.
    """
    from dataclasses import replace

    from stepdiag_ros.compensation.permission import DESPITE, permission

    found = permission(identified, control, settings)
    for text in found.warnings:
        warn(f"{source}: {text}")
    if not found.refusal:
        return replace(identified, remarks=(*found.warnings, *identified.remarks))
    if not despite:
        raise ValueError(
            f"{source}: nothing is compensated, because {found.refusal.rstrip('.')}; see 'stepdiag"
            f" diagnose', or give {DESPITE}"
        )
    warn(f"{source}: compensated by {DESPITE}, although {found.refusal}")
    origin = replace(identified.origin, despite_verdict=identified.verdict.words)
    return replace(identified, origin=origin)


def run(arguments: Namespace) -> int:
    """Write the tables; see the module."""
    from stepdiag_ros.compensation import control
    from stepdiag_ros.report.documents.compensation import compensation_json
    from stepdiag_ros.report.tables.compensation import print_compensation
    from stepdiag_ros.text.console import make_console

    chosen = control(arguments.control)
    if arguments.list_settings:
        _list(chosen)
        return 0
    if arguments.result is None:
        raise ValueError("name the result: a bag (.mcap), or results.json of 'stepdiag solve'")
    folder = arguments.output or arguments.result.parent / (
        f"{arguments.result.stem}_for_{chosen.name}"
    )
    _refuse_existing(folder)
    report = report_of(chosen, arguments)
    text = io.StringIO()
    print_compensation(report, make_console(text))
    contents = {
        **report.files,
        _TEXT: text.getvalue(),
        _DOCUMENT: compensation_json(report) + "\n",
    }
    files = _write(folder, contents, report, arguments.pictures)
    if arguments.json:
        print(compensation_json(report))
    else:
        print_compensation(report, make_console(sys.stdout))
    say(f"tables in {folder}: {', '.join(files)}")
    return 0


def report_of(chosen: "Control", arguments: Namespace) -> "CompensationReport":
    """Make the tables of a control, and find what they leave.

    Args:
        chosen: the control.
        arguments: parsed.

    Raises:
        ValueError: the result, a setting or a limit of the control forbids it; one sentence.
    """
    from stepdiag_ros.compensation.control import Layout, checked_settings
    from stepdiag_ros.evaluation.compensation import compensation_of
    from stepdiag_ros.text.intake import refusals_of

    settings = checked_settings(chosen, _given(arguments.settings))
    if arguments.spacing < 0.0:
        raise ValueError(f"--spacing is {arguments.spacing:g} mm; expected more than 0")
    x, y, z = (value * MILLI for value in arguments.reference)
    before = _tables_before(chosen, arguments.on_top_of)
    refuse_unsealed(arguments, arguments.result)
    learned = _learned(arguments.model)
    identified = permitted(
        load_identified(arguments.result, arguments.method, arguments.run_id, learned),
        *(arguments.result, arguments.despite_verdict, chosen, settings),
    )
    layout = Layout(
        reference=(x, y, z),
        spacing=arguments.spacing * MILLI,
        settings=settings,
        on_top_of=before,
        header=_header(identified),
    )
    with refusals_of(arguments.result):
        return compensation_of(chosen, identified, layout, str(arguments.on_top_of or ""))


def _learned(model: str | None) -> "Learned | None":
    """Return what a model adds to the curves; None without a model."""
    from hashlib import sha256

    from stepdiag_ros.configuration import load_model
    from stepdiag_ros.evaluation.compensation import Learned

    if model is None:
        return None
    loaded, text = load_model(model)
    digest = sha256(text.encode()).hexdigest()
    learned = Learned(loaded, f"the model {Path(model).name} (SHA-256 {digest})")
    for said in learned.warnings():
        warn(f"{model}: {said}")
    return learned


def load_identified(
    path: Path,
    method: str = "",
    run_id: str | None = None,
    learned: "Learned | None" = None,
) -> "Identified":
    """Return the errors in a bag or in a ``results.json``.

    Args:
        path: of the file.
        method: of the solver; empty: the one to rely on.
        run_id: which run, where a bag holds several; a document is of one.
        learned: what a model adds to the curves; needs the lines in a bag.

    Raises:
        ValueError: it cannot be read or solved, or does not have the method; one sentence.
    """
    from stepdiag_ros.bags.digest import sha256_of
    from stepdiag_ros.compensation.identified import from_results_file, require_run
    from stepdiag_ros.evaluation.compensation import identified_of

    if not is_bag(path):
        if learned is not None:
            raise ValueError(
                f"{path} holds no lines, which --model needs to take its effects off: give the bag"
                " (.mcap) instead"
            )
        found = from_results_file(path, method, sha256_of(path))
        return require_run(found, path, run_id)
    from stepdiag_ros.bags.run import load_run
    from stepdiag_ros.evaluation.recorded_run import report_of_run

    with progress_bar(f"reading {path.name}") as progress:
        recorded = load_run(path, run_id)
        correct = None if learned is None else learned.taken_off
        report = report_of_run(recorded, progress, warn=warn, correct=correct, with_verdict=True)
    added = () if learned is None else learned.effects
    return identified_of(report, recorded.start_time, method, learned=added)


def _header(identified: "Identified") -> tuple[str, ...]:
    from datetime import datetime, timezone

    from stepdiag_ros import __version__

    written = datetime.now(timezone.utc).isoformat(timespec="seconds")
    return (
        f"written {written} by stepdiag_ros {__version__}, not installed by it",
        *identified.origin.lines(),
        *([f"do not install this: {identified.warning}"] if identified.warning else []),
    )


def _given(settings: list[str]) -> dict[str, Any]:
    import yaml

    given = []
    for one in settings:
        name, equals, value = one.partition("=")
        if not equals:
            raise ValueError(f"--set {one}: expected NAME=VALUE")
        # A list of joints or axes stays a text.
        given.append((name.strip(), value if "," in value else yaml.safe_load(value)))
    return each_once("--set", given)


def each_once(option: str, pairs: Iterable[tuple[Key, Value]]) -> dict[Key, Value]:
    """Return the values of an option that may be given several times, once for each name.

    Args:
        option: as the user writes it.
        pairs: name and value, in the order of the command line.

    Raises:
        Refusal: a name has two values.
    """
    given: dict[Key, Value] = {}
    for name, value in pairs:
        if name in given:
            raise Refusal(
                f"{option}: '{name}' is given twice. Leave out one of its values",
                fault="twice",
                about=str(name),
                where=option,
            )
        given[name] = value
    return given


def _tables_before(chosen: "Control", folder: Path | None) -> "TableSet":
    from stepdiag_ros.compensation.applied import TableSet
    from stepdiag_ros.configuration import read_text

    if folder is None:
        return TableSet(())
    if not folder.is_dir():
        raise ValueError(f"--on-top-of {folder}: there is no such folder")
    suffixes = (".comp", ".ini", ".INI", ".COM", ".CMA", ".TXT", ".txt", ".json")
    files = {
        path.name: read_text(path) for path in folder.iterdir() if path.name.endswith(suffixes)
    }
    found = chosen.read(files)
    if not isinstance(found, TableSet):
        raise ValueError(f"a map has no tables that others could contain: leave out {folder}")
    return found


def _list(chosen: "Control") -> None:
    print(f"{chosen.title}: --set NAME=VALUE")
    for one in chosen.settings:
        allowed = f" ({' or '.join(one.choices)})" if one.choices else ""
        print(f"  {one.name}={one.default}{allowed}: {one.meaning}")
    if not chosen.settings:
        print("  none")


def _refuse_existing(folder: Path) -> None:
    if folder.is_dir() and not any(folder.iterdir()):
        return
    if folder.exists():
        raise ValueError(f"{folder} is there already and is not overwritten: name another --output")


def _write(
    folder: Path, contents: "Files", report: "CompensationReport", picture: str
) -> list[str]:
    """Write all files or none: into a folder beside, which then takes the name."""
    from tempfile import TemporaryDirectory

    from stepdiag_ros.report.files import make_folder
    from stepdiag_ros.report.publish import write_results

    def draw() -> "dict[str, Picture]":
        from stepdiag_ros.plots.files.compensation import draw_compensation

        return draw_compensation(report)

    make_folder(folder.parent)
    formats = () if picture == "none" else (picture,)
    try:
        with TemporaryDirectory(prefix=".partial-", dir=folder.parent) as partial:
            made = Path(partial) / "tables"
            with progress_bar("writing tables") as progress:
                files = write_results(made, contents, draw, formats, progress)
            _refuse_existing(folder)
            made.replace(folder)
    except OSError as error:
        # The folder beside is gone by now.
        raise OSError(error.errno, error.strerror, str(folder)) from error
    return [path.name for path in files]


COMMAND = Command(
    "compensate",
    Group.CORRECT,
    10,
    _add_options,
    run,
    help="write compensation tables and show the remaining errors",
    description="Write the compensation tables of a control from a measurement: positioning, and"
    " where the control supports it, straightness and squareness. The command computes the"
    " remaining errors from the written files and shows the errors before and after.",
    epilog=_EPILOG,
)
