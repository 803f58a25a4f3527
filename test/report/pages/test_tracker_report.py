"""``stepdiag report`` of a run with a tracker: what is in its files is what the evaluation says."""

import json
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from report.pages.page_reading import ReadPage
from standard_runs import RUN_ID
from tracker_runs import BESIDE, STATIONS, tracker_run, write_tracker_run

from stepdiag_ros import open_run, schemas
from stepdiag_ros.cli import main
from stepdiag_ros.evaluation.tracker import reports_of_run
from stepdiag_ros.metrology.tracker.joint import NAMES
from stepdiag_ros.report.pages import pictures
from stepdiag_ros.words.tracker import joint_values, sentences_of


@contextmanager
def here(beside=True):
    """Draw in this process."""
    del beside
    yield pictures.Studio()


@pytest.fixture(autouse=True)
def drawn_here(monkeypatch):
    monkeypatch.setattr(pictures, "studio", here)


def reported(bag, *options):
    folder = bag.parent / "report"
    code = main(["report", str(bag), "--output", str(folder), *map(str, options)])
    assert code == 0
    document = json.loads((folder / "report.json").read_text())
    # Whatever is written is checked against the schema that it names (test/conftest.py).
    assert document["schema"] == schemas.identifier("tracker_report")
    html = folder / "report.html"
    return document, ReadPage(html.read_text()) if html.exists() else None


def test_page_pdf_and_document_say_what_the_evaluation_says(tmp_path):
    bag = write_tracker_run(tmp_path / "run.mcap", *tracker_run())
    (one,) = reports_of_run(open_run(bag))
    document, page = reported(bag, "--customer", "Mill & <Sons>", "--place", "hall 3")
    assert (tmp_path / "report" / "report.pdf").read_bytes().startswith(b"%PDF")
    for text in (RUN_ID, "Mill & <Sons>", "hall 3", "-150.0, 150.0, -150.0 mm", "YXZ"):
        assert text in page.text
    for text in (one.verdict.sentence, *sentences_of(one)):
        assert " ".join(text.split()) in page.text
    for _, value in joint_values(one.result.joint):
        assert value in page.text
    passes = page.tables["Each pass against all others"]
    assert [row[0] for row in passes[1:]] == [str(each) for each in one.result.joint.passes]
    assert len(page.sources) == 3
    assert all(source.startswith("data:image/png") for source in page.sources)
    assert document["measurement"]["customer"] == "Mill & <Sons>"
    assert len(document["measurement"]["sha256"]) == 64
    assert document["measurement"]["sha256"] in page.text
    assert document["tracker"]["places"] == {"1": list(BESIDE)}
    (station,) = document["stations"]
    np.testing.assert_array_equal(station["joint"]["values"], one.result.joint.values)
    assert document["grid"] is None


def test_the_lead_names_the_pass_in_which_something_happened(tmp_path, capsys):
    plan, lines = tracker_run()
    slipped = next(line for line in lines if line.line.name == "1:xyz")
    shift = np.where(np.arange(len(slipped.target)) >= 2, 2e-6, 0.0)
    moved = replace(slipped, displacement=slipped.displacement + shift)
    lines = [moved if line is slipped else line for line in lines]
    bag = write_tracker_run(tmp_path / "run.mcap", plan, lines)
    document, page = reported(bag, "--html", "--json")
    assert document["stations"][0]["verdict"]["name"] == "UNEXPLAINED"
    assert any("xyz forward, run 1" in text for text in document["summary"]["sentences"])
    assert "xyz forward, run 1" in capsys.readouterr().out
    assert page.headings[0] == document["summary"]["headline"]
    whole = write_tracker_run(tmp_path / "whole.mcap", *tracker_run())
    assert reported(whole, "--json")[0]["summary"]["headline"] != document["summary"]["headline"]


def test_what_was_not_measured_and_what_was_left_out_stand_on_top(tmp_path):
    plan, lines = tracker_run()
    last = lines[-1]
    torn = replace(last, displacement=np.where(np.arange(5) == 2, np.nan, last.displacement))
    kept = [*(line for line in lines[:-1] if line.line.name != "1:xz"), torn]
    bag = write_tracker_run(tmp_path / "run.mcap", plan, kept)
    document, _ = reported(bag, "--json")
    said = " ".join(document["summary"]["sentences"])
    assert f"{len(kept) - 1} of {len(lines)} planned passes" in said
    assert "y, xz" in said
    assert str(torn.line) in said
    assert document["stations"][0]["joint"]["names"] == list(NAMES)


def test_each_of_two_stations_has_its_own_chapters_and_tables(tmp_path):
    plan, lines = tracker_run(stations=(BESIDE, STATIONS[0]), runs=1)
    bag = write_tracker_run(tmp_path / "run.mcap", plan, lines)
    document, page = reported(bag, "--html", "--json")
    assert [one["station"] for one in document["stations"]] == ["1", "2"]
    for station in "12":
        assert f"Each pass against all others, station {station}" in page.tables
    assert not (tmp_path / "report" / "report.pdf").exists()


def test_of_a_grid_the_page_has_the_error_curves(tmp_path):
    plan, lines = tracker_run(stations=STATIONS, nodes=4)
    bag = write_tracker_run(tmp_path / "run.mcap", plan, lines)
    document, page = reported(bag, "--html", "--json")
    assert document["stations"] == []
    assert "multilateration" in document["grid"]["methods"]
    assert "Error curves" in " ".join(page.headings)
    assert not [one for one in page.headings if "budget" in one.casefold()]


@pytest.mark.parametrize(
    "option", [("--tolerance", 20), ("--instrument", "demo"), ("--direct", "angles.csv")]
)
def test_what_a_tracker_has_no_use_for_is_refused_and_nothing_written(tmp_path, capsys, option):
    (tmp_path / "angles.csv").write_text("")
    bag = write_tracker_run(tmp_path / "run.mcap", *tracker_run())
    folder = tmp_path / "report"
    assert main(["report", str(bag), "--output", str(folder), *map(str, option)]) == 1
    assert option[0] in capsys.readouterr().err
    assert not folder.exists()
