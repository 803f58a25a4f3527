"""Who attends a run of ``stepdiag measure``: with a terminal, without one, and what is printed."""

import json
import os
import pty
import re
import select
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from refused import refused

from stepdiag_ros.cli import make_parser
from stepdiag_ros.commands import cell, measure
from stepdiag_ros.commands.measure import _Attendant
from stepdiag_ros.commands.output import progress_bar
from stepdiag_ros.commands.until import RunTeller
from stepdiag_ros.metrology.target import TargetStanding, TargetState
from stepdiag_ros.processes.following import RunFailed, RunNews, RunOutcome, _told
from stepdiag_ros.run.conclusion import Outcome
from stepdiag_ros.run.sequence import State

SETUP = "align laser and mirror for ppp XYZ, then resume"


@pytest.fixture
def terminal(monkeypatch):
    """Make standard input a terminal; return what is typed on."""
    keyboard, screen = pty.openpty()
    with os.fdopen(screen) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        yield keyboard
    os.close(keyboard)


def insists(attendant, state, text, limit=5.0):
    """Ask until the attendant wants to go on."""
    end = time.monotonic() + limit
    while not attendant(state, text):
        assert time.monotonic() < end
        time.sleep(0.01)


def test_enter_goes_on_once_it_was_said_why_the_run_is_held(terminal, capsys):
    attendant = _Attendant("")
    # Typed before anybody could know that the machine stands: it must not start it.
    os.write(terminal, b"\n")
    time.sleep(0.1)
    for _ in range(5):
        assert not attendant(State.FAULT, "the beam is lost")
        time.sleep(0.01)
    assert capsys.readouterr().err == "the beam is lost: Enter goes on, Ctrl-C ends the run\n"
    os.write(terminal, b"\n")
    insists(attendant, State.FAULT, "the beam is lost")
    # Held once more for the same reason: said once more, and Enter is wanted once more.
    for _ in range(5):
        assert not attendant(State.FAULT, "the beam is lost")
    assert "the beam is lost" in capsys.readouterr().err
    assert not attendant(State.WAITING_FOR_SETUP, SETUP)
    assert capsys.readouterr().err == f"{SETUP}: Enter goes on, Ctrl-C ends the run\n"


def test_without_a_terminal_a_fault_ends_the_run_and_a_setup_waits(monkeypatch, capsys):
    with Path(os.devnull).open() as nothing:
        monkeypatch.setattr("sys.stdin", nothing)
        attendant = _Attendant("")
        for _ in range(3):
            assert not attendant(State.WAITING_FOR_SETUP, SETUP)
        (said,) = capsys.readouterr().err.splitlines()
        assert SETUP in said and "stepdiag resume" in said and "sequencer/resume" in said
        with refused(RunFailed, "stopped"):
            attendant(State.FAULT, "the beam is lost")


def test_without_a_terminal_each_pass_is_told_once():
    shown, said = [], []
    tell = RunTeller(lambda *_: shown.append(_), said.append)
    for done, line in enumerate(("x forward", "x forward", "x backward")):
        tell(RunNews(line, done, 3))
    first, second = said
    assert "x forward" in first and "x backward" in second and "2" in second and len(shown) == 3


def test_what_a_run_came_to_is_printed(capsys):
    measured = RunOutcome(
        Outcome.ABORTED,
        "aborted by the operator",
        "20261121T110000Z-abcdef",
        17,
        42,
        ("ppp XYZ forward, repeat 0: stop 3: no beam",),
        "UNKNOWN",
        "no diagnosis node is running",
        None,
        False,
        "no recorder states where it has recorded this run",
    )
    measure._show(measured, as_json=False)
    assert capsys.readouterr().out.splitlines() == [
        "run:     20261121T110000Z-abcdef",
        "outcome: aborted by the operator (17 of 42 stops)",
        "left:    ppp XYZ forward, repeat 0: stop 3: no beam",
        "bag:     unknown (no recorder states where it has recorded this run)",
        "",
        "In short:",
        "The measurement is not complete: 17 of 42 planned stops have a value. End of the run:"
        " aborted by the operator.",
        "NOT DIAGNOSED: no diagnosis node is running",
    ]
    # The fixture of all tests holds it against its schema.
    measure._show(measured, as_json=True)
    document = json.loads(capsys.readouterr().out)
    assert document["bag"] is None and document["verdict"] == "UNKNOWN"
    first = document["lead"]
    assert first["verdict"]["name"] == "NOT DIAGNOSED" and first["solved"] is None
    assert first["passes"]["missing"] == ["ppp XYZ forward, repeat 0"]
    assert first["next"] == [], "without a recording there is nothing to run"
    measure._show(replace(measured, bag=Path("run.mcap")), as_json=True)
    steps = json.loads(capsys.readouterr().out)["lead"]["next"]
    assert steps[0]["command"] is None and "ppp XYZ forward, repeat 0" in steps[0]["why"]
    assert steps[1]["command"] == "stepdiag solve run.mcap"
    assert not any("compensate" in (one["command"] or "") for one in steps)


def test_the_largest_error_is_printed_as_the_solver_published_it(capsys):
    measured = RunOutcome(
        *(Outcome.FINISHED, "all lines are measured", "20261121T110000Z-abcdef", 42, 42, ()),
        *("CONSISTENT", "they agree", Path("run.mcap"), True, "closed"),
        largest_error=8.93e-6,
        expanded_uncertainty=1.24e-6,
        largest_at=(0.1, 0.2, -0.05),
        not_determined=("C0Y",),
    )
    measure._show(measured, as_json=False)
    said = capsys.readouterr().out
    assert "8.9 ± 1.2 µm" in said and "X 100.0, Y 200.0, Z -50.0 mm" in said and "C0Y" in said
    assert "nan" not in said
    measure._show(measured, as_json=True)
    lead = json.loads(capsys.readouterr().out)["lead"]
    assert (lead["largest_in_volume"], lead["expanded_uncertainty"]) == (8.93e-6, 1.24e-6)


def test_a_run_that_has_reached_its_target_is_complete(capsys):
    standing = TargetStanding("E_XX", "m", 1e-6, 0.9e-6, 0.9e-6, 0.0, TargetState.REACHED, 4, "")
    measured = RunOutcome(
        *(Outcome.FINISHED, "the target is reached", "20261121T110000Z-abcdef", 17, 42, ()),
        *("CONSISTENT", "they agree", Path("run.mcap"), True, "closed", standing),
    )
    measure._show(measured, as_json=True)
    lead = json.loads(capsys.readouterr().out)["lead"]
    assert lead["passes"]["missing"] == [] and lead["passes"]["planned"] == 17
    assert any("0.9 µm" in sentence for sentence in lead["sentences"])
    beyond = replace(standing, state=TargetState.BEYOND_PLAN, lines=8, text="U is 0.9 µm")
    measure._show(replace(measured, standing=beyond), as_json=True)
    assert json.loads(capsys.readouterr().out)["lead"]["passes"]["planned"] == 42


@pytest.mark.parametrize(
    ("given", "taken"), [("/cell_1", "/cell_1"), ("cell_1", "/cell_1"), ("/a/b_2", "/a/b_2")]
)
def test_a_namespace_is_taken_with_or_without_its_slash(given, taken):
    assert make_parser().parse_args(["measure", "--namespace", given]).namespace == taken
    assert make_parser().parse_args(["measure"]).namespace == ""


@pytest.mark.parametrize("given", ["1 bad", "/cell_1/", "//a", "a-b", "/", "ä"])
def test_what_is_no_namespace_is_refused(given, capsys):
    with refused(SystemExit, code=2):
        make_parser().parse_args(["measure", "--namespace", given])
    assert f"'{given}' is not a namespace. Write it like /cell_1" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("state", "text", "said"),
    [
        (State.RUNNING, "measuring", "ppp XYZ forward"),
        (State.WAITING_FOR_SETUP, SETUP, "waiting for the alignment for ppp XYZ forward"),
        (State.FINISHED, "all lines are measured; waiting for the verdict", None),
        (State.FAULT, "the beam is lost", None),
    ],
)
def test_the_progress_is_told_in_words(state, text, said):
    class Message:
        line = "ppp XYZ forward"
        stops_done, stops_total, remaining_time = 17, 42, 12.5

    message = Message()
    message.state, message.text = int(state), text
    told = _told(message, text if state is State.FINISHED else "")
    assert told.text == (said or text)
    assert (told.done, told.total, told.remaining) == (17, 42, 12.5)


@contextmanager
def narrow_screen():
    """Make standard error a terminal of 60 columns; give what reads the words on it."""
    screen, shown = pty.openpty()

    def words():
        raw = b""
        while select.select([screen], [], [], 0.05)[0]:
            raw += os.read(screen, 1 << 16)
        return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]|[━╺╸]", "", raw.decode()).split()

    with os.fdopen(shown, "w") as stderr, pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.stderr", stderr)
        patch.setenv("COLUMNS", "60")
        patch.setenv("TERM", "xterm")
        yield words
    os.close(screen)


def test_a_narrow_terminal_shows_the_whole_text_beside_the_bar():
    waited = "waiting for the alignment for ppp XYZ forward, repeat 0"
    with narrow_screen() as words:
        with progress_bar("") as progress:
            progress(0.1, waited)
        shown = words()
    assert set(waited.split()) <= set(shown) and "10%" in shown


def test_a_cell_that_is_up_shows_no_bar(monkeypatch, tmp_path):
    class Up:
        def __init__(self, *given):
            self.tell = given[2]

        def keep_up(self, ready):
            self.tell(RunNews("looking"))
            ready("")
            assert "looking" in words()
            # Long enough for a bar to be drawn again.
            time.sleep(0.3)
            self.tell(RunNews("later"))

    monkeypatch.setattr("stepdiag_ros.processes.measure.MeasuringSession", Up)
    arguments = make_parser().parse_args(["cell", "--plan", "quick", "-o", str(tmp_path)])
    with narrow_screen() as words:
        cell.run(arguments)
        assert words() == ["later"]
