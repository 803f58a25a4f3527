"""A table holds texts; a terminal shows all of them, whatever its width."""

import io

import pytest

from stepdiag_ros.text.console import make_console
from stepdiag_ros.text.table import Column, Table, new_table, with_rows


def shown(table, **options):
    stream = io.StringIO()
    make_console(stream).print(table, **options)
    return [line.rstrip() for line in stream.getvalue().splitlines()]


def test_names_stand_on_the_left_and_numbers_on_the_right():
    table = new_table("Errors", "name", "value / µm")
    table.add_row("E_XX", "1.5")
    table.add_row("E_YX, straightness", "-12.25")
    lines = shown(table)
    assert lines[0] == "Errors"
    first, second = (line for line in lines if "E_" in line)
    assert first.strip().startswith("E_XX ") and first.endswith("  1.5")
    assert len(first) == len(second)


def test_a_row_that_does_not_fit_its_heads_is_refused():
    table = new_table("Errors", "name", "value")
    for cells in ((), ("E_XX",), ("E_XX", "1", "2")):
        with pytest.raises(ValueError):
            table.add_row(*cells)
    assert table.rows == []


def test_a_line_is_drawn_under_a_section():
    def lines(ends):
        return len(shown(Table("", [Column("a")], [("1",), ("2",)], section_ends=ends)))

    table = new_table("", "a")
    table.add_row("1")
    table.add_section()
    assert table.section_ends == {0}
    assert lines({0}) > lines(set())


def test_words_are_broken_and_numbers_are_not():
    words = "what an effect does in a machine, in many words"
    table = Table("", [Column("effect", wraps=True), Column("size", number=True)])
    table.add_row(words, "1,234.567")
    lines = shown(table, width=30)
    assert max(map(len, lines)) <= 30
    assert any("1,234.567" in line for line in lines)
    text = " ".join(" ".join(lines).replace("1,234.567", "").split())
    assert all(word in text for word in words.split())


def test_what_would_steer_a_terminal_is_taken_out():
    table = new_table("a\x1b[2Jb", "c\x1b[31m")
    table.add_row("d\x07")
    assert not set("\x1b\x07") & set("".join(shown(table)))


def test_tables_without_rows_are_left_out():
    table = new_table("", "a")
    assert with_rows([None, table]) == []
    table.add_row("1")
    assert with_rows([None, table]) == [table]


def test_a_table_is_folded_on_a_narrow_terminal_and_nothing_of_it_is_lost():
    table = new_table("Sources", "input", *(f"column {n}" for n in range(9)))
    table.add_row("laser wavelength", *(f"{n}.2345678" for n in range(9)))
    stream = io.StringIO()
    console = make_console(stream)
    console.text_width = 80
    console.print(table)
    text = stream.getvalue()
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 80
    assert all(f"column {n}" in text and f"{n}.2345678" in text for n in range(9))
    assert text.count("laser wavelength") == 2
    assert table.folded(200) == [table]
