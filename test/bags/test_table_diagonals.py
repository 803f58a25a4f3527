"""Run tables of ISO 230-6 diagonals: out of a simulation, into a bag, and back."""

import csv

import numpy as np
import pytest
from cells_for_tests import make_cell
from refused import refused

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.export import export_bag
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.bags.table import import_table, load_table
from stepdiag_ros.bags.table_rows import COLUMNS
from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.metrology.plan import (
    BACKWARD,
    DIAGONAL,
    FORWARD,
    LINE_NAMES,
    LINEAR,
    STEP_DIAGONAL,
    Line,
    Plan,
    Volume,
)
from stepdiag_ros.metrology.simulation import simulate

VOLUME = Volume((0.1, 0.0, 0.02), (0.01, 0.02, 0.03), 3)
CELL = make_cell(
    1, "XYZ", high=(0.2,) * 3, noise=1e-7, tilt=1e-5, squareness=(1e-5, 0.0, 0.0), held=0.0
)


def passes(kind, name, order="", offset=(0.0, 0.0, 0.0)):
    return [
        Line(kind, name, order, repeat, way, offset)
        for repeat in range(2)
        for way in (FORWARD, BACKWARD)
    ]


def written(folder, lines, volume=VOLUME):
    """Simulate lines and write them as a run table, all digits."""
    measured = simulate(Plan("plan", volume, tuple(lines), 0.1), CELL)
    folder.mkdir(exist_ok=True)
    with (folder / "run.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for measured_line in measured.lines:
            which = measured_line.line
            for stop in range(len(measured_line.time)):
                writer.writerow(
                    [
                        repr(float(measured_line.time[stop])),
                        *(which.kind, which.name, which.order, which.repeat, which.direction),
                        stop,
                        *map(repr, measured_line.target[stop].tolist()),
                        repr(float(measured_line.displacement[stop])),
                        *map(repr, measured_line.environment[stop].tolist()),
                    ]
                )
    return measured


LINES = [
    *passes(LINEAR, "x"),
    *passes(STEP_DIAGONAL, "ppp", "XYZ"),
    *(line for name in LINE_NAMES[DIAGONAL] for line in passes(DIAGONAL, name)),
    *passes(DIAGONAL, "pp0", offset=(0.0, 0.0, 0.045)),
    *passes(DIAGONAL, "0np", offset=(0.03, 0.0, 0.0)),
]


def test_diagonals_survive_the_way_through_a_bag_and_back(tmp_path):
    measured = written(tmp_path / "in", LINES)
    import_table(tmp_path / "in" / "run.csv", None, tmp_path / "a.mcap")
    run = load_run(tmp_path / "a.mcap")
    assert run.volume == VOLUME
    assert tuple(run.plan.lines) == tuple(LINES)
    imported = run.measurement.lines
    for line, truth in zip(imported, measured.lines, strict=True):
        assert line.line == truth.line
        assert line.setup == truth.setup
        assert np.array_equal(line.displacement, truth.displacement)
        assert np.array_equal(line.target, truth.target)
    assert export_bag(tmp_path / "a.mcap", tmp_path / "out").remarks == ()
    assert (tmp_path / "out" / "run.csv").read_text() == (tmp_path / "in" / "run.csv").read_text()


@pytest.mark.parametrize(
    "lines",
    [
        passes(DIAGONAL, "npp"),
        passes(DIAGONAL, "n0p") + passes(DIAGONAL, "pp0"),
        passes(LINEAR, "y") + passes(DIAGONAL, "p0p", offset=(0.0, 0.02, 0.0)),
    ],
    ids=["body", "two faces", "linear and face"],
)
def test_the_box_is_found_from_the_axes_that_move(lines, tmp_path):
    written(tmp_path, lines)
    table = load_table(tmp_path / "run.csv")
    found = table.measurement.volume
    assert found.blocks == 3
    assert found.origin == pytest.approx(VOLUME.origin)
    assert found.step == pytest.approx(VOLUME.step)
    plan = plan_from_text(table.plan_text, "plan")
    assert [line.setup for line in plan.lines] == [line.setup for line in lines]


def test_a_box_of_which_an_axis_never_moves_cannot_be_found(tmp_path):
    written(tmp_path, passes(DIAGONAL, "pp0"))
    with refused(TableError, "undetermined", "Z"):
        load_table(tmp_path / "run.csv")
