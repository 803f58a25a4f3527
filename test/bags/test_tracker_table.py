"""The table of a tracker's readings: what it says, and every way in which it can be wrong."""

from dataclasses import replace

import pytest
from refused import a_fault, refused

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
    with refused(TableError, "malformed", row=2, about="length_change_m"):
        parse_table(text, "t")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", a_fault("missing", "station", row=1)),
        (HEADER + "\n", a_fault("too_few")),
        (HEADER.replace(",", ";") + "\n", a_fault("wrong_kind", aspect="delimiter", row=1)),
        (HEADER.replace("run", "round") + "\n" + ROW, a_fault("missing", "round")),
        (HEADER + ",more\n", a_fault("unknown", "more")),
        (HEADER + ",run\n", a_fault("twice", "run", "2", aspect="column")),
        (f"{HEADER}\n{ROW},9\n", a_fault("malformed", "11", "10", row=2, aspect="cell")),
        (f"{HEADER}\n1,xy,2\n", a_fault("malformed", "3", row=2, aspect="cell")),
        (f"{HEADER}\n{ROW}\n{ROW}\n", a_fault("twice", "2", row=3, aspect="reading")),
        (f"{HEADER}\n{ROW.replace('xy', 'yx')}\n", a_fault("unknown", "yx", row=2, about="line")),
        (
            f"{HEADER}\n{ROW.replace('backward', 'back')}\n",
            a_fault("unknown", "back", about="direction"),
        ),
        (
            f"{HEADER}\n{ROW.replace('2,backward', '0,backward')}\n",
            a_fault("out_of_range", "0", about="run"),
        ),
        (f"{HEADER}\n{ROW.replace('-0.2', '-200.0e3')}\n", a_fault("out_of_range", about="y_m")),
        (f"{HEADER}\n{ROW.replace('-0.2', 'nan')}\n", a_fault("malformed", "nan", about="y_m")),
        (
            f"{HEADER}\n{ROW.replace('2e-07', '-2e-07')}\n",
            a_fault("out_of_range", about="standard_uncertainty_m"),
        ),
        (
            f"{HEADER}\n{ROW.replace('2e-07', '2e-0')}\n",
            a_fault("out_of_range", "2e-0", about="standard_uncertainty_m"),
        ),
        (f"{HEADER}\n{ROW.replace('1,xy', ',xy')}\n", a_fault("missing", about="station")),
        (f'{HEADER}\n"1,xy\n', a_fault("malformed", aspect="quoting", row=2)),
    ],
)
def test_what_is_wrong_is_named_with_its_row(text, words):
    with refused(TableError, words):
        parse_table(text, "t")


def test_no_file_is_said(tmp_path):
    with refused(TableError, "not_found", "t.csv"):
        read_table(tmp_path / "t.csv")
