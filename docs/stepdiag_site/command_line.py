"""The reference of the command line: what ``stepdiag COMMAND --help`` prints."""

import argparse
import os
from collections.abc import Iterator

COLUMNS = "88"
"""Characters in a line of a help text."""


def parsers() -> Iterator[tuple[str, str, argparse.ArgumentParser]]:
    """Yield every command: its name with that of its group, what it does, and its parser."""
    from stepdiag_ros.cli import make_parser

    yield from _below("", make_parser())


def _below(
    prefix: str, parser: argparse.ArgumentParser
) -> Iterator[tuple[str, str, argparse.ArgumentParser]]:
    for action in parser._actions:
        if not isinstance(action, argparse._SubParsersAction):
            continue
        helps = {choice.dest: choice.help or "" for choice in action._choices_actions}
        for name, below in action.choices.items():
            yield f"{prefix}{name}", helps.get(name, ""), below
            yield from _below(f"{prefix}{name} ", below)


def commands_page(_: str) -> str:
    """Return the help of every command."""
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = COLUMNS
    try:
        return "\n".join(
            f"## stepdiag {name}\n\n{_sentence(what)}\n\n````text\n{parser.format_help()}````\n"
            for name, what, parser in parsers()
        )
    finally:
        if before is None:
            del os.environ["COLUMNS"]
        else:
            os.environ["COLUMNS"] = before


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}." if text else ""
