"""Every help fits a terminal of 80 columns; only a command to be copied may be longer."""

import argparse

import pytest

from stepdiag_ros.cli import commands, make_parser
from stepdiag_ros.commands.arguments import fit_line

COLUMNS = 80


def parsers(parser):
    """Return a parser and those of its sub-commands."""
    found = [parser]
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for one in action.choices.values():
                found += parsers(one)
    return found


@pytest.fixture(scope="module")
def helps():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", str(COLUMNS))
        return {one.prog: one.format_help() for one in parsers(make_parser())}


def test_no_help_is_wider_than_the_terminal(helps):
    assert {f"stepdiag {one.name}" for one in commands()} < {*helps}
    wide = [line for text in helps.values() for line in text.splitlines() if len(line) > COLUMNS]
    assert not [line for line in wide if not line.startswith("  stepdiag ")]
    # Of an example only the command is left; what it is for stands below.
    assert not [line for line in wide if "  " in line.strip()]


@pytest.mark.parametrize(
    ("line", "lines"),
    [
        ("  short  as it is", ["  short  as it is"]),
        (
            "  stepdiag solve run.mcap  what it is for",
            ["  stepdiag solve run.mcap", "      what it is for"],
        ),
        (
            "  stepdiag solve a/long/path/run.mcap -o out",
            ["  stepdiag solve a/long/path/run.mcap -o out"],
        ),
        (
            "  name    one two three four five six",
            ["  name    one two three four five", "          six"],
        ),
        ("one two three four five six seven eight", ["one two three four five six seven", "eight"]),
    ],
)
def test_a_line_ends_where_its_kind_demands_it(line, lines):
    assert fit_line(line, 34).split("\n") == lines
