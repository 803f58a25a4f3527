"""``stepdiag plan``: what it prints and writes, what it refuses, and that it overwrites nothing."""

import json

import pytest
from gcode_reader import Machine as Controller

from stepdiag_ros import cli
from stepdiag_ros.commands import plan as command
from stepdiag_ros.configuration import load_machine, load_plan
from stepdiag_ros.metrology.geometry import CHAINS
from stepdiag_ros.metrology.plausible import CLASSES, DEFAULT_CLASS
from stepdiag_ros.planning.assessment import assess
from stepdiag_ros.planning.candidates import PURPOSES
from stepdiag_ros.planning.nc_writing import DWELL_FORMS
from stepdiag_ros.run.feasibility import beyond_machine

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_choices_are_those_of_planning():
    assert tuple(PURPOSES) == command.PURPOSES
    assert tuple(DWELL_FORMS) == command.DWELL_FORMS
    assert tuple(sorted(CHAINS)) == command.CHAINS


def test_a_proposal_is_written_and_shown(folder, capsys):
    assert cli.main(["plan", "--for", "quick", "--machine", "demo", "--nc"]) == 0
    shown = capsys.readouterr()
    for words in (
        "Duration",
        "Visibility",
        "Expected uncertainty",
        "What this plan will not determine",
    ):
        assert words in shown.out
    assert (
        "wrote quick_plan.yaml, quick_plan.nc, quick_plan_sheet.txt, quick_plan.png,"
        in " ".join(shown.err.split())
    )
    plan = load_plan(folder / "quick_plan.yaml")[0]
    assert beyond_machine(plan, load_machine("demo")[0]) == ""
    read = Controller().run((folder / "quick_plan.nc").read_text("ascii"))
    assert len(read.stays) == plan.stop_count
    for picture in ("quick_plan.png", "quick_plan_frontier.png"):
        assert (folder / picture).read_bytes().startswith(PNG)
    head = (folder / "quick_plan.yaml").read_text("utf-8")
    assert "E_BY" in head and head.startswith("# Proposed by stepdiag ") and "30 m/min" in head


def test_the_program_of_a_plan_that_is_there_is_named_after_it(folder):
    assert cli.main(["plan", "--check", "quick", "--machine", "demo", "--nc"]) == 0
    assert {path.name for path in folder.iterdir()} == {"quick.nc", "quick_sheet.txt"}


def test_what_was_written_checks_as_what_was_proposed(folder, capsys):
    assert cli.main(["plan", "--for", "quick", "--machine", "demo", "--json", "--no-picture"]) == 0
    proposed = json.loads(capsys.readouterr().out)
    assert [path.name for path in folder.iterdir()] == ["quick_plan.yaml"]
    assert cli.main(["plan", "--check", "quick_plan.yaml", "--machine", "demo", "--json"]) == 0
    checked = json.loads(capsys.readouterr().out)
    assert proposed.pop("proposal")["purpose"] == "quick"
    assert checked.pop("proposal") is None
    assert checked == proposed
    assert [path.name for path in folder.iterdir()] == ["quick_plan.yaml"]


def test_json_says_the_same_as_the_functions(capsys):
    plan, machine = load_plan("demo")[0], load_machine("demo")[0]
    assert (
        cli.main(["plan", "--check", "demo", "--machine", "demo", "--noise", "0.2", "--json"]) == 0
    )
    document = json.loads(capsys.readouterr().out)
    assessment = assess(plan, machine, 0.2e-6)
    assert document["duration"]["total"] == assessment.duration.total
    said = document["expected_standard_uncertainty"]
    assert said["least_squares"]["squareness"] == assessment.expectation.squareness
    assert said["with_rotations"]["squareness"] == assessment.with_rotations.squareness
    assert said["rigid_body"]["angular"]["E_BY"] is None
    assert document["visibility"]["errors"]["E_XX"]["status"] == "determined"


@pytest.mark.parametrize("there", ["quick_plan.yaml", "quick_plan.nc", "quick_plan.png"])
def test_nothing_is_overwritten_and_nothing_half_written(folder, capsys, there):
    (folder / there).write_text("mine")
    arguments = ["plan", "--for", "quick", "--machine", "demo", "--nc"]
    assert cli.main(arguments) == 1
    shown = capsys.readouterr()
    assert f"{there} is there already" in shown.err
    assert shown.out == ""
    assert [path.name for path in folder.iterdir()] == [there]
    assert (folder / there).read_text() == "mine"
    assert cli.main([*arguments, "--force"]) == 0
    assert not (folder / there).read_bytes().startswith(b"mine")


@pytest.mark.parametrize("beside", [["--table", "mine.csv"], ["--nc", "./mine.yaml"]])
def test_nothing_takes_the_place_of_the_plan_that_is_checked(folder, capsys, beside):
    text = load_plan("demo")[1]
    (folder / "mine.yaml").write_text(text)
    wish = ["plan", "--check", "mine.yaml", "--machine", "demo", *beside, "--force"]
    assert cli.main(wish) == 1
    assert "mine.yaml is the plan that is checked" in capsys.readouterr().err
    assert [path.name for path in folder.iterdir()] == ["mine.yaml"]
    assert (folder / "mine.yaml").read_text() == text


def test_the_dialect_is_as_asked(folder, capsys):
    nc = ["--nc", "p.nc", "--nc-dwell", "F_s", "--nc-number", "7", "--nc-line-numbers"]
    nc += ["--nc-no-percent", "--nc-decimals", "5"]
    assert cli.main(["plan", "--check", "demo", "--machine", "demo", *nc]) == 0
    capsys.readouterr()
    text = (folder / "p.nc").read_text("ascii")
    assert text.startswith("O0007 (DEMO") and "\nN10 (" in text and " X10.00000\n" in text
    assert len(Controller("F_s").run(text).stays) == load_plan("demo")[0].stop_count


@pytest.mark.parametrize(("rotations", "below_usual"), [("precision", True), ("", False)])
def test_a_wish_that_rests_on_assumed_rotations_is_said_to(folder, capsys, rotations, below_usual):
    lines = [one for one in load_machine("demo")[1].splitlines() if not one.startswith("rotations")]
    given = [f"rotations: {rotations}"] if rotations else []
    (folder / "m.yaml").write_text("\n".join(lines + given))
    wish = ["--for", "volumetric", "--machine", "m.yaml", "--until", "20um", "--no-picture"]
    assert cli.main(["plan", *wish, "--json"]) == 0
    proposal = json.loads(capsys.readouterr().out)["proposal"]
    assumed = proposal["assumed_rotations"]
    assert assumed["size"] == (CLASSES[rotations] if rotations else CLASSES[DEFAULT_CLASS])
    assert assumed["without"] is None, "step diagonals alone do not determine rotations"
    if below_usual:
        assert assumed["with_usual"] > proposal["chosen"]["expanded_uncertainty"]
    else:
        assert assumed["with_usual"] is None
    assert cli.main(["plan", *wish, "--force"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "assumption" in said and f"{assumed['size'] * 1e6:g} µrad" in said
    if below_usual:
        assert f"{assumed['with_usual'] * 1e6:.2g} µm" in said


@pytest.mark.usefixtures("folder")
def test_a_wish_that_rests_on_nothing_is_not_said_to(capsys):
    wish = ["--for", "volumetric", "--machine", "demo", "--no-picture", "--json"]
    assert cli.main(["plan", *wish]) == 0
    assert json.loads(capsys.readouterr().out)["proposal"]["assumed_rotations"] is None


def test_all_wishes_that_cannot_be_met_are_said_at_once(folder, capsys):
    wrong = ["--until", "E_QQ=1um", "--overrun", "0.1", "--to", "9", "9", "0.06"]
    arguments = ["--for", "volumetric", "--machine", "demo", "--chain", "XYZ", *wrong]
    assert cli.main(["plan", *arguments]) == 1
    error = " ".join(capsys.readouterr().err.split())
    for name in ("--chain", "E_QQ", "overrun of 0.1 m", "box runs X", "box runs Y"):
        assert name in error
    assert "box runs Z" not in error
    assert not list(folder.iterdir())


def test_all_that_is_wrong_in_a_plan_and_beside_it_is_said_at_once(folder, capsys):
    (folder / "p.yaml").write_text(
        "step_m: [0.01, 0.01, 0]\nblocks: 0\nrepeat: 2\nfeed_m_per_s: 20\n"
        "lines:\n  - {kind: linear, names: [w]}\n  - {kind: linear, names: [x], way: 1}\n"
        "sampling: {dwell_s: -1, window_s: x}\n"
    )
    arguments = ["--check", "p.yaml", "--machine", "nothing", "--time", "2h", "--dwell", "2"]
    assert cli.main(["plan", *arguments]) == 1
    error = " ".join(capsys.readouterr().err.split())
    keys = ("step_m", "blocks", "repeat", "feed_m_per_s", "names", "way", "dwell_s", "window_s")
    for name in (*keys, "--time", "--dwell", "machine 'nothing'"):
        assert name in error
    assert error.count("stepdiag: error:") == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--check", "nothing", "--machine", "demo"], "there is no plan 'nothing'"),
        (["--check", "demo", "--machine", "nothing"], "there is no machine 'nothing'"),
        (["--check", "demo", "--machine", "demo", "--time", "2h"], "--time goes with --for"),
        (["--check", "demo", "--travel", "0.1", "1", "1"], "cannot be executed on travel 100 x"),
        (["--for", "quick", "--machine", "demo", "--chain", "XYZ"], "--chain goes with --travel"),
        (["--for", "angular", "--travel", "1", "1", "1"], "need the kinematic chain"),
        (["--for", "quick", "--machine", "demo", "--time", "6min"], "takes less than 6 min"),
        (["--for", "volumetric", "--machine", "demo", "--until", "1um"], "E_CY"),
        (["--for", "volumetric", "--machine", "demo", "--until", "E_QQ=1um"], "E_QQ"),
        (["--for", "volumetric", "--machine", "demo", "--until", "X:A=1um"], "A of X"),
        (["--for", "volumetric", "--machine", "demo", "--until", "E_AX=1urad"], "--for angular"),
        (["--for", "squareness", "--machine", "demo", "--until", "1um"], "rad"),
        (["--for", "quick", "--machine", "demo", "--output", "no/p.yaml"], "there is no folder no"),
        (["--for", "quick", "--machine", "demo", "--picture", "p.gif"], "p.gif: pictures are"),
        (["--for", "quick", "--machine", "demo", "--nc", "--nc-decimals", "9"], "9 decimals"),
    ],
)
def test_a_wrong_request_is_one_sentence_and_no_file(folder, capsys, arguments, said):
    assert cli.main(["plan", *arguments]) == 1
    shown = capsys.readouterr()
    assert said in shown.err
    assert shown.err.count("\n") == 1
    assert shown.out == ""
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    "output",
    [
        ["--output", "no/p.yaml"],
        ["--output", "."],
        ["--picture", "p.gif"],
        ["--nc", "--nc-decimals", "9"],
        ["--output", "there.yaml"],
        ["--table", "no/readings.csv"],
        ["--table", "quick_plan.csv"],
        ["--nc", "quick_plan.yaml"],
        ["--nc", "there.nc"],
        ["--table", "there.csv"],
        ["--picture", "there.png"],
    ],
)
def test_what_cannot_be_written_is_refused_before_any_planning(folder, capsys, monkeypatch, output):
    planned = []
    monkeypatch.setattr("stepdiag_ros.planning.proposal.propose", planned.append)
    mine = {"there.yaml", "there_sheet.txt", "there_frontier.png"}
    for name in mine:
        (folder / name).write_text("mine")
    assert cli.main(["plan", "--for", "quick", "--machine", "demo", *output]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert planned == []
    assert {path.name: path.read_text() for path in folder.iterdir()} == dict.fromkeys(mine, "mine")


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--for", "quick"],
        ["--machine", "demo"],
        ["--for", "beauty", "--machine", "demo"],
        ["--for", "quick", "--machine", "demo", "--noise", "0"],
        ["--for", "quick", "--machine", "demo", "--blocks", "1.5"],
        ["--for", "quick", "--machine", "demo", "--time", "soon"],
        ["--for", "quick", "--machine", "demo", "--time", "0min"],
        ["--for", "quick", "--travel", "1", "1"],
        ["--for", "quick", "--travel", "1", "1", "nan"],
    ],
)
def test_wrong_usage_ends_with_2(folder, capsys, arguments):
    with pytest.raises(SystemExit) as ended:
        cli.main(["plan", *arguments])
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith("stepdiag plan: error: ")
    assert list(folder.iterdir()) == []


def test_a_travel_in_millimetres_is_answered_in_metres(capsys):
    with pytest.raises(SystemExit):
        cli.main(["plan", "--for", "quick", "--travel", "600", "400", "300"])
    said = " ".join(capsys.readouterr().err.split())
    assert "--travel" in said and "600" in said and "0.6" in said and "metres" in said


@pytest.mark.usefixtures("folder")
def test_the_rates_of_drift_that_were_taken_are_stated(capsys):
    assert cli.main(["plan", "--for", "quick", "--travel", "0.6", "0.4", "0.3"]) == 0
    drift = next(one for one in capsys.readouterr().out.splitlines() if "growth_per_s" in one)
    assert "5e-10" in drift and "1e-10" in drift and drift.count("default") == 2


def test_only_the_travel_is_enough(folder, capsys):
    travel = ["--travel", "0.8", "0.5", "0.4", "--time", "2h", "--output", "mine.yaml"]
    assert cli.main(["plan", "--for", "squareness", *travel, "--no-picture"]) == 0
    assert "The kinematic chain is not known" in capsys.readouterr().out
    plan = load_plan(folder / "mine.yaml")[0]
    for axis, length in enumerate((0.8, 0.5, 0.4)):
        nodes = plan.volume.nodes(axis)
        assert nodes[0] >= 0.005 - 1e-12 and nodes[-1] <= length - 0.005 + 1e-12
