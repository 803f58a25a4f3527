"""Figures in the documents are those that the present state computes."""

import re
import sys
from pathlib import Path

import pytest
from refused import refused

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))

import document_figures  # noqa: E402
from document_figures import FIGURES, Figure, alike, differences, marked, texts, write  # noqa: E402


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_in_a_document_is_what_is_computed(name):
    figure = FIGURES[name]
    computed = figure.make()
    for found in texts(figure):
        if not alike(found, computed):
            # Not an assertion: pytest would print both texts whole before the remedy.
            pytest.fail(
                f"run python benchmarks/document_figures.py --write --only '{name}';"
                f" {figure.document} (-) and what is computed (+) differ in\n"
                f"{differences(found, computed)}",
                pytrace=False,
            )


def test_every_marked_place_has_its_figure():
    expressions = {figure.found_by for figure in FIGURES.values()}
    for path in (ROOT / "docs").rglob("*.md"):
        text = path.read_text(encoding="utf-8")
        names = re.findall(r"<!-- ([^>]+): written by benchmarks/document_figures.py", text)
        assert {marked(name) for name in names} <= expressions, path


@pytest.mark.parametrize(
    ("text", "other", "same"),
    [
        ("| 0.798 ± 0.020 µm |", "| 0.799 ± 0.019 µm |", True),
        ("| 0.798 ± 0.020 µm |", "| 0.800 ± 0.020 µm |", False),
        ("| 0.798 ± 0.020 µm |", "| -0.798 ± 0.020 µm |", False),
        ("from stop 22", "from stop 23", False),
        ("| NAMED: backlash of X |", "| NAMED: backlash of Y |", False),
        ("| 0.80 |", "| 0.80 | 1 |", False),
    ],
)
def test_only_the_last_digit_may_turn_over(text, other, same):
    assert alike(text, other) == same


def test_only_the_rows_that_differ_are_shown():
    table = "| a | 1.0 |\n| b | 2.0 |\n| c | 3.0 |"
    assert differences(table, table.replace("2.0", "2.5")) == "-| b | 2.0 |\n+| b | 2.5 |"
    assert differences(table, f"{table}\n| d | 4.0 |") == "+| d | 4.0 |"


def test_a_figure_is_written_at_each_of_its_places_and_nowhere_else(tmp_path, monkeypatch):
    monkeypatch.setattr(document_figures, "ROOT", tmp_path)
    begin = "<!-- a: written by benchmarks/document_figures.py, not by hand -->"
    text = f"1 pass\n{begin}\nold\n<!-- a: end -->\nafter {begin}old<!-- a: end -->\n"
    (tmp_path / "page.md").write_text(text)
    figure = Figure("page.md", marked("a"), lambda: "new")
    write(figure, figure.make())
    assert texts(figure) == ["new", "new"]
    assert (tmp_path / "page.md").read_text() == text.replace("\nold\n", "new").replace(
        "old", "new"
    )
    counted = Figure("page.md", r"(\d+) pass", lambda: "28")
    write(counted, "28")
    assert (tmp_path / "page.md").read_text().startswith("28 pass\n")
    with refused(ValueError, None, "page.md"):
        texts(Figure("page.md", marked("b"), lambda: ""))
