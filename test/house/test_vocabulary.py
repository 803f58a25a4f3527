"""Prose keeps to the vocabulary (docs/vocabulary.yaml); what was written before may only shrink.

``vocabulary_debt.json`` allows a number of hits to each file written before there was a vocabulary.
``python test/house/test_vocabulary.py`` lowers these numbers to the present hits, and never raises
one; a file that moves takes its number along by hand.
"""

import ast
import json
import re
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
VOCABULARY = ROOT / "docs" / "vocabulary.yaml"
DEBT = Path(__file__).with_name("vocabulary_debt.json")
PAGES = ("*.md", "docs/**/*.md")
CODE = re.compile(r"<!--.*?-->|^ *```.*?^ *```|``.*?``|`[^`]*`", re.DOTALL | re.MULTILINE)
LOWER = "python test/house/test_vocabulary.py"

Rules = list[tuple[re.Pattern[str], str]]


def rules() -> Rules:
    """Return each pattern with the advice to give where it is found."""
    entries = yaml.safe_load(VOCABULARY.read_text(encoding="utf-8"))
    return [
        (re.compile(entry["pattern"], re.IGNORECASE), f"write {entry['write']} ({entry['why']})")
        for entry in entries
    ]


def prose(path: Path) -> list[str]:
    """Return the texts of a page or of a module's strings, without what is in code style."""
    text = path.read_text(encoding="utf-8")
    texts = [text]
    if path.suffix == ".py":
        strings = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Constant))
        texts = [one.value for one in strings if isinstance(one.value, str) and " " in one.value]
    return [" ".join(CODE.sub("`", one).split()) for one in texts]


def hits(texts: list[str], known: Rules) -> list[str]:
    """Return a line for each hit: the words, and what to write instead."""
    return [
        f"'{found[0]}' in '{text[max(0, found.start() - 30) : found.end() + 30]}': {advice}"
        for text in texts
        for pattern, advice in known
        for found in pattern.finditer(text)
    ]


def found(root: Path = ROOT) -> dict[str, list[str]]:
    """Return the hits of every file that has any."""
    known = rules()
    paths = [path for page in PAGES for path in root.glob(page) if "_build" not in path.parts]
    paths += (root / "stepdiag_ros").rglob("*.py")
    each = {path.relative_to(root).as_posix(): hits(prose(path), known) for path in sorted(paths)}
    return {name: lines for name, lines in each.items() if lines}


def complaints(allowed: dict[str, int], present: dict[str, list[str]]) -> list[str]:
    """Return what is wrong: files with more hits than allowed, and numbers that are too high."""
    wrong = []
    for name in sorted(allowed.keys() | present.keys()):
        lines, most = present.get(name, []), allowed.get(name, 0)
        if len(lines) > most:
            wrong.append("\n  ".join([f"{name}: {len(lines)} hits, {most} allowed:", *lines]))
        elif len(lines) < most:
            wrong.append(f"{name}: {len(lines)} hits, {most} allowed: run {LOWER}")
    return wrong


def recorded() -> dict[str, int]:
    """Return the hits allowed to each file."""
    numbers: dict[str, int] = json.loads(DEBT.read_text(encoding="utf-8"))
    return numbers


def test_prose_keeps_to_the_vocabulary() -> None:
    wrong = complaints(recorded(), found())
    assert not wrong, "docs/style.md explains the rules.\n" + "\n".join(wrong)


def test_words_are_found_in_pages_and_strings_but_not_in_code(tmp_path: Path) -> None:
    page, module = tmp_path / "README.md", tmp_path / "stepdiag_ros" / "module.py"
    page.write_text("The node\ntold `is none`, ``told``.\n\n```sh\nlikewise\n```\nLikewise.\n")
    module.parent.mkdir()
    module.write_text('"""This is\n    none."""\ntold = f"told {1} is None", "told"  # told\n')
    present = found(tmp_path)
    assert {name: len(lines) for name, lines in present.items()} == {
        "README.md": 2,
        "stepdiag_ros/module.py": 2,
    }
    assert "'told' in 'The node told" in present["README.md"][0]
    assert "write report" in present["README.md"][0]


def test_more_hits_fail_fewer_ask_for_a_lower_number_and_equal_ones_pass() -> None:
    assert complaints({"a.md": 1}, {"a.md": ["x"]}) == []
    assert "2 hits, 1 allowed" in complaints({"a.md": 1}, {"a.md": ["x", "y"]})[0]
    assert "1 hits, 0 allowed" in complaints({}, {"new.md": ["x"]})[0]
    assert LOWER in complaints({"gone.md": 1}, {})[0]


if __name__ == "__main__":
    now, before = found(), recorded()
    lower = {name: min(len(now[name]), most) for name, most in before.items() if name in now}
    DEBT.write_text(json.dumps(lower, indent=1, sort_keys=True) + "\n", encoding="utf-8")
