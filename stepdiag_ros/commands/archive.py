"""``stepdiag archive``: thousands of bags, and a catalogue of what they show."""

import sys
from argparse import ArgumentParser, Namespace, _SubParsersAction
from collections.abc import Callable, Iterable
from functools import partial
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepdiag_ros.archive import require_libraries
from stepdiag_ros.commands.arguments import Command, Group, whole
from stepdiag_ros.commands.output import Progress, progress_bar, say
from stepdiag_ros.text.controls import printable

if TYPE_CHECKING:
    from stepdiag_ros.archive.engine import Engine
    from stepdiag_ros.archive.work import Outcome
    from stepdiag_ros.text.table import Table

_MOST_WORKERS = 10_000
_EXAMPLES = """\
examples:
  stepdiag archive add /data/machines run.mcap other_runs/   copies and evaluates them
  stepdiag archive update /data/machines                     what this version has not evaluated
  stepdiag archive list /data/machines --machine "VMC 3"
  stepdiag archive show /data/machines 20260203T040506Z-abcdef
  stepdiag archive sql s3://plant/machines "select machine, max(largest_m) from runs group by 1"
  stepdiag archive update s3://plant/machines --scheduler tls://head.plant:8786"""


def _add_options(parser: ArgumentParser) -> None:
    what = parser.add_subparsers(title="subcommand", metavar="WHAT", dest="what", required=True)
    add = _command(what, "add", "copy bags into an archive and evaluate them", _add)
    add.add_argument("bags", type=Path, nargs="+", metavar="BAG", help="a bag, or a folder of bags")
    update = _command(
        what, "update", "evaluate what this version has not; make the catalogue again", _update
    )
    for one in (add, update):
        _add_engine(one)
    listed = _command(what, "list", "list the runs, newest first", _list)
    listed.add_argument("--machine", default="", metavar="NAME", help="only of this machine")
    shown = _command(what, "show", "show what the catalogue holds of a run", _show)
    shown.add_argument(
        "run_id", metavar="RUN", help="identity of the run, or beginning of its bag's SHA-256"
    )
    _command(what, "verify", "compare bags, catalogue and checksums", _verify)
    sql = _command(what, "sql", "ask the catalogue in SQL (DuckDB)", _sql)
    sql.add_argument("query", help="the views are runs, figures and curves")
    sql.add_argument("--csv", action="store_true", help="print CSV, with all digits")


def _command(
    what: "_SubParsersAction[ArgumentParser]",
    name: str,
    text: str,
    run: Callable[[Namespace], int],
) -> ArgumentParser:
    parser: ArgumentParser = what.add_parser(
        name, help=text, description=f"{text[0].upper()}{text[1:]}.", epilog=_EXAMPLES
    )
    parser.add_argument(
        "place", metavar="PLACE", help="a folder, or a URL such as s3://bucket/name"
    )
    parser.set_defaults(run=partial(_run, run))
    return parser


def _add_engine(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--workers",
        type=partial(whole, low=1, high=_MOST_WORKERS),
        default=0,
        metavar="N",
        help="processes on this computer (default: one a processor); 1: one bag after the other",
    )
    parser.add_argument(
        "--scheduler",
        default="",
        metavar="ADDRESS",
        help="of a Dask cluster, such as tls://head:8786, in place of processes here",
    )


def _run(run: Callable[[Namespace], int], arguments: Namespace) -> int:
    require_libraries()
    return run(arguments)


def _engine(arguments: Namespace) -> "Engine":
    from stepdiag_ros.archive.engine import Engine

    return Engine(arguments.workers, arguments.scheduler)


def _add(arguments: Namespace) -> int:
    from stepdiag_ros.archive.place import Place
    from stepdiag_ros.archive.work import add, bags_below

    bags = bags_below(arguments.bags)
    outcomes = add(Place(arguments.place), bags, _engine(arguments))
    return _followed(outcomes, len(bags), "adding")


def _update(arguments: Namespace) -> int:
    from stepdiag_ros.archive.place import Place
    from stepdiag_ros.archive.work import update

    number, outcomes = update(Place(arguments.place), _engine(arguments))
    return _followed(outcomes, number, "evaluating")


def _followed(outcomes: "Iterable[Outcome]", number: int, title: str) -> int:
    """Say what becomes of each bag; return the exit code."""
    evaluated = there = failed = 0
    with progress_bar(title) as progress:
        for done, one in enumerate(outcomes, 1):
            progress(done / max(number, 1), one.file)
            evaluated += one.evaluated and not one.problem
            there += bool(one.same_as)
            failed += bool(one.problem)
            if one.same_as and Path(one.file).name != one.same_as:
                say(f"{one.file} is the same bag as {one.same_as}, which is in the archive")
            if one.problem:
                say(f"{one.file}: {one.problem}")
    print(f"{evaluated} evaluated, {there} in the archive before, {failed} with a problem")
    if failed:
        raise ValueError(f"{failed} of {number} bags have a problem, which is stated above")
    return 0


_SIMULATED = "*"
"""Behind the time of a run of a simulated machine."""


def _list(arguments: Namespace) -> int:
    from stepdiag_ros.archive.catalogue import Catalogue
    from stepdiag_ros.archive.place import Place
    from stepdiag_ros.text.console import make_console
    from stepdiag_ros.text.numbers import with_expanded
    from stepdiag_ros.text.table import Column, Table

    with Catalogue(Place(arguments.place)) as catalogue:
        rows = catalogue.ask(
            "select * from runs where ? in ('', machine) order by time desc nulls last, file",
            [arguments.machine],
        )
    if arguments.machine and not rows:
        raise ValueError(f"{arguments.place} has no run of a machine '{arguments.machine}'")
    table = Table(
        "",
        [
            *(Column(name) for name in ("time, UTC", "machine", "run", "plan")),
            Column("largest error, µm", number=True),
            Column("verdict", wraps=True, widest=40),
        ],
    )
    for row in rows:
        value, wide = (_number(row[f"largest_{name}"]) for name in ("m", "expanded_uncertainty_m"))
        table.add_row(
            f"{row['time']:%Y-%m-%d %H:%M}{_SIMULATED if row['simulated'] else ''}"
            if row["time"]
            else "unknown",
            row["machine"] or "unnamed",
            row["run_id"] or row["file"],
            row["plan"] or "",
            "" if row["problem"] else with_expanded(value, wide, 1e6),
            row["verdict"] or "has a problem",
        )
    make_console(sys.stdout).print(table)
    if any(row["simulated"] for row in rows):
        say(f"{_SIMULATED}: the time of its simulated clock, which is not when it was made")
    for sentence in _remarks(rows):
        say(sentence)
    return 0


def _remarks(rows: list[dict[str, Any]]) -> Iterable[str]:
    """Yield what is odd about runs, a sentence each."""
    from stepdiag_ros import __version__
    from stepdiag_ros.archive.stated import FILE

    files: dict[str, list[str]] = {}
    for row in rows:
        name = row["run_id"] or row["file"]
        files.setdefault(name, []).append(row["file"])
        if row["problem"]:
            yield f"{name}: {row['problem']}"
        elif row["time"] is None:
            clock = row["start_time"]
            told = f"its clock stated {clock:%Y-%m-%d}" if clock else "its clock stated no date"
            yield f"{name}: {told}; state under times in {FILE} when it began"
    yield from (
        f"{name} is in {len(bags)} bags: {', '.join(bags)}"
        for name, bags in files.items()
        if len(bags) > 1
    )
    older = sum(row["software_version"] != __version__ for row in rows)
    if older:
        yield f"{older} runs were evaluated by another version: 'stepdiag archive update'"


def _show(arguments: Namespace) -> int:
    from stepdiag_ros.archive.catalogue import Catalogue
    from stepdiag_ros.archive.place import Place
    from stepdiag_ros.archive.work import bags_of
    from stepdiag_ros.text.console import make_console

    place = Place(arguments.place)
    wanted = arguments.run_id
    with Catalogue(place) as catalogue:
        runs = catalogue.ask(
            "select * from runs where run_id = ? or starts_with(bag_sha256, ?)", [wanted, wanted]
        )
        if len(runs) != 1:
            found = ", ".join(one["bag_sha256"][:12] for one in runs)
            told = f"{len(runs)} runs '{wanted}'; name one by its bag: {found}"
            raise ValueError(f"{place.url} has {told if runs else f'no run {wanted!r}'}")
        (run,) = runs
        figures = catalogue.ask(
            "select * from figures where bag_sha256 = ? and run_id is not distinct from ?"
            " and relied_on order by list_position(['volume', 'single', 'effect'], kind)"
            " nulls last, kind, name",
            [run["bag_sha256"], run["run_id"]],
        )
    for name, value in run.items():
        if value not in (None, [], ""):
            text = ", ".join(value) if isinstance(value, list) else str(value)
            print(printable(f"{name}: {text}"))
    bag = bags_of(place).get(run["bag_sha256"])
    print(f"bag: {place.address(bag) if bag else 'not in the archive any more'}\n")
    make_console(sys.stdout).print(_figures(figures))
    return 0


def _figures(figures: list[dict[str, Any]]) -> "Table":
    from stepdiag_ros.text.numbers import with_expanded
    from stepdiag_ros.text.table import new_table

    table = new_table("", "figure", "kind", "value ± U", "unit")
    for row in figures:
        micro = row["unit"] in ("m", "rad")
        value, wide = _number(row["value"]), _number(row["expanded_uncertainty"])
        unit = f"µ{row['unit']}" if micro else row["unit"]
        shown = with_expanded(value, wide, 1e6 if micro else 1.0)
        table.add_row(row["name"], row["kind"], shown, unit)
    return table


def _verify(arguments: Namespace) -> int:
    from stepdiag_ros.archive.place import Place
    from stepdiag_ros.archive.work import verify

    def tell(progress: Progress, done: float, text: str) -> None:
        progress(done, text)

    with progress_bar("verifying") as progress:
        wrong = verify(Place(arguments.place), partial(tell, progress))
    for one in wrong:
        say(one)
    if wrong:
        raise ValueError(f"{arguments.place} is not whole: {len(wrong)} faults, stated above")
    print(
        f"{arguments.place} is whole: each bag is the one that was added, and is in the catalogue"
    )
    return 0


def _sql(arguments: Namespace) -> int:
    from stepdiag_ros.archive.catalogue import Catalogue
    from stepdiag_ros.archive.place import Place
    from stepdiag_ros.bags.csv_cells import csv_text, guarded
    from stepdiag_ros.text.console import make_console
    from stepdiag_ros.text.table import Column, Table

    with Catalogue(Place(arguments.place)) as catalogue:
        rows = catalogue.ask(arguments.query)
    if not rows:
        return 0
    cells = [["" if value is None else str(value) for value in row.values()] for row in rows]
    if arguments.csv:
        print(csv_text([[guarded(one) for one in row] for row in (rows[0], *cells)]), end="")
        return 0
    table = Table("", [Column(name) for name in rows[0]])
    for row in cells:
        table.add_row(*row)
    make_console(sys.stdout).print(table)
    return 0


def _number(value: float | None) -> float:
    return nan if value is None else value


COMMAND = Command(
    "archive",
    Group.LOOK_AFTER,
    35,
    _add_options,
    None,
    help="keep thousands of bags with a catalogue of what they show",
    description="An archive is a folder of bags, on this computer or in a store, and a catalogue"
    " (Parquet) with one row a run, one a figure and one a curve, which can be made again from the"
    " bags. Any number of computers may add bags at once.",
    epilog=_EXAMPLES,
)
