"""Every command that takes a bag, on one that was measured with a tracker: served, or refused."""

from argparse import _SubParsersAction
from pathlib import Path

import pytest
from refused import refused
from standard_runs import write_bag
from tracker_runs import tracker_run, write_tracker_run

from stepdiag_ros import cli, notebook, open_run, plots
from stepdiag_ros.commands import measure
from stepdiag_ros.evaluation.lead import RunLead
from stepdiag_ros.metrology.discrepancy.findings import NOT_TESTABLE
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.processes.following import Outcome, RunOutcome
from stepdiag_ros.words.lead import next_steps

SERVED = {
    "info": ["info", "BAG"],
    "export": ["export", "BAG", "--output", "tables"],
    "recover": ["recover", "BAG", "recovered.mcap"],
    "report": ["report", "BAG", "--json", "--output", "page"],
    "solve": ["solve", "BAG", "--pictures", "none", "--output", "solved"],
    "diagnose": ["diagnose", "BAG", "--pictures", "none", "--output", "diagnosed"],
    "tracker evaluate": ["tracker", "evaluate", "BAG", "--pictures", "none", "--output", "t"],
}
REFUSED = {
    "budget": ["budget", "BAG", "--output", "out"],
    "iso230": ["iso230", "BAG", "--output", "out"],
    "squareness": ["squareness", "BAG", "--output", "out"],
    "compare": ["compare", "BAG", "--measured", "direct.csv", "--output", "out"],
    "changes": ["changes", "BAG", "BAG", "--output", "out"],
    "volumetric": ["volumetric", "BAG", "--output", "out"],
    "compensate": ["compensate", "BAG", "--for", "generic", "--output", "out"],
    "compensate-nc": ["compensate-nc", "part.ngc", "BAG", "--output", "out"],
    "diagnose with a further bag": ["diagnose", "BAG", "BAG", "--output", "out"],
    "diagnose with a model": ["diagnose", "BAG", "--model", "model.yaml", "--output", "out"],
    "diagnose and extend": ["diagnose", "BAG", "--extend", "out", "--pictures", "none"],
    "diagnose and propose": ["diagnose", "BAG", "--propose", "out", "--pictures", "none"],
    "diagnose after another": ["diagnose", "plain.mcap", "BAG", "--output", "out"],
}
ELSEWHERE = {
    "monitor",
    "watch",
    "foxglove",
    "replay",
    "by-hand",
    "import",
    "selftest",
    "air",
    "seal",
}
"""Look at a live run too and have tests of their own, take no run, or sign any bag."""


@pytest.fixture
def bag(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "direct.csv").write_text(
        "name,position_m,value,standard_uncertainty\nE_XX,0.0,0,1e-7\nE_XX,0.05,1e-7,1e-7\nE_XX,0.1,1e-6,1e-7\n"
    )
    (tmp_path / "part.ngc").write_text("G21 G90\nG1 X10 F100\nM2\n")
    return write_tracker_run(tmp_path / "run.mcap", *tracker_run())


def called(arguments, bag, capsys):
    code = cli.main([str(bag) if one == "BAG" else one for one in arguments])
    out, err = capsys.readouterr()
    assert "is not a line" not in out + err
    assert "Traceback" not in out + err
    return code, out, err


@pytest.mark.parametrize("name", SERVED)
def test_a_command_that_can_serve_it_does(bag, capsys, name):
    code, out, _ = called(SERVED[name], bag, capsys)
    assert code == 0
    assert out


@pytest.mark.parametrize("name", REFUSED)
def test_a_command_that_cannot_says_so_in_one_sentence_and_writes_nothing(bag, capsys, name):
    write_bag(bag.parent / "plain.mcap")
    code, out, err = called(REFUSED[name], bag, capsys)
    assert code == 1
    assert out == ""
    said = [line for line in err.splitlines() if line.startswith("stepdiag: error:")]
    assert len(said) == 1
    assert "run.mcap" in said[0] and "tracker" in said[0]
    assert not (bag.parent / "out").exists()


def test_no_command_that_takes_a_bag_is_forgotten():
    (commands,) = (
        action for action in cli.make_parser()._actions if isinstance(action, _SubParsersAction)
    )
    taking = {
        name
        for name, parser in commands.choices.items()
        if any(
            not action.option_strings and ".mcap" in str(action.help) for action in parser._actions
        )
    }
    known = {case.partition(" ")[0] for case in (*SERVED, *REFUSED)} | ELSEWHERE
    assert taking <= known


def test_a_diagnosis_shows_verdict_and_departures(bag, capsys):
    code, out, _ = called(SERVED["diagnose"], bag, capsys)
    assert code == 0
    assert "CONSISTENT" in out
    shown = out.partition("Each pass against all others")[2].partition("Lines by ISO")[0]
    rows = [line for line in shown.splitlines() if "run" in line or "locate" in line]
    assert len(rows) == 5


@pytest.mark.parametrize("function", [notebook.solve, notebook.diagnose])
def test_a_notebook_is_refused_what_the_command_line_is(bag, function):
    with refused(Refusal, "wrong_kind", "run.mcap"):
        function(open_run(bag))


def test_commands_that_take_a_plan_name_the_file_and_the_tracker(bag, capsys, tmp_path):
    from stepdiag_ros.planning.plan_text import plan_text

    (tmp_path / "plan.yaml").write_text(plan_text(tracker_run()[0]))
    for arguments in (
        ["plan", "--check", "plan.yaml", "--machine", "demo"],
        ["by-hand", "run.mcap", "--plan", "plan.yaml"],
    ):
        code, _, err = called(arguments, bag, capsys)
        assert code == 1
        assert "plan.yaml" in err and "tracker" in err


def test_a_plan_with_a_tracker_is_drawn_with_stations_lines_and_places():
    figure = plots.plan(tracker_run()[0])
    (panel,) = figure.axes
    labels = panel.get_legend_handles_labels()[1] or [
        text.get_text() for legend in figure.legends for text in legend.get_texts()
    ]
    assert {f"line {name}" for name in ("x", "z", "xy", "xz", "yz", "xyz")} <= set(labels)
    assert "tracker" in labels


def test_a_line_of_a_tracker_that_was_left_keeps_its_name():
    plan, _ = tracker_run()
    line = str(plan.lines[3])
    measured = RunOutcome(
        Outcome.FINISHED,
        "all lines are measured",
        "run",
        *(10, 12),
        (f"{line}: stop 2 was rejected: the reading drifts",),
        *("", "", None, True, ""),
    )
    assert measure._lead(measured).passes.missing == (line,)


@pytest.mark.parametrize(("tracked", "asked"), [(True, "tracker plan"), (False, "plan --for")])
def test_a_run_that_nothing_can_test_is_told_the_plan_of_its_own_instrument(tracked, asked):
    lead = RunLead(
        Verdict(NOT_TESTABLE, "Too few readings."), bag=Path("a"), solved=True, tracked=tracked
    )
    commands = [step.command for step in next_steps(lead)]
    assert any(command and f"stepdiag {asked}" in command for command in commands), commands
