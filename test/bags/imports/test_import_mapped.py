"""Tables of any layout, by mapping files: the shipped ones, and what is refused."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from import_files import DATA, RTL, changed
from refused import a_fault, refused

from stepdiag_ros.bags.axis_table import read_axis_table
from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.imports.imported import ImportOptions
from stepdiag_ros.bags.imports.made import NO_CHAIN, farthest_reading, unequal_runs
from stepdiag_ros.bags.imports.mapping import mapping_of
from stepdiag_ros.bags.imports.registry import import_file, import_files, read_file
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.cli import main
from stepdiag_ros.configuration import available, find, read_text
from stepdiag_ros.evaluation.solving import solve_reproducibly
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD
from stepdiag_ros.metrology.standards.axis_test import all_runs
from stepdiag_ros.resources import directory

COLUMNS = DATA / "made_up_runs_in_columns.csv"
ROWS = DATA / "made_up_rows.csv"
DIAGONALS = DATA / "made_up_step_diagonal.txt"
STREAM = DATA / "made_up_stream.csv"
HOUSE = Path("axis.csv")
"""Written by the test."""


def by(name, **options):
    return ImportOptions(mapping=name, **options)


def written(tmp_path, name, change):
    """Write a changed copy of a shipped mapping file and return its path."""
    parsed = yaml.safe_load(read_text(find(name, "imports")))
    change(parsed)
    path = tmp_path / f"{name}_changed.yaml"
    path.write_text(yaml.safe_dump(parsed, allow_unicode=True), encoding="utf-8")
    return str(path)


def test_every_shipped_mapping_file_is_whole():
    names = available("imports")
    assert len(names) == 4
    for name in names:
        path = directory("config") / "imports" / f"{name}.yaml"
        text = path.read_text(encoding="utf-8")
        assert mapping_of(yaml.safe_load(text), name, text).text == text


def test_runs_in_columns_with_decimal_commas():
    _, made = read_file(COLUMNS, by("runs_in_columns"))
    assert [line.line.direction for line in made.lines] == [FORWARD, BACKWARD] * 2
    table = COLUMNS.read_text(encoding="cp1252").splitlines()[4:10]
    cells = [[float(cell.replace(",", ".")) for cell in row.split(";")] for row in table]
    for place, line in enumerate(made.lines):
        rows = cells if place % 2 == 0 else cells[::-1]
        assert line.target[:, 0] == pytest.approx([1e-3 * row[0] for row in rows], abs=1e-15)
        found = line.displacement - line.target[:, 0]
        assert found == pytest.approx([1e-6 * row[place + 1] for row in rows], abs=1e-15)
    assert made.facts == {"machine": "Example machine"}
    assert np.all(np.isnan(made.lines[0].environment))


def test_rows_of_positions_in_inches_with_the_other_sign(tmp_path):
    import_file(ROWS, tmp_path / "y.mcap", by("rows_of_positions", axis="Y"))
    (runs,) = all_runs(load_run(tmp_path / "y.mcap").measurement)
    assert (runs.name, runs.forward.shape, runs.backward.shape) == ("Y", (2, 5), (2, 5))
    with ROWS.open(newline="") as file:
        for row in csv.DictReader(file):
            target = float(row["Position/inch"])
            place = int(np.argmin(np.abs(runs.target - 25.4e-3 * target)))
            ways = runs.forward if row["Dir"] == "+" else runs.backward
            expected = 25.4e-3 * (-float(row["Laser/inch"]) - target)

            assert ways[int(row["Run"]) - 1, place] == pytest.approx(expected, abs=1e-14)


def test_step_diagonals_become_lines_that_can_be_solved(tmp_path):
    import_file(DIAGONALS, tmp_path / "d.mcap", by("step_diagonal_stops"))
    run = load_run(tmp_path / "d.mcap")
    assert len(run.lines) == 16 and run.measurement.chain == "YXZ"
    assert {(line.line.kind, line.line.order) for line in run.lines} == {("step_diagonal", "XYZ")}
    results, _ = solve_reproducibly(run.measurement)
    # A scale of 8 µm/m on every reading is the example's only error.
    slope = results["conventional"].curves["E_XX"][-1] / 0.4
    assert slope == pytest.approx(8e-6, abs=1e-6)


def test_stops_are_counted_where_no_column_does(tmp_path):
    name = written(tmp_path, "step_diagonal_stops", lambda made: made["columns"].pop("stop"))
    counted, told = (
        read_file(DIAGONALS, by(mapping))[1] for mapping in (name, "step_diagonal_stops")
    )
    for one, other in zip(counted.lines, told.lines, strict=True):
        assert one.line == other.line
        assert one.displacement.tolist() == other.displacement.tolist()


def with_column(tmp_path, meaning, value, unit=None):
    """Return a step diagonal's table with one more column, and its mapping."""
    rows = DIAGONALS.read_text().splitlines()
    head = next(place for place, row in enumerate(rows) if row.startswith("Diagonal"))
    end = rows.index("END")
    rows[head] += " Further"
    rows[head + 1 : end] = [f"{row} {value}" for row in rows[head + 1 : end]]
    table = tmp_path / "further.txt"
    table.write_text("\n".join(rows))

    def change(made):
        made["columns"][meaning] = "Further"
        made["units"] |= {meaning: unit} if unit else {}

    return table, by(written(tmp_path, "step_diagonal_stops", change))


@pytest.mark.parametrize(
    ("pressure", "unit", "pascal"),
    [(101250, None, 101250.0), (1012.5, "hPa", 101250.0), (760, "mmHg", 101325.0)],
)
def test_the_pressure_of_a_column_has_its_unit(tmp_path, pressure, unit, pascal):
    _, made = read_file(*with_column(tmp_path, "air_pressure_Pa", pressure, unit))
    for line in made.lines:
        assert line.environment[:, 1] == pytest.approx(pascal, rel=1e-6)


def test_a_pressure_that_no_air_has_is_refused_with_the_key_of_its_unit(tmp_path):
    with refused(TableError, "out_of_range", "Further", "1012.5", "air_pressure_Pa", "hPa"):
        read_file(*with_column(tmp_path, "air_pressure_Pa", 1012.5))


def test_a_column_states_the_overrun_of_step_diagonals_too(tmp_path):
    _, made = read_file(*with_column(tmp_path, "overrun", 2, "mm"))
    assert {line.overrun for line in made.lines} == {0.002}
    with refused(TableError, "out_of_range", "overrun", "2 m"):
        read_file(*with_column(tmp_path, "overrun", 2, "m"))


def test_an_uncertainty_that_no_reading_has_is_refused(tmp_path):
    _, made = read_file(*with_column(tmp_path, "uncertainty", 0.2, "um"))
    assert {float(u) for line in made.lines for u in line.standard_uncertainty} == {2e-7}
    with refused(TableError, "out_of_range", "0.2 m", about="uncertainty"):
        read_file(*with_column(tmp_path, "uncertainty", 0.2, "m"))


def test_a_unit_without_a_column_is_refused(tmp_path):
    name = written(tmp_path, "step_diagonal_stops", lambda made: made["columns"].pop("reading"))
    with refused(ValueError, "missing", "reading", about="reading"):
        read_file(DIAGONALS, by(name))


def test_stops_of_a_step_diagonal_without_order_are_refused_with_that_key(tmp_path):
    name = written(tmp_path, "step_diagonal_stops", lambda made: made.pop("order"))
    with refused(TableError, "out_of_range", "order: XYZ"):
        read_file(DIAGONALS, by(name))


def test_a_bag_is_not_imported_again(tmp_path):
    import_file(DIAGONALS, tmp_path / "d.mcap", by("step_diagonal_stops"))
    with refused(TableError, "wrong_kind", "d.mcap", aspect="layout"):
        import_file(tmp_path / "d.mcap", tmp_path / "again.mcap", by("step_diagonal_stops"))


def test_a_stream_of_readings_goes_in_with_its_plan(tmp_path):
    plan = read_text(find("quick", "plans"))
    import_file(STREAM, tmp_path / "s.mcap", by("readings_in_time", plan=plan))
    run = load_run(tmp_path / "s.mcap")
    readings = list(run.readings())
    rows = [line.split("\t") for line in STREAM.read_text().splitlines()[1:]]
    assert len(readings) == len(rows) == 400
    for number, (reading, (time, value)) in enumerate(zip(readings, rows, strict=True)):
        assert reading.sequence == number
        assert reading.time == round(float(time) * 1e6)
        assert reading.compensated_displacement == pytest.approx(1e-3 * float(value), abs=1e-18)
        assert np.isnan(reading.raw_displacement) and np.isnan(reading.signal_strength)
    assert run.plan_text == plan
    with refused(TableError, "missing", "--plan"):
        read_file(STREAM, by("readings_in_time"))


def test_the_house_s_table_of_an_axis_gives_the_same_test(tmp_path):
    path = tmp_path / "axis.csv"
    rows = ["cycle,direction,target_mm,position_mm"]
    for cycle in range(2):
        for way, targets in (("forward", (0, 10, 25)), ("backward", (25, 10, 0))):
            rows += [f"{cycle},{way},{t},{t + 0.001 * cycle + 0.0001 * t}" for t in targets]
    path.write_text("\n".join(rows) + "\n")
    import_file(path, tmp_path / "z.mcap", ImportOptions(axis="Z"))
    (runs,) = all_runs(load_run(tmp_path / "z.mcap").measurement)
    direct = read_axis_table(path, "Z")
    assert runs.name == direct.name == "Z"
    for name in ("target", "forward", "backward"):
        ours, theirs = getattr(runs, name), getattr(direct, name)
        assert ours == pytest.approx(theirs, abs=1e-15), name


@pytest.mark.parametrize(
    ("path", "name", "old", "new", "said"),
    [
        (
            COLUMNS,
            "runs_in_columns",
            "40,00",
            "40.00",
            a_fault("malformed", "Target (mm)", "40.00", row=6),
        ),
        (COLUMNS, "runs_in_columns", "40,00", "0,00", a_fault("twice", "0", row=6)),
        (COLUMNS, "runs_in_columns", "Run 2 rev", "Run 3", a_fault("not_found", "2", row=4)),
        (COLUMNS, "runs_in_columns", "Run 1 rev", "Run 1 fwd", a_fault("ambiguous", "2", row=4)),
        (
            COLUMNS,
            "runs_in_columns",
            "\r\n40,00;",
            "\r\n41;40,00;",
            a_fault("too_many", "6", row=6),
        ),
        (COLUMNS, "runs_in_columns", "200,00;", "100,00;", a_fault("out_of_order", "1", row=10)),
        (COLUMNS, "runs_in_columns", "Statistics", "Sum", a_fault("too_few", "1", row=11)),
        (ROWS, "rows_of_positions", "1,1,+", "1,1,up", a_fault("unknown", "up", row=2)),
        (ROWS, "rows_of_positions", "2,1,+", "2,x,+", a_fault("malformed", "Run", "x", row=3)),
        (ROWS, "rows_of_positions", "2.0000,-2.0", "2.0000,-2.5", a_fault("mismatch", row=3)),
        (
            DIAGONALS,
            "step_diagonal_stops",
            "forward    3 ",
            "forward    4 ",
            a_fault("missing", "3", row=8),
        ),
        (DIAGONALS, "step_diagonal_stops", "ppp ", "pps ", a_fault("unknown", "pps", row=5)),
        (
            DIAGONALS,
            "step_diagonal_stops",
            "forward   30",
            "forward   31",
            a_fault("out_of_range", "31"),
        ),
        (
            STREAM,
            "readings_in_time",
            "\n40.0\t",
            "\n20.0\t",
            a_fault("out_of_order", "0.02", row=4),
        ),
        (
            STREAM,
            "readings_in_time",
            "\n40.0\t",
            "\n-40.0\t",
            a_fault("out_of_range", "-0.04", row=4),
        ),
    ],
)
def test_a_cell_that_is_wrong_is_refused_with_its_row(path, name, old, new, said, tmp_path):
    copy = changed(path, old, new, tmp_path)
    needed = {
        "runs_in_columns": {"axis": "X"},
        "rows_of_positions": {"axis": "X"},
        "readings_in_time": {"plan": read_text(find("quick", "plans"))},
    }
    with refused(TableError, said) as caught:
        read_file(copy, by(name, **needed.get(name, {})))
    assert str(copy) in str(caught.value) and "\n" not in str(caught.value)


def _without_position(made):
    made["columns"].pop("position")
    made["units"].pop("position")


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("runs_in_columns", lambda m: m.update(tabel=1), a_fault("unknown", about="tabel")),
        ("runs_in_columns", lambda m: m["units"].pop("target"), a_fault("missing", about="target")),
        (
            "runs_in_columns",
            lambda m: m["units"].update(target="cm"),
            a_fault("unknown", "cm", about="target"),
        ),
        ("runs_in_columns", lambda m: m["columns"].update(run="Run"), a_fault("mismatch", "runs")),
        (
            "runs_in_columns",
            lambda m: m["text"].update(delimiter="comma"),
            a_fault("mismatch", "runs_in_columns_changed.yaml"),
        ),
        ("runs_in_columns", lambda m: m["text"].update(header=False), a_fault("malformed", "1")),
        ("runs_in_columns", lambda m: m.update(sign=0), a_fault("out_of_range", "sign", "0")),
        (
            "runs_in_columns",
            lambda m: m["text"].update(encoding="utf-8"),
            a_fault("malformed", "utf-8"),
        ),
        (
            "runs_in_columns",
            lambda m: m["text"].update(encoding="klingon"),
            a_fault("malformed", "klingon"),
        ),
        ("rows_of_positions", _without_position, a_fault("missing", "deviation", "position")),
        (
            "rows_of_positions",
            lambda m: m["directions"].update(backward="+"),
            a_fault("twice", "rows_of_positions_changed.yaml"),
        ),
        (
            "rows_of_positions",
            lambda m: m["columns"].update(reading="x"),
            a_fault("unknown", "rows_of_positions_changed.yaml"),
        ),
        ("step_diagonal_stops", lambda m: m.update(line="ppp"), a_fault("twice", "line")),
        ("step_diagonal_stops", lambda m: m.pop("volume"), a_fault("missing", about="origin_m")),
        (
            "readings_in_time",
            lambda m: m.pop("compensated"),
            a_fault("missing", about="compensated"),
        ),
    ],
)
def test_a_mapping_file_that_is_wrong_is_refused_with_its_key(name, change, said, tmp_path):
    path = COLUMNS if name == "runs_in_columns" else ROWS
    with refused(TableError, said):
        read_file(path, by(written(tmp_path, name, change), axis="X"))


def test_the_case_of_a_run_table_is_no_mapping_file():
    case = {"units": "SI", "chain": ["Y", "X", "Z"], "step_m": [0.01] * 3, "blocks": 12}
    with refused(ValueError, "wrong_kind", "case"):
        mapping_of(case, "case.yaml", "")


def page_example(tmp_path):
    """Write the example of the how-to, table and mapping, and return their paths."""
    page = (Path(__file__).parents[3] / "docs" / "how_to" / "import.md").read_text("utf-8")
    section = page.partition("## Example: a step diagonal")[2]
    table, mapping = (part.partition("\n")[2] for part in section.split("```")[1:4:2])
    paths = tmp_path / "diagonal.csv", tmp_path / "diagonal.yaml"
    for path, text in zip(paths, (table, mapping), strict=True):
        path.write_text(text, encoding="utf-8")
    return paths


def test_the_example_on_the_page_is_imported_by_the_mapping_beside_it(tmp_path, capsys):
    table, mapping = page_example(tmp_path)
    bag = tmp_path / "my_run.mcap"
    assert main(["import", str(table), str(bag), "--mapping", str(mapping)]) == 0
    shown = capsys.readouterr()
    forward, backward = load_run(bag).lines
    assert (forward.line.direction, backward.line.direction) == (FORWARD, BACKWARD)
    assert backward.target[0] == pytest.approx(forward.target[-1])
    assert backward.target[0] == pytest.approx([0.08, 0.06, 0.05])
    volume = load_run(bag).plan.volume
    found = farthest_reading(load_run(bag).lines, volume)
    assert abs(found.deviation) == pytest.approx(0.8e-6, abs=0.06e-6)
    assert f"{found.deviation * 1e6:.4g} µm" in shown.out and "X 0 to 80" in shown.out
    assert "chain" not in shown.err


def test_an_import_of_diagonals_without_a_chain_warns(tmp_path, capsys):
    table, mapping = page_example(tmp_path)
    kept = [line for line in mapping.read_text().splitlines() if not line.startswith("chain")]
    mapping.write_text("\n".join(kept))
    told = ["import", str(table), str(tmp_path / "b.mcap"), "--mapping", str(mapping)]
    assert main(told) == 0
    assert NO_CHAIN.partition(":")[0] in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("ppp;1;backward;3;", "ppp;1;backward;4;", a_fault("missing", "run 1", "backward", row=12)),
        ("\nppp;1;forward;0;0,0000", "\nppp;1;forward;0;0,0x", a_fault("malformed", "comma")),
        ("\nppp;1;forward;0;0,0000", "\nppp;1;forward;0;0.1", a_fault("malformed", "comma")),
    ],
)
def test_a_refusal_names_the_run_of_the_file_and_the_decimal_sign(tmp_path, old, new, said):
    table, mapping = page_example(tmp_path)
    with refused(TableError, said):
        read_file(changed(table, old, new, table.parent), by(str(mapping)))


def test_the_command_says_what_it_made_and_refuses_in_one_sentence(tmp_path, capsys):
    bag = tmp_path / "b.mcap"
    assert main(["import", str(COLUMNS), str(bag), "--mapping", "runs_in_columns"]) == 0
    shown = capsys.readouterr()
    assert "4 passes with 24 stops, 5 blocks" in shown.out and "note: where Y and Z" in shown.err
    assert main(["info", str(bag)]) == 0
    assert f"{COLUMNS.name}, SHA-256 " in capsys.readouterr().out
    assert main(["export", str(bag), "--output", str(tmp_path / "out"), "--attachments"]) == 0
    kept = tmp_path / "out" / "attachments" / "source"
    assert (kept / COLUMNS.name).read_bytes() == COLUMNS.read_bytes()
    shipped = (directory("config") / "imports" / "runs_in_columns.yaml").read_bytes()
    assert (kept / "mapping.yaml").read_bytes() == shipped
    assert main(["import", str(COLUMNS), str(tmp_path / "c.mcap")]) != 0
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert re.search("has no known format.*--mapping", error)
    assert not list(tmp_path.glob("*c.mcap*"))


def test_columns_without_a_use_and_missing_runs_are_named(tmp_path):
    mapping = written(tmp_path, "runs_in_columns", lambda parsed: parsed["runs"].pop())
    bag = tmp_path / "a.mcap"
    made = import_file(COLUMNS, bag, by(mapping))
    (unused,) = (one for one in made.remarks if "not used" in one)
    assert "'Run 2 rev (µm)'" in unused and "fwd" not in unused
    (missing,) = unequal_runs(load_run(bag))
    assert re.search(r"\bx\b.*\b2\b.*\b1\b", missing)


def test_a_table_that_is_used_whole_has_no_such_note(tmp_path):
    bag = tmp_path / "a.mcap"
    made = import_file(COLUMNS, bag, by("runs_in_columns"))
    assert not any("not used" in one for one in made.remarks)
    assert unequal_runs(load_run(bag)) == []


def test_of_many_columns_without_a_use_a_few_are_named(tmp_path):
    text = "target,deviation," + ",".join(f"more {n}" for n in range(20))
    rows = [f"{target},0" + ",1" * 20 for target in (0, 10, 20)]
    path, mapping = tmp_path / "wide.csv", tmp_path / "wide.yaml"
    path.write_text("\n".join([text, *rows]))
    mapping.write_text(
        "table: axis\ncolumns: {target: target, deviation: deviation}\naxis: X\n"
        "units: {target: mm, deviation: um}\n"
    )
    (unused,) = (one for one in read_file(path, by(str(mapping)))[1].remarks if "not used" in one)
    assert "'more 0'" in unused and "'more 19'" not in unused and "15" in unused


def test_one_mapping_reads_all_files_of_a_measurement(tmp_path):
    other = tmp_path / "other.csv"
    other.write_bytes(COLUMNS.read_bytes().replace(b"0,82", b"0,83"))
    both = [by("runs_in_columns", axis=axis) for axis in "XY"]
    made = import_files([COLUMNS, other], tmp_path / "a.mcap", both)
    assert {line.line.name for line in made.lines} == {"x", "y"}
    with refused(TableError):
        import_files([COLUMNS, DATA / "made_up_axis.rtl"], tmp_path / "b.mcap", both)


def placed(tmp_path, *lines, **options):
    """Import lines along Z, each of three stops, over a box of 80 × 60 × 50 mm."""
    stops = [f"{name};{stop};{25 * stop}" for name in lines for stop in range(3)]
    table = tmp_path / "z.csv"
    table.write_text("\n".join(["Line;Stop;mm", *stops]))
    mapping = tmp_path / "z.yaml"
    columns = {"line": "Line", "stop": "Stop", "reading": "mm"}
    volume = {"origin_m": [0.1, 0.2, 0.3], "step_m": [0.04, 0.03, 0.025], "blocks": 2}
    mapping.write_text(
        yaml.safe_dump(
            {
                "table": "lines",
                "text": {"delimiter": "semicolon"},
                "columns": columns,
                "units": {"reading": "mm"},
                "volume": volume,
            }
        )
    )
    return read_file(table, ImportOptions(mapping=str(mapping), **options))[1]


def at_corner(made):
    """Return the notes that a line is taken to be at the first corner."""
    return [one for one in made.remarks if "first corner" in one]


def test_a_line_elsewhere_is_placed_by_its_name(tmp_path):
    made = placed(tmp_path, "z@0,0.06,0", "z@0.08,0,0")
    assert [line.line.offset for line in made.lines] == [(0.0, 0.06, 0.0), (0.08, 0.0, 0.0)]
    assert made.lines[0].target[0] == pytest.approx([0.1, 0.26, 0.3])
    assert [line.setup for line in made.lines] == ["z@0,0.06,0", "z@0.08,0,0"]
    assert not at_corner(made)


def test_of_a_line_without_a_place_it_is_said_that_the_first_corner_was_taken(tmp_path):
    made = placed(tmp_path, "z", "z@0,0.06,0")
    assert [line.line.offset for line in made.lines] == [(0.0, 0.0, 0.0), (0.0, 0.06, 0.0)]
    assert len(at_corner(made)) == 1


@pytest.mark.parametrize(
    "name", ["z@0,60,0", "z@0,0.06,0.01", "z@0,0.07,0", "z@0,x,0", "z@0,0.06", "z@nan,0,0"]
)
def test_a_place_that_cannot_be_is_refused_with_the_row(tmp_path, name):
    with refused(TableError, "malformed", "row 2"):
        placed(tmp_path, f'"{name}"')


@pytest.mark.parametrize(
    "options", [{"plan": "name: x"}, {"axis": "Z"}, {"standing": (0.0, 0.0, 0.0)}]
)
def test_an_option_that_has_no_effect_on_a_table_of_lines_is_refused(tmp_path, options):
    with refused(TableError, "mismatch", about=f"--{next(iter(options))}"):
        placed(tmp_path, "z", **options)


@pytest.mark.parametrize(
    ("path", "mapping", "options"),
    [
        (COLUMNS, "runs_in_columns", {"chain": "YXZ"}),
        (COLUMNS, "runs_in_columns", {"decimal": ","}),
        (RTL, "", {"plan": "name: x"}),
        (RTL, "", {"chain": "YXZ"}),
        (HOUSE, "", {"plan": "name: x"}),
        (HOUSE, "", {"decimal": ","}),
        (HOUSE, "", {"encoding": "utf-8"}),
    ],
)
def test_an_option_that_has_no_effect_on_a_format_is_refused(path, mapping, options, tmp_path):
    if not path.exists():
        path = tmp_path / path
        path.write_text("cycle,direction,target_mm,position_mm\n0,forward,0,0\n")
    with refused(TableError, "mismatch", about=f"--{next(iter(options))}", where=str(path)):
        read_file(path, ImportOptions(axis="X", mapping=mapping, **options))


@pytest.mark.parametrize("options", [[str(COLUMNS), "--mapping", "runs_in_columns"], [str(RTL)]])
def test_the_case_of_a_run_table_is_refused_for_other_files(options, tmp_path, capsys):
    case, bag = tmp_path / "case.yaml", tmp_path / "a.mcap"
    case.write_text("chain: [Y, X, Z]\n")
    assert main(["import", options[0], str(bag), *options[1:], "--case", str(case)]) == 1
    said = capsys.readouterr().err
    assert "--case" in said and "UTF-8" not in said and not bag.exists()
