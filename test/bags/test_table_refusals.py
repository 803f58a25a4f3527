"""Every table that contradicts itself is refused with the row and the reason."""

import csv
from pathlib import Path

import pytest
from refused import refused

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.plain_table import read_rows
from stepdiag_ros.bags.table import read_table
from stepdiag_ros.bags.table_rows import COLUMNS

CASE = Path(__file__).parent.parent / "data" / "cases" / "four_diagonals"


@pytest.fixture
def rows():
    """Return header and rows of a good table: x forward in rows 2..14, backward in 15..27."""
    with (CASE / "run.csv").open(newline="") as file:
        return list(csv.reader(file))


def is_refused(rows, tmp_path, row, fault, *names, case=None, **fields):
    path = tmp_path / "run.csv"
    path.write_text("\n".join(",".join(cells) for cells in rows) + "\n")
    if case is not None:
        (tmp_path / "case.yaml").write_bytes((case / "case.yaml").read_bytes())
    with refused(TableError, fault, *names, **fields) as caught:
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
    is_refused(less, tmp_path, 1, "missing", column)


def test_a_column_with_another_name(rows, tmp_path):
    change(rows, 1, reading_m="reading_mm")
    is_refused(rows, tmp_path, 1, "missing", "reading_m", "reading_mm")


def test_a_column_that_is_there_twice(rows, tmp_path):
    is_refused([[*cells, cells[0]] for cells in rows], tmp_path, 1, "twice", "time_s", "2")


def test_more_cells_than_columns(rows, tmp_path):
    rows[7].append("1")
    is_refused(rows, tmp_path, 8, "too_many", "16", "15")


def test_semicolons(rows, tmp_path):
    is_refused([[";".join(cells)] for cells in rows], tmp_path, 1, "wrong_kind", aspect="delimiter")


@pytest.mark.parametrize("column", ["time_s", "x_m", "y_m", "z_m", "reading_m"])
@pytest.mark.parametrize(
    ("value", "fault"),
    [
        ("", "malformed"),
        ("wide", "malformed"),
        ("1_000", "malformed"),
        ("0x10", "malformed"),
        ("nan", "out_of_range"),
        ("-inf", "out_of_range"),
    ],
)
def test_what_is_no_number(rows, tmp_path, column, value, fault):
    change(rows, 9, **{column: value})
    is_refused(rows, tmp_path, 9, fault, f"'{value}'", about=column)


def test_a_decimal_comma(rows, tmp_path):
    change(rows, 9, reading_m='"0,07"')
    is_refused(rows, tmp_path, 9, "malformed", about="reading_m")


@pytest.mark.parametrize(
    ("column", "value", "fault", "names"),
    [
        ("air_temperature_degC", "293.15", "out_of_range", []),
        ("material_temperature_degC", "293.15", "out_of_range", []),
        ("air_pressure_Pa", "1013.25", "out_of_range", ["hPa"]),
        ("relative_humidity", "50", "out_of_range", []),
        ("air_pressure_Pa", "high", "malformed", []),
        ("kind", "circular", "unknown", ["linear", "step_diagonal", "diagonal"]),
        ("line", "w", "unknown", ["x", "y", "z"]),
        ("line", "ppp", "unknown", ["x", "y", "z"]),
        ("order", "XYZ", "mismatch", ["linear"]),
        ("direction", "Forward", "unknown", ["forward", "backward"]),
        ("repeat", "-1", "malformed", []),
        ("repeat", "0.5", "malformed", []),
        ("stop", "seven", "malformed", []),
    ],
)
def test_a_cell_with_a_wrong_value(rows, tmp_path, column, value, fault, names):
    change(rows, 9, **{column: value})
    is_refused(rows, tmp_path, 9, fault, value, *names, about=column)


def first_row(rows, line, direction="forward"):
    for number, cells in enumerate(rows, start=1):
        if (cells[2], cells[5]) == (line, direction):
            return number
    raise AssertionError


@pytest.mark.parametrize("line", ["nnn", "x", "xy"])
def test_an_unknown_diagonal(rows, tmp_path, line):
    row = first_row(rows, "ppp")
    change(rows, row, line=line)
    is_refused(rows, tmp_path, row, "unknown", "ppp", "npp", "pnp", "ppn", about="line")


@pytest.mark.parametrize("order", ["", "XYX", "xyz"])
def test_an_unknown_order(rows, tmp_path, order):
    row = first_row(rows, "ppp")
    change(rows, row, order=order)
    is_refused(rows, tmp_path, row, "unknown", "XYZ", about="order")


def test_a_row_that_is_cut_off(rows, tmp_path):
    rows[8] = rows[8][:9]
    is_refused(rows, tmp_path, 9, "too_few", "9")


def test_a_cell_that_is_cut_off(rows, tmp_path):
    rows[0].append("standard_uncertainty_m")
    for cells in rows[1:]:
        cells.append("4.575199940953895e-08")
    rows[-1][-1] = rows[-1][-1][:-1]
    cut, column = rows[-1][-1], "standard_uncertainty_m"
    is_refused(rows, tmp_path, len(rows), "out_of_range", cut, about=column)


def test_a_quote_that_never_ends(rows, tmp_path):
    rows[-1][2] = '"ppn'
    is_refused(rows, tmp_path, len(rows), "malformed", aspect="quoting")


def test_no_rows(rows, tmp_path):
    is_refused(rows[:1], tmp_path, 0, "too_few", "run.csv", aspect="row")


def test_an_empty_file(tmp_path):
    (tmp_path / "run.csv").touch()
    with refused(TableError, "missing", "time_s", row=1):
        read_table(tmp_path / "run.csv")


def test_a_file_that_is_no_text(tmp_path):
    (tmp_path / "run.csv").write_bytes(b"time_s,\xff\xfe")
    with refused(TableError, "wrong_kind", "run.csv", aspect="text"):
        read_table(tmp_path / "run.csv")


def test_a_file_that_is_not_there(tmp_path):
    with refused(TableError, "not_found", "run.csv"):
        read_table(tmp_path / "run.csv")
    (tmp_path / "run.csv").write_bytes((CASE / "run.csv").read_bytes())
    with refused(TableError, "not_found", "none.yaml"):
        read_table(tmp_path / "run.csv", tmp_path / "none.yaml")


def test_time_that_goes_back(rows, tmp_path):
    change(rows, 9, time_s="2.0")
    is_refused(rows, tmp_path, 9, "out_of_order", "18", "2")


def test_a_missing_stop(rows, tmp_path):
    del rows[8]
    is_refused(rows, tmp_path, 9, "missing", "x forward, repeat 0", "7", "8")


def test_a_missing_first_stop(rows, tmp_path):
    del rows[1]
    is_refused(rows, tmp_path, 2, "missing", "x forward, repeat 0", "0")


def test_a_missing_last_stop(rows, tmp_path):
    del rows[13]
    is_refused(rows, tmp_path, 13, "too_few", "x forward, repeat 0", "11", "12")


def test_a_table_that_ends_in_the_middle_of_a_line(rows, tmp_path):
    is_refused(rows[:-5], tmp_path, len(rows) - 5, "too_few", "31", case=CASE)


def test_a_row_that_is_there_twice(rows, tmp_path):
    rows.insert(9, list(rows[8]))
    is_refused(rows, tmp_path, 10, "twice", aspect="row")


def test_a_stop_that_is_there_twice(rows, tmp_path):
    rows.insert(9, list(rows[8]))
    change(rows, 10, reading_m="0.07")
    is_refused(rows, tmp_path, 10, "twice", "x forward, repeat 0", "7", aspect="stop")


def test_stops_in_the_wrong_order(rows, tmp_path):
    change(rows, 9, stop="8")
    change(rows, 10, stop="7")
    is_refused(rows, tmp_path, 9, "missing", "7", "8")


def test_stops_that_go_back(rows, tmp_path):
    change(rows, 9, stop="3")
    is_refused(rows, tmp_path, 9, "out_of_order", "3", "6")


def test_a_pass_that_is_there_twice_in_a_row(rows, tmp_path):
    again = [[str(float(cells[0]) + 38.0), *cells[1:]] for cells in rows[1:14]]
    rows[14:14] = again
    for cells in rows[27:]:
        cells[0] = str(float(cells[0]) + 1000.0)
    is_refused(rows, tmp_path, 15, "too_many", "13")


def test_a_pass_that_was_measured_already_in_the_setup(rows, tmp_path):
    for row in range(28, 41):
        change(rows, row, repeat="0")  # the forward pass of repeat 1
    is_refused(rows, tmp_path, 28, "twice", "2")


def test_more_stops_than_the_box_has(rows, tmp_path):
    (tmp_path / "case.yaml").write_text("step_m: [0.01, 0.01, 0.01]\nblocks: 11\n")
    is_refused(rows, tmp_path, 14, "too_many", "11")


def test_a_direction_that_contradicts_the_positions(rows, tmp_path):
    for row in range(2, 15):
        change(rows, row, direction="backward")
    for row in range(15, 28):
        change(rows, row, direction="forward")
    is_refused(rows, tmp_path, 2, "mismatch", "x backward, repeat 0")


def test_positions_of_another_diagonal(rows, tmp_path):
    begin, end = first_row(rows, "ppp"), first_row(rows, "ppp", "backward")
    for row in range(begin, end):
        change(rows, row, line="npp")
    is_refused(rows, tmp_path, begin, "mismatch", "npp", "ppp", "XYZ")


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
    is_refused(made, tmp_path, 2, "mismatch", "XYZ", about="order")


def test_a_linear_line_with_a_diagonals_name(rows, tmp_path):
    made = as_diagonal(rows)
    change(made, 2, kind="diagonal", line="x")
    is_refused(made, tmp_path, 2, "unknown", "x", "ppp", "npp", "0np", about="line")


def test_a_step_diagonal_that_is_called_a_diagonal(rows, tmp_path):
    begin = first_row(rows, "ppp")
    for row in range(begin, first_row(rows, "ppp", "backward")):
        change(rows, row, kind="diagonal", order="")
    is_refused(rows, tmp_path, begin + 1, "mismatch", aspect="order")


def test_positions_of_another_diagonal_at_once(rows, tmp_path):
    made = as_diagonal(rows)
    for row in range(2, len(made) + 1):
        change(made, row, line="pnp")
    is_refused(made, tmp_path, 2, "mismatch", "pnp", "ppp")


def test_positions_of_another_order(rows, tmp_path):
    begin, end = first_row(rows, "ppp"), first_row(rows, "ppp", "backward")
    for row in range(begin, end):
        change(rows, row, order="YZX")
    is_refused(rows, tmp_path, begin, "mismatch", "ppp", "YZX", "XYZ")


def test_a_position_off_the_grid(rows, tmp_path):
    change(rows, 9, x_m="0.070100")
    is_refused(rows, tmp_path, 9, "mismatch", "X", "0.0701", "0.07", aspect="grid")


def test_a_position_on_the_grid_at_the_wrong_place(rows, tmp_path):
    change(rows, 9, x_m="0.080000")
    is_refused(rows, tmp_path, 9, "mismatch", "X", "0.08", aspect="order")


def test_an_axis_that_should_stand_still(rows, tmp_path):
    change(rows, 9, y_m="0.010000")
    is_refused(
        rows, tmp_path, 9, "mismatch", "x forward, repeat 0", "Y", "0.01", "7", "0", aspect="order"
    )


def in_millimetres(rows, *columns, factor=1000.0):
    for cells in rows[1:]:
        for column in columns:
            place = COLUMNS.index(column)
            cells[place] = repr(float(cells[place]) * factor)


def test_everything_in_millimetres(rows, tmp_path):
    in_millimetres(rows, "x_m", "y_m", "z_m", "reading_m")
    is_refused(rows, tmp_path, 3, "out_of_range", "10")


def test_positions_in_millimetres_beside_a_case_file(rows, tmp_path):
    in_millimetres(rows, "x_m", "y_m", "z_m")
    is_refused(rows, tmp_path, 3, "mismatch", "X", "10", aspect="unit", case=CASE)


@pytest.mark.parametrize("factor", [1000.0, 0.001])
def test_readings_in_another_unit(rows, tmp_path, factor):
    in_millimetres(rows, "reading_m", factor=factor)
    is_refused(rows, tmp_path, 3, "out_of_range", aspect="unit")


def test_readings_with_the_wrong_sign(rows, tmp_path):
    for cells in rows[1:]:
        cells[COLUMNS.index("reading_m")] = repr(-float(cells[COLUMNS.index("reading_m")]))
    is_refused(rows, tmp_path, 3, "out_of_range", aspect="sign")


def test_a_reading_that_does_not_belong_there(rows, tmp_path):
    change(rows, 9, reading_m="0.0500000")
    is_refused(rows, tmp_path, 9, "out_of_range", "0.05", "0.07")


def test_a_box_that_cannot_be_seen(rows, tmp_path):
    only = [rows[0]] + [cells for cells in rows[1:] if cells[2] in ("x", "z")]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(",".join(cells) for cells in only))
    with refused(TableError, "undetermined", "Y"):
        read_table(path)
    assert len(read_table(path, CASE / "case.yaml").lines) == 12


def test_a_single_stop(rows, tmp_path):
    is_refused(rows[:2], tmp_path, 2, "too_few")


def test_a_misspelt_column_that_is_needed_is_asked_about(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(",".join("readings_m" if one == "reading_m" else one for one in COLUMNS) + "\n")
    with refused(TableError, "missing", "reading_m", "readings_m"):
        read_table(path)
    path.write_text("cycel,target_mm\n1,2\n")
    with refused(TableError, "missing", "cycle", "cycel"):
        read_rows(path, ("cycle", "target_mm"))
