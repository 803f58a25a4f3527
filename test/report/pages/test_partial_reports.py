"""Reports of runs that lack much, and of what is no run at all."""

import builtins
import json
import pickle
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from io import BytesIO
from math import isnan
from pathlib import Path
from types import SimpleNamespace

import pytest
from PIL import Image
from refused import refused
from report.pages.page_reading import ReadPage, sections_without_archive
from report.pages.written_runs import with_backlash_of_x, write_lines
from standard_runs import measured, write_bag

from stepdiag_ros.bags.run import load_run
from stepdiag_ros.cli import main
from stepdiag_ros.commands.solve import report_of
from stepdiag_ros.evaluation.lead import RunLead
from stepdiag_ros.metrology.credibility import Misfit
from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    CONSISTENT,
    NAMED,
    NOT_TESTABLE,
    UNEXPLAINED,
)
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.effects import backlash
from stepdiag_ros.metrology.refusal import Refusal, Unusable
from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.report.pages import material, pictures
from stepdiag_ros.report.pages.given import Given
from stepdiag_ros.report.pages.lead import (
    EXCEEDS,
    KEEPS,
    NOT_ASKED,
    OPEN,
    ToleranceJudgement,
    judge,
)
from stepdiag_ros.report.pages.page import chapter, page
from stepdiag_ros.report.pages.pictures import Drawing, Drawn, Studio, draw, studio
from stepdiag_ros.report.pages.sections.measurement import condition_facts
from stepdiag_ros.report.pages.summary import DECISIONS, TITLE_OF_ERRORS, _decision
from stepdiag_ros.text.table import Column, Table

HEAD = """\
name: part of a run
step_m: [0.03, 0.02, 0.025]
blocks: 3
feed_m_per_s: 0.05
"""
PARTS = {
    "one axis, once": "lines:\n  - {kind: linear, names: [x]}\n",
    "three step diagonals, once": "lines:\n  - {kind: step_diagonal, names: [ppp, npp, pnp]}\n",
    "body diagonals at once": "repeats: 2\ndirections: [forward, backward]\n"
    "lines:\n  - {kind: diagonal, names: [ppp, npp, pnp, ppn]}\n",
}


class _Here(Studio):
    """Draws in this process what has gone the way to another one."""

    def ask(self, chapter, drawings):
        super().ask(chapter, pickle.loads(pickle.dumps(dict(drawings))))


@contextmanager
def here(beside=True):
    del beside
    yield _Here()


@pytest.fixture(scope="module", autouse=True)
def drawn_here():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "studio", here)
        yield


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    folder = tmp_path_factory.mktemp("parts")
    found = {}
    for name, lines in PARTS.items():
        bag = folder / f"{name.replace(' ', '_').replace(',', '')}.mcap"
        write_bag(bag, HEAD + lines)
        assert main(["report", str(bag), "--html", "--json"]) == 0, name
        made = bag.with_name(f"{bag.stem}_report")
        found[name] = (
            ReadPage((made / "report.html").read_text(encoding="utf-8")),
            json.loads((made / "report.json").read_text(encoding="utf-8")),
        )
    return found


@pytest.mark.parametrize("name", PARTS)
def test_every_section_says_something(parts, name, validators):
    told, document = parts[name]
    assert not list(validators[document["schema"]].iter_errors(document))
    numbered = [text for text in told.headings if text[0].isdigit()]
    assert len(numbered) == len(sections_without_archive())
    assert "nan" not in told.text.lower().split()
    facts = told.facts()
    assert facts["Largest error allowed"] == "not agreed"
    assert facts["Largest error in the volume"] == facts["Largest error ± U (95 %)"]
    assert "None" not in told.text.split()


def test_one_axis_has_its_test_and_nothing_else_is_claimed(parts):
    told, document = parts["one axis, once"]
    assert document["sections"]["volume"] is None or document["summary"]["value"] is None
    assert document["summary"]["verdict"] == "not asked"
    assert "No diagonal was measured completely" in told.text
    assert "how far readings repeat is unknown" in told.text
    assert document["sections"]["readings"]["repeats"]["standard_deviation_of_a_reading"] is None
    assert document["sections"]["table_one"] is None
    assert document["sections"]["compensation"] is None
    assert told.facts()["Measured box"] == "X 0 to 90 mm, at Y 0, Z 0 mm"
    assert not told.facts()["A stop"].startswith("unknown")
    (errors,) = (rows for title, rows in told.tables.items() if title.startswith(TITLE_OF_ERRORS))
    travels = {row[0]: row[-1] for row in errors[1:]}
    assert {name for name, text in travels.items() if text == "90"} == {"E_XX", "E_YX", "E_ZX"}
    assert {text for text in travels.values() if text != "90"} == {"not moved"}
    assert told.headings[0] in (
        "This run determines only some of the machine's errors",
        "This run does not determine the machine's errors",
    )


def test_diagonals_without_lines_say_that_no_axis_was_measured(parts):
    told, document = parts["body diagonals at once"]
    assert "No axis was measured along its own line" in told.text
    assert document["sections"]["axes"]["diagonals"][0]["place"] == "body diagonals"
    assert "ISO 230-6: body diagonals" in told.tables


def test_a_plan_that_was_left_early_names_what_is_missing(tmp_path):
    text = f"{HEAD}lines:\n  - {{kind: linear, names: [x, y, z]}}\n"
    _, measurement = measured(text)
    write_lines(tmp_path / "early.mcap", text, measurement.lines[:1])
    assert main(["report", str(tmp_path / "early.mcap"), "--json"]) == 0
    document = json.loads((tmp_path / "early_report" / "report.json").read_text(encoding="utf-8"))
    unknown = document["sections"]["unknown"]
    assert "y: 0 of 1 passes are complete." in unknown["Not measured"]
    assert "z: 0 of 1 passes are complete." in unknown["Not measured"]
    assert "The bag does not describe the machine." in unknown["Parts that this report lacks"]
    assert document["sections"]["curves"]["run"]["chain"] is None


def test_an_effect_that_the_run_names_is_told_on_the_first_page_and_drawn(tmp_path):
    text = (
        f"{HEAD}repeats: 2\ndirections: [forward, backward]\noverrun_m: 0.002\nlines:\n"
        "  - {kind: linear, names: [x, y, z]}\n"
        "  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn]}\n"
    )
    _, measurement = measured(text)
    bag = tmp_path / "hidden.mcap"
    write_lines(bag, text, with_backlash_of_x(measurement, 2e-6), "name: mill\nchain: YXZ\n")
    with pytest.MonkeyPatch.context() as patch:
        # What the whole catalogue finds is the engine's own test.
        patch.setattr(material, "catalogue", lambda: {backlash.EFFECT.name: backlash.EFFECT})
        assert main(["report", str(bag), "--html", "--json", "--tolerance", "500"]) == 0
    told = ReadPage((tmp_path / "hidden_report" / "report.html").read_text(encoding="utf-8"))
    document = json.loads((tmp_path / "hidden_report" / "report.json").read_text(encoding="utf-8"))
    (found,) = document["sections"]["discrepancy"]["findings"]
    assert found["label"] == "backlash of X"
    low, high = found["sizes"][0]["band_95"]
    assert low < 2e-6 < high
    assert "What to do: see to backlash of X" in told.text
    # However wide the limit is: what is missing in the figures is not known by them.
    assert "no decision at 500 µm, since the rule of ISO 14253-1" in told.text
    assert document["summary"]["verdict"] == OPEN and document["summary"]["more_acts"] is True
    assert "NAMED" in told.headings
    assert "What is missing in the model" in told.tables
    assert "No picture:" not in told.text


@pytest.mark.parametrize(
    ("value", "u", "tolerance", "verdict"),
    [
        (10e-6, 1e-6, 10e-6 + COVERAGE_FACTOR * 1e-6, KEEPS),
        (10e-6, 1e-6, 11e-6, OPEN),
        (10e-6, 1e-6, 9e-6, OPEN),
        (10e-6, 1e-6, 8e-6, EXCEEDS),
        (10e-6, 1e-6, float("nan"), NOT_ASKED),
        (10e-6, float("nan"), 50e-6, OPEN),
        (float("nan"), float("nan"), 50e-6, OPEN),
    ],
)
def test_a_limit_is_kept_or_exceeded_only_with_the_uncertainty(value, u, tolerance, verdict):
    given = SimpleNamespace(tolerance=tolerance)
    found = SimpleNamespace(
        accuracy=VolumetricAccuracy(value, (0.0,) * 3, (0.0,) * 3),
        expanded_uncertainty=COVERAGE_FACTOR * u,
        lower_bound=False,
        given=given,
        lead=RunLead(),
    )
    assert judge(found).verdict == verdict
    found.accuracy, found.expanded_uncertainty, given.tolerance = None, float("nan"), 1.0
    assert judge(found).verdict == OPEN


@pytest.mark.parametrize("lower_bound", [True, False])
def test_a_lower_bound_of_the_uncertainty_is_called_one_everywhere(lower_bound):
    judged = ToleranceJudgement(OPEN, 10e-6, 1e-6, lower_bound, 50e-6, False, False)
    assert ("lower bound" in judged.size) == lower_bound and "10.0 ± 1.0 µm" in judged.size


@pytest.mark.parametrize("lower_bound", [True, False])
@pytest.mark.parametrize("verdict", [KEEPS, EXCEEDS, OPEN])
def test_what_is_signed_has_the_reservation_of_the_first_page(verdict, lower_bound):
    judged = ToleranceJudgement(verdict, 10e-6, 1e-6, lower_bound, 50e-6, False, False)
    nothing_stated = SimpleNamespace(given=SimpleNamespace(instrument_source=""))
    signed = _decision(nothing_stated, judged)
    assert signed.startswith(DECISIONS[verdict])
    reserved = lower_bound and verdict != OPEN
    assert bool(judged.reservation) == reserved == (signed != DECISIONS[verdict])
    assert judged.reservation in signed and ("instrument" in signed) == reserved


@pytest.mark.parametrize("verdict", [KEEPS, EXCEEDS, OPEN, NOT_ASKED])
def test_a_decision_that_no_reading_tested_says_on_what_it_rests(verdict):
    tolerance = float("nan") if verdict == NOT_ASKED else 50e-6
    tested = ToleranceJudgement(verdict, 10e-6, 1e-6, False, tolerance, False, False)
    untested = replace(tested, tested=False)
    nothing_stated = SimpleNamespace(given=SimpleNamespace(instrument_source=""))
    decided = verdict in (KEEPS, EXCEEDS)
    assert not tested.reservation and not tested.basis
    assert bool(untested.reservation) == untested.decided == decided
    assert "no reading" in untested.basis
    signed = _decision(nothing_stated, untested)
    assert (untested.basis in signed) == decided and ("instrument" in signed) is False
    assert _decision(nothing_stated, tested) == DECISIONS[verdict]
    unknown = replace(untested, value=float("nan"), verdict=OPEN)
    assert not unknown.basis and not unknown.reservation
    assert isnan(tested.guard_band) if verdict == NOT_ASKED else tested.guard_band == 1e-6


@pytest.mark.parametrize("tolerance", [50e-6, 1e-6])
@pytest.mark.parametrize("acts", [NAMED, AMBIGUOUS, UNEXPLAINED, CONSISTENT, NOT_TESTABLE])
def test_no_run_that_shows_more_than_the_error_curves_decides_on_a_limit(acts, tolerance):
    found = SimpleNamespace(
        accuracy=VolumetricAccuracy(10e-6, (0.0,) * 3, (0.0,) * 3),
        expanded_uncertainty=1e-6,
        lower_bound=False,
        given=SimpleNamespace(tolerance=tolerance),
        lead=RunLead(Verdict(acts, "so it is")),
    )
    judged = judge(found)
    alone = KEEPS if tolerance == 50e-6 else EXCEEDS
    assert judged.verdict == (alone if acts in (CONSISTENT, NOT_TESTABLE) else OPEN)
    assert judged.more_acts == (judged.verdict == OPEN)
    assert judged.tested == (acts != NOT_TESTABLE)
    found.lead = RunLead(Verdict(acts, "so it is", contained=True))
    assert judge(found).verdict == alone
    # Errors that do not explain the readings beyond rotations prove nothing.
    found.lead = RunLead(Verdict(acts, "so it is", contained=True), misfit=Misfit.SHOWN)
    assert judge(found).verdict == OPEN


def test_noise_exceeds_no_limit():
    found = SimpleNamespace(
        accuracy=VolumetricAccuracy(0.15e-6, (0.0,) * 3, (0.0,) * 3),
        expanded_uncertainty=0.09e-6,
        lower_bound=False,
        given=SimpleNamespace(tolerance=0.05e-6),
        lead=RunLead(noise=False),
    )
    assert judge(found).verdict == EXCEEDS
    found.lead = RunLead(noise=True)
    assert judge(found).verdict == OPEN and judge(found).noise
    found.given.tolerance = 1e-6
    assert judge(found).verdict == KEEPS


@pytest.mark.parametrize(
    ("tolerance", "written"),
    [(25e-6, "25 µm"), (7.29e-6, "7.29 µm"), (0.05e-6, "0.05 µm"), (1.2345e-3, "1234.5 µm")],
)
def test_a_limit_is_written_as_it_was_given(tolerance, written):
    assert ToleranceJudgement(OPEN, 1.0, 0.1, False, tolerance, False, False).limit == written


def _refused(capsys, *arguments):
    assert main(["report", *map(str, arguments)]) == 1
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1, said
    return said[0]


def test_what_is_no_bag_is_refused_in_a_sentence_and_nothing_is_written(tmp_path, capsys):
    assert "nowhere.mcap" in _refused(capsys, tmp_path / "nowhere.mcap")
    text = tmp_path / "text.mcap"
    text.write_text("no bag\n")
    assert "text.mcap" in _refused(capsys, text)
    assert [path.name for path in tmp_path.iterdir()] == ["text.mcap"]


def test_a_folder_without_permission_is_refused_with_what_to_do(tmp_path, capsys, monkeypatch):
    bag = tmp_path / "run.mcap"
    write_bag(bag, HEAD + PARTS["one axis, once"])

    def forbidden(self, **_):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "mkdir", forbidden)
    said = _refused(capsys, bag, "--json")
    assert said.endswith("cannot be made: Permission denied; name another one with --output FOLDER")


def test_a_folder_that_is_a_file_is_refused(tmp_path, capsys):
    bag = tmp_path / "run.mcap"
    write_bag(bag, HEAD + PARTS["one axis, once"])
    said = _refused(capsys, bag, "--json", "--output", bag)
    assert said.endswith(f"{bag} is a file; results need a folder")


def test_a_tolerance_that_is_no_number_is_wrong_usage(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["report", str(tmp_path / "run.mcap"), "--tolerance", "tight"])
    assert ended.value.code == 2
    assert "'tight' is not a number" in capsys.readouterr().err


def test_without_the_pdf_library_a_sentence_says_what_to_install(tmp_path, capsys, monkeypatch):
    bag = tmp_path / "run.mcap"
    write_bag(bag, HEAD + PARTS["one axis, once"])
    imported = builtins.__import__

    def lacking(name, *rest, **more):
        if name.split(".")[0] == "weasyprint":
            raise OSError("cannot load library 'libpango-1.0-0'")
        return imported(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", lacking)
    said = _refused(capsys, bag, "--html", "--pdf")
    assert "PDF cannot be made here" in said and "libpango-1.0-0" in said and "--html" in said
    assert not (tmp_path / "run_report").exists(), "something was written though one file failed"


def test_a_table_that_is_long_is_left_out_of_print_and_says_so():
    def made(count, for_print):
        rows = [(str(number),) for number in range(count)]
        view = Table("Numbers", [Column("n", number=True)], rows)
        told = {"taken": view, "repeats": [], "no_repeats": []}
        return str(chapter("k", "K", ["sections/readings.html"], told, {}, for_print).html)

    assert made(31, for_print=False).count("<td") == 31
    assert made(30, for_print=True).count("<td") == 30
    printed = made(31, for_print=True)
    assert printed.count("<td") == 0
    assert "Numbers: 31 rows, in the page (HTML) and in the JSON document." in printed


def test_a_page_of_an_unknown_tone_is_refused():
    with refused(Refusal, "unknown", "gay"):
        page("t", "s", SimpleNamespace(tone="gay"), [], "f")


def test_a_plot_with_nothing_to_show_says_so_in_its_place():
    drawn = draw(Drawing("weather", ([],), "Weather."), "any")
    assert drawn is None or (drawn.source == "" and drawn.caption)
    values = {"taken": Table("", []), "repeats": [], "no_repeats": []}
    pictures_of = {"lines": Drawn("there is no line")}
    html = str(chapter("k", "K", ["sections/readings.html"], values, pictures_of).html)
    assert "No picture: there is no line" in html
    assert "<img" not in html


def test_pictures_are_drawn_in_a_process_of_their_own():
    with studio() as atelier:
        machines = Drawing("diagonals_alone", (), "Three machines.")
        atelier.ask("any", {"machines": machines, "nothing": Drawing("weather", ([],), "Weather.")})
        drawn = atelier.fetch_all()["any"]
        png = drawn["machines"].fetch()
    assert Image.open(BytesIO(png)).size == drawn["machines"].size.dots
    assert drawn["machines"].source.startswith("data:image/png;base64,")
    assert drawn["machines"].caption == "Three machines."
    assert "nothing" not in drawn or not drawn["nothing"].source


def test_the_end_of_the_process_that_draws_is_told():
    class Pool:
        def submit(self, *work):
            del work
            return SimpleNamespace(cancel=lambda: False, result=self.ended)

        def ended(self):
            raise BrokenProcessPool

    atelier = Studio(Pool())
    atelier.ask("any", {"weather": Drawing("weather", ([],), "")})
    with refused(Unusable, "stopped"):
        atelier.fetch_all()


def test_a_test_of_an_axis_at_uneven_targets_is_still_reported(tmp_path):
    bag = tmp_path / "axis.mcap"
    table = Path(__file__).parents[2] / "data" / "imports" / "made_up_axis.rtl"
    assert main(["import", str(table), str(bag)]) == 0
    assert main(["report", str(bag), "--html", "--json"]) == 0
    folder = tmp_path / "axis_report"
    told = ReadPage((folder / "report.html").read_text(encoding="utf-8"))
    document = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    (test,) = document["sections"]["axes"]["tests"]
    assert test["name"] == "X" and test["parameters"]["A"]["value"] > 0.0
    assert document["summary"]["value"] is None
    # The first page leads with what the standard asks for, and says once what is not evaluated.
    facts, parameters = told.facts(), test["parameters"]
    for name in ("A", "R", "E", "M", "B"):
        shown = float(facts[name].split()[0])
        assert shown == pytest.approx(parameters[name]["value"] * 1e6, abs=1e-3)
    assert told.headings[0].startswith("ISO 230-2: X A = ")
    said = document["summary"]["sentences"]
    assert said[0].startswith("ISO 230-2, axis X")
    assert sum("need evenly spaced targets" in text for text in said) == 1
    assert "NOT DIAGNOSED" not in " ".join(said) and "not a node" not in told.text
    assert "how far readings repeat is unknown" not in told.text
    assert document["sections"]["curves"]["lead"]["verdict"]["name"] == "NOT DIAGNOSED"
    # Nobody measured a box, nor states how the readings at a stop were taken.
    assert facts["Measured box"] == "X -400 to 0 mm, at Y 0, Z 0 mm"
    assert facts["A stop"].startswith("unknown")


def test_a_test_of_an_axis_at_even_targets_leads_with_the_standard_too(tmp_path, capsys):
    text = f"{HEAD}repeats: 5\ndirections: [forward, backward]\noverrun_m: 0.002\n"
    bag = tmp_path / "axis.mcap"
    write_bag(bag, f"{text}lines:\n  - {{kind: linear, names: [x]}}\n")
    assert main(["report", str(bag), "--html", "--json"]) == 0
    folder = tmp_path / "axis_report"
    told = ReadPage((folder / "report.html").read_text(encoding="utf-8"))
    document = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    (test,) = document["sections"]["axes"]["tests"]
    facts, parameters = told.facts(), test["parameters"]
    for name in ("A", "R", "E", "M", "B"):
        shown = float(facts[name].split()[0])
        assert shown == pytest.approx(parameters[name]["value"] * 1e6, abs=1e-3)
    assert told.headings[0].startswith("ISO 230-2: X A = ")
    said = document["summary"]["sentences"]
    verdict = document["sections"]["discrepancy"]["verdict"]
    places = [number for number, one in enumerate(said) if one.startswith(verdict)]
    assert said[0].startswith("ISO 230-2, axis X") and places and places[0] > 0
    assert not any("need evenly spaced targets" in one for one in said)
    capsys.readouterr()
    assert main(["solve", str(bag), "--json", "--pictures", "none"]) == 0
    lead = json.loads(capsys.readouterr().out)["lead"]
    assert lead["sentences"][0] == said[0]
    assert lead["next"][0]["command"].startswith("stepdiag iso230")


def test_a_positioning_error_has_no_smaller_u_than_iso_230_2_states_for_it(tmp_path):
    text = f"{HEAD}repeats: 5\ndirections: [forward, backward]\noverrun_m: 0.002\n"
    bag, conditions = tmp_path / "axis.mcap", tmp_path / "conditions.yaml"
    write_bag(bag, f"{text}lines:\n  - {{kind: linear, names: [x]}}\n")
    conditions.write_text(
        "device_U_m_per_m: 1.0e-4\nmisalignment_m: 0.0\ntemperature_range_K: 0.5\n"
        "expansion_coefficient_per_K: 11.5e-6\nexpansion_range_per_K: 2.0e-6\n"
        "temperature_difference_K: 0.9\nenvironmental_variation_m: 0.5e-6\n"
    )
    assert main(["report", str(bag), "--json", "--uncertainty", str(conditions)]) == 0
    document = json.loads((tmp_path / "axis_report" / "report.json").read_text(encoding="utf-8"))
    (test,) = document["sections"]["axes"]["tests"]
    (error,) = (one for one in document["summary"]["single_errors"] if one["name"] == "E_XX")
    stated = test["parameters"]["M"]["expanded_uncertainty"]
    assert stated > 5e-6
    assert error["expanded_uncertainty"] == pytest.approx(stated)
    said = " ".join(document["summary"]["sentences"])
    assert "Nothing was stated" not in said and "--uncertainty" in said


def test_what_the_source_states_stands_in_the_fields_of_the_report(tmp_path):
    bag = tmp_path / "axis.mcap"
    write_bag(bag, HEAD + PARTS["one axis, once"])
    stated = {
        "machine_serial_number": "0815-47",
        "instrument": "counter X",
        "instrument_serial_number": "12-3",
        "test_date": "2026-11-28",
    }
    run, report = load_run(bag), report_of(bag, with_visibility=True)
    imported = material.Material(replace(run, told_by_source=stated), report, Given())
    facts = {fact.name: fact.text for fact in condition_facts(imported)}
    assert facts["Machine number"] == "0815-47"
    assert (facts["Instrument"], facts["Laser number"]) == ("counter X", "12-3")
    assert "2026" in facts["Begun"]
    silent = material.Material(replace(run, told_by_source={}), report, Given(laser_serial="7"))
    facts = {fact.name: fact.text for fact in condition_facts(silent)}
    assert (facts["Instrument"], facts["Laser number"]) == ("unknown", "7")
