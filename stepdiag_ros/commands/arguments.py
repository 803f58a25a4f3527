"""How a command reads its arguments: in any order, with a hint where one is not known."""

import argparse
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from enum import Enum
from functools import partial
from pathlib import Path
from shutil import get_terminal_size
from typing import Any, NoReturn

from stepdiag_ros.metrology.spelling import nearest, suggestion
from stepdiag_ros.text.terminal import columns, fitted

_HIGHEST_PORT = 65535
_HIGHEST_SEED = 2**31


_REASON = " " * 6
"""In front of the comment on a command that stands above it."""


def fit_line(line: str, width: int) -> str:
    """Return a line of a help text that fits the terminal; a command stays on one line.

    Args:
        line: words, or two columns with two blanks or more between them.
        width: columns of the terminal.
    """
    if len(line) <= width:
        return line
    left, gap, right = re.fullmatch(r"(\s*\S+(?: \S+)*)(\s{2,})?(.*)", line).groups("")  # type: ignore[union-attr]
    indent = " " * (len(left) - len(left.lstrip()))
    is_command = left.lstrip().startswith(("stepdiag ", "pip ", "python"))
    if not gap:
        return line if is_command else fitted(line, width, indent)
    if is_command:
        return f"{left}\n{fitted(_REASON + right, width, _REASON)}"
    return fitted(line, width, " " * len(left + gap))


def no_such(value: object, known: Sequence[str], kind: str = "") -> str:
    """Say that a word is not among those to choose from, and which may have been meant."""
    near = nearest(value, known)
    hint = suggestion(near, f"choose from {', '.join(known)}")
    return f"there is no {kind}'{value}'; {hint}"


class _HelpFormatter(argparse.HelpFormatter):
    """Wraps a paragraph of one line; of lines that were broken on purpose, those that are too long.

    The latter are examples and lists.
    """

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if "\n" not in text:
            return super()._fill_text(text, width, indent)
        # Two columns fewer than the terminal are for a text without line ends.
        return "\n".join(fit_line(indent + line, width + 2) for line in text.split("\n")) + "\n"


class HintingParser(argparse.ArgumentParser):
    """Refuses a word that is not among the choices, and names the one that may have been meant."""

    def __init__(self, *args: Any, further_help: Callable[[], str] | None = None, **more: Any):
        """Make the parser; ``further_help`` returns the end of the help once it is asked for."""
        super().__init__(*args, **more)
        self._further_help = further_help

    def format_help(self) -> str:
        """Return the help, with what takes long to find out only here."""
        further = self._further_help() if self._further_help else ""
        width = get_terminal_size().columns
        return super().format_help() + "\n".join(fit_line(x, width) for x in further.split("\n"))

    def error(self, message: str) -> NoReturn:
        """End the program with one sentence; the usage would push it out of sight."""
        name = self.prog
        helped = "--help" in message or "did you mean" in message
        hint = "" if helped else f" ('{name} --help' explains what it takes)"
        self.exit(2, f"{name}: error: {message}{hint}\n")

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        """End the program with a message that fits the terminal."""
        super().exit(status, message and fitted(message, columns(sys.stderr)))

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        known = [str(choice) for choice in action.choices]
        if isinstance(action, argparse._SubParsersAction):
            raise argparse.ArgumentError(None, no_such(value, known, "command "))
        raise argparse.ArgumentError(action, no_such(value, known))


class CommandParser(HintingParser):
    """The parser of one command.

    It takes options before, between and after files, since people type them in any order, and says
    itself what it does not know: the parser above knows the options of no command.
    """

    _intermixed = False

    def __init__(self, *args: Any, **more: Any):
        """Make the parser, with the layout that the examples need."""
        super().__init__(*args, **{"formatter_class": _HelpFormatter, **more})

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        """Parse all arguments of the command; end the program with a hint where one is not known.

        Returns:
            the arguments, and an empty list.
        """
        if self._intermixed or not self._files_may_come_anywhere():
            return super().parse_known_args(args, namespace)
        # Before what is missing is said: a misspelt option is missing, too.
        if foreign := self._foreign(args or ()):
            self._refuse(foreign)
        self._intermixed = True
        try:
            parsed, unknown = self.parse_known_intermixed_args(args, namespace)
        finally:
            self._intermixed = False
        if unknown:
            self._refuse(unknown)
        return parsed, []

    def _files_may_come_anywhere(self) -> bool:
        """Say whether no argument of this command is for another parser or for a node."""
        whole = (argparse.PARSER, argparse.REMAINDER)
        return not any(action.nargs in whole for action in self._actions)

    def _foreign(self, args: Sequence[str]) -> list[str]:
        """Return the options that are neither known nor the beginning of one."""
        end = args.index("--") if "--" in args else len(args)
        names = [one for one in args[:end] if one.startswith("--")]
        known = tuple(self._option_string_actions)
        return [
            one
            for one in names
            if not any(option.startswith(one.partition("=")[0]) for option in known)
        ]

    def _refuse(self, unknown: list[str]) -> NoReturn:
        options = [argument for argument in unknown if argument.startswith("-")]
        if not options:
            self.error(f"one argument too many: {' '.join(unknown)}")
        wrong = options[0].partition("=")[0]
        # All begin with two dashes, which makes none of them alike.
        names = [one[2:] for one in self._option_string_actions if one.startswith("--")]
        near = nearest(wrong.lstrip("-"), names)
        hint = suggestion(near and f"--{near}", f"'{self.prog} --help' lists them")
        self.error(f"there is no option {wrong}; {hint}")


class Group(Enum):
    """What a command is for; the help lists the groups in this order under these headings."""

    MEASURE = "measure"
    WATCH = "watch a live run, or a bag"
    UNDERSTAND = "understand the result"
    CORRECT = "correct the machine"
    EXCHANGE = "exchange data"
    LOOK_AFTER = "look after bags, nodes and this program"


@dataclass(frozen=True)
class Command:
    """A command of ``stepdiag``: all that is declared of it.

    Attributes:
        name: that the user types.
        group: what it is for.
        order: its place in its group.
        add_options: adds its arguments; of commands below it each sets its own ``run``.
        run: returns the exit code; None where there are commands below it.
        help: what it does, in the list of commands.
        description: above its options.
        epilog: below them, such as examples.
        further_help: returns the end of the help, where it takes long to find out.
    """

    name: str
    group: Group
    order: int
    add_options: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int] | None
    help: str
    description: str
    epilog: str
    further_help: Callable[[], str] | None = None

    def add_parser(
        self, subparsers: "argparse._SubParsersAction[CommandParser]"
    ) -> argparse.ArgumentParser:
        """Add it to the command line; return its parser."""
        parser = subparsers.add_parser(
            self.name,
            help=self.help,
            description=self.description,
            epilog=self.epilog,
            further_help=self.further_help,
        )
        self.add_options(parser)
        if self.run is not None:
            parser.set_defaults(run=self.run)
        return parser


class Controls:
    """The names of the controls, as an option's choices; looked up once somebody asks for them."""

    def __iter__(self) -> Iterator[str]:
        """Return the names one after the other."""
        from stepdiag_ros.compensation import controls

        return iter(controls())

    def __contains__(self, name: object) -> bool:
        """Say whether there is a control of that name."""
        return name in list(self)


def _namespace(text: str) -> str:
    if not text:
        return ""
    if not re.fullmatch(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", text, re.ASCII):
        raise argparse.ArgumentTypeError(f"'{text}' is not a namespace. Write it like /cell_1")
    return "/" + text.lstrip("/")


def whole(text: str, low: int, high: int) -> int:
    """Return the whole number that an option was given.

    Raises:
        argparse.ArgumentTypeError: it is not a whole number, or not within [low, high].
    """
    if not text.isascii() or not text.isdigit() or not low <= int(text) <= high:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from {low} to {high}")
    return int(text)


def port(text: str) -> int:
    """Return the port that an option was given.

    Raises:
        argparse.ArgumentTypeError: it is not a port.
    """
    if not text.isascii() or not text.isdigit() or int(text) > _HIGHEST_PORT:
        raise argparse.ArgumentTypeError(
            f"'{text}' is not a port. Use a number from 0 to {_HIGHEST_PORT}"
        )
    return int(text)


COMMON: dict[str, dict[str, Any]] = {
    "details": {
        "action": "store_true",
        "help": "print all tables, as in report.txt, and draw all methods beside each other",
    },
    "force": {"action": "store_true", "help": "overwrite existing files"},
    "json": {"action": "store_true", "help": "print JSON in SI units"},
    "method": {"default": "", "help": "method of the solver (default: the most reliable one)"},
    "namespace": {
        "type": _namespace,
        "default": "",
        "metavar": "NS",
        "help": "namespace of the nodes, such as /cell_1 (default: none)",
    },
    "output": {"flags": ("-o",), "type": Path, "metavar": "FOLDER"},
    "pictures": {
        "choices": ("png", "svg", "pdf", "none"),
        "default": "png",
        "help": "format of the pictures, or none (default: png)",
    },
    "run": {
        "dest": "run_id",
        "metavar": "ID",
        "help": "run to use, if a recording of 'ros2 bag record' holds several",
    },
    "seed": {
        "type": partial(whole, low=0, high=_HIGHEST_SEED),
        "default": 0,
        "help": "seed of the noise (default: 0)",
    },
}
"""Options that several commands have: name → how argparse declares them."""


_NEWEST = "\0"
"""Stands for the bag that nobody named; no path holds this character."""
RESULTS = Path("stepdiag_results")
"""Folder in which runs are recorded where none was named."""


def add_bag(parser: argparse.ArgumentParser, what: str = "the measurement (.mcap)") -> None:
    """Add the argument that names a bag; if it is left out, the newest bag here is taken.

    Args:
        parser: of the command.
        what: the argument may name, for the help.
    """
    help_text = f"{what} (default: the newest .mcap here or in {RESULTS})"
    parser.add_argument("bag", type=_bag, nargs="?", default=_NEWEST, help=help_text)


def _bag(text: str) -> Path:
    from stepdiag_ros.commands.output import say

    if text != _NEWEST:
        return Path(text)
    from stepdiag_ros.bags.errors import BagError
    from stepdiag_ros.bags.info import end_of

    found = [path for folder in (Path(), RESULTS) for path in folder.glob("*.mcap")]
    if not found:
        raise argparse.ArgumentTypeError(f"no .mcap file is here or in {RESULTS}: name a bag")
    newest = max(found, key=lambda path: path.stat().st_mtime_ns)
    written = datetime.fromtimestamp(newest.stat().st_mtime)
    end = ""
    with suppress(BagError):  # The command says what is wrong with it.
        end = end_of(newest)
    say(f"stepdiag: newest bag: {newest}, written {written:%Y-%m-%d %H:%M}{end and f'; {end}'}")
    return newest


def results_folder(source: Path, what: str = "results") -> Path:
    """Return the folder for the results of a bag or table: ``NAME_WHAT`` beside it."""
    if source.name in ("", ".."):
        source = source.resolve()
    return source.parent / f"{source.stem}_{what}"


def add_common(parser: argparse._ActionsContainer, name: str, **changes: Any) -> None:
    """Add an option that several commands have.

    Args:
        parser: of the command, or a group of it.
        name: of ``COMMON``.
        changes: what this command declares otherwise, mostly ``help``.
    """
    declared = {**COMMON[name], **changes}
    parser.add_argument(*declared.pop("flags", ()), f"--{name}", **declared)


def picture_formats(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Return the formats of pictures that the user asked for; none if without pictures."""
    return () if arguments.pictures == "none" else (arguments.pictures,)
