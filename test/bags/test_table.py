"""Run tables to bags and back."""

import csv
import json
import re
from datetime import date
from pathlib import Path

import numpy as np
import pytest
import yaml
from refused import a_fault, refused

from stepdiag_ros.bags.case import FACTS, facts_of
from stepdiag_ros.bags.errors import BagError, TableError
from stepdiag_ros.bags.export import export_bag
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.bags.table import import_table, load_table, read_table
from stepdiag_ros.bags.table_rows import COLUMNS, OPTIONAL_COLUMNS
from stepdiag_ros.cli import main
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.plan import BOX_KEYS, COURSE_KEYS, LINE_NAMES, Line, Volume
from stepdiag_ros.metrology.refusal import Refusal

DOCS = Path(__file__).parents[2] / "docs"
CASE_KEYS = (*BOX_KEYS, *COURSE_KEYS, *FACTS, "chain", "dead_path_m", "reading_noise_m")

CASES = sorted(
    path.parent for path in (Path(__file__).parent.parent / "data/cases").glob("*/run.csv")
)


def number_or_text(cell):
    try:
        return float(cell)
    except ValueError:
        return cell


def rows_of(path):
    with path.open(newline="") as file:
        return [[number_or_text(cell) for cell in row] for row in csv.reader(file)]


@pytest.mark.parametrize("case", CASES, ids=lambda path: path.name)
def test_a_table_survives_the_way_through_a_bag(case, tmp_path):
    bag, again = tmp_path / "a.mcap", tmp_path / "b.mcap"
    import_table(case / "run.csv", None, bag)
    report = export_bag(bag, tmp_path / "out")
    assert report.remarks == ()
    assert rows_of(tmp_path / "out" / "run.csv") == rows_of(case / "run.csv")
    told = yaml.safe_load((case / "case.yaml").read_text())
    kept = yaml.safe_load((tmp_path / "out" / "case.yaml").read_text())
    told["reading_noise_m"] = float(told["reading_noise_m"])  # YAML takes 1e-07 for a text
    assert kept == {key: told[key] for key in kept}
    assert {"chain", "step_m", "dead_path_m", "reading_noise_m", "mirror_on"} <= kept.keys()
    import_table(tmp_path / "out" / "run.csv", None, again)
    for first, second in zip(load_run(bag).lines, load_run(again).lines, strict=True):
        assert first.line == second.line
        assert np.array_equal(first.displacement, second.displacement)
        assert np.array_equal(first.standard_uncertainty, second.standard_uncertainty)


@pytest.mark.parametrize("case", CASES, ids=lambda path: path.name)
def test_the_bag_is_the_measurement_in_the_table(case, tmp_path):
    told = yaml.safe_load((case / "case.yaml").read_text())
    table = import_table(case / "run.csv", None, tmp_path / "a.mcap")
    run = load_run(tmp_path / "a.mcap")
    assert run.volume == Volume(tuple(told["origin_m"]), tuple(told["step_m"]), told["blocks"])
    assert run.chain == "".join(told["chain"])
    assert np.isnan(run.plan.feed)
    assert table.stops == len(rows_of(case / "run.csv")) - 1
    by_index = {line.line_index: line for line in run.lines}
    assert [by_index[index].line for index in range(len(run.plan.lines))] == list(run.plan.lines)
    for line in run.lines:
        assert np.abs(line.line.stops(run.volume) - line.target).max() < 1e-9
        assert set(line.standard_uncertainty) == {float(told["reading_noise_m"])}
    with BagReader(tmp_path / "a.mcap") as bag:
        files = {attachment.name: attachment.data for attachment in bag.attachments}
    assert files["source/run.csv"] == (case / "run.csv").read_bytes()
    assert files["source/case.yaml"] == (case / "case.yaml").read_bytes()


@pytest.mark.parametrize("case", CASES, ids=lambda path: path.name)
def test_the_box_is_found_without_a_case_file(case, tmp_path):
    (tmp_path / "run.csv").write_bytes((case / "run.csv").read_bytes())
    measurement = read_table(tmp_path / "run.csv")
    assert measurement.volume == read_table(case / "run.csv").volume
    assert np.isnan(measurement.lines[0].standard_uncertainty).all()


def test_values_are_where_they_belong(tmp_path):
    rows = [
        "time_s,kind,line,order,repeat,direction,stop,x_m,y_m,z_m,reading_m,"
        "air_temperature_degC,air_pressure_Pa,relative_humidity,material_temperature_degC",
        "1,linear,x,,0,backward,0,0.04,0.5,0,0.03,20.1,101000,0.4,19.5",
        "2,linear,x,,0,backward,1,0.01,0.5,0,0,20.2,,nan,19.6",
    ]
    (tmp_path / "run.csv").write_text("\n".join(rows))
    (tmp_path / "case.yaml").write_text(
        "chain: XZY\norigin_m: [0.01, 0.1, 0]\nstep_m: [0.03, 1, 1]\nblocks: 1\n"
    )
    table = load_table(tmp_path / "run.csv")
    (line,) = table.measurement.lines
    assert line.line == Line("linear", "x", "", 0, "backward", (0.0, 0.4, 0.0))
    assert line.setup == "x@0,0.4,0"
    assert line.time.tolist() == [1.0, 2.0]
    assert line.end_time == 2_000_000_000
    assert line.displacement.tolist() == [0.03, 0.0]
    assert line.target.tolist() == [[0.04, 0.5, 0.0], [0.01, 0.5, 0.0]]
    assert line.environment[0].tolist() == [20.1, 101000.0, 0.4, 19.5]
    assert np.isnan(line.environment[1, 1:3]).all()
    assert table.case.chain == "XZY"


@pytest.mark.parametrize("start", [b"", b"\xef\xbb\xbf"], ids=["plain", "byte order mark"])
@pytest.mark.parametrize("end", [b"\n", b"\r\n"], ids=["LF", "CRLF"])
def test_forms_of_text_files(tmp_path, start, end):
    text = (CASES[0] / "run.csv").read_bytes()
    (tmp_path / "run.csv").write_bytes(start + text.replace(b"\n", end) + end + end)
    expected = read_table(CASES[0] / "run.csv", CASES[0] / "case.yaml")
    found = read_table(tmp_path / "run.csv", CASES[0] / "case.yaml")
    assert len(found.lines) == len(expected.lines)
    assert np.array_equal(found.lines[-1].displacement, expected.lines[-1].displacement)


def test_columns_may_stand_in_another_order_with_others_between(tmp_path):
    rows = rows_of_text(CASES[0] / "run.csv")
    turned = [["note", *reversed(row)] for row in rows]
    (tmp_path / "run.csv").write_text("\n".join(",".join(row) for row in turned))
    found = read_table(tmp_path / "run.csv")
    expected = read_table(CASES[0] / "run.csv")
    assert np.array_equal(found.lines[5].displacement, expected.lines[5].displacement)


def rows_of_text(path):
    with path.open(newline="") as file:
        return list(csv.reader(file))


def test_the_same_line_measured_again_later_is_a_setup_of_its_own(tmp_path):
    rows = rows_of_text(CASES[0] / "run.csv")
    first = [row for row in rows[1:] if row[2] == "x" and row[4] == "0"]
    again = [[str(float(row[0]) + 1e6), *row[1:]] for row in first]
    (tmp_path / "run.csv").write_text("\n".join(",".join(row) for row in rows + again))
    table = import_table(tmp_path / "run.csv", CASES[0] / "case.yaml", tmp_path / "a.mcap")
    lines = load_run(tmp_path / "a.mcap").measurement.lines
    assert [line.setup for line in lines[-2:]] == ["x #2", "x #2"]
    assert lines[0].setup == "x"
    assert table.setups == load_table(CASES[0] / "run.csv").setups + 1
    assert len(lines) == len(read_table(CASES[0] / "run.csv").lines) + 2


def test_a_line_that_begins_again_at_another_place_is_another_pass(tmp_path):
    rows = rows_of_text(CASES[0] / "run.csv")
    first = [row for row in rows[1:] if row[2] == "x" and row[4] == "0" and row[5] == "forward"]
    y = rows[0].index("y_m")
    aside = [[str(float(row[0]) - 1e6), *row[1:y], "0.05", *row[y + 1 :]] for row in first]
    (tmp_path / "run.csv").write_text(
        "\n".join(",".join(row) for row in rows[:1] + aside + rows[1:])
    )
    lines = load_table(tmp_path / "run.csv", CASES[0] / "case.yaml").measurement.lines
    assert [line.setup for line in lines[:2]] == ["x@0,0.05,0", "x"]
    assert lines[0].line.offset == (0.0, 0.05, 0.0)
    assert len(lines) == len(read_table(CASES[0] / "run.csv").lines) + 1


def test_importing_neither_overwrites_nor_leaves_halves(tmp_path):
    target = tmp_path / "a.mcap"
    target.write_bytes(b"precious")
    with refused(BagError, "exists", "a.mcap"):
        import_table(CASES[0] / "run.csv", None, target)
    assert target.read_bytes() == b"precious"
    (tmp_path / "run.csv").write_text(",".join(COLUMNS) + "\n")
    with pytest.raises(TableError):
        import_table(tmp_path / "run.csv", None, tmp_path / "b.mcap")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "run.csv"]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("units: mm\n", a_fault("unsupported", "units", "mm", "SI")),
        ("chain: [Y, X]\nstep_m: [1, 1, 1]\nblocks: 1\n", a_fault("malformed", "case.yaml")),
        ("chain: ABC\n", a_fault("unknown", "XYZ", about="chain")),
        ("step_m: [0.01, 0.01]\nblocks: 12\n", a_fault("malformed", about="step_m")),
        ("step_m: [0.01, 0.01, 0.01]\n", a_fault("missing", about="blocks")),
        ("reading_noise_m: small\n", a_fault("malformed", "small", about="reading_noise_m")),
        ("[", a_fault("malformed", "case.yaml", aspect="YAML")),
    ],
)
def test_a_wrong_case_file_is_refused_by_its_key(tmp_path, text, reason):
    (tmp_path / "run.csv").write_bytes((CASES[0] / "run.csv").read_bytes())
    (tmp_path / "case.yaml").write_text(text)
    with refused(TableError, reason):
        read_table(tmp_path / "run.csv")


def test_the_help_of_the_command_names_every_kind_line_and_column(capsys):
    with pytest.raises(SystemExit):
        main(["import", "--help"])
    words = set(re.findall(r"\w+", capsys.readouterr().out))
    names = {name for known in LINE_NAMES.values() for name in known}
    assert {*LINE_NAMES, *names, *COLUMNS, *OPTIONAL_COLUMNS} <= words


def test_the_documents_explain_every_column_and_key():
    words = set(re.findall(r"\w+", (DOCS / "import.md").read_text()))
    assert {*COLUMNS, *OPTIONAL_COLUMNS, *CASE_KEYS} <= words


def test_a_misspelt_column_is_refused_and_a_column_of_remarks_is_not(tmp_path):
    rows = rows_of_text(CASES[0] / "run.csv")
    for name, known in (("overun_m", "overrun_m"), ("Setup", "setup")):
        (tmp_path / "run.csv").write_text("\n".join(",".join([*row, name]) for row in rows))
        with refused(TableError, "unknown", name, known, row=1):
            read_table(tmp_path / "run.csv")


@pytest.mark.parametrize(
    ("column", "values", "reason"),
    [
        ("setup", ["a"] * 3 + ["b"] * 10, a_fault("mismatch", "setup")),
        ("setup", [""], a_fault("missing", about="setup")),
        ("overrun_m", ["-0.001"], a_fault("out_of_range", "0", about="overrun_m")),
        ("attempt", ["0"], a_fault("out_of_range", "1", about="attempt")),
        ("line_index", ["0"], a_fault("undetermined", "case.yaml")),
        ("settled", ["false"], a_fault("mismatch", about="reading_m")),
        ("settled", ["no"], a_fault("unknown", about="settled")),
    ],
)
def test_a_wrong_cell_of_an_optional_column_is_refused(tmp_path, column, values, reason):
    rows = rows_of_text(CASES[0] / "run.csv")
    values = values + [values[-1]] * (len(rows) - 1 - len(values))
    made = [[*row, value] for row, value in zip(rows, [column, *values], strict=True)]
    (tmp_path / "run.csv").write_text("\n".join(",".join(row) for row in made))
    with refused(TableError, reason):
        read_table(tmp_path / "run.csv")


def test_an_overrun_is_told_once(tmp_path):
    rows = rows_of_text(CASES[0] / "run.csv")
    values = ["overrun_m"] + ["0.002"] * (len(rows) - 1)
    text = "\n".join(",".join([*row, value]) for row, value in zip(rows, values, strict=True))
    (tmp_path / "run.csv").write_text(text)
    assert {line.overrun for line in read_table(tmp_path / "run.csv").lines} == {0.002}
    with refused(TableError, "too_many", "--overrun"):
        load_table(tmp_path / "run.csv", overrun=0.001)


def test_the_facts_of_a_case_file_are_in_the_document_and_in_the_bag(tmp_path, capsys):
    (tmp_path / "run.csv").write_bytes((CASES[0] / "run.csv").read_bytes())
    facts = {"machine": "Portal 4", "test_date": "2026-11-28", "operator": "A. Beispiel"}
    stated = {**facts, "test_date": date(2026, 11, 28)}
    case = {**yaml.safe_load((CASES[0] / "case.yaml").read_text()), "facts": stated}
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(case))
    assert main(["import", str(tmp_path / "run.csv"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["facts"] == facts
    run = load_run(tmp_path / "run.mcap")
    assert dict(run.told_by_source) == facts
    assert run.machine["name"] == "Portal 4"


def test_a_misspelt_fact_is_refused_with_its_name():
    with refused(Refusal, "unknown", "operater"):
        facts_of(Section({"facts": {"operater": "A. Beispiel"}}, "case.yaml"))
    with refused(Refusal, "malformed", "test_date"):
        facts_of(Section({"facts": {"test_date": 20261128}}, "case.yaml"))
    assert facts_of(Section({}, "case.yaml")) == {}


def test_what_says_nothing_of_a_run_table_is_refused(tmp_path, capsys):
    (tmp_path / "run.csv").write_bytes((CASES[0] / "run.csv").read_bytes())
    text = (["--encoding", "utf-8"], ["--decimal", ","])
    for option in (["--axis", "X"], ["--box", *"000111"], ["--plan", "demo"], *text):
        assert main(["import", str(tmp_path / "run.csv"), *option]) == 1
        assert f"Leave out {option[0]}" in capsys.readouterr().err
    assert not (tmp_path / "run.mcap").exists()
