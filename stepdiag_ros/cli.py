#!/usr/bin/env python3
"""The ``stepdiag`` command line.

Exit codes: 0 done, 1 refused or failed (one sentence on standard error says why), 2 wrong usage,
130 stopped with Ctrl-C, 143 ended by SIGTERM, 141 the reader of the output has gone away.
"""

import argparse
import gc
import os
import signal
import sys
from collections.abc import Sequence
from functools import partial
from itertools import chain, groupby
from pathlib import Path
from shutil import get_terminal_size
from textwrap import wrap

from stepdiag_ros.commands.arguments import Command, CommandParser, Group, HintingParser
from stepdiag_ros.metrology.registry import of_modules
from stepdiag_ros.run.interruption import Terminated
from stepdiag_ros.text.sentence import PREFIX, sentence
from stepdiag_ros.text.terminal import columns, fitted

_DESCRIPTION = """\
Measure the positioning, straightness and squareness errors of a three-axis
machine tool with one laser interferometer, along step diagonals and along the
axes. A measurement is recorded in one file, a bag (.mcap). Every result can be
computed from that file again."""

_COLLECTED_AT = 50_000
"""New objects after which Python looks for unused cycles.

Nearly all that a command imports, reads and computes lives until it ends. At Python's own threshold
(700 to 2,000 objects) looking through it again and again takes a tenth of a command's time.
"""
_THREADS = "1"
"""Threads of the numerical libraries, which are loaded later.

The matrices of a run gain nothing by more, and sums over several threads differ in their last bits
from computer to computer.
"""
_WIDEST = 100
"""Columns of the widest help text, however wide the terminal is."""
_FIRST_STEPS = (
    "'stepdiag demo' measures a simulated machine, in one to two minutes.",
    "'stepdiag COMMAND --help' explains a command, with an example.",
)
_EXIT_REFUSED = 1
_EXIT_INTERRUPTED = 128 + signal.SIGINT
_EXIT_BROKEN_PIPE = 141


def commands() -> list[Command]:
    """Return all commands in the order in which the help lists them."""
    found: list[Command] = of_modules("stepdiag_ros.commands", "COMMAND")
    # Commands that share everything but their name share a module.
    found += chain.from_iterable(of_modules("stepdiag_ros.commands", "COMMANDS"))
    groups = list(Group)
    return sorted(found, key=lambda one: (groups.index(one.group), one.order))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    from stepdiag_ros import __version__

    known = commands()
    parser = HintingParser(
        prog="stepdiag",
        usage="stepdiag [--version] [--traceback] COMMAND ...",
        description=_DESCRIPTION,
        further_help=lambda: _listed(known),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"stepdiag {__version__}")
    parser.add_argument(
        "--traceback",
        action="store_true",
        help="when a command fails, show where in the program (for a bug report)",
    )
    # The self-test runs other commands, as a user would.
    parser.set_defaults(main=main, run=partial(_show_help, parser))
    # The end of the help lists the commands by what they are for.
    subparsers = parser.add_subparsers(
        prog="stepdiag", dest="command", help=argparse.SUPPRESS, parser_class=CommandParser
    )
    for command in known:
        command.add_parser(subparsers)
    return parser


def _show_help(parser: argparse.ArgumentParser, _: argparse.Namespace) -> int:
    """Print the help, for who gave no command; return the exit code."""
    parser.print_help()
    return 0


def _listed(known: Sequence[Command]) -> str:
    """Return the commands under the headings of their groups, and how to go on."""
    column = max(len(command.name) for command in known) + 4
    width = min(get_terminal_size().columns, _WIDEST) - 2
    lines = []
    for group, members in groupby(known, key=lambda command: command.group):
        lines.append(f"{group.value}:")
        for command in members:
            start = f"  {command.name}".ljust(column)
            lines += wrap(command.help, width, initial_indent=start, subsequent_indent=" " * column)
        lines.append("")
    return "\n".join(["", *lines, *_FIRST_STEPS, ""])


def _leave_pipe() -> None:
    """Keep Python from complaining about the closed pipe once more when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())


def _end_by_sigterm() -> None:
    """End by the signal that asked for it, as the caller expects: a service manager or a shell.

    Everything that the command began is ended already.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.raise_signal(signal.SIGTERM)


def _forget_interrupt() -> None:
    """Let ``python -m stepdiag_ros.cli`` end with the exit code that ``main`` returns.

    An interrupt that hits code executed from text, such as the methods that ``dataclass`` writes,
    leaves a mark in CPython. The interpreter then ends by SIGINT although the interrupt was
    handled. Executing another text clears the mark.
    """
    exec("")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Args:
        argv: arguments without the program's name; those of the process if not given.
    """
    gc.set_threshold(_COLLECTED_AT)
    for library in ("OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", _THREADS)
    # A caller may have closed what is written to; there is still work to be done.
    sys.stdout = sys.stdout or Path(os.devnull).open("w")  # noqa: SIM115
    sys.stderr = sys.stderr or Path(os.devnull).open("w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        # A terminal that cannot show µ shall show a question mark, not end the program.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    try:
        return _run(argv)
    except KeyboardInterrupt as error:
        print(f"stepdiag: stopped{f': {error}' if str(error) else ''}", file=sys.stderr)
        _forget_interrupt()
        if isinstance(error, Terminated):
            _end_by_sigterm()
        return _EXIT_INTERRUPTED
    except BrokenPipeError:
        _leave_pipe()
        return _EXIT_BROKEN_PIPE


def _run(argv: Sequence[str] | None) -> int:
    arguments = argparse.Namespace(traceback=False)
    try:
        # Help and choices name what other packages add, and one of these may be broken.
        make_parser().parse_args(argv, arguments)
        code: int = arguments.run(arguments)
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        raise
    except (ValueError, OSError) as error:
        if arguments.traceback:
            raise
        print(fitted(f"{PREFIX}{sentence(error)}", columns(sys.stderr)), file=sys.stderr)
        return _EXIT_REFUSED


if __name__ == "__main__":
    sys.exit(main())
