"""``stepdiag report``: what is in its files is what the evaluation returns."""

import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from base64 import b64decode
from collections import Counter
from contextlib import contextmanager, suppress
from datetime import datetime, timezone
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import RendererAgg
from PIL import Image
from report.pages.page_reading import ReadPage, sections_without_archive
from standard_runs import RUN_ID, write_bag

from stepdiag_ros import open_run, schemas
from stepdiag_ros.cli import main
from stepdiag_ros.commands.solve import report_of
from stepdiag_ros.configuration import load_instrument
from stepdiag_ros.evaluation.single_errors import single_errors
from stepdiag_ros.metrology.geometry import SQUARENESS
from stepdiag_ros.metrology.solvers import limits
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.metrology.uncertainty.budget import make_budget
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.uncertainty.largest_error import budget_of_largest_error
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.report import beside
from stepdiag_ros.report.files import try_folder
from stepdiag_ros.report.pages import pictures
from stepdiag_ros.report.pages.sections import sections
from stepdiag_ros.report.pages.sections.measurement import _words_of
from stepdiag_ros.report.pages.sections.readings import _few_stops
from stepdiag_ros.text.numbers import ARC_SECONDS, OF_READINGS, plus_minus, with_expanded

PLAN = """\
name: small run
step_m: [0.03, 0.02, 0.025]
blocks: 4
repeats: 2
directions: [forward, backward]
overrun_m: 0.002
feed_m_per_s: 0.05
lines:
  - {kind: linear, names: [x, y, z]}
  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn]}
"""
RUN_WITH_READINGS = Path(__file__).parents[3] / "docs" / "examples" / "small_run.mcap"
GIVEN = ("--customer", "Mill & <Sons>", "--operator", "A. Turner", "--tolerance", "50")
needs_poppler = pytest.mark.skipif(
    shutil.which("pdftotext") is None, reason="poppler's pdftotext is not installed here"
)


@contextmanager
def here(beside=True):
    """Draw in this process: the tests share what it imports."""
    del beside
    yield pictures.Studio()


@pytest.fixture(scope="module", autouse=True)
def drawn_here():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "studio", here)
        yield


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "small.mcap"
    write_bag(path, PLAN)
    return path


@pytest.fixture(scope="module")
def letters():
    """All words that are drawn into pictures of the module, with their sizes in points."""
    drawn = []

    def draw_text(renderer, context, x, y, words, font, *more, **named):
        drawn.append((font.get_size_in_points(), words))
        draw(renderer, context, x, y, words, font, *more, **named)

    draw = RendererAgg.draw_text
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RendererAgg, "draw_text", draw_text)
        yield drawn


@pytest.fixture(scope="module")
def folder(bag, letters):
    del letters
    assert main(["report", str(bag), *GIVEN, "--instrument", "demo"]) == 0
    return bag.parent / "small_report"


@pytest.fixture(scope="module")
def page(folder):
    return ReadPage((folder / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def document(folder):
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def solved(bag):
    return report_of(bag, with_visibility=True)


def test_three_files_and_no_other(folder):
    assert sorted(path.name for path in folder.iterdir()) == [
        "report.html",
        "report.json",
        "report.pdf",
    ]


def test_what_a_large_run_is_not_evaluated_for_is_said_first_and_in_the_report(
    bag, tmp_path, capsys, monkeypatch
):
    large = tmp_path / "large.mcap"
    shutil.copy(bag, large)
    monkeypatch.setattr(limits, "MOST_VALUES", 30)
    monkeypatch.setattr(pictures.Studio, "fetch_all", lambda _: {})
    assert main(["report", str(large), "--json"]) == 0
    first = capsys.readouterr().err.splitlines()[0]
    for name in ("conventional", "rigid_body", limits.DIAGNOSIS, limits.BUDGET, limits.VISIBILITY):
        assert name in first
    text = (tmp_path / "large_report" / "report.json").read_text(encoding="utf-8")
    for name in (limits.DIAGNOSIS, limits.BUDGET):
        assert f"The {name} is left out for its size" in text


def test_a_report_of_another_run_is_not_replaced_without_a_word(bag, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(limits, "MOST_VALUES", 30)
    monkeypatch.setattr(pictures.Studio, "fetch_all", lambda _: {})
    (tmp_path / "report.json").write_text('{"run_id": "X1"}')
    assert main(["report", str(bag), "--json", "--output", str(tmp_path)]) == 0
    assert "'X1'" in capsys.readouterr().err


def test_the_page_has_every_section_in_order_and_everything_in_itself(page):
    titles = [section.title for section in sections_without_archive()]
    numbered = [text for text in page.headings if re.match(r"\d+ ", text)]
    assert numbered == [f"{number} {title}" for number, title in enumerate(titles, 1)]
    assert len(page.sources) >= 14
    assert all(source.startswith("data:image/png;base64,") for source in page.sources)
    assert page.links == [f"#{section.name}" for section in sections_without_archive()]


def test_solve_states_the_uncertainty_of_the_report(bag, tmp_path, monkeypatch):
    monkeypatch.setattr(pictures.Studio, "fetch_all", lambda _: {})
    assert main(["report", str(bag), "--json", "--output", str(tmp_path)]) == 0
    summary = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["summary"]
    assert main(["solve", str(bag), "--pictures", "none", "--output", str(tmp_path)]) == 0
    lead = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["lead"]
    assert lead["largest_in_volume"] == summary["value"]
    assert lead["expanded_uncertainty"] == summary["expanded_uncertainty"]
    assert lead["expanded_uncertainty_of_readings"] < lead["expanded_uncertainty"]
    assert lead["lower_bound"] is summary["lower_bound"] is True
    in_report = {one["name"]: one["expanded_uncertainty"] for one in summary["single_errors"]}
    assert lead["single_errors"]
    for one in lead["single_errors"]:
        assert one["expanded_uncertainty"] == in_report[one["name"]]


def test_squareness_in_the_page_is_that_of_the_solvers_with_its_digits(page, solved):
    rows = page.tables[f"Squareness, {OF_READINGS}"]
    heads, first, second = rows[:3]
    for result in solved.results:
        short = {"setup_robust": "Setup-robust", "least_squares": "Least squares"}
        if result.method in short:
            column = heads.index(short[result.method])
            found = result.figure("C0Y")
            micro = plus_minus(found.value, found.standard_uncertainty, IN_MICRO)
            arc = plus_minus(found.value, found.standard_uncertainty, ARC_SECONDS)
            assert (first[column], second[column]) == (micro, arc)


def test_table_one_is_that_of_the_result(page, solved):
    rows = page.tables[f"Table 1 (Ibaraki & Hata 2010), over the travel, in µm, {OF_READINGS}"]
    found = solved.preferred().figure("positioning E_XX")
    expected = plus_minus(found.value, found.standard_uncertainty, IN_MICRO)
    assert dict(zip(rows[0], rows[1], strict=True))["Least squares"] == expected
    assert rows[1][0] == "Positioning X, at end"
    assert len(rows) == 1 + 12


def test_the_first_page_says_the_worst_error_and_whether_it_is_allowed(page, document, solved):
    worst = of_result(solved.preferred(), solved.chain)
    expanded = document["summary"]["expanded_uncertainty"]
    budget = make_budget(solved.measurement, load_instrument("demo")[0], "least_squares")
    largest = budget_of_largest_error(solved.preferred(), worst, budget, solved.chain)
    assert expanded == largest.expanded.value
    rows = dict(page.tables["Largest error: standard uncertainty by source, µm"])
    assert rows["expanded U (0.95)"] == with_expanded(0.0, expanded, IN_MICRO).split()[-1]
    (of_x,) = [
        size
        for source, size in zip(budget.sources, largest.contributions, strict=True)
        if source.name == "angular errors of X"
    ]
    assert float(rows["angular errors of X"]) == pytest.approx(of_x * IN_MICRO, abs=5e-5)
    assert expanded > COVERAGE_FACTOR * worst.standard_uncertainty
    size = with_expanded(worst.value, expanded, IN_MICRO)
    assert page.headings[0] == ("The machine conforms to its limit of 50 µm in the measured volume")
    assert f"Largest error in the measured volume: {size} µm at" in page.text
    assert page.facts()["Largest error in the volume"] == f"{size} µm"
    assert "could bring the largest error in the volume" in page.text
    # What is left is uncertain where the errors are known least well, and not by U of the largest.
    (most,) = re.findall(r"up to ([0-9.]+) µm may remain", page.text)
    assert float(most) >= 0.99 * expanded * IN_MICRO
    assert document["summary"]["lower_bound"] is False
    volume = document["sections"]["volume"]
    assert volume["expanded_uncertainty"] == document["summary"]["expanded_uncertainty"]
    in_json = {one["name"]: one for one in document["summary"]["single_errors"]}
    assert len(in_json) == 12
    assert in_json["E_XX"]["value"] == np.ptp(solved.preferred().curves["E_XX"])


def test_the_first_page_ranks_positioning_by_its_range_with_the_larger_uncertainty(page, solved):
    budget = make_budget(solved.measurement, load_instrument("demo")[0], "least_squares")
    found = single_errors(solved.preferred(), budget)
    largest = max(found, key=lambda one: one.value)
    size = with_expanded(largest.value, largest.expanded_uncertainty, IN_MICRO)
    said = page.text.split("Largest single errors")[1]
    assert said.split(": ", 1)[1].startswith(f"{largest.words} {size} µm over")
    for name in ("E_XX", "E_YY", "E_ZZ"):
        (one,) = [one for one in found if one.name == name]
        curve = solved.preferred().curves[name]
        assert one.value == np.ptp(curve)
    rows = page.tables[f"Positioning error, peak to peak over the travel, {OF_READINGS}"]
    of_readings = single_errors(solved.preferred())[0]
    assert dict(zip(rows[0], rows[1], strict=True))["Least squares"] == with_expanded(
        of_readings.value, of_readings.expanded_uncertainty, IN_MICRO
    )
    assert "The values are without pitch, yaw and roll of all axes" in page.text


def test_a_simulated_clock_is_called_one():
    told = datetime(2026, 1, 2, 3, 4, 5, tzinfo=timezone.utc)
    assert _words_of(told, True) == "2026-01-02 03:04:05 UTC (simulated clock)"
    assert _words_of(told, None) == "2026-01-02 03:04:05 UTC"
    assert _words_of(None, True) == "unknown"


def _child_that_draws(process):
    """Wait for the process that draws; None if the command ends before."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    while process.poll() is None:
        for child in children.read_text().split():
            with suppress(OSError):
                if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                    return int(child)
        time.sleep(0.002)
    return None


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
def test_ctrl_c_ends_the_command_in_one_line_and_leaves_nothing(tmp_path):
    """A terminal sends it to all processes of the command, here while the second one begins."""
    command = [sys.executable, "-m", "stepdiag_ros.cli", "report", str(RUN_WITH_READINGS)]
    process = subprocess.Popen(
        [*command, "--output", str(tmp_path / "new")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    child = _child_that_draws(process)
    assert child is not None, process.communicate()
    os.killpg(process.pid, signal.SIGINT)
    said, complaint = process.communicate(timeout=60)
    assert (said, complaint) == ("", "stepdiag: stopped\n")
    assert process.returncode == 130
    assert not Path(f"/proc/{child}").exists()
    assert not list(tmp_path.iterdir())


def test_ctrl_c_waits_until_the_process_that_draws_is_begun():
    """A thread that does not block it, as numerical libraries have them, takes the signal."""
    over = threading.Event()
    other = threading.Thread(target=over.wait)
    other.start()
    begun = False
    try:
        with pytest.raises(KeyboardInterrupt), beside.interrupts_held():
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.05)
            begun = True
    finally:
        over.set()
        other.join()
    assert begun


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="looks for masks in /proc")
def test_the_process_that_draws_never_gets_ctrl_c(tmp_path):
    """From its first instruction on: in an interpreter that has started no other process before."""
    asked = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from stepdiag_ros.report.pages.pictures import studio\n"
        "def blocked(child):\n"
        "    lines = Path(f'/proc/{child}/status').read_text().splitlines()\n"
        "    return int(next(line for line in lines if line.startswith('SigBlk')).split()[1], 16)\n"
        "if __name__ == '__main__':\n"
        "    with studio():\n"
        "        children = Path('/proc/self/task').glob('*/children')\n"
        "        found = [c for path in children for c in path.read_text().split()]\n"
        "        drawing = [c for c in found\n"
        "                   if b'spawn_main' in Path(f'/proc/{c}/cmdline').read_bytes()]\n"
        "        print(len(drawing), all(blocked(c) & 2 for c in drawing))\n"
    )
    (tmp_path / "asked.py").write_text(asked, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "asked.py"], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert done.stdout == "1 True\n", done.stderr


def test_what_the_user_told_is_text_never_markup(page, folder):
    assert page.facts()["Measured by"] == "A. Turner"
    assert page.facts()["Customer"] == "Mill & <Sons>"
    assert "<Sons>" not in (folder / "report.html").read_text(encoding="utf-8")


def test_nodes_are_in_the_page_with_the_uncertainty_of_each(page, solved):
    rows = page.tables[f"Errors as X moves, Least squares, {OF_READINGS}"]
    result = solved.preferred()
    assert [row[0] for row in rows[1:]] == ["0.000", "30.000", "60.000", "90.000", "120.000"]
    last = plus_minus(result.curves["E_XX"][-1], result.standard_uncertainty["E_XX"][-1], IN_MICRO)
    assert rows[-1][1] == last


def test_the_document_has_the_numbers_of_the_page_in_si(document, solved, bag):
    assert document["schema"] == schemas.identifier("report")
    worst = of_result(solved.preferred(), solved.chain)
    summary = document["summary"]
    assert summary["value"] == worst.value
    assert summary["verdict"] == "keeps"
    assert summary["tolerance"] == pytest.approx(50e-6)
    told = document["sections"]
    curves = told["curves"]["methods"]["least_squares"]["curves"]
    assert curves["E_XX"] == list(solved.preferred().curves["E_XX"])
    assert told["measurement"]["bag"] == bag.name
    assert len(told["measurement"]["sha256"]) == 64
    assert told["measurement"]["place"] is None
    # No sensor was recorded, and every line states the air at its stops.
    stops = np.concatenate([line.environment for line in solved.measurement.lines])
    air = told["measurement"]["weather"]["air_temperature"]
    assert (air["mean"], air["values"]) == (pytest.approx(np.mean(stops[:, 0])), len(stops))
    assert {one["name"]: one["passes_complete"] for one in told["readings"]["lines"]} == {
        **dict.fromkeys(("x", "y", "z"), 4),
        **dict.fromkeys(("ppp XYZ", "npp XYZ", "pnp XYZ", "ppn XYZ"), 4),
    }
    assert told["uncertainty"]["instrument"] == "laser interferometer in a good workshop"
    assert told["compensation"]["control"] == "generic"
    assert {test["name"] for test in told["axes"]["tests"] if test["kind"] == "linear"} == set(
        "XYZ"
    )


def test_the_document_fits_its_schema_with_the_documents_in_it(document, validators):
    """Made before the check of all tests begins, so asked for here."""
    assert not list(validators[document["schema"]].iter_errors(document))
    document["sections"]["curves"]["methods"]["least_squares"]["lines"] = "many"
    faults = list(validators[document["schema"]].iter_errors(document))
    place = ["sections", "curves", "methods", "least_squares", "lines"]
    assert [fault.instance_path for fault in faults] == [place]
    document["sections"]["curves"]["methods"]["least_squares"]["lines"] = 28


def test_what_is_not_known_is_gathered(document, page):
    unknown = document["sections"]["unknown"]
    assert unknown["Not stated"] == [
        "Where it was measured (--place).",
        "The number of the machine (--serial).",
        "The laser's certificate (--laboratory).",
    ]
    assert any("weather sensor" in one for one in unknown["Parts that this report lacks"])
    begin = page.headings.index(f"{len(sections_without_archive()) - 1} What is not known") + 1
    assert page.headings[begin : begin + len(unknown)] == list(unknown)
    assert page.facts()["Place"] == "unknown"


@needs_poppler
def test_the_pdf_has_the_sections_page_numbers_and_the_run_on_every_page(folder):
    pages = _text(folder / "report.pdf").split("\f")[:-1]
    assert 5 <= len(pages) <= 12
    for number, text in enumerate(pages, 1):
        assert f"{number} / {len(pages)}" in text, f"page {number}"
        assert f"run {RUN_ID}" in text, f"page {number}"
    whole = " ".join(" ".join(pages).split())
    for number, section in enumerate(sections_without_archive(), 1):
        assert f"{number} {section.title}" in whole
    assert "conforms to its limit of 50 µm" in whole


@needs_poppler
def test_no_words_in_a_picture_are_printed_smaller_than_they_can_be_read(folder, letters):
    """Every picture is printed at its own size or larger, and drawn with letters of 6.5 pt."""
    listed = subprocess.run(
        ["pdfimages", "-list", folder / "report.pdf"], capture_output=True, text=True, check=True
    )
    resolutions = [int(line.split()[12]) for line in listed.stdout.splitlines()[2:]]
    assert len(resolutions) >= 12
    assert max(resolutions) <= pictures.DOTS_PER_INCH
    assert len(letters) > 300
    assert [one for one in letters if one[0] < 6.5] == []


@needs_poppler
def test_the_summary_takes_two_pages_and_its_contents_name_the_page_of_each_annex(folder):
    pages = _text(folder / "report.pdf").split("\f")[:-1]
    assert "Largest error" in pages[0]
    assert "Signatures" in pages[1] and "Conformity" in pages[1]
    named = re.findall(r"(\d+)\. ([^.]+?) *\.{3,} *(\d+)", pages[1])
    assert {int(number): title for number, title, _ in named} == {
        number: section.title for number, section in enumerate(sections_without_archive(), 1)
    }
    for number, title, place in named:
        heading = re.compile(rf"^\s*{number} {re.escape(title)}", re.MULTILINE)
        assert heading.search(pages[int(place) - 1]), title
        assert int(place) >= 3


def test_the_summary_has_every_single_error_the_decision_and_who_signs(page, document, solved):
    rows = page.tables["Errors over the travel, peak to peak (ISO 230-1), U (95 %)"]
    assert [row[0] for row in rows[1:]] == [
        one["name"] for one in document["summary"]["single_errors"]
    ]
    sign = {figure.name: figure.value for figure in solved.preferred().figures}
    for row, one in zip(rows[1:], document["summary"]["single_errors"], strict=True):
        if one["name"] in SQUARENESS:
            # As an angle somebody adjusts by it: the side to which the axis leans is kept.
            assert one["angle"] == sign[one["name"]]
            assert row[3] == with_expanded(
                one["angle"], one["expanded_uncertainty"] / one["travel"], IN_MICRO
            )
        else:
            assert row[3] == "" and one["angle"] is None
        assert row[2] == with_expanded(one["value"], one["expanded_uncertainty"], IN_MICRO)
    assert page.facts()["Decision"] == "the machine conforms"
    assert page.facts()["Largest error allowed"] == "50 µm"
    summary = document["summary"]
    (decision,) = summary["decisions"]
    assert decision["quantity"] == "largest_error_in_volume" and decision["decision"] == "keeps"
    assert decision["value"] == summary["value"] and decision["limit"] == pytest.approx(50e-6)
    assert decision["guard_band"] == decision["expanded_uncertainty"]
    assert decision["expanded_uncertainty"] == summary["expanded_uncertainty"]
    worst = document["sections"]["volume"]["worst"]["methods"][solved.preferred().method]
    assert list(decision["position"].values()) == worst["position"]
    assert decision["diagnosis"] == document["sections"]["discrepancy"]["verdict"]
    assert decision["tested"] is True and decision["basis"] is None
    size = with_expanded(summary["value"], summary["expanded_uncertainty"], IN_MICRO)
    assert f"Largest error {size} µm (U: 95 %) at X " in page.text
    signed = [row for rows in page.tables.values() for row in rows if "date, signature" in row]
    assert [row[1] for row in signed] == ["A. Turner", "", "Mill & <Sons>"]


def test_what_proves_the_software_comes_last_and_keeps_its_place_in_the_document(page, document):
    assert sections()[-1].name == "table_one"
    assert list(document["sections"]).index("table_one") == 3
    begin = page.text.index(f"{len(sections_without_archive())} Proofs of the software")
    assert page.text.index("Table 1 (Ibaraki & Hata 2010)") > begin


def test_a_folder_that_cannot_be_written_is_refused_before_any_work(bag, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("", encoding="utf-8")
    monkeypatch.setattr("stepdiag_ros.bags.run.load_run", None)
    asked = ["report", str(bag), "--json", "--output"]
    assert main([*asked, str(tmp_path / "file")]) != 0
    assert main([*asked, str(tmp_path / "file" / "deeper")]) != 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


def test_trying_a_folder_leaves_nothing_behind(tmp_path):
    try_folder(tmp_path / "new" / "deeper")
    assert not list(tmp_path.iterdir())
    (tmp_path / "old").mkdir()
    try_folder(tmp_path / "old")
    assert not list((tmp_path / "old").iterdir())


def test_the_lead_is_printed_even_where_no_file_can_be_written(bag, tmp_path, capsys, monkeypatch):
    def full(path):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr("stepdiag_ros.report.pages.build.whole_file", full)
    assert main(["report", str(bag), "--json", "--output", str(tmp_path / "new")]) != 0
    said = capsys.readouterr()
    assert "Largest error in the measured volume" in said.out
    assert "no space left on device" in said.err


@needs_poppler
def test_nothing_in_the_pdf_runs_off_the_paper(folder):
    boxes = subprocess.run(
        ["pdftotext", "-bbox", folder / "report.pdf", "-"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    width = float(re.search(r'<page width="([\d.]+)"', boxes).group(1))
    ends = [float(end) for end in re.findall(r'<word xMin="[\d.]+".*? xMax="([\d.]+)"', boxes)]
    assert len(ends) > 1000
    assert max(ends) < width - 20.0


@needs_poppler
def test_the_pdf_has_every_picture_of_the_page_at_its_own_size(folder, page):
    listed = subprocess.run(
        ["pdfimages", "-list", folder / "report.pdf"], capture_output=True, text=True, check=True
    ).stdout.splitlines()[2:]
    drawn = Counter(tuple(int(size) for size in line.split()[3:5]) for line in listed)
    files = [b64decode(source.partition(",")[2]) for source in page.sources]
    assert len(files) > 5
    assert drawn == Counter(Image.open(BytesIO(data)).size for data in files)


@needs_poppler
def test_the_pictures_of_the_pdf_are_those_of_the_page_in_every_pixel(folder, page, tmp_path):
    subprocess.run(["pdfimages", "-png", folder / "report.pdf", tmp_path / "picture"], check=True)
    placed = Counter(_pixels(path.read_bytes()) for path in tmp_path.glob("picture-*.png"))
    drawn = Counter(_pixels(b64decode(source.partition(",")[2])) for source in page.sources)
    assert len(drawn) > 5
    assert placed == drawn


def _pixels(png):
    image = Image.open(BytesIO(png))
    return image.size, image.convert("RGB").tobytes()


def _text(path):
    return subprocess.run(
        ["pdftotext", "-layout", path, "-"], capture_output=True, text=True, check=True
    ).stdout


@pytest.mark.parametrize("wanted", ["html", "json", "pdf"])
def test_one_format_alone(bag, tmp_path, wanted, capsys, monkeypatch):
    monkeypatch.setattr(pictures.Studio, "fetch_all", lambda _: {})
    assert main(["report", str(bag), f"--{wanted}", "--output", str(tmp_path / "new")]) == 0
    assert [path.name for path in (tmp_path / "new").iterdir()] == [f"report.{wanted}"]
    said = capsys.readouterr()
    assert "Largest error in the measured volume" in said.out
    assert f"report in {tmp_path / 'new'}: report.{wanted}" in said.err


@needs_poppler
def test_no_page_parts_a_table_from_its_title_or_from_its_first_rows(folder):
    titles = (
        f"Table 1 (Ibaraki & Hata 2010), over the travel, in µm, {OF_READINGS}",
        "What is known of the inputs",
        f"Volumetric accuracy, {OF_READINGS}",
        "Methods",
    )
    found = 0
    for text in _text(folder / "report.pdf").split("\f"):
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        for place, line in enumerate(lines):
            if line in titles:
                found += 1
                # Its heads, two rows at least, and the foot of the page.
                assert len(lines) - place >= 5, line
    assert found == len(titles)


def test_readings_of_a_few_stops_are_drawn_where_the_bag_holds_them(bag):
    run = open_run(RUN_WITH_READINGS)
    shown, stops = _few_stops(SimpleNamespace(recorded=run))
    assert [one.command.stop for one in stops] == [1, 2, 3]
    assert len({one.line for one in stops}) == 1
    for one in stops:
        inside = [got for got in shown if one.window_start <= got.time <= one.window_end]
        mean = sum(got.compensated_displacement for got in inside) / len(inside)
        assert mean == pytest.approx(one.displacement, abs=1e-12)
    assert len(shown) < sum(1 for _ in run.readings()), "only those around the stops"
    assert _few_stops(SimpleNamespace(recorded=open_run(bag))) is None
