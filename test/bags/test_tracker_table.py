"""The table of a tracker's readings: what it says, and every way in which it can be wrong."""

from dataclasses import replace

import pytest

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.tracker_table import COLUMNS, parse_table, read_table, table_text
from stepdiag_ros.metrology.tracker.readings import TrackerReading

HEADER = ",".join(COLUMNS)
ROW = "1,xy,2,backward,3,0.1,-0.2,0.3,0.0123456789012345,2e-07"
READING = TrackerReading("1", "xy", 2, "backward", 3, (0.1, -0.2, 0.3), 0.0123456789012345, 2e-7)


def test_a_row_means_what_the_columns_say():
    assert parse_table(f"{HEADER}\n{ROW}\n", "t") == (READING,)


def test_there_and_back_to_the_last_bit(tmp_path):
    readings = (READING, replace(READING, stop=4, change=1 / 3))
    path = tmp_path / "t.csv"
    path.write_text("\ufeff" + table_text(readings), encoding="utf-8")
    assert read_table(path) == readings


def test_columns_in_any_order_and_without_uncertainty():
    names = ["stop", "line", "station", "z_m", "y_m", "x_m", "run", "direction", "length_change_m"]
    text = ",".join(names) + "\n3,grid,A,0.3,0.2,0.1,1,forward,0.5\n"
    (found,) = parse_table(text, "t")
    assert found.position == (0.1, 0.2, 0.3)
    assert found.uncertainty != found.uncertainty


def test_a_plan_may_lack_lengths_a_measurement_may_not():
    text = table_text([replace(READING, change=float("nan"))])
    (found,) = parse_table(text, "t", planned=True)
    assert found.change != found.change
    with pytest.raises(TableError, match="row 2: 'length_change_m' is ''"):
        parse_table(text, "t")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "row 1: column 'station' is missing"),
        (HEADER + "\n", "no rows"),
        (HEADER.replace(",", ";") + "\n", "not separated by commas"),
        (HEADER.replace("run", "round") + "\n" + ROW, "unknown column 'round'"),
        (HEADER + ",more\n", "unknown column 'more'"),
        (HEADER + ",run\n", "'run' is there 2 times"),
        (f"{HEADER}\n{ROW},9\n", "row 2: it has 11 cells under 10 columns; is there a decimal"),
        (f"{HEADER}\n1,xy,2\n", "row 2: it has 3 cells"),
        (f"{HEADER}\n{ROW}\n{ROW}\n", "row 3: .* there already in row 2"),
        (f"{HEADER}\n{ROW.replace('xy', 'yx')}\n", "row 2: 'line' is 'yx'; expected one of"),
        (f"{HEADER}\n{ROW.replace('backward', 'back')}\n", "'direction' is 'back'"),
        (
            f"{HEADER}\n{ROW.replace('2,backward', '0,backward')}\n",
            "'run' is '0'; expected a whole",
        ),
        (f"{HEADER}\n{ROW.replace('-0.2', '-200.0e3')}\n", "'y_m' .* millimetres"),
        (f"{HEADER}\n{ROW.replace('-0.2', 'nan')}\n", "'y_m' is 'nan'"),
        (f"{HEADER}\n{ROW.replace('2e-07', '-2e-07')}\n", "more than zero"),
        (f"{HEADER}\n{ROW.replace('1,xy', ',xy')}\n", "'station' is ''"),
        (f'{HEADER}\n"1,xy\n', "no CSV"),
    ],
)
def test_what_is_wrong_is_named_with_its_row(text, words):
    with pytest.raises(TableError, match=words):
        parse_table(text, "t")


def test_no_file_is_said(tmp_path):
    with pytest.raises(TableError, match="there is no table"):
        read_table(tmp_path / "t.csv")
