"""The section of a report with the years of the machine: what an archive says of it."""

import json
from pathlib import Path

import pytest
from archive_runs import digest
from fleet_runs import run, state, written
from refused import refused
from report.pages.page_reading import ReadPage

from stepdiag_ros.archive.catalogue import Catalogue
from stepdiag_ros.archive.histories import UNNAMED, history_of_run
from stepdiag_ros.archive.place import Place
from stepdiag_ros.bags.digest import sha256_of
from stepdiag_ros.cli import main
from stepdiag_ros.report.pages import pictures

RUN = Path(__file__).parents[3] / "docs" / "examples" / "small_run.mcap"
MACHINE = "demo machine"
SIZES = (2.0, 2.1, 1.9, 2.0, 2.1, 8.0, 8.1, 7.9, 8.0, 8.1)
"""C0Y of ten runs, µrad: it has changed with the sixth."""


@pytest.fixture
def folder(tmp_path):
    """An archive, empty."""
    return Place(str(tmp_path / "archive"))


@pytest.fixture
def years(folder):
    """An archive with ten runs of the machine, and some of another one."""
    return written(
        folder,
        *(run(n, MACHINE, 900 - 90 * n, 1e-6 * size) for n, size in enumerate(SIZES)),
        *(run(100 + n, "OTHER MACHINE", 30 * n, 1e-6) for n in range(3)),
    )


@pytest.fixture
def reported(tmp_path, monkeypatch):
    """Return what makes the report of the run, in this process."""
    studio = pictures.studio
    monkeypatch.setattr(pictures, "studio", lambda: studio(beside=False))

    def make(*options):
        folder = tmp_path / "report"
        given = ["--html", "--json", "--output", str(folder), *options]
        assert main(["report", str(RUN), *given]) == 0
        page = ReadPage((folder / "report.html").read_text(encoding="utf-8"))
        return page, json.loads((folder / "report.json").read_text(encoding="utf-8"))

    return make


def test_the_years_stand_in_the_report(reported, years, validators):
    page, document = reported("--archive", years.url)
    assert not list(validators[document["schema"]].iter_errors(document))
    (machine,) = document["sections"]["history"]["machines"]
    assert (machine["name"], machine["runs"]) == (MACHINE, len(SIZES))
    (figure,) = (one for one in machine["figures"] if one["name"] == "C0Y")
    (change,) = figure["changes"]
    assert change["size"] == pytest.approx(6e-6, abs=change["expanded_uncertainty"])
    assert any(heading.endswith("History of the machine") for heading in page.headings)
    assert "not in the archive" in page.text
    assert "OTHER MACHINE" not in page.text


def test_without_an_archive_nothing_is_said_of_the_years(reported):
    page, document = reported()
    assert document["sections"]["history"] is None
    assert not any("History" in heading for heading in page.headings)


def test_the_archive_names_the_machine_of_a_run_that_it_holds(folder):
    own = run(1, "VMC 3", 10, 2e-6)
    for row in (*own.runs, *own.figures, *own.curves):
        object.__setattr__(row, "bag_sha256", sha256_of(RUN))
    with Catalogue(written(folder, own, run(2, MACHINE, 5, 1e-6))) as catalogue:
        found = history_of_run(catalogue, sha256_of(RUN), MACHINE)
        assert (found.machine.name, found.contains_run) == ("VMC 3", True)
        found = history_of_run(catalogue, digest(9), MACHINE)
        assert (found.machine.name, found.contains_run) == (MACHINE, False)


def test_a_machine_that_was_renamed_is_found_by_its_name_in_the_bag(folder):
    place = written(folder, run(1, MACHINE, 10, 2e-6))
    state(place, f"machines: {{{MACHINE}: VMC 3}}\n")
    with Catalogue(place) as catalogue:
        assert history_of_run(catalogue, digest(9), MACHINE).machine.name == "VMC 3"


def test_a_machine_without_a_name_has_its_history(folder):
    with Catalogue(written(folder, run(1, None, 10, 2e-6), run(2, MACHINE, 5, 1e-6))) as catalogue:
        found = history_of_run(catalogue, digest(1), "")
        assert (found.machine.name, found.machine.runs) == (UNNAMED, 1)
        # A bag that is not in the archive and names no machine is taken for one of these.
        assert history_of_run(catalogue, digest(9), "").machine.name == UNNAMED


def test_a_machine_that_the_archive_does_not_have_is_refused(folder, tmp_path, capsys):
    place = written(folder, run(1, "another", 10, 2e-6))
    with Catalogue(place) as catalogue, refused(ValueError, "not_found", "another", about=MACHINE):
        history_of_run(catalogue, digest(9), MACHINE)
    output = tmp_path / "report"
    assert main(["report", str(RUN), "--archive", place.url, "--output", str(output)]) == 1
    assert place.url in capsys.readouterr().err
    assert not list(output.glob("*"))
