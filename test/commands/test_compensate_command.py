"""``stepdiag compensate``: from a bag or a result to tables, never over anything, never half."""

import hashlib
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import standard_runs
from refused import a_fault, refused

from stepdiag_ros import cli, schemas
from stepdiag_ros.commands import compensate
from stepdiag_ros.compensation import control, controls, identified
from stepdiag_ros.compensation.generic import correction_from_file, map_from_text
from stepdiag_ros.configuration import load_machine
from stepdiag_ros.evaluation import recorded_run
from stepdiag_ros.evaluation.compensation import CompensationReport
from stepdiag_ros.metrology.credibility import Misfit
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.plots.files.compensation import draw_compensation
from stepdiag_ros.text.controls import Comment

pytestmark = pytest.mark.usefixtures("kept_results")

STEPS = """\
name: step diagonals
step_m: [0.03, 0.02, 0.025]
blocks: 5
repeats: 2
overrun_m: 0.002
directions: [forward, backward]
feed_m_per_s: 0.05
lines:
  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn], orders: [XYZ]}
  - {kind: linear, names: [x, y, z]}
"""


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return standard_runs.write_bag(tmp_path_factory.mktemp("bag") / "run.mcap", STEPS)


def stepdiag(capsys, *arguments):
    code = cli.main([str(argument) for argument in arguments])
    said = capsys.readouterr()
    return code, said.out, said.err


@pytest.mark.parametrize("name", controls())
def test_tables_come_with_their_origin_and_what_they_leave(capsys, tmp_path, bag, name):
    folder = tmp_path / "tables"
    code, out, err = stepdiag(
        capsys, "compensate", bag, "--for", name, "--output", folder, "--pictures", "none", "--json"
    )
    assert code == 0 and "tables in" in err
    document = json.loads(out)
    assert document == json.loads((folder / "compensation.json").read_text())
    assert document["schema"] == schemas.identifier("compensation")
    digest = hashlib.sha256(bag.read_bytes()).hexdigest()
    assert document["origin"]["sha256"] == digest and document["origin"]["file"] == "run.mcap"
    assert document["origin"]["run_id"] == standard_runs.RUN_ID
    for file in document["files"]:
        data = (folder / file["name"]).read_bytes()
        assert hashlib.sha256(data).hexdigest() == file["sha256"]
    text = (folder / "compensation.txt").read_text()
    assert digest in text and "Nothing was installed" in text and "least_squares" in text
    # Every file that can hold a comment says where it comes from.
    if name not in ("linuxcnc", "heidenhain"):
        told = [(folder / file["name"]).read_text() for file in document["files"]]
        assert sum(digest in one for one in told) >= len(told) - (name == "fanuc")
    changes = {one["name"]: one for one in document["changes"]}
    for letter in "XYZ":
        one = changes[f"positioning E_{letter}{letter}"]
        assert one["corrected"] and one["after"] < 0.5 * one["before"]
    straight = [one for key, one in changes.items() if key.startswith("straightness")]
    if name in ("linuxcnc", "fanuc"):
        assert not any(one["corrected"] for one in straight)
        assert any("squareness C0Y stays" in said for said in document["uncorrected"])
    else:
        assert all(one["after"] < 0.3 * one["before"] for one in straight)
    assert any("E_AX" in said and "not estimated" in said for said in document["uncorrected"])
    assert document["rms_standard_uncertainty"] > 0.0


def test_nothing_is_overwritten_and_nothing_is_left_half(capsys, tmp_path, bag, monkeypatch):
    folder = tmp_path / "tables"
    given = ("compensate", bag, "--for", "siemens", "--output", folder, "--pictures", "none")
    assert stepdiag(capsys, *given)[0] == 0
    kept = {path.name: path.read_bytes() for path in folder.iterdir()}
    code, out, err = stepdiag(capsys, *given)
    assert code == 1 and out == "" and "is there already and is not overwritten" in err
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == kept

    def full(_path, _text, **_):
        raise OSError(28, "no space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    other = tmp_path / "other"
    code, _, err = stepdiag(capsys, *given[:4], "--output", other, "--pictures", "none")
    assert code == 1 and "no space left" in err
    assert str(other) in err and ".partial" not in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["tables"]


@pytest.fixture(scope="module")
def forged(tmp_path_factory):
    """Return a bag whose version brings statements for controls along."""
    with pytest.MonkeyPatch.context() as patch:
        version = "1.0\nN5 $MA_MAX_AX_VELO[AX1]=99999\n3620 X = 9\n)M30\x1b[2J\u2028M17"
        patch.setattr(standard_runs, "__version__", version)
        return standard_runs.write_bag(tmp_path_factory.mktemp("forged") / "run.mcap", STEPS)


@pytest.mark.parametrize("name", controls())
def test_what_a_bag_says_of_itself_stays_a_comment(capsys, tmp_path, forged, name, monkeypatch):
    given = ("compensate", forged, "--for", name, "--pictures", "none", "--output")
    code, out, _ = stepdiag(capsys, *given, tmp_path / "tables")
    assert code == 0 and "\x1b" not in out
    document = json.loads((tmp_path / "tables" / "compensation.json").read_text())
    assert document["origin"]["software_version"].endswith("\u2028M17")
    for path in (tmp_path / "tables").iterdir():
        for line in path.read_text().splitlines():
            if "VELO" in line:
                assert re.match(r"; |# |  run made by|    \"software_version\": \"", line), path
    if name == "heidenhain":
        return  # whose files have no comments
    # Were a comment ever written as it came, the file would be read once more and refused.
    monkeypatch.setattr(Comment, "lines", lambda self, text: [f"{self.opening}{text}"])
    code, out, err = stepdiag(capsys, *given, tmp_path / "more")
    assert code == 1 and out == "" and "nothing is written" in err and len(err.splitlines()) <= 2
    assert [path.name for path in tmp_path.iterdir()] == ["tables"]


def test_a_result_serves_as_well_as_its_bag_but_knows_no_reversal(capsys, tmp_path, bag):
    assert stepdiag(capsys, "solve", bag, "--output", tmp_path / "r", "--pictures", "none")[0] == 0
    files = {}
    for source, name in ((bag, "bag"), (tmp_path / "r" / "results.json", "json")):
        folder = tmp_path / name
        code, _, _ = stepdiag(
            *(capsys, "compensate", source, "--for", "linuxcnc", "--output", folder),
            *("--pictures", "none"),
        )
        assert code == 0
        files[name] = np.loadtxt(folder / "x.comp")
        text = (folder / "compensation.txt").read_text()
        assert ("the reversal errors are not known" in text) == (name == "json")
        assert "unknown" in text if name == "json" else standard_runs.RUN_ID in text
    document = tmp_path / "r" / "results.json"
    assert compensate.load_identified(document, run_id=standard_runs.RUN_ID).origin.run_id
    with refused(Refusal, "not_found", about="foo", where=str(document)):
        compensate.load_identified(document, run_id="foo")
    mean = np.mean(files["bag"][:, 1:], axis=1)
    assert files["json"][:, 1] == pytest.approx(mean, abs=2e-7)


def test_a_map_is_read_back_as_it_was_and_corrects_targets(capsys, tmp_path, bag):
    folder = tmp_path / "map"
    given = ("compensate", bag, "--for", "generic", "--output", folder, "--pictures", "none")
    assert stepdiag(capsys, *given)[0] == 0
    path = folder / "volumetric_map.json"
    identified = map_from_text(path.read_text(), "map")
    made = identified.error_map
    solved = compensate.load_identified(bag)
    places = made.grid(between=1)
    assert made.errors(places) == pytest.approx(solved.error_map.errors(places), abs=1e-15)
    assert made.chain == "YXZ" and identified.origin == solved.origin
    assert np.isfinite(made.uncertainty_limit_at(places)).all()
    correction = correction_from_file(path, 0.2e-3)
    assert correction.sha256 in correction.words and "run.mcap" in correction.words
    sent = correction.sent((0.1, 0.05, 0.1))
    assert correction.nominal(sent) == pytest.approx((0.1, 0.05, 0.1), abs=1e-11)
    with refused(Refusal, "out_of_range", "correction_limit"):
        correction_from_file(path, 1e-9).sent((0.1, 0.05, 0.1))
    # The table of curves is one that 'stepdiag compare' reads.
    compared = ("compare", bag, "--measured", folder / "error_curves.csv", "--pictures", "none")
    code, out, _ = stepdiag(capsys, *compared, "--output", tmp_path / "c")
    assert code == 0 and "E_YX" in out


def test_the_picture_shows_nine_errors_before_and_after(bag):
    from stepdiag_ros.compensation.control import Layout, checked_settings
    from stepdiag_ros.compensation.remaining import remainder

    found = control("linuxcnc")
    identified = compensate.load_identified(bag)
    layout = Layout(settings=checked_settings(found, {}))
    files = found.write(identified, layout)
    left = remainder(identified, found.read(files), found.corrects)
    made = CompensationReport(found, identified, layout, files, left)
    (picture,) = draw_compensation(made).values()
    titles = [axes.get_title() for axes in picture.axes]
    assert titles[0] == "E_XX: X error as X moves" and len(titles) == 9
    assert "E_YX: Y error as X moves (no table)" in titles
    heights = {line.get_label(): np.ptp(line.get_ydata()) for line in picture.axes[0].lines}
    assert heights["before"] > 10 * heights["after (computed)"]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("--method", "soons"), "method 'soons': "),
        (("--method", "best"), "there is no such method"),
        (("--set", "typ=1"), "unknown key 'typ'"),
        (("--set", "type=2"), "a whole number from 0 to 1"),
        (("--set", "type"), "expected NAME=VALUE"),
        (("--spacing", "-1"), "expected more than 0"),
        (("--spacing", "0.1"), "the control takes 256"),
        (("--on-top-of", "/nowhere"), "there is no such folder"),
    ],
    ids=str,
)
def test_what_is_wrong_is_said_in_a_sentence_and_nothing_is_written(
    capsys, tmp_path, bag, given, words
):
    folder = tmp_path / "tables"
    code, out, err = stepdiag(
        capsys, "compensate", bag, "--for", "linuxcnc", "--output", folder, *given
    )
    assert (code, out) == (1, "") and words in err and "\n" not in err.strip()
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nothing", "is not a JSON document"),
        ("{}", "is not a result of 'stepdiag solve'"),
        ('{"schema": "urn:stepdiag_ros:result:1"}', "does not fit the schema"),
        ('{"schema": "urn:stepdiag_ros:result:1", "methods": {}, "run": {}}', "no method could"),
    ],
    ids=str,
)
def test_a_document_that_is_no_result_is_refused(capsys, tmp_path, text, words):
    path = tmp_path / "results.json"
    path.write_text(text)
    code, _, err = stepdiag(capsys, "compensate", path, "--for", "generic")
    assert code == 1 and words in err


def test_a_setting_with_two_values_is_refused():
    with refused(Refusal, "twice", about="tables", where="--set"):
        compensate._given(["tables=2", "tables =3"])
    assert compensate._given(["tables=2", "type=1"]) == {"tables": 2, "type": 1}


def test_a_map_of_another_machine_moves_nothing(capsys, tmp_path, bag):
    folder = tmp_path / "map"
    given = ("compensate", bag, "--for", "generic", "--output", folder, "--pictures", "none")
    assert stepdiag(capsys, *given)[0] == 0
    path = folder / "volumetric_map.json"
    document = json.loads(path.read_text())
    own = replace(load_machine("demo")[0], chain=document["chain"])
    document["origin"]["machine"] = own.name
    path.write_text(json.dumps(document))
    assert correction_from_file(path, 0.2e-3, own).limit == 0.2e-3
    for what, other in (
        ("chain", replace(own, chain=own.chain[::-1])),
        ("name", replace(own, name="x")),
    ):
        with refused(Refusal, "mismatch", aspect=what):
            correction_from_file(path, 0.2e-3, other)


def test_a_map_has_no_tables_to_stand_on(capsys, tmp_path, bag):
    folder = tmp_path / "map"
    given = ("compensate", bag, "--for", "generic", "--pictures", "none", "--output")
    assert stepdiag(capsys, *given, folder)[0] == 0
    code, _, err = stepdiag(capsys, *given, tmp_path / "more", "--on-top-of", folder)
    assert code == 1 and "map" in err and not (tmp_path / "more").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.pop("curves"), a_fault("missing", "curves")),
        (lambda d: d.update(schema="other"), a_fault("wrong_kind", "volumetric_map.json")),
        (lambda d: d["nodes"].update(X=[0.0, 0.0, 1.0]), a_fault("out_of_order", "X")),
        (lambda d: d["curves"].pop("E_XX"), a_fault("missing", "E_XX", aspect="curves")),
        (
            lambda d: d.update(chain="ABC"),
            a_fault("unknown", "volumetric_map.json", aspect="chain"),
        ),
        (
            lambda d: d["origin"].update(colour="red"),
            a_fault(None, "volumetric_map.json", "colour"),
        ),
        (lambda d: d["reversal"].update(X=[1.0]), a_fault("mismatch", "X")),
        (
            lambda d: d["curves"].update(E_XX=[None] * 6),
            a_fault("undetermined", "volumetric_map.json"),
        ),
    ],
)
def test_a_map_that_was_damaged_is_refused_by_the_bridge(capsys, tmp_path, bag, change, words):
    folder = tmp_path / "map"
    given = ("compensate", bag, "--for", "generic", "--output", folder, "--pictures", "none")
    assert stepdiag(capsys, *given)[0] == 0
    path = folder / "volumetric_map.json"
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    with refused(Refusal, words):
        correction_from_file(path, 0.2e-3)
    with refused(Refusal, "unreadable", "nowhere.json"):
        correction_from_file(tmp_path / "nowhere.json", 0.2e-3)


def test_tables_on_top_of_tables_are_their_sum(capsys, tmp_path, bag):
    given = ("compensate", bag, "--for", "linuxcnc", "--pictures", "none", "--output")
    assert stepdiag(capsys, *given, tmp_path / "first")[0] == 0
    again = (*given, tmp_path / "second", "--on-top-of", tmp_path / "first", "--json")
    code, out, _ = stepdiag(capsys, *again)
    assert code == 0 and json.loads(out)["on_top_of"] == str(tmp_path / "first")
    for name in ("x.comp", "y.comp", "z.comp"):
        first, second = (np.loadtxt(tmp_path / each / name) for each in ("first", "second"))
        assert second[:, 1:] == pytest.approx(2.0 * first[:, 1:], abs=2e-7)
        assert np.max(np.abs(first[:, 1:])) > 1e-4


def test_a_result_that_its_readings_contradict_is_told(capsys, tmp_path, monkeypatch, bag):
    """In one of three move orders a diagonal jumps: no curve and no rotation of an axis does that.

    Rotations by themselves contradict nothing: they are taken out, and are in the uncertainties.
    """
    orders = STEPS.replace("[XYZ]", "[XYZ, YZX, ZXY]")
    measured = standard_runs.measured

    def jumping(*arguments, **options):
        plan, measurement = measured(*arguments, **options)
        lines = tuple(
            replace(line, displacement=line.displacement + 1e-6 * (line.target[:, 0] > 0.07))
            if (line.line.name, line.line.order) == ("ppp", "XYZ")
            else line
            for line in measurement.lines
        )
        return plan, replace(measurement, lines=lines)

    # What acts besides is asked elsewhere, and takes long for so many lines.
    monkeypatch.setattr(recorded_run, "verdict_on", lambda _: Verdict())
    turning = standard_runs.write_bag(tmp_path / "turning.mcap", orders, rotation=20e-6)
    with monkeypatch.context() as patch:
        patch.setattr(standard_runs, "measured", jumping)
        contradicted = standard_runs.write_bag(tmp_path / "jumping.mcap", orders)
    for source, warned in ((contradicted, True), (turning, False), (bag, False)):
        folder = tmp_path / f"tables_of_{source.stem}"
        given = ["compensate", source, "--for", "siemens", "--pictures", "none", "--json"]
        code, out, _ = stepdiag(capsys, *given, "--output", folder)
        remarks = json.loads(out)["remarks"]
        assert code == 0
        assert any("disagree with this model" in one for one in remarks) == warned


@pytest.mark.parametrize("found", [*Misfit, "noise"])
def test_what_speaks_against_tables_stands_above_them(capsys, tmp_path, bag, monkeypatch, found):
    monkeypatch.setattr(identified, "misfit", lambda *_: Misfit.NONE if found == "noise" else found)
    monkeypatch.setattr(identified, "is_noise", lambda _: found == "noise")
    # An axis with reversal is more than noise, whatever its curves are.
    monkeypatch.setattr(identified, "reversal_of", lambda runs, _: (0.0 * runs.target, "zero"))
    given = ["compensate", bag, "--for", "generic", "--pictures", "none", "--output"]
    code, out, _ = stepdiag(capsys, *given, tmp_path / "tables")
    assert code == 0
    out = " ".join(out.split())
    warned = "Do not install these tables: " in out[: out.index("What the tables change")]
    assert warned == (found in (Misfit.SHOWN, "noise"))
    assert ("(rms standard uncertainty)" in out) == (not warned)
    told = "the readings disagree with this model" in out
    assert told == (found in (Misfit.SHOWN, Misfit.UNCLEAR))


def test_the_settings_of_each_control_are_listed(capsys):
    for name in controls():
        code, out, _ = stepdiag(capsys, "compensate", "--for", name, "--settings")
        assert code == 0 and control(name).title in out
        for one in control(name).settings:
            assert f"{one.name}={one.default}" in out
