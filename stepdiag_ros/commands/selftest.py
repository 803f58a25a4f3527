"""``stepdiag selftest``: solve reference problems with known answers, and print a record of it."""

from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from stepdiag_ros.commands.arguments import Command, Group, add_common, whole
from stepdiag_ros.commands.output import progress_bar, say

_DEFAULT_PROBLEMS = 14
_MOST_PROBLEMS = 10_000
_LARGEST_SEED = 2**63 - 1


def _add_options(parser: ArgumentParser) -> None:
    add_common(
        parser,
        "seed",
        type=partial(whole, low=0, high=_LARGEST_SEED),
        default=None,
        help="seed of the problems (default: a new one each time)",
    )
    parser.add_argument(
        "--problems",
        type=partial(whole, low=1, high=_MOST_PROBLEMS),
        default=_DEFAULT_PROBLEMS,
        metavar="N",
        help="number of step-diagonal problems; the kinds alternate (default:"
        f" {_DEFAULT_PROBLEMS})",
    )
    parser.add_argument(
        "--every-check",
        action="store_true",
        help="print every comparison, not only the one nearest to its limit (JSON has all)",
    )
    add_common(parser, "json", help="print the record as JSON")
    add_common(
        parser,
        "output",
        metavar="FILE",
        help="write the record into this file as well, in place of an earlier record",
    )


def run(arguments: Namespace) -> int:
    """Run the self-test; see the module."""
    import secrets
    import sys

    from stepdiag_ros.report.files import check_new, refuse_foreign, whole_file
    from stepdiag_ros.selftest.session import run_selftest
    from stepdiag_ros.selftest.text import RECORD, print_record
    from stepdiag_ros.text.console import make_console

    if arguments.output is not None:
        check_new([arguments.output], overwrite=True)
        refuse_foreign(arguments.output, RECORD, "record of a self-test")
    seed = secrets.randbelow(2**32) if arguments.seed is None else arguments.seed
    with progress_bar("selftest") as progress:
        record = run_selftest(
            seed, arguments.problems, partial(solve_as_a_user, arguments.main), progress
        )
    if arguments.output is not None:
        with whole_file(arguments.output) as file, file.open("w", encoding="utf-8") as stream:
            if arguments.json:
                stream.write(record.json() + "\n")
            else:
                print_record(record, make_console(stream), arguments.every_check)
        say(f"record in {arguments.output}")
    if arguments.json:
        print(record.json())
    else:
        print_record(record, make_console(sys.stdout), arguments.every_check)
    return 0 if record.passed else 1


def solve_as_a_user(main: Callable[[Sequence[str]], int], table: Path) -> dict[str, Any]:
    """Import a run table and solve the bag by the command line; return what it prints as JSON.

    Args:
        main: the command line, as a function of its arguments that returns the exit code.
        table: with ``case.yaml`` beside it; the bag and the results folder are made beside it, too.

    Raises:
        ValueError: a command fails; with its own words.
    """
    import json

    bag = table.with_suffix(".mcap")
    _command(main, "import", str(table), str(bag))
    results = table.with_name("results")
    solving = ("solve", str(bag), "--json", "--pictures", "none", "--output", str(results))
    printed = _command(main, *solving)
    document: dict[str, Any] = json.loads(printed)
    return document


def _command(main: Callable[[Sequence[str]], int], *words: str) -> str:
    """Run a command of this command line in this process; return its standard output."""
    import io
    from contextlib import redirect_stderr, redirect_stdout

    output, errors = io.StringIO(), io.StringIO()
    with redirect_stdout(output), redirect_stderr(errors):
        code = main(words)
    if code != 0:
        raise ValueError(
            f"stepdiag {words[0]} ended with exit code {code}: {errors.getvalue().strip()}"
        )
    return output.getvalue()


COMMAND = Command(
    "selftest",
    Group.LOOK_AFTER,
    40,
    _add_options,
    run,
    help="solve random reference problems with known answers",
    description="Draw random machines, setups and noise, simulate their readings by rigid bodies,"
    " and solve them as a user does: a run table on the disk, imported, solved. The command"
    " compares every result with the known answer, and shows the limit and its reason beside each"
    " deviation. The record names version and platform; the same seed draws the same problems."
    " The exit code is 1 if any comparison fails.",
    epilog="examples:\n"
    "  stepdiag selftest                          a new seed each time\n"
    "  stepdiag selftest --seed 7 --problems 70   more problems, the same each time\n"
    "  stepdiag selftest --output record.txt      keep the record\n"
    "  stepdiag selftest --json --output record.json",
)
