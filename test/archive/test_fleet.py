"""The machines of an archive as they are now: states by hand, order, and what belongs to a run."""

import json
from datetime import date, timedelta
from math import isnan
from pathlib import Path

import jsonschema_rs
import pytest
from archive_runs import digest
from fleet_runs import NOW, run, state, written
from refused import refused

from stepdiag_ros import schemas
from stepdiag_ros.archive.catalogue import Catalogue
from stepdiag_ros.archive.fleet import fleet
from stepdiag_ros.archive.place import Place
from stepdiag_ros.cli import main
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.standards.conformity import Conformity
from stepdiag_ros.report.pages.fleet import fleet_page
from stepdiag_ros.words.fleet import overdue


def read(place):
    with Catalogue(place) as opened:
        return {one.name: one for one in fleet(opened)}


@pytest.mark.parametrize(
    ("size", "verdict", "contained", "wanted"),
    [
        (9.7e-6, "CONSISTENT", False, Conformity.WITHIN),
        (-9.7e-6, "CONSISTENT", False, Conformity.WITHIN),
        (9.9e-6, "CONSISTENT", False, Conformity.UNDECIDED),
        (10.1e-6, "CONSISTENT", False, Conformity.UNDECIDED),
        (-10.3e-6, "CONSISTENT", False, Conformity.NOT_WITHIN),
        (10.3e-6, "NAMED", False, Conformity.UNDECIDED),
        (10.3e-6, "NAMED", True, Conformity.NOT_WITHIN),
        (9.7e-6, "UNEXPLAINED", False, Conformity.UNDECIDED),
    ],
)
def test_the_newest_run_alone_is_judged_with_its_uncertainty(
    folder, size, verdict, contained, wanted
):
    newest = run(2, "mill", 3, size, verdict=verdict, contained=contained)
    written(folder, run(1, "mill", 30, 5e-5), newest)
    state(folder, "tolerances: {C0Y: 1.0e-5}\n")
    (mill,) = read(folder).values()
    assert mill.state is wanted
    (judged,) = mill.judged
    assert (judged.name, judged.value, judged.expanded) == ("C0Y", size, pytest.approx(2e-7))


@pytest.mark.parametrize(("bound", "wanted"), [(9.9e-6, "WITHIN"), (10.1e-6, "UNDECIDED")])
def test_the_largest_error_is_within_a_limit_if_it_is_so_at_every_place(folder, bound, wanted):
    made = run(1, "mill", 3, 9.0e-6, largest_upper_bound_m=bound)
    object.__setattr__(made.figures[0], "name", "largest in volume")
    written(folder, made)
    state(folder, "tolerances: {largest in volume: 1.0e-5}\n")
    assert read(folder)["mill"].state is Conformity[wanted]


def test_an_archive_of_an_earlier_version_lacks_columns(folder):
    from pyarrow import parquet

    written(folder, run(1, "mill", 3, 9.7e-6, verdict="NAMED"))
    state(folder, "tolerances: {C0Y: 1.0e-5}\n")
    for file in Path(folder.url).rglob("*.parquet"):
        table = parquet.read_table(file)
        if "contained" in table.column_names:
            parquet.write_table(table.drop_columns(["contained"]), file)
    (mill,) = read(folder).values()
    assert mill.state is Conformity.UNDECIDED


def test_machines_stand_worst_first(folder):
    sizes = {"a within": 1e-6, "b beyond": 9e-5, "c open": 1e-5, "e renamed": 2e-6}
    runs = [run(number, name, 5, size) for number, (name, size) in enumerate(sizes.items())]
    free = run(90, "d free", 5, 1e-6)
    free.figures.clear()
    written(folder, *runs, free)
    state(folder, "machines: {e renamed: e}\ntolerances:\n  C0Y: 1.0e-5\n  e: {C0Y: 1.0e-6}\n")
    found = read(folder)
    # What was never measured of a machine is not judged.
    assert [*found] == ["b beyond", "e", "c open", "a within", "d free"]
    assert found["d free"].state is Conformity.NOT_ASKED and found["d free"].history is None


def test_the_trend_orders_machines_of_one_state(folder):
    runs = []
    for name, wear in (("still", 0.0), ("worn", 4e-6)):
        for back in range(20):
            noise = 5e-8 * (-1) ** back
            number = len(runs)
            runs.append(run(number, name, 50 * back, 2e-6 + wear * (20 - back) * 50 / 365 + noise))
    written(folder, *runs)
    state(folder, "tolerances: {C0Y: 2.0e-5}\n")
    found = read(folder)
    assert [*found] == ["worn", "still"]
    assert {one.state for one in found.values()} == {Conformity.WITHIN}


def test_of_machines_outside_the_farthest_comes_first(folder):
    runs = [
        run(20 * n + k, name, 30 * k, size + 1e-8 * (k % 3))
        for n, (name, size) in enumerate({"a near": 3e-5, "b far": 9e-5, "c between": 6e-5}.items())
        for k in range(12)
    ]
    written(folder, *runs)
    state(folder, "tolerances: {C0Y: 1.0e-5}")
    assert [*read(folder)] == ["b far", "c between", "a near"]


def test_a_run_that_was_not_evaluated_proves_nothing(folder):
    broken = run(2, "mill", 3, 1e-6, problem="no line was finished", largest_m=None)
    broken.figures.clear()
    written(folder, run(1, "mill", 30, 1e-6), broken)
    state(folder, "tolerances: {C0Y: 1.0e-5}\n")
    mill = read(folder)["mill"]
    assert mill.newest.problem and isnan(mill.newest.largest)
    assert mill.state is Conformity.UNDECIDED and isnan(mill.judged[0].value)


def test_runs_are_newest_first_and_one_in_two_bags_counts_once(folder):
    twin = run(3, "mill", 20, 1e-6, run_id=f"run {digest(2)[:8]}", serial_number="old")
    undated = run(4, "mill", None, 1e-6)
    newest = run(1, "mill", 10, 1e-6, serial_number="SN-2")
    written(folder, twin, run(2, "mill", 20, 1e-6), newest, undated)
    mill = read(folder)["mill"]
    assert [one.sha256 for one in mill.runs[::2]] == [digest(1), digest(4)] and len(mill.runs) == 3
    assert mill.serial_number == "SN-2" and mill.newest.time == NOW - timedelta(days=10)


def test_what_is_due(folder):
    written(
        folder, run(1, "late", 91, 0.0), run(2, "due today", 90, 0.0), run(3, "dateless", None, 0.0)
    )
    found = read(folder)
    assert found["late"].due(90).date() == date(2024, 5, 31)
    assert {name for name, one in found.items() if overdue(one, 90, NOW)} == {"late", "dateless"}
    assert not any(overdue(one, None, NOW) for one in found.values())
    assert found["late"].due(None) is None


def test_a_report_belongs_to_its_run(folder):
    runs = [run(number, "mill", 50 - number, 0.0, run_id=f"r{number}") for number in range(4)]
    second = run(3, "mill", 1, 0.0, run_id="second", run_number=2)  # of the same bag as r3
    written(folder, *runs, second)
    for number in range(4):
        bag = Path(folder.url, "bags", digest(number), "x.mcap")
        bag.parent.mkdir(parents=True)
        bag.touch()
    beside = [Path(folder.url, "bags", digest(number), "x_report") for number in (1, 3)]
    for where in (*beside, Path(folder.url, "reports", "r2"), Path(folder.url, "reports", "gone")):
        where.mkdir(parents=True)
        (where / "report.html").touch()
    found = {one.run_id: one for one in read(folder)["mill"].runs}
    assert {name: one.report for name, one in found.items()} == {
        "r0": "",
        "r1": f"bags/{digest(1)}/x_report/report.html",
        "r2": "reports/r2/report.html",
        # Of which run of the bag it is, nobody states.
        "r3": "",
        "second": "",
    }
    assert found["r0"].bag == f"bags/{digest(0)}/x.mcap" and found["r0"].alone
    assert not found["r3"].alone


def test_an_archive_may_lie_in_a_store(place, tmp_path):
    written(place, run(1, "mill", 3, 1e-6, run_id="r1"))
    for name in (f"bags/{digest(1)}/x.mcap", "reports/r1/report.html"):
        (tmp_path / "empty").touch()
        place.put(tmp_path / "empty", name)
    (newest,) = read(place)["mill"].runs
    assert newest.bag == f"bags/{digest(1)}/x.mcap" and newest.report == "reports/r1/report.html"
    content = fleet_page(place, [*read(place).values()], None, NOW, tmp_path / "fleet.html")
    link = "reports/r1/report.html" if place.is_local else place.address(newest.report)
    assert link in content and (f'"local": {str(place.is_local).lower()}' in content)


def test_the_command_writes_page_and_document(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(folder, run(1, "mill", 30, 5e-5, simulated=True), run(2, "lathe", None, 1e-6))
    state(folder, "tolerances: {C0Y: 1.0e-5}\n")
    assert main(["fleet", folder.url, "--json", "--every", "90"]) == 0
    document = json.loads(capsys.readouterr().out)
    jsonschema_rs.validate(schemas.schema("fleet"), document)
    mill, lathe = document["machines"]
    assert (mill["name"], mill["state"]) == ("mill", "NOT_WITHIN")
    assert mill["judged"][0]["conformity"] == "NOT_WITHIN" and mill["runs"][0]["bag"] is None
    assert (lathe["due"], lathe["overdue"], lathe["runs"][0]["time"]) == (None, True, None)
    assert (mill["runs"][0]["simulated"], lathe["runs"][0]["simulated"]) == (True, None)
    assert not list(tmp_path.glob("*.html"))
    assert main(["fleet", folder.url, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["machines"][0]["overdue"] is None
    assert main(["fleet", folder.url]) == 0
    page = tmp_path / "fleet.html"
    first = page.read_text()
    assert main(["fleet", folder.url, "--output", "fleet.html", "--every", "9"]) == 0
    assert page.read_text() != first


@pytest.mark.parametrize(
    "told",
    [["--output", "run.mcap"], ["--output", "nowhere/a.html"], ["--every", "0"], ["--every", "x"]],
)
def test_what_cannot_be_written_is_refused(folder, tmp_path, told, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(folder, run(1, "mill", 30, 5e-5))
    bag = tmp_path / "run.mcap"
    bag.write_bytes(b"bag")
    before = sorted(tmp_path.rglob("*"))
    try:
        assert main(["fleet", folder.url, *told]) == 1
    except SystemExit as end:
        assert end.code == 2
    assert bag.read_bytes() == b"bag" and sorted(tmp_path.rglob("*")) == before


def test_a_file_that_is_no_page_of_a_fleet_is_not_replaced(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(folder, run(1, "mill", 30, 5e-5))
    other = tmp_path / "fleet.html"
    other.write_text("machines: {}\n")
    assert main(["fleet", folder.url]) == 1
    assert "fleet.html" in capsys.readouterr().err
    assert other.read_text() == "machines: {}\n"


def test_what_is_no_archive_is_refused(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with refused(Refusal, "missing"):
        read(Place(str(tmp_path / "nowhere")))
    written(folder)
    with refused(Refusal, "missing"):
        read(folder)
    other = Path(folder.url, "catalogue")
    (other / "1").rename(other / "99")
    with refused(Refusal, "mismatch"):
        read(folder)
    for where in (folder.url, str(tmp_path / "nowhere")):
        assert main(["fleet", where]) == 1
    assert not list(tmp_path.glob("*.html")) and not capsys.readouterr().out
