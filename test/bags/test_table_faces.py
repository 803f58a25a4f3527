"""Run tables of step diagonals of a face: of machines with two axes, with and without a case."""

import csv

import numpy as np
import pytest
from cells_for_tests import make_cell
from refused import a_fault, refused

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.export import export_bag
from stepdiag_ros.bags.table import import_table, load_table
from stepdiag_ros.bags.table_rows import COLUMNS
from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve

CELL = make_cell(
    1, "XYZ", high=(0.2,) * 3, noise=1e-8, tilt=1e-5, squareness=(1e-5, 0.0, 0.0), held=0.0
)


def plan(names=("pp0", "np0"), linear=("x", "y"), orders=("XY", "YX")):
    return Plan.from_mapping(
        {
            "origin_m": [0.05, 0.0, 0.02],
            "step_m": [0.01, 0.02, 0.01],
            "blocks": 4,
            "repeats": 2,
            "directions": ["forward", "backward"],
            "feed_m_per_s": 0.05,
            "lines": [
                {"kind": "linear", "names": list(linear)},
                {"kind": "step_diagonal", "names": list(names), "orders": list(orders)},
            ],
        },
        "plan",
    )


@pytest.fixture
def table(tmp_path):
    rows = []
    for line in simulate(plan(), CELL, 1).lines:
        one = line.line
        for stop, (time, place, reading) in enumerate(
            zip(line.time, line.target, line.displacement, strict=True)
        ):
            rows.append(
                [repr(float(time)), one.kind, one.name, one.order, one.repeat, one.direction, stop]
                + [f"{value:.6f}" for value in place]
                + [repr(float(reading)), "", "", "", ""]
            )
    path = tmp_path / "run.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(rows)
    return path


def test_the_third_side_of_the_box_is_where_its_axis_stood(table):
    found = load_table(table).measurement
    assert found.volume.blocks == 4
    assert found.volume.origin == pytest.approx((0.05, 0.0, 0.02))
    assert found.volume.step[:2] == pytest.approx((0.01, 0.02))
    result = solve(found)
    truth = CELL.truth(plan().volume)
    for name in ("E_XX", "E_YX", "E_XY", "E_YY"):
        np.testing.assert_allclose(result.curves[name], truth[name], atol=5e-8)
    assert np.all(np.isnan(result.curves["E_ZZ"][1:]))
    assert np.isnan(result.figure("A0Z").value)


def test_a_bag_of_it_gives_the_same_lines_and_plan_back(table, tmp_path):
    bag = tmp_path / "face.mcap"
    imported = import_table(table, None, bag)
    again = plan_from_text(imported.plan_text, "plan")
    wanted = [(line.name, line.order, line.repeat, line.direction) for line in plan().lines]
    found = [(line.name, line.order, line.repeat, line.direction) for line in again.lines]
    assert sorted(found) == sorted(wanted)
    folder = tmp_path / "out"
    export_bag(bag, folder)
    back = load_table(folder / "run.csv").measurement
    for one, other in zip(imported.measurement.lines, back.lines, strict=True):
        assert one.line == other.line
        np.testing.assert_array_equal(one.displacement, other.displacement)


@pytest.mark.parametrize(
    ("old", "new", "wrong"),
    [
        ("step_diagonal,pp0,XY", "step_diagonal,pp0,XYZ", a_fault("unknown", about="order")),
        ("step_diagonal,pp0,XY", "step_diagonal,pp0,XZ", a_fault("unknown", about="order")),
        ("step_diagonal,pp0,XY", "step_diagonal,pp0,", a_fault("unknown", about="order")),
        ("step_diagonal,pp0,XY", "step_diagonal,p0p,XZ", a_fault("undetermined", "Z")),
        ("step_diagonal,pp0,XY", "step_diagonal,np0,XY", a_fault("mismatch", "np0", "pp0", row=42)),
        ("step_diagonal,pp0,XY", "step_diagonal,pp0,YX", a_fault("mismatch", "YX", "XY", row=42)),
    ],
)
def test_a_wrong_name_or_order_is_refused_with_its_row(table, old, new, wrong):
    text = table.read_text()
    assert old in text
    table.write_text(text.replace(old + ",0,forward", new + ",0,forward"))
    with refused(TableError, wrong, "run.csv"):
        load_table(table)


def test_linear_lines_of_two_axes_alone_still_do_not_tell_the_box(table):
    rows = table.read_text().splitlines()
    table.write_text("\n".join(row for row in rows if "step_diagonal" not in row) + "\n")
    with refused(TableError, "undetermined", "Z"):
        load_table(table)
