"""The rows of a bag are what the commands say of it."""

import json
from pathlib import Path

import pytest
from archive_runs import write_bag
from small_run import RUN_ID

from stepdiag_ros.archive.rows import rows_of_bag
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.evaluation.recorded_run import report_of_run
from stepdiag_ros.report.documents.run import report_json

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "small_run.mcap"
"""A run of a machine with backlash of X, 0.8 µm."""


@pytest.fixture(scope="module")
def rows():
    return rows_of_bag(EXAMPLE, "0" * 64, "1-0")


@pytest.fixture(scope="module")
def document():
    """Return what ``stepdiag solve --json`` prints."""
    return json.loads(report_json(report_of_run(load_run(EXAMPLE), with_verdict=True)))


def test_each_figure_and_curve_is_that_of_the_report(rows, document):
    expected = {
        (method, name): (one["value"], one["standard_uncertainty"], one["unit"])
        for method, told in document["methods"].items()
        for name, one in told["figures"].items()
    }
    found = {
        (one.method, one.name): (one.value, one.standard_uncertainty, one.unit)
        for one in rows.figures
        if one.kind == "result"
    }
    assert found == expected
    for one in rows.curves:
        told = document["methods"][one.method]
        assert one.value == told["curves"][one.name]
        assert one.standard_uncertainty == told["standard_uncertainty"][one.name]
        assert one.position_m == told["nodes"][one.name[-1]]
    assert len(rows.curves) == sum(len(one["curves"]) for one in document["methods"].values())


def test_the_run_has_the_lead_of_the_report(rows, document):
    (run,), lead = rows.runs, document["lead"]
    assert run.largest_m == lead["largest_in_volume"]
    assert run.largest_expanded_uncertainty_m == lead["expanded_uncertainty"]
    assert (run.verdict, run.verdict_sentence) == (
        lead["verdict"]["name"],
        lead["verdict"]["sentence"],
    )
    assert list(run.effects) == lead["verdict"]["effects"]
    single = {one.name: (one.value, one.expanded_uncertainty) for one in rows.figures if
              one.kind == "single"}  # fmt: skip
    assert single == {
        one["name"]: (one["value"], one["expanded_uncertainty"]) for one in lead["single_errors"]
    }
    assert (run.machine, run.instrument, run.chain) == ("demo machine", "simulated", "YXZ")
    assert run.weather_station == "simulated"
    assert 20.0 < run.air_temperature_degC < 21.0 and 1.0e5 < run.air_pressure_Pa < 1.02e5
    assert (run.figure_count, run.curve_count) == (len(rows.figures), len(rows.curves))


def test_the_effect_has_its_size_with_a_band(rows):
    (size,) = [one for one in rows.figures if one.kind == "effect"]
    assert size.name == "backlash of X: lost_motion" and size.unit == "m"
    assert size.value == pytest.approx(0.8e-6, abs=3.0 * size.standard_uncertainty)
    assert size.low < size.value < size.high
    assert size.expanded_uncertainty == pytest.approx(0.5 * (size.high - size.low))
    tests = {one.name for one in rows.figures if one.kind == "ISO 230-2"}
    assert {"A X", "B Z", "mean B Y"} <= tests


def test_a_run_of_newer_messages_is_named_and_the_others_go_on(tmp_path):
    described = {"run_id": "newer", "schema_version": 99}, {"run_id": "unfinished"}
    bag = write_bag(tmp_path / "two.mcap", described=described)
    newer, unfinished = rows_of_bag(bag, "0" * 64, "1-0").runs
    assert (newer.run_id, newer.run_number) == ("newer", 1)
    assert "99" in newer.problem and "two.mcap" in newer.problem
    assert str(tmp_path) not in newer.problem + unfinished.problem
    assert (unfinished.run_id, unfinished.run_number) == ("unfinished", 2)
    assert unfinished.machine and unfinished.plan and unfinished.start_time


def test_what_holds_no_run_has_one_row(tmp_path):
    (row,) = rows_of_bag(write_bag(tmp_path / "none.mcap", described=()), "0" * 64, "1-0").runs
    assert row.problem and row.run_id is None


def test_names_do_not_depend_on_where_the_bag_is(tmp_path):
    rows = [
        rows_of_bag(write_bag(tmp_path / folder / "a.mcap", streams=True), "0" * 64, "1-0")
        for folder in ("here", "there")
        if (tmp_path / folder).mkdir() is None
    ]
    assert rows[0] == rows[1] and rows[0].runs[0].run_id == RUN_ID
