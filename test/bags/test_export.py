"""A bag as tables."""

import csv
import importlib.util
import io
import re
import unicodedata
from dataclasses import replace
from math import isnan

import numpy as np
import pytest
from bags_for_tests import RUN_ID, START, put
from hypothesis import given
from hypothesis import strategies as st
from make_schema_bag import diagnosis
from refused import refused
from test_run import description, header, line, write_run

from stepdiag_ros import open_run, topics
from stepdiag_ros.bags.csv_cells import csv_text, guarded, unguarded
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.export import export_bag
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.diagnosis import from_diagnosis
from stepdiag_ros.messages.volumetric import from_volumetric_errors
from stepdiag_ros.metrology.geometry import TRANSLATIONS
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors

NEW = own_types().new


def table(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def result(method, scale):
    nodes = np.linspace(0.0, 0.02, 3)
    return VolumetricErrors(
        method=method,
        nodes=(nodes, 2 * nodes, 3 * nodes),
        curves={name: scale * np.array([0.0, 1 / 3, np.nan]) for name in TRANSLATIONS},
        standard_uncertainty={name: np.full(3, scale / 7) for name in TRANSLATIONS},
        figures=(Figure("C0Y", scale / 9, scale / 11, "rad"),),
        lines=1,
        chi_squared=1.0,
        degrees_of_freedom=1,
    )


@pytest.fixture
def bag(tmp_path):
    path = tmp_path / "a.mcap"
    broken = line(1, 1, start=50.0)
    broken.displacement[1] = np.nan
    with BagWriter(path, header()) as writer:
        put(writer, topics.RUN_DESCRIPTION, description(), START)
        for measured in (line(0, 1), line(0, 2), broken):
            message = conversion.from_measured_line(measured, RUN_ID, NEW)
            put(writer, topics.LINE, message, START)
        for method, scale in (
            ("least_squares", 1e-6),
            ("conventional", 5e-6),
            ("least_squares", 2e-6),
        ):
            message = from_volumetric_errors(result(method, scale), RUN_ID, START, NEW)
            put(writer, topics.VOLUMETRIC_ERRORS, message, START)
    return path


def test_diagnoses_are_all_there_and_the_findings_of_the_last(bag, tmp_path):
    nothing = replace(diagnosis(), verdict="CONSISTENT", findings=(), run_over=False)
    with BagWriter(tmp_path / "b.mcap", header()) as writer:
        put(writer, topics.RUN_DESCRIPTION, description(), START)
        for one in (nothing, diagnosis()):
            put(writer, topics.DIAGNOSIS, from_diagnosis(one, RUN_ID, NEW), START)
    export_bag(tmp_path / "b.mcap", tmp_path / "out")
    rows = table(tmp_path / "out" / "diagnoses.csv")
    assert [row["verdict"] for row in rows] == ["CONSISTENT", "AMBIGUOUS"]
    assert [row["run_over"] for row in rows] == ["false", "true"]
    assert float(rows[1]["chi_squared_before"]) == diagnosis().before.chi_squared
    assert float(rows[1]["rms_m_after"]) == diagnosis().after.rms
    assert rows[1]["p_value_after"] == ""
    (found,) = table(tmp_path / "out" / "findings.csv")
    assert (found["label"], found["closes"]) == ("backlash of X", "all")
    assert float(found["value"]) == 8e-7
    assert (float(found["band_95_low"]), float(found["band_95_high"])) == (7.8e-7, 8.2e-7)
    assert found["ambiguous_with"] == "backlash of Y"
    export_bag(bag, tmp_path / "without")
    assert not (tmp_path / "without" / "diagnoses.csv").exists()


FORMULAS = (
    *('=cmd|"/c calc"!A1', "+1", "-1+1", "@SUM(1)", "\t=1", "\r=1", "\n=1", " =1", "'=1", "''-x"),
    *("＝1", "\u200b=1", "\ufeff@x", "﹢1"),
)


@pytest.mark.parametrize("text", FORMULAS, ids=ascii)
def test_no_text_of_a_bag_is_a_formula_in_a_spreadsheet(tmp_path, text):
    gap = replace(diagnosis().before, rms=-1e-6)
    model = replace(diagnosis().model, name=text)
    told = replace(diagnosis(), sentence=text, verdict=text, model=model, before=gap)
    with BagWriter(tmp_path / "b.mcap", header()) as writer:
        put(writer, topics.RUN_DESCRIPTION, description(), START)
        put(writer, topics.DIAGNOSIS, from_diagnosis(told, RUN_ID, NEW), START)
    export_bag(tmp_path / "b.mcap", tmp_path / "out")
    (row,) = table(tmp_path / "out" / "diagnoses.csv")
    for name in ("sentence", "verdict", "model"):
        assert row[name] == f"'{text}" and unguarded(row[name]) == text
    assert row["rms_m_before"] == "-1e-06", "a number stays a number"


@given(
    st.text(st.one_of(st.sampled_from("=+-@'\t\r\n ＝a"), st.characters(exclude_characters="\0")))
)
def test_every_text_comes_back_from_its_cell(text):
    cell = guarded(text)
    assert unguarded(cell) == text and cell in (text, f"'{text}")
    assert unicodedata.normalize("NFKC", cell.strip())[:1] not in tuple("=+-@")
    if re.match(r"\w", text):
        assert cell == text
    read = list(csv.reader(io.StringIO(csv_text([[cell, "next"]]), newline="")))
    assert read == [[cell, "next"]], "one row, whatever line breaks it has"


def test_the_last_attempt_at_each_line_makes_the_run_table(bag, tmp_path):
    report = export_bag(bag, tmp_path / "out")
    rows = table(tmp_path / "out" / "run.csv")
    assert [float(row["reading_m"]) for row in rows[:3]] == line(0, 2).displacement.tolist()
    assert [row["air_temperature_degC"] for row in rows] == [""] * 6
    assert [row["attempt"] for row in rows] == list("222111")
    assert [row["settled"] for row in rows] == ["true"] * 4 + ["false", "true"]
    assert rows[4]["reading_m"] == ""
    assert len(report.remarks) == 2
    assert "settled: false" in report.remarks[0]
    # The second line stands at a place where the plan has another pass.
    assert "cannot be imported again" in report.remarks[1]
    every = table(tmp_path / "out" / "lines.csv")
    assert [row["attempt"] for row in every] == list("111222111")
    assert [row["displacement_m"] for row in every][7] == ""


def test_results_are_the_last_of_each_solver_with_all_digits(bag, tmp_path):
    export_bag(bag, tmp_path / "out")
    rows = table(tmp_path / "out" / "results.csv")
    assert len(rows) == 2 * 9 * 3
    (row,) = (
        row
        for row in rows
        if (row["method"], row["curve"], row["node"]) == ("least_squares", "E_ZY", "1")
    )
    assert float(row["position_m"]) == 0.02
    assert float(row["error"]) == 2e-6 * (1 / 3)
    assert float(row["standard_uncertainty"]) == 2e-6 / 7
    assert {row["error"] for row in rows if row["node"] == "2"} == {""}
    figures = table(tmp_path / "out" / "figures.csv")
    assert [(row["method"], float(row["value"])) for row in figures] == [
        ("least_squares", 2e-6 / 9),
        ("conventional", 5e-6 / 9),
    ]


def same_cells(cells, values):
    for cell, value in zip(cells, values, strict=True):
        assert (cell == "") if isnan(value) else (float(cell) == value)


def test_stops_blocks_and_readings(tmp_path):
    report = export_bag(write_run(tmp_path / "a.mcap"), tmp_path / "out", readings=True)
    names = ["run.csv", "lines.csv", "stops.csv", "blocks.csv", "readings.csv", "case.yaml"]
    assert [path.name for path in report.files] == names
    stops = table(tmp_path / "out" / "stops.csv")
    assert [float(row["displacement_m"]) for row in stops] == [0.0, 0.01, 0.02]
    assert stops[1]["settled"] == "true"
    assert int(stops[2]["time_ns"]) == START + 2
    (block,) = table(tmp_path / "out" / "blocks.csv")
    assert float(block["displacement_m"]) == 0.0100001
    readings = table(tmp_path / "out" / "readings.csv")
    assert [int(row["sequence"]) for row in readings] == [0, 1, 2]
    assert float(readings[1]["compensated_displacement_m"]) == 2 * float(
        readings[1]["raw_displacement_m"]
    )
    recorded = list(open_run(tmp_path / "a.mcap").readings())
    assert len(recorded) == len(readings)
    for row, reading in zip(readings, recorded, strict=True):
        assert None not in row, "a row has more cells than the table has columns"
        weather = (row["air_temperature_degC"], row["air_pressure_Pa"], row["relative_humidity"])
        same_cells(weather, reading.environment[:3])
        same_cells([row["material_temperature_degC"]], reading.environment[3:])
        assert int(row["trigger"]) == reading.trigger


def test_existing_files_are_kept_unless_allowed(bag, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "results.csv").write_text("precious")
    with refused(BagError, "exists", "results.csv"):
        export_bag(bag, out)
    assert [path.name for path in out.iterdir()] == ["results.csv"]
    export_bag(bag, out, overwrite=True)
    assert (out / "results.csv").read_text() != "precious"


def test_a_bag_without_lines_says_so(tmp_path):
    path = tmp_path / "a.mcap"
    with BagWriter(path, header()) as writer:
        put(writer, topics.RUN_DESCRIPTION, description(), START)
    report = export_bag(path, tmp_path / "out")
    assert report.files == ()
    assert report.remarks == ("The bag holds no finished line, so there is no run table.",)


def test_an_unknown_format_is_refused(bag, tmp_path):
    with refused(Refusal, "unknown", "xlsx"):
        export_bag(bag, tmp_path / "out", "xlsx")


def test_parquet_without_pyarrow_is_refused_with_advice(bag, tmp_path, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "pyarrow" else find(name)
    )
    with refused(BagError, "not_installed", "pyarrow"):
        export_bag(bag, tmp_path / "out", "parquet")


def test_parquet_holds_the_same_numbers(bag, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    export_bag(bag, tmp_path / "out", "parquet")
    found = parquet.read_table(tmp_path / "out" / "lines.parquet").to_pydict()
    assert found["displacement_m"][3:6] == line(0, 2).displacement.tolist()
    assert found["displacement_m"][7] is None
