"""``stepdiag archive``, as a user calls it."""

import csv
import importlib.util
import subprocess
import sys

import pytest
from archive_runs import digest, filled, rows_made_up, write_bag

from stepdiag_ros.archive import work
from stepdiag_ros.archive.place import Place
from stepdiag_ros.cli import main


@pytest.fixture
def place(tmp_path):
    """Return an archive with three runs."""
    return filled(Place(str(tmp_path / "archive")), range(3))


def test_runs_are_listed_with_what_is_odd(place, capsys):
    filled(place, [5], start_time=None, software_version="0.0.1", machine="lathe")
    filled(place, [6], problem="it is cut", run_id="R6")
    filled(place, [7], run_id="R6", file="twin.mcap")
    assert main(["archive", "list", place.url]) == 0
    out, err = capsys.readouterr()
    assert all(f"run {digest(number)[:8]}" in out for number in (0, 1, 2, 5))
    odd = err.splitlines()
    assert any(digest(5)[:8] in line and "archive.yaml" in line for line in odd)
    assert "R6: it is cut" in odd and any("a.mcap, twin.mcap" in line for line in odd)
    assert any("stepdiag archive update" in line for line in odd)
    assert main(["archive", "list", place.url, "--machine", "lathe"]) == 0
    assert digest(0)[:8] not in capsys.readouterr().out
    assert main(["archive", "list", place.url, "--machine", "nobody"]) == 1
    assert "nobody" in capsys.readouterr().err


def test_a_run_is_shown_by_its_name_or_its_bag(place, capsys):
    for name in (f"run {digest(1)[:8]}", digest(1)[:10]):
        assert main(["archive", "show", place.url, name]) == 0
        out = capsys.readouterr().out
        assert digest(1) in out and "positioning E_XX" in out
    for name in ("nothing", ""):
        assert main(["archive", "show", place.url, name]) == 1
        assert place.url in capsys.readouterr().err


def test_sql_gives_csv_with_all_digits(place, capsys):
    query = "select bag_sha256, largest_m from runs order by largest_m"
    assert main(["archive", "sql", place.url, query, "--csv"]) == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    assert {row["bag_sha256"]: float(row["largest_m"]) for row in rows} == {
        digest(number): int(digest(number)[:6], 16) * 1e-12 for number in range(3)
    }
    assert main(["archive", "sql", place.url, query]) == 0
    assert digest(0) in capsys.readouterr().out
    assert main(["archive", "sql", place.url, "select x from runs"]) == 1
    assert '"x"' in capsys.readouterr().err


def test_bags_are_added_verified_and_brought_up_to_date(tmp_path, capsys, monkeypatch):
    bag = write_bag(tmp_path / "a.mcap")
    twin = tmp_path / "twin.mcap"
    twin.write_bytes(bag.read_bytes())
    url = str(tmp_path / "archive")
    assert main(["archive", "add", url, str(bag), str(twin)]) == 1
    out, err = capsys.readouterr()
    assert out.startswith("0 evaluated, 1 in the archive before, 1 with a problem")
    assert "twin.mcap is the same bag as a.mcap" in err
    assert main(["archive", "verify", url]) == 0
    assert main(["archive", "update", url]) == 0
    monkeypatch.setattr(work, "rows_of_bag", rows_made_up)
    for name in Place(url).names("catalogue"):
        Place(url).remove(name)
    assert main(["archive", "verify", url]) == 1
    assert main(["archive", "update", url]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("1 evaluated")


@pytest.mark.parametrize("library", ["pyarrow", "duckdb", "fsspec", "distributed"])
def test_without_a_library_it_is_said_what_to_install(place, capsys, monkeypatch, library):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        "stepdiag_ros.archive.find_spec", lambda name: None if name == library else find(name)
    )
    assert main(["archive", "list", place.url]) == 1
    err = capsys.readouterr().err
    assert library in err and "stepdiag_ros[archive]" in err


def test_nothing_else_imports_the_libraries_of_the_archive():
    code = "import sys, stepdiag_ros.cli, stepdiag_ros.notebook, stepdiag_ros.report.publish\n"
    code += "import stepdiag_ros.nodes.recorder, stepdiag_ros.plots\n"
    code += "stepdiag_ros.cli.make_parser().format_help()\n"
    code += "print({'duckdb', 'pyarrow', 'fsspec', 'distributed', 'dask'} & sys.modules.keys())"
    told = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert told.stdout.strip() == "set()"
