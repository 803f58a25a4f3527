"""How a command reads its arguments: in any order, with a hint where one is not known."""

import argparse
import re
from collections.abc import Callable, Iterator, Sequence
from difflib import get_close_matches
from typing import Any, NoReturn

_HIGHEST_PORT = 65535


class CommandParser(argparse.ArgumentParser):
    """The parser of one command.

    It takes options before, between and after files, since people type them in any order, and says
    itself what it does not know: the parser above knows the options of no command.
    """

    _intermixed = False

    def __init__(self, *args: Any, further_help: Callable[[], str] | None = None, **more: Any):
        """Make the parser; ``further_help`` returns the end of the help once it is asked for."""
        super().__init__(*args, **more)
        self._further_help = further_help

    def format_help(self) -> str:
        """Return the help, with what takes long to find out only here."""
        return super().format_help() + (self._further_help() if self._further_help else "")

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        """Parse all arguments of the command; end the program with a hint where one is not known.

        Returns:
            the arguments, and an empty list.
        """
        if self._intermixed or not self._files_may_come_anywhere():
            return super().parse_known_args(args, namespace)
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

    def _refuse(self, unknown: list[str]) -> NoReturn:
        options = [argument for argument in unknown if argument.startswith("-")]
        if not options:
            self.error(f"one argument too many: {' '.join(unknown)}")
        wrong = options[0].partition("=")[0]
        near = get_close_matches(wrong, self._option_string_actions, n=1)
        hint = f"did you mean {near[0]}?" if near else f"'{self.prog} --help' lists them"
        self.error(f"there is no option {wrong}; {hint}")


class Controls:
    """The names of the controls, as an option's choices; looked up once somebody asks for them."""

    def __iter__(self) -> Iterator[str]:
        """Return the names one after the other."""
        from stepdiag_ros.compensation import controls

        return iter(controls())

    def __contains__(self, name: object) -> bool:
        """Say whether there is a control of that name."""
        return name in list(self)


def add_namespace_option(parser: argparse.ArgumentParser) -> None:
    """Add the option that says in which namespace the nodes are.

    Args:
        parser: of the command.
    """
    parser.add_argument(
        "--namespace",
        type=_namespace,
        default="",
        metavar="NS",
        help="of the nodes, such as /cell_1 (default: none)",
    )


def _namespace(text: str) -> str:
    if not text:
        return ""
    if not re.fullmatch(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", text, re.ASCII):
        raise argparse.ArgumentTypeError(f"'{text}' is no namespace, such as /cell_1")
    return "/" + text.lstrip("/")


def port(text: str) -> int:
    """Return the port that an option was given.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    if not text.isascii() or not text.isdigit() or int(text) > _HIGHEST_PORT:
        raise argparse.ArgumentTypeError(f"'{text}' is no port: 0 to {_HIGHEST_PORT}")
    return int(text)
