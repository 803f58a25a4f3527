"""Run, stops, commands, work and storage, as /diagnostics tells them."""

from math import nan
from pathlib import Path

import pytest

from stepdiag_ros.run.health import UNKNOWN, WINDOW, Level
from stepdiag_ros.run.pacing import GovernedTime
from stepdiag_ros.run.sequence import Answer, Progress, State
from stepdiag_ros.run.work_health import (
    Commands,
    Reached,
    StopCount,
    Storage,
    StreamArrival,
    Work,
    judge_recording,
    judge_run,
)

SECOND = 1_000_000_000


def progress(state, text):
    return Progress(
        state=state,
        line_index=1,
        line_count=3,
        line="ppp XYZ forward, repeat 1",
        setup="ppp",
        block=1,
        block_count=3,
        stop=2,
        stop_count=10,
        stops_done=12,
        stops_total=30,
        remaining_time=nan,
        text=text,
    )


@pytest.mark.parametrize(
    ("state", "level"),
    [
        (State.RUNNING, Level.OK),
        (State.PAUSED, Level.WARN),
        (State.WAITING_FOR_SETUP, Level.WARN),
        (State.FAULT, Level.ERROR),
        (State.FINISHED, Level.OK),
        (State.ABORTED, Level.OK),
    ],
)
def test_a_run_tells_where_it_is_and_what_it_waits_for(state, level):
    finding = judge_run(progress(state, "as it is"), "the stop to settle")
    assert finding.level is level and "as it is" in finding.message
    assert finding.values["stops of the run"] == "12 of 30"
    assert finding.values["waits for"] == "the stop to settle"
    assert finding.values["remaining time (s)"] == UNKNOWN


def test_nothing_was_started():
    assert judge_run(None, "").message == "nothing was started"


def test_a_stream_is_waited_for_only_in_a_run():
    arrival = StreamArrival("reading", 3.0)
    assert arrival.judge(True, 0, 0.0).level is Level.OK
    arrival.begin(SECOND, 1.0)
    assert arrival.judge(True, 4 * SECOND, 4.0).level is Level.OK
    finding = arrival.judge(True, 4 * SECOND + 1, 4.1)
    assert finding.level is Level.STALE and finding.forbids
    assert finding.message == "no reading has come for more than 3 s"
    assert arrival.judge(False, 5 * SECOND, 5.0).level is Level.OK
    arrival.take(5 * SECOND, 5.0)
    assert arrival.judge(True, 5 * SECOND, 5.0).level is Level.OK


def test_stops_are_counted():
    stops = StopCount()
    stops.take("")
    assert stops.judge().level is Level.OK
    stops.take("ppp, stop 3: the beam was lost")
    finding = stops.judge()
    assert finding.level is Level.WARN
    assert finding.values["last rejection"] == "ppp, stop 3: the beam was lost"
    assert (finding.values["settled stops"], finding.values["rejected stops"]) == ("1", "1")


def test_a_command_that_failed_is_told_until_one_succeeds():
    commands = Commands()
    assert commands.judge(False).level is Level.OK
    for number, answer, words in (
        (1, Answer.REJECTED, "command 1 was rejected: beyond the limits"),
        (2, Answer.STOPPED, "command 2 was stopped: beyond the limits"),
        (3, Answer.FAULT, "command 3 ended in a fault: beyond the limits"),
    ):
        commands.take(number, Answer.ACCEPTED, "")
        commands.take(number, answer, "beyond the limits")
        finding = commands.judge(False)
        assert finding.level is Level.WARN and finding.message == words
    commands.take(4, Answer.MOVING, "")
    assert commands.judge(True).level is Level.WARN
    commands.take(4, Answer.IN_POSITION, "")
    finding = commands.judge(False)
    assert finding.level is Level.OK
    values = finding.values
    assert [values[key] for key in ("executed", "failed", "rejected")] == ["1", "2", "1"]


def test_work_is_timed_piece_by_piece():
    work = Work("solution")
    assert work.judge(0, 0).values["last solution took (s)"] == UNKNOWN
    work.begin(10.0)
    assert "at work" in work.judge(2, 2).message
    work.end(13.0)
    work.end(14.0)
    values = work.judge(0, 2).values
    assert (values["last solution took (s)"], values["longest took (s)"]) == ("1", "3")
    assert values["solutions made"] == "2"


class TestStorage:
    def test_room_is_told_at_its_limits(self):
        storage = Storage(warn_below=2e9, stop_below=2e8)
        assert storage.judge(int(2e9), 0, 0.0).level is Level.OK
        assert storage.judge(int(2e9) - 1, 0, 0.0).level is Level.WARN
        assert storage.judge(int(2e8), 0, 0.0).level is Level.WARN
        finding = storage.judge(int(2e8) - 1, 0, 0.0)
        assert finding.level is Level.ERROR and finding.forbids
        assert storage.judge(int(3e9), 0, 0.0).level is Level.OK

    def test_the_rate_says_when_the_disk_will_be_full(self):
        storage = Storage(0.0, 0.0)
        storage.judge(int(1e9), 0, 0.0)
        values = storage.judge(int(1e9), int(5e6 * WINDOW), WINDOW).values
        assert values["written a second (MB/s)"] == "5"
        assert values["full in (s), at this rate"] == "200"
        # Another bag begins.
        values = storage.judge(int(1e9), 10, 2 * WINDOW).values
        assert values["written a second (MB/s)"] == UNKNOWN

    def test_a_folder_that_is_gone(self, tmp_path):
        storage = Storage(0.0, 0.0)
        assert storage.look(tmp_path, None, 0.0).level is Level.OK
        finding = storage.look(tmp_path / "gone", None, 0.0)
        assert finding.level is Level.ERROR and "gone" in finding.message


def test_simulated_time_that_is_held_up_is_told_and_by_whom():
    governed, reached = GovernedTime(20.0, 0, 0.0), Reached()
    for real in (0.0, WINDOW):
        finding = reached.judge(governed, real)
    assert finding.level is Level.OK
    assert finding.values["simulated seconds in a real second"] == "20"
    assert finding.values["waits for"] == "nobody"
    # The recorder comes on by 10 s a second only.
    for step in range(1, 81):
        real = WINDOW + 0.05 * step
        governed.heard(round((20.0 + 0.5 * step) * SECOND), real, "recorder", 0.1)
        governed.advance(real)
        finding = reached.judge(governed, real)
    assert finding.level is Level.WARN and "slower" in finding.message
    assert float(finding.values["simulated seconds in a real second"]) == pytest.approx(10.0, 0.2)
    assert finding.values["waits for"] == "recorder"
    governed.run_at(5.0, real)
    for step in range(1, 81):
        later = real + 0.05 * step
        governed.heard(10**15, later, "recorder")
        finding = reached.judge(governed, later)
    assert finding.level is Level.OK and finding.values["waits for"] == "nobody"


def test_a_recording_tells_what_is_stored():
    assert judge_recording("", 0, "", 0, "").message == "waits for a run"
    finding = judge_recording(str(Path("run.mcap")), 7, "12", 1, "")
    assert finding.message == "records a run"
    assert finding.values["last stop on the disk"] == "12"
    finding = judge_recording("", 0, "", 0, "the disk is full")
    assert (finding.level, finding.message) == (Level.ERROR, "the disk is full")
