"""``stepdiag watch`` on a bag: its options, and what it writes where."""

import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
from patience import PATIENCE
from refused import refused

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros.cli import main
from stepdiag_ros.commands import watch

COMMAND = (sys.executable, "-m", "stepdiag_ros.cli", "watch")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--rate", "2"], "--rate is for a bag, and none is given"),
        (["--run", "a"], "--run is for a bag, and none is given"),
        (["none.mcap"], "there is no bag none.mcap"),
        (["BAG", "--run", "a"], "holds no run 'a'"),
        (["BAG", "--namespace", "cell_1"], "--namespace is for live nodes"),
    ],
)
def test_what_cannot_be_shown_is_refused_in_one_sentence(arguments, said, bag, capsys):
    assert main(["watch", *(str(bag) if one == "BAG" else one for one in arguments)]) == 1
    written = capsys.readouterr()
    assert written.err.startswith("stepdiag: error: ") and said in written.err
    assert written.err.count("\n") == 1 and written.out == ""


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--rate", "fast", "'fast' is not a number"),
        ("--rate", "-1", "-1 is not between 0 and"),
        ("--namespace", "a b", "'a b' is not a namespace. Write it like /cell_1"),
    ],
)
@pytest.mark.parametrize("command", ["watch", "monitor"])
def test_wrong_usage(command, option, value, said, capsys):
    with refused(SystemExit, code=2):
        main([command, option, value])
    assert said in capsys.readouterr().err


def test_the_whole_view_once(bag, run, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    assert main(["watch", str(bag), "--once"]) == 0
    written = capsys.readouterr()
    rows = written.out.splitlines()
    assert rows[0].startswith(run.run_id) and "\x1b" not in written.out and written.err == ""
    assert max(map(len, rows)) <= 100
    assert run.diagnoses[-1].sentence in " ".join(written.out.split())


def test_without_a_terminal_it_is_a_log_with_the_recorded_time(bag, run, capsys):
    assert main(["watch", str(bag), "--rate", "0"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert all(re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00 \S", line) for line in lines)
    stamps = [line.split()[0] for line in lines]
    assert stamps == sorted(stamps)
    said = [line.partition(" ")[2] for line in lines]
    assert said[0].startswith(f"run {run.run_id}")
    assert sum(line.startswith("line ") for line in said) == len(run.lines)
    assert any(line.startswith("state: finished") for line in said)
    assert any(line.startswith(f"verdict: {run.diagnoses[-1].verdict}") for line in said)


@pytest.mark.parametrize(("command", "enclave"), [("watch", "viewer"), ("monitor", "monitor")])
def test_live_nodes_may_be_in_a_namespace(command, enclave, monkeypatch):
    from stepdiag_ros.nodes import base, monitor

    started = []

    def spin(_):
        started.append(list(sys.argv))
        return 3

    monkeypatch.setattr(sys, "argv", list(sys.argv))
    monkeypatch.setattr(base, "spin", spin)
    monkeypatch.setattr(monitor, "spin", spin)
    assert main([command, "--namespace", "cell_1"]) == 3
    # Several may look on at once, and nodes of one name are an error.
    assert started[0][:10] == [
        *(command, "--ros-args", "--enclave", f"/stepdiag/{enclave}"),
        *("-r", f"__node:={enclave}_{os.getpid()}"),
        # A busy computer is no fault of the nodes that a view shows.
        *("-p", "heartbeat_timeout:=10.0"),
        *("-r", "__ns:=/cell_1"),
    ]


def environment(**given):
    kept = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "TERM")}
    return kept | {"TERM": "xterm-256color", "COLUMNS": "80", "LINES": "24"} | given


def test_ascii_output_does_not_fail(bag):
    done = subprocess.run(
        [*COMMAND, str(bag), "--once"],
        env=environment(PYTHONIOENCODING="ascii"),
        capture_output=True,
        check=True,
    )
    assert done.stdout.isascii() and b" um" in done.stdout and b"?m" not in done.stdout


def on_a_terminal(arguments, end=False, **given):
    """Run the command on a terminal of its own; return exit code and all that it wrote."""
    leader, follower = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, *arguments],
        stdin=follower,
        stdout=follower,
        stderr=follower,
        env=environment(**given),
    )
    os.close(follower)
    written, deadline = b"", time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if not select.select([leader], [], [], 1.0)[0]:
            continue
        try:
            written += os.read(leader, 65536)
        except OSError:
            break
        # By then all modules are loaded: Python ends by the signal where it comes amid that.
        if end and b" off nominal" in written:
            process.send_signal(signal.SIGINT)
            end = False
    os.close(leader)
    return process.wait(PATIENCE), written.decode()


TAKEN, GIVEN_BACK = "\x1b[?1049h", "\x1b[?1049l"
COLOUR = re.compile(r"\x1b\[[0-9;]*3[0-7]m")


def test_a_terminal_is_taken_and_given_back_and_the_end_stays_on_it(bag, run):
    code, written = on_a_terminal([str(bag), "--rate", "400"])
    assert code == 0
    assert written.count(TAKEN) == written.count(GIVEN_BACK) == 1
    shown, _, left = written.partition(GIVEN_BACK)
    assert "Beam" in shown and COLOUR.search(shown)
    assert run.run_id in left and "Squareness" in left
    # The cursor is seen again.
    assert written.rfind("\x1b[?25h") > written.rfind("\x1b[?25l")


def test_ctrl_c_leaves_the_terminal_whole_and_there_may_be_no_colour(bag):
    code, written = on_a_terminal([str(bag), "--rate", "40"], end=True, NO_COLOR="1")
    assert code == 0
    assert written.endswith(GIVEN_BACK) or written.rfind(GIVEN_BACK) > written.rfind(TAKEN)
    assert written.rfind("\x1b[?25h") > written.rfind("\x1b[?25l")
    assert not COLOUR.search(written) and "Traceback" not in written


def test_a_terminal_that_cannot_be_drawn_on_gets_a_log(bag):
    code, written = on_a_terminal([str(bag), "--rate", "0"], TERM="dumb")
    assert code == 0 and "\x1b" not in written and " state: finished" in written


class AState:
    """What a viewer knows of a run that has measured five stops, with those that have come."""

    def __init__(self):
        self.stops = 0

    def document(self, name):
        run = {"state": "FINISHED", "run_id": "one", "stops_done": 5}
        trace = [[number, None, None] for number in range(1, self.stops + 1)]
        return {"run": run, "stop": {"trace": trace}}[name]


def test_who_looks_once_waits_for_stops_that_are_late_but_not_for_ever(monkeypatch):
    monkeypatch.setattr(watch, "_make_screen", lambda *_: None)
    now = [100.0]
    monkeypatch.setattr(watch.time, "monotonic", lambda: now[0])
    node = SimpleNamespace(contact=lambda: "ten nodes", namespaces_with=lambda _: "")

    def seconds_until_done(late):
        state, begun = AState(), now[0]
        once = watch._Once(state)
        while not once.look(node):
            now[0] += 0.1
            state.stops = 5 if now[0] - begun > late else 3
        return now[0] - begun

    assert seconds_until_done(0.0) < 2.0
    assert 4.0 < seconds_until_done(4.0) < 4.5
    assert 10.0 < seconds_until_done(1e9) < 10.5
