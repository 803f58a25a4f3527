"""``stepdiag changes``: two measurements beside each other, in tables, JSON and as a page."""

import json
import shutil
from argparse import ArgumentParser
from dataclasses import replace
from html import unescape
from io import StringIO

import numpy as np
import pytest
import standard_runs

from stepdiag_ros import cli, schemas
from stepdiag_ros.commands import changes as command
from stepdiag_ros.commands.arguments import CommandParser
from stepdiag_ros.commands.solve import report_of
from stepdiag_ros.evaluation.changes import ChangesReport
from stepdiag_ros.metrology.agreement import compare
from stepdiag_ros.metrology.agreement.shared import UNSEEN_ANGLES
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.report.documents.run import report_json
from stepdiag_ros.report.pages import changes as changes_page
from stepdiag_ros.report.tables.changes import print_changes
from stepdiag_ros.text.console import make_console
from stepdiag_ros.text.numbers import plus_minus
from stepdiag_ros.words.changes import remarks_of, sentences_of, uncertainty_words, verdict

pytestmark = pytest.mark.usefixtures("kept_results")

STEPS = """\
name: step diagonals
step_m: [0.03, 0.02, 0.025]
blocks: 4
repeats: 1
overrun_m: 0.002
directions: [forward, backward]
feed_m_per_s: 0.05
lines:
  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn], orders: [XYZ]}
  - {kind: linear, names: [x, y, z]}
"""


def write(path, number, plan=STEPS, **options):
    """Write the bag of a run of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(standard_runs, "RUN_ID", f"2026010{number}T030405-abcd")
        return standard_runs.write_bag(path, plan, **options)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("bags")


@pytest.fixture(scope="module")
def before(folder):
    return write(folder / "before.mcap", 1)


@pytest.fixture(scope="module")
def after(folder):
    """Return the same machine after its squareness was compensated."""
    return write(folder / "after.mcap", 2, squareness=(0.5e-6, 0.0, 0.0))


def stepdiag(capsys, *arguments):
    code = cli.main([str(argument) for argument in arguments])
    said = capsys.readouterr()
    return code, said.out, said.err


def compared(*arguments) -> ChangesReport:
    parser = ArgumentParser()
    command.COMMAND.add_parser(parser.add_subparsers(parser_class=CommandParser))
    given = ["changes", *(str(argument) for argument in arguments)]
    return command.report_of(parser.parse_args(given))


@pytest.fixture(scope="module")
def report(before, after):
    return compared(before, after)


def test_the_document_holds_what_both_results_say(capsys, before, after):
    code, out, err = stepdiag(capsys, "changes", before, after, "--json")
    document = json.loads(out)
    assert code == 0 and not err
    assert document["schema"] == schemas.identifier("changes")
    assert document["before"]["run_id"] == "20260101T030405-abcd"
    assert document["after"]["file"] == "after.mcap"
    figures = {one["name"]: one for one in document["figures"]}
    by_readings = []
    for source, when in ((before, "before"), (after, "after")):
        result = report_of(source).preferred()
        by_readings.append(np.diag(result.readings_covariance))
        for name in ("C0Y", "positioning E_XX", "straightness E_YX", "diagonal ppp"):
            told = result.figure(name)
            assert figures[name][when] == told.value
            assert figures[name][f"{when}_standard_uncertainty"] == told.standard_uncertainty
        for name, values in result.curves.items():
            assert document["curves"][name][when] == values.tolist()
        # Left-out rotations act at the place itself.
        alone = of_result(result, "YXZ").at_the_place
        told = document["volume"]["worst"][f"{when}_standard_uncertainty"]
        assert alone < told == pytest.approx(alone, rel=0.01)
    one = figures["C0Y"]
    u = one["difference_standard_uncertainty"]
    assert one["difference"] == one["after"] - one["before"]
    assert one["normalised_error"] == pytest.approx(one["difference"] / (2.0 * u))
    # Rotations that neither run shows are the same in both: what is left is the readings' scatter.
    apart = np.hypot(one["before_standard_uncertainty"], one["after_standard_uncertainty"])
    assert 0.0 < u < 0.5 * apart
    told = [document["curves"][name]["difference_standard_uncertainty"] for name in result.curves]
    np.testing.assert_allclose(
        np.concatenate(told), np.sqrt(sum(by_readings)), rtol=1e-6, atol=1e-12
    )
    assert document["verdict"] == "better"
    assert "times better" in document["words"][0]
    assert document["joint"]["probability"] < 1e-6
    assert document["curves"]["E_XY"]["changed"] and not document["curves"]["E_XX"]["changed"]
    assert document["uncertainty"]["shared"] == [UNSEEN_ANGLES]
    assert UNSEEN_ANGLES in " ".join(document["uncertainty"]["words"])
    assert {"mean reversal X", "mean reversal Y", "mean reversal Z"} <= set(figures)


def test_better_worse_and_no_change_are_told_apart(capsys, tmp_path, before, after):
    code, out, _ = stepdiag(capsys, "changes", after, before)
    assert code == 0 and "times WORSE" in out and "the machine has changed" in out
    assert "Changed: squareness C0Y, B0Z, A0Z. Clearest: squareness " in out
    assert "E_XY changed most: -" in out and "squareness C0Y" in out and "arcsec" in out
    again = write(tmp_path / "again.mcap", 3, seed=9)
    code, out, _ = stepdiag(capsys, "changes", before, again)
    assert "no significant change" in out
    assert "as chance has it" in out and "changed most:" not in out
    assert "no proof of a change" in out


def test_a_reversal_that_changed_is_told_in_every_sentence(capsys, tmp_path, monkeypatch, before):
    measured = standard_runs.measured

    def unlike(*arguments, **options):
        plan, measurement = measured(*arguments, **options)
        lines = tuple(
            replace(line, displacement=line.displacement + (-2e-6, 2e-6)[back] / 4.0)
            if (line.line.kind, line.line.name) == ("linear", "x")
            else line
            for line in measurement.lines
            for back in [line.line.direction == "backward"]
        )
        return plan, replace(measurement, lines=lines)

    with monkeypatch.context() as patch:
        patch.setattr(standard_runs, "measured", unlike)
        loose = write(tmp_path / "loose.mcap", 8, seed=9)
    code, out, _ = stepdiag(capsys, "changes", before, loose)
    assert code == 0 and "no proof of a change" not in out
    assert "The volume's rms error was" in out and "Other figures have changed." in out
    assert "chance does not explain that: the machine has changed" in out
    [told] = [line for line in out.splitlines() if line.startswith("Changed: reversal of X, from ")]
    assert " to -1.0" in told and told.endswith(").") and "µm (E_n = -" in told
    assert "Changed: the curves" not in out and "changed most: " not in out
    report = compared(before, loose)
    found = verdict(report.changes)
    assert found.kind == "other" and found.headline.startswith(
        "Changed, but the volume is neither better nor"
    )
    monkeypatch.setattr(changes_page, "_pictures", lambda _: {})
    html = unescape(changes_page.ChangesPage(report).html())
    # Beside the headline, and where it is told what changed.
    assert found.headline in html and html.count(told) == 2
    # A result without its lines tells no reversal, and so no change.
    document = tmp_path / "loose.json"
    document.write_text(report_json(report_of(loose)))
    assert verdict(compared(before, document).changes).kind == "unknown"


def test_what_is_left_may_be_nothing(tmp_path, monkeypatch, before):
    def perfect(**options):
        made = cell(**options)
        none = tuple(np.zeros_like(values) for values in made.errors.values)
        return replace(made, errors=replace(made.errors, values=none))

    cell = standard_runs.cell
    monkeypatch.setattr(standard_runs, "cell", perfect)
    changes = compared(before, write(tmp_path / "perfect.mcap", 4)).changes
    found = verdict(changes)
    assert found.kind == "better" and found.headline.startswith("At least ")
    # Each error vector is uncertain by more than what is left; how uncertain the rms is differs.
    assert changes.rms.after < 2.0 * changes.rms_noise[1]
    assert f"{2.0 * changes.rms_noise[1] * IN_MICRO:.3f} µm" in found.sentence


def test_the_text_writes_every_figure_with_its_uncertainty(report):
    text = StringIO()
    print_changes(report, make_console(text))
    for one in (report.changes.rms, report.changes.worst, *report.changes.figures):
        row = next(line for line in text.getvalue().splitlines() if one.name in line)
        assert plus_minus(one.difference, one.difference_uncertainty, IN_MICRO) in row
        cells = row.split()
        # How many times smaller is only said of a figure that is another one.
        assert (cells[-3] == "-") == (not one.changed) == (cells[-1] == "no")
    assert sum(one.changed for one in report.changes.figures) > 1
    assert "taken as independent" in text.getvalue()


def test_a_result_without_its_bag_tells_single_nodes(capsys, tmp_path, before, after, report):
    path = tmp_path / "results.json"
    path.write_text(report_json(report_of(after)))
    code, out, _ = stepdiag(capsys, "changes", before, path, "--json")
    document = json.loads(out)
    assert code == 0 and document["after"]["file"] == "results.json"
    # Which lines a document was solved from is not told: nothing is known to be in both alike.
    assert document["uncertainty"]["shared"] == []
    for one in report.changes.curves:
        told = document["curves"][one.name]
        known = [value for value in told["normalised_error"] if value is not None]
        apart = np.hypot(one.before_uncertainty, one.after_uncertainty)
        fixed = apart == 0.0
        expected = one.difference[~fixed] / (2.0 * apart[~fixed])
        np.testing.assert_allclose(known, expected)
        np.testing.assert_array_less(np.abs(known), np.abs(one.normalised_error[~fixed]))
        # Of many nodes one is named by itself, without the covariance of the others.
        assert told["changed"] is (True if one.name == "E_XZ" else None)
        assert told["joint"]["probability"] is None
    assert document["volume"]["rms"]["normalised_error"] is None
    assert document["verdict"] == "other"
    assert [one["name"] for one in document["judgement"]["families"]] == ["single nodes"]
    again = tmp_path / "again.json"
    run = write(tmp_path / "again.mcap", 3, seed=9)
    again.write_text(report_json(report_of(run)))
    document = json.loads(stepdiag(capsys, "changes", before, again, "--json")[1])
    assert document["verdict"] == "unknown"
    assert all(one["changed"] is None for one in document["curves"].values())
    for option in (("--instrument", "demo"), ("--expansion-per-K", "11.5e-6")):
        code, _, err = stepdiag(capsys, "changes", before, path, *option)
        assert code == 1 and "results.json holds no readings" in err


def test_an_instrument_tells_what_both_share(capsys, before, after, report):
    given = (before, after, "--instrument", "demo")
    apart, together = compared(*given), compared(*given, "--same-instrument")
    assert apart.changes.shared == () and "laser wavelength" in together.changes.shared
    rows = [
        next(one for one in each.changes.figures if one.name == "positioning E_XX")
        for each in (report, together, apart)
    ]
    spreads = [one.difference_uncertainty for one in rows]
    assert spreads[0] < spreads[1] < spreads[2]
    assert together.changes.at_least
    words = " ".join(uncertainty_words(together))
    assert "cancels in the change: laser wavelength" in words and "lower bound" in words
    assert "--same-instrument" in " ".join(uncertainty_words(apart))
    code, _, err = stepdiag(capsys, "changes", before, after, "--same-instrument")
    assert code == 1 and "--same-instrument needs one --instrument" in err
    code, _, err = stepdiag(capsys, "changes", *given, *given[2:], *given[2:])
    assert code == 1 and "more than twice" in err


def test_both_are_corrected_to_20_degrees(before, after):
    corrected = compared(
        before, after, "--expansion-per-K", "10e-6", "--material-temperature", "30"
    )
    plain = compared(before, after)
    for when in ("before", "after"):
        one, other = (
            getattr(next(f for f in each.changes.figures if f.name == "positioning E_XX"), when)
            for each in (corrected, plain)
        )
        # 10 K · 10 µm/(m·K) · 0.12 m
        assert other - one == pytest.approx(12e-6, rel=0.01)
    assert any(
        remark.startswith("both: ") and "20 degC" in remark for remark in remarks_of(corrected)
    )


def test_a_page_shows_it_all(capsys, tmp_path, before, after, report):
    pytest.importorskip("matplotlib")
    folder = tmp_path / "page"
    code, out, err = stepdiag(capsys, "changes", before, after, "--html", "--output", folder)
    assert code == 0 and "changes.html" in err and "times better" in out
    files = {"changes.html", "changes.json", "changes.txt"}
    assert {path.name for path in folder.iterdir()} == files
    text = (folder / "changes.html").read_text(encoding="utf-8")
    html = unescape(text)
    found = verdict(report.changes)
    assert found.headline in html and found.sentence in html
    for one in (report.changes.rms, *report.changes.figures):
        assert plus_minus(one.difference, one.difference_uncertainty, IN_MICRO) in html
    for curve in report.changes.curves:
        for row in range(len(curve.positions)):
            spread = curve.difference_uncertainty[row]
            assert plus_minus(curve.difference[row], spread, IN_MICRO) in html
    assert html.count("data:image/png;base64,") == 1
    assert "src=" in html and 'src="http' not in html and "<link" not in html
    for run in ("20260101T030405-abcd", "20260102T030405-abcd"):
        assert run in html
    document = json.loads((folder / "changes.json").read_text())
    assert document["words"][0] == found.sentence
    assert found.sentence in (folder / "changes.txt").read_text()


def test_the_page_is_a_pdf_too(capsys, tmp_path, before, after):
    pytest.importorskip("weasyprint")
    code, _, err = stepdiag(capsys, "changes", before, after, "--pdf", "--output", tmp_path / "p")
    assert code == 0 and "changes.pdf" in err
    assert (tmp_path / "p" / "changes.pdf").read_bytes().startswith(b"%PDF-")


def test_angular_errors_have_a_picture_of_their_own():
    from stepdiag_ros.metrology.agreement import ComparedMeasurement
    from stepdiag_ros.metrology.solvers import solve
    from stepdiag_ros.report.pages.changes import ChangesPage

    text = STEPS.replace("[XYZ]", "[XYZ, YZX, ZXY]")
    made = []
    for seed in (1, 2):
        _, measurement = standard_runs.measured(text, seed=seed, rotation=10e-6)
        made.append(
            ComparedMeasurement(solve(measurement, "rigid_body"), measurement.chain, measurement)
        )
    changes = compare(*made)
    identity = compared_identity()
    html = ChangesPage(ChangesReport(identity, identity, changes)).html()
    assert html.count("data:image/png;base64,") == 2 and "E_AX" in html and "µrad" in html


def compared_identity():
    from stepdiag_ros.compensation.identified import Origin, identify
    from stepdiag_ros.metrology.solvers import solve

    _, measurement = standard_runs.measured(STEPS)
    return identify(solve(measurement), measurement.chain, measurement, Origin(machine="mill"))


def test_what_cannot_be_compared_is_refused_in_one_sentence(
    capsys, tmp_path, monkeypatch, before, after
):
    def refused(*arguments):
        code, out, err = stepdiag(capsys, "changes", *arguments)
        assert code == 1 and not out and err.startswith("stepdiag: error: ")
        assert err.count("\n") == 1
        return err

    copy = tmp_path / "copy.mcap"
    shutil.copy(before, copy)
    for one in (before, copy):
        assert "hold the same run (20260101T030405-abcd)" in refused(before, one)
    other = write(tmp_path / "box.mcap", 5, STEPS.replace("blocks: 4", "blocks: 3"))
    assert "boxes differ: X from 0 to 120 mm and from 0 to 90 mm" in refused(before, other)
    note = tmp_path / "note.txt"
    note.write_text("not a measurement")
    assert f"{note} is not a JSON document" in refused(before, note)
    assert "nowhere.mcap" in refused(before, tmp_path / "nowhere.mcap")
    empty = tmp_path / "empty.mcap"
    empty.write_bytes(b"")
    assert "empty.mcap" in refused(empty, after)
    assert "'magic'" in refused(before, after, "--method", "magic")
    assert "20990101T000000-ffff" in refused(before, after, "--run-after", "20990101T000000-ffff")
    measured = standard_runs.measured

    def nothing(*arguments, **options):
        plan, measurement = measured(*arguments, **options)
        return plan, type(measurement)(measurement.volume, (), measurement.chain)

    with monkeypatch.context() as patch:
        patch.setattr(standard_runs, "measured", nothing)
        bare = write(tmp_path / "bare.mcap", 6)
    assert "no line was finished" in refused(before, bare)
    loaded = standard_runs.load_machine

    def turned(name):
        machine, text = loaded(name)
        assert text.count("chain: YXZ") == 1
        return machine, text.replace("chain: YXZ", "chain: XYZ")

    with monkeypatch.context() as patch:
        patch.setattr(standard_runs, "load_machine", turned)
        elsewhere = write(tmp_path / "elsewhere.mcap", 7)
    assert "different machines" in refused(before, elsewhere)
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert "is a file; results need a folder" in refused(before, after, "--output", blocked)


def test_two_names_are_asked_about_before_anything_is_called_a_change(before, after):
    def named(*names):
        found = compared(before, after)
        both = [
            replace(one, origin=replace(one.origin, machine=name))
            for one, name in zip((found.before, found.after), names, strict=True)
        ]
        return sentences_of(replace(found, before=both[0], after=both[1]))

    for names in (("mill", "mill"), ("mill", "")):
        assert not named(*names)[0].startswith("The machines")
    first = named("mill", "lathe")[0]
    assert "'mill'" in first and "'lathe'" in first
