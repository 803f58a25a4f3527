"""Every table that contradicts itself is refused with the row and the reason."""

import csv
from pathlib import Path

import pytest

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.table import read_table
from stepdiag_ros.bags.table_rows import COLUMNS

CASE = Path(__file__).parent.parent / "data" / "cases" / "four_diagonals"


@pytest.fixture
def rows():
    """Return header and rows of a good table: x forward in rows 2..14, backward in 15..27."""
    with (CASE / "run.csv").open(newline="") as file:
        return list(csv.reader(file))


def refused(rows, tmp_path, row, reason, case=None):
    path = tmp_path / "run.csv"
    path.write_text("\n".join(",".join(cells) for cells in rows) + "\n")
    if case is not None:
        (tmp_path / "case.yaml").write_bytes((case / "case.yaml").read_bytes())
    with pytest.raises(TableError, match=reason) as caught:
        read_table(path)
    expected = f"{path}, row {row}: " if row else f"{path} "
    assert str(caught.value).startswith(expected)


def change(rows, row, **cells):
    for name, value in cells.items():
        rows[row - 1][COLUMNS.index(name)] = value


def test_the_unchanged_table_is_taken(rows, tmp_path):
    (tmp_path / "run.csv").write_text("\n".join(",".join(cells) for cells in rows))
    assert len(read_table(tmp_path / "run.csv").lines) == 42


@pytest.mark.parametrize("column", COLUMNS)
def test_a_missing_column(rows, tmp_path, column):
    place = COLUMNS.index(column)
    less = [cells[:place] + cells[place + 1 :] for cells in rows]
    refused(less, tmp_path, 1, f"column '{column}' is missing")


def test_a_column_with_another_name(rows, tmp_path):
    change(rows, 1, reading_m="reading_mm")
    refused(rows, tmp_path, 1, "'reading_m' is missing; there is an unknown column 'reading_mm'")


def test_a_column_that_is_there_twice(rows, tmp_path):
    refused([[*cells, cells[0]] for cells in rows], tmp_path, 1, "'time_s' is there 2 times")


def test_more_cells_than_columns(rows, tmp_path):
    rows[7].append("1")
    refused(rows, tmp_path, 8, "has 16 cells under 15 columns")


def test_semicolons(rows, tmp_path):
    refused([[";".join(cells)] for cells in rows], tmp_path, 1, "not separated by commas")


@pytest.mark.parametrize("column", ["time_s", "x_m", "y_m", "z_m", "reading_m"])
@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("", "expected a number"),
        ("wide", "expected a number"),
        ("1_000", "expected a number"),
        ("0x10", "expected a number"),
        ("nan", "expected a finite number"),
        ("-inf", "expected a finite number"),
    ],
)
def test_what_is_no_number(rows, tmp_path, column, value, reason):
    change(rows, 9, **{column: value})
    refused(rows, tmp_path, 9, f"'{column}' is '{value}'; {reason}")


def test_a_decimal_comma(rows, tmp_path):
    change(rows, 9, reading_m='"0,07"')
    refused(rows, tmp_path, 9, "with a point, not a comma")


@pytest.mark.parametrize(
    ("column", "value", "reason"),
    [
        ("air_temperature_degC", "293.15", "kelvin"),
        ("material_temperature_degC", "293.15", "kelvin"),
        ("air_pressure_Pa", "1013.25", "hPa"),
        ("relative_humidity", "50", "per cent"),
        ("air_pressure_Pa", "high", "a number"),
        ("kind", "circular", "one of linear, step_diagonal, diagonal"),
        ("line", "w", "one of x, y, z"),
        ("line", "ppp", "one of x, y, z"),
        ("order", "XYZ", "nothing for a line of kind linear"),
        ("direction", "Forward", "one of forward, backward"),
        ("repeat", "-1", "a whole number"),
        ("repeat", "0.5", "a whole number"),
        ("stop", "seven", "a whole number"),
    ],
)
def test_a_cell_with_a_wrong_value(rows, tmp_path, column, value, reason):
    change(rows, 9, **{column: value})
    refused(rows, tmp_path, 9, f"'{column}' is '{value}'; expected .*{reason}")


def first_row(rows, line, direction="forward"):
    for number, cells in enumerate(rows, start=1):
        if (cells[2], cells[5]) == (line, direction):
            return number
    raise AssertionError


@pytest.mark.parametrize("line", ["nnn", "x", "xy"])
def test_an_unknown_diagonal(rows, tmp_path, line):
    row = first_row(rows, "ppp")
    change(rows, row, line=line)
    refused(rows, tmp_path, row, "one of ppp, npp, pnp, ppn")


@pytest.mark.parametrize("order", ["", "XYX", "xyz"])
def test_an_unknown_order(rows, tmp_path, order):
    row = first_row(rows, "ppp")
    change(rows, row, order=order)
    refused(rows, tmp_path, row, "'order' is .* one of XYZ")


def test_a_row_that_is_cut_off(rows, tmp_path):
    rows[8] = rows[8][:9]
    refused(rows, tmp_path, 9, "only 9 cells")


def test_a_quote_that_never_ends(rows, tmp_path):
    rows[-1][2] = '"ppn'
    refused(rows, tmp_path, len(rows), "no CSV")


def test_no_rows(rows, tmp_path):
    refused(rows[:1], tmp_path, 0, "has no rows")


def test_an_empty_file(tmp_path):
    (tmp_path / "run.csv").touch()
    with pytest.raises(TableError, match="row 1: column 'time_s' is missing"):
        read_table(tmp_path / "run.csv")


def test_a_file_that_is_no_text(tmp_path):
    (tmp_path / "run.csv").write_bytes(b"time_s,\xff\xfe")
    with pytest.raises(TableError, match="no text in UTF-8"):
        read_table(tmp_path / "run.csv")


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(TableError, match="there is no table"):
        read_table(tmp_path / "run.csv")
    (tmp_path / "run.csv").write_bytes((CASE / "run.csv").read_bytes())
    with pytest.raises(TableError, match="there is no case file"):
        read_table(tmp_path / "run.csv", tmp_path / "none.yaml")


def test_time_that_goes_back(rows, tmp_path):
    change(rows, 9, time_s="2.0")
    refused(rows, tmp_path, 9, "time goes back from 18 s to 2 s")


def test_a_missing_stop(rows, tmp_path):
    del rows[8]
    refused(rows, tmp_path, 9, "stop 7 of 'x forward, repeat 0' is missing before stop 8")


def test_a_missing_first_stop(rows, tmp_path):
    del rows[1]
    refused(rows, tmp_path, 2, "stop 0 of 'x forward, repeat 0' is missing")


def test_a_missing_last_stop(rows, tmp_path):
    del rows[13]
    refused(rows, tmp_path, 13, "'x forward, repeat 0' ends at stop 11; stop 12 to 12 are missing")


def test_a_table_that_ends_in_the_middle_of_a_line(rows, tmp_path):
    refused(rows[:-5], tmp_path, len(rows) - 5, "ends at stop 31", CASE)


def test_a_row_that_is_there_twice(rows, tmp_path):
    rows.insert(9, list(rows[8]))
    refused(rows, tmp_path, 10, "the row is there twice")


def test_a_stop_that_is_there_twice(rows, tmp_path):
    rows.insert(9, list(rows[8]))
    change(rows, 10, reading_m="0.07")
    refused(rows, tmp_path, 10, "stop 7 of 'x forward, repeat 0' is there twice")


def test_stops_in_the_wrong_order(rows, tmp_path):
    change(rows, 9, stop="8")
    change(rows, 10, stop="7")
    refused(rows, tmp_path, 9, "stop 7 of .* is missing before stop 8")


def test_stops_that_go_back(rows, tmp_path):
    change(rows, 9, stop="3")
    refused(rows, tmp_path, 9, "stop 3 of .* comes after stop 6")


def test_a_pass_that_is_there_twice_in_a_row(rows, tmp_path):
    again = [[str(float(cells[0]) + 38.0), *cells[1:]] for cells in rows[1:14]]
    rows[14:14] = again
    for cells in rows[27:]:
        cells[0] = str(float(cells[0]) + 1000.0)
    refused(rows, tmp_path, 15, "begins again after 13 stops; count its repeats")


def test_a_pass_that_was_measured_already_in_the_setup(rows, tmp_path):
    for row in range(28, 41):
        change(rows, row, repeat="0")  # the forward pass of repeat 1
    refused(rows, tmp_path, 28, "was measured already from row 2 on; count its repeats")


def test_more_stops_than_the_box_has(rows, tmp_path):
    (tmp_path / "case.yaml").write_text("step_m: [0.01, 0.01, 0.01]\nblocks: 11\n")
    refused(rows, tmp_path, 14, "goes on behind its last stop 11")


def test_a_direction_that_contradicts_the_positions(rows, tmp_path):
    for row in range(2, 15):
        change(rows, row, direction="backward")
    for row in range(15, 28):
        change(rows, row, direction="forward")
    refused(rows, tmp_path, 2, "says 'x backward, repeat 0', but the positions run forward")


def test_positions_of_another_diagonal(rows, tmp_path):
    begin, end = first_row(rows, "ppp"), first_row(rows, "ppp", "backward")
    for row in range(begin, end):
        change(rows, row, line="npp")
    refused(rows, tmp_path, begin, "says 'npp .*but the positions are those of 'ppp XYZ forward")


def as_diagonal(rows, name="ppp", way="forward"):
    """Make of a step diagonal what is measured when all axes move at once."""
    begin = first_row(rows, name, way)
    kept = [rows[begin - 1 + 3 * stop] for stop in range(13)]
    made = [[*cells] for cells in [rows[0], *kept]]
    for stop, cells in enumerate(made[1:]):
        for column, value in (("kind", "diagonal"), ("order", ""), ("stop", str(stop))):
            cells[COLUMNS.index(column)] = value
    return made


def test_a_diagonal_has_no_order(rows, tmp_path):
    made = as_diagonal(rows)
    change(made, 2, order="XYZ")
    refused(made, tmp_path, 2, "'order' is 'XYZ'; expected nothing for a line of kind diagonal")


def test_a_linear_line_with_a_diagonals_name(rows, tmp_path):
    made = as_diagonal(rows)
    change(made, 2, kind="diagonal", line="x")
    refused(made, tmp_path, 2, "'line' is 'x'; expected one of ppp, npp, .*0np")


def test_a_step_diagonal_that_is_called_a_diagonal(rows, tmp_path):
    begin = first_row(rows, "ppp")
    for row in range(begin, first_row(rows, "ppp", "backward")):
        change(rows, row, kind="diagonal", order="")
    refused(rows, tmp_path, begin + 1, "does not follow the line's name and order")


def test_positions_of_another_diagonal_at_once(rows, tmp_path):
    made = as_diagonal(rows)
    for row in range(2, len(made) + 1):
        change(made, row, line="pnp")
    refused(made, tmp_path, 2, "says 'pnp diagonal .*but the positions are those of 'ppp diagonal")


def test_positions_of_another_order(rows, tmp_path):
    begin, end = first_row(rows, "ppp"), first_row(rows, "ppp", "backward")
    for row in range(begin, end):
        change(rows, row, order="YZX")
    refused(rows, tmp_path, begin, "says 'ppp YZX .*but the positions are those of 'ppp XYZ")


def test_a_position_off_the_grid(rows, tmp_path):
    change(rows, 9, x_m="0.070100")
    refused(rows, tmp_path, 9, "X is 0.0701 m .* expected 0.07 m; it is off the grid")


def test_a_position_on_the_grid_at_the_wrong_place(rows, tmp_path):
    change(rows, 9, x_m="0.080000")
    refused(rows, tmp_path, 9, "X is 0.08 m .* does not follow the line's name and order")


def test_an_axis_that_should_stand_still(rows, tmp_path):
    change(rows, 9, y_m="0.010000")
    refused(rows, tmp_path, 9, "Y is 0.01 m at stop 7 of 'x forward, repeat 0', expected 0 m")


def in_millimetres(rows, *columns):
    for cells in rows[1:]:
        for column in columns:
            place = COLUMNS.index(column)
            cells[place] = repr(float(cells[place]) * 1000.0)


def test_everything_in_millimetres(rows, tmp_path):
    in_millimetres(rows, "x_m", "y_m", "z_m", "reading_m")
    refused(rows, tmp_path, 3, "blocks would be 10 m long.*millimetres")


def test_positions_in_millimetres_beside_a_case_file(rows, tmp_path):
    in_millimetres(rows, "x_m", "y_m", "z_m")
    refused(rows, tmp_path, 3, "X is 10 m .* looks like millimetres", CASE)


def test_readings_in_millimetres(rows, tmp_path):
    in_millimetres(rows, "reading_m")
    refused(rows, tmp_path, 3, "readings are in metres, this looks like millimetres")


def test_readings_with_the_wrong_sign(rows, tmp_path):
    for cells in rows[1:]:
        cells[COLUMNS.index("reading_m")] = repr(-float(cells[COLUMNS.index("reading_m")]))
    refused(rows, tmp_path, 3, "sign is wrong, a reading grows along the beam")


def test_a_reading_that_does_not_belong_there(rows, tmp_path):
    change(rows, 9, reading_m="0.0500000")
    refused(rows, tmp_path, 9, "changed by 0.05 m .* positions have changed by 0.07 m")


def test_a_box_that_cannot_be_seen(rows, tmp_path):
    only = [rows[0]] + [cells for cells in rows[1:] if cells[2] in ("x", "z")]
    refused_text = "no line moves Y"
    path = tmp_path / "run.csv"
    path.write_text("\n".join(",".join(cells) for cells in only))
    with pytest.raises(TableError, match=refused_text):
        read_table(path)
    assert len(read_table(path, CASE / "case.yaml").lines) == 12


def test_a_single_stop(rows, tmp_path):
    refused(rows[:2], tmp_path, 2, "a single stop")
