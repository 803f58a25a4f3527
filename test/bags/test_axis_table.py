"""Plain tables of an axis and of diagonals: what is read, and each refusal by row and reason."""

from pathlib import Path

import numpy as np
import pytest
from refused import a_fault, refused

from stepdiag_ros.bags.axis_table import read_axis_table
from stepdiag_ros.bags.diagonal_table import read_diagonal_table
from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.imports.imported import ImportOptions
from stepdiag_ros.bags.imports.registry import read_file

CASE = Path(__file__).parent.parent / "data" / "cases" / "iso230_2_measured" / "data.csv"
HEADER = "cycle,direction,target_mm,position_mm\n"
ROWS = ["1,forward,0,0.001", "1,forward,10,10.002", "1,backward,10,10.003", "1,backward,0,0.004"]

DIAGONAL_HEADER = (
    "diagonal,start_x_mm,start_y_mm,start_z_mm,finish_x_mm,finish_y_mm,finish_z_mm,length_mm"
)


def write(folder, text):
    path = folder / "axis.csv"
    path.write_text(text, encoding="utf-8")
    return path


def table(folder, *rows):
    return write(folder, HEADER + "\n".join(rows) + "\n")


def test_the_measured_case_is_read():
    runs = read_axis_table(CASE, "X")
    assert (runs.name, runs.kind) == ("X", "linear")
    np.testing.assert_allclose(runs.target, [-0.01, -0.00488, 0.00024, 0.00536, 0.01048])
    assert runs.forward.shape == runs.backward.shape == (5, 5)
    assert runs.forward[0][0] == pytest.approx(-0.00008102e-3, rel=1e-9)
    assert runs.backward[4][0] == pytest.approx(-0.00009402e-3, rel=1e-9)


def test_rows_may_stand_in_any_order(tmp_path):
    one = read_axis_table(table(tmp_path, *ROWS))
    other = read_axis_table(table(tmp_path, *ROWS[::-1]))
    np.testing.assert_array_equal(one.forward, other.forward)
    np.testing.assert_allclose(one.backward, [[4e-6, 3e-6]])
    assert one.name == "axis"


def test_runs_in_one_direction_are_enough_to_be_read(tmp_path):
    runs = read_axis_table(table(tmp_path, *ROWS[:2]))
    assert runs.backward.shape == (0, 2)
    assert runs.remarks == ()


def test_the_evaluation_refuses_the_unit_that_the_import_refuses(tmp_path):
    path = table(tmp_path, *(f"1,forward,{target},{1e-3 * target}" for target in (0, 10, 20)))
    for read in (read_axis_table, lambda one: read_file(one, ImportOptions(axis="X"))):
        with refused(TableError, "mismatch"):
            read(path)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([*ROWS, "1,forward,10,10.1"], a_fault("twice", "10", row=6)),
        (ROWS[:3], a_fault("missing", "1", "0")),
        ([*ROWS[:2], "1,forward,20,0.02002"], a_fault("mismatch", "20", row=4)),
        ([*ROWS, "2,sideways,0,0"], a_fault("unknown", "sideways", row=6, about="direction")),
        ([*ROWS, "x,forward,0,0"], a_fault("malformed", "x", row=6, about="cycle")),
        ([*ROWS, "2,forward,0,none"], a_fault("malformed", "none", row=6, about="position_mm")),
        ([*ROWS, "2,forward,0,nan"], a_fault("out_of_range", "nan", row=6, about="position_mm")),
        ([*ROWS, "2,forward,0,0,1"], a_fault("too_many", "5", "4", row=6)),
        ([*ROWS, '2,forward,0,"0,1"'], a_fault("malformed", about="position_mm")),
        (["1,forward,0,0.001"], a_fault("too_few", "axis.csv", aspect="target")),
        ([], a_fault("too_few", "axis.csv", aspect="row")),
    ],
)
def test_a_wrong_table_is_refused_by_row_and_reason(tmp_path, rows, message):
    with refused(TableError, message):
        read_axis_table(table(tmp_path, *rows))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "cycle;direction;target_mm;position_mm\n1;forward;0;0\n",
            a_fault("wrong_kind", aspect="delimiter", row=1),
        ),
        ("cycle,direction,target_mm\n1,forward,0\n", a_fault("missing", "position_mm", row=1)),
        (HEADER.replace("\n", ",x\n"), a_fault("unknown", "x")),
        (HEADER.replace("\n", ",cycle\n"), a_fault("twice", "cycle", "2")),
    ],
)
def test_a_wrong_header_is_refused(tmp_path, text, message):
    with refused(TableError, message):
        read_axis_table(write(tmp_path, text))


def test_a_missing_table_is_named(tmp_path):
    with refused(TableError, "not_found", "none.csv"):
        read_axis_table(tmp_path / "none.csv")


def test_diagonals_are_read_with_what_is_known_of_them(tmp_path):
    text = (
        f"{DIAGONAL_HEADER},uncertainty_um,same_approach\n"
        "pp0,0,0,0,400,300,0,500.005,0.3,yes\n"
        "np0,400,0,0,0,300,0,499.999,,\n"
    )
    one, other = read_diagonal_table(write(tmp_path, text))
    assert one.error == pytest.approx(5e-6, rel=1e-6)
    assert one.standard_uncertainty == pytest.approx(0.3e-6)
    assert one.same_approach is True
    assert other.error == pytest.approx(-1e-6, rel=1e-6)
    assert np.isnan(other.standard_uncertainty)
    assert other.same_approach is None
    assert other.start == pytest.approx((0.4, 0, 0))
    without = read_diagonal_table(
        write(tmp_path, f"{DIAGONAL_HEADER}\npp0,0,0,0,400,300,0,500.005\n")
    )
    assert without[0].same_approach is None


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("xy,0,0,0,400,300,0,500", a_fault("unknown", "xy", "ppp", row=2, about="diagonal")),
        ("pp0,0,0,0,400,300,0,0.5", a_fault("mismatch", "0.5", about="length_mm")),
        ("pp0,0,0,0,400,,0,500", a_fault("malformed", about="finish_y_mm")),
    ],
)
def test_a_wrong_diagonal_is_refused(tmp_path, row, message):
    with refused(TableError, message):
        read_diagonal_table(write(tmp_path, f"{DIAGONAL_HEADER}\n{row}\n"))
