"""Commands on the pages: each is one that stepdiag takes, with options that there are."""

import re
import shlex
from pathlib import Path

import pytest

from stepdiag_ros.cli import make_parser

ROOT = Path(__file__).parents[2]
FOLDERS = (
    ".",
    "docs",
    *(f"docs/{name}" for name in ("explanation", "guide", "how_to", "reference", "tutorial")),
)
PAGES = [page for folder in FOLDERS for page in sorted((ROOT / folder).glob("*.md"))]
ROW = re.compile(r"^\| \[`stepdiag ([^`]+)`\]\(#stepdiag-([\w-]+)\) \| .+ \|$", re.MULTILINE)
"""A row of the table of all commands: the command line, and where it links to."""
BLOCK = re.compile(r"^ *```sh\n(.*?)^ *```", re.DOTALL | re.MULTILINE)


def commands(text):
    """Yield the arguments of every stepdiag command in the shell blocks of a page."""
    for block in BLOCK.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.shlex(line, posix=True, punctuation_chars=True)
            words.whitespace_split = True
            command = []
            for word in [*words, ";"]:
                if set(word) - set("();<>|&"):
                    command.append(word)
                    continue
                if "stepdiag" in command[:2]:
                    yield command[command.index("stepdiag") + 1 :]
                # What follows > is a file, and no command.
                command = ["file"] if word == ">" else []


@pytest.fixture(scope="module")
def parser():
    return make_parser()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_command_on_a_page_is_one_that_there_is(page, parser, capsys):
    for words in commands(page.read_text(encoding="utf-8")):
        try:
            parser.parse_args(words)
        except SystemExit as ended:
            if ended.code:
                pytest.fail(f"stepdiag {shlex.join(words)}: {capsys.readouterr().err}")


def test_the_table_of_commands_has_every_command_as_it_is_typed(parser, capsys):
    """Groups of docs/reference/commands.md, whose rows no shell block holds."""
    from stepdiag_site.command_line import parsers

    text = (ROOT / "docs/reference/commands.md").read_text(encoding="utf-8")
    rows = ROW.findall(text)
    assert len(rows) == text.count("| [`stepdiag "), "a row that is not of the table's kind"
    names = {name for name, _, _ in parsers() if " " not in name}
    assert {link for _, link in rows} == names
    for line, link in rows:
        words = shlex.split(line)
        assert words[0] == link
        try:
            parser.parse_args(words)
        except SystemExit as ended:
            assert not ended.code, f"stepdiag {line}: {capsys.readouterr().err}"


def test_commands_are_found_and_wrong_ones_are_seen(parser, capsys):
    text = "```sh\na && stepdiag info x.mcap  # why\nstepdiag solve y --no-such-option\n```\n"
    right, wrong = commands(text)
    assert right == ["info", "x.mcap"]
    with pytest.raises(SystemExit):
        parser.parse_args(wrong)
    assert "--no-such-option" in capsys.readouterr().err
    tutorial = [commands(page.read_text()) for page in PAGES if page.parent.name == "tutorial"]
    assert sum(len(list(found)) for found in tutorial) >= 8
