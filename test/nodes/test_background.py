"""Work in a process of its own: results, refusals and accidents come back; none is left behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from patience import PATIENCE
from refused import refused

from stepdiag_ros.nodes.background import YIELDING, BackgroundProcess, WorkFailed

ENDLESS = 600.0


@pytest.fixture
def background():
    made = BackgroundProcess()
    yield made
    made.end()


def alive(process_id):
    state = Path(f"/proc/{process_id}/stat")
    return state.exists() and state.read_text().rsplit(")", 1)[1].split()[0] != "Z"


def test_results_come_back_one_after_another_from_one_process(background):
    answers = [background.submit(pow, number, 2) for number in range(5)]
    assert [answer.result(PATIENCE) for answer in answers] == [0, 1, 4, 9, 16]
    # Large enough that replies would mix if they were asked for at the same time.
    sizes = [3_000_000 + number for number in range(8)]
    answers = [background.submit(bytes, size) for size in sizes]
    assert [len(answer.result(PATIENCE)) for answer in answers] == sizes
    process_id = background.submit(os.getpid).result(PATIENCE)
    assert process_id not in (os.getpid(), None)
    assert background.submit(os.getpid).result(PATIENCE) == process_id


def test_the_process_is_of_low_priority(background):
    niceness = background.submit(os.getpriority, os.PRIO_PROCESS, 0).result(PATIENCE)
    assert niceness == min(19, os.getpriority(os.PRIO_PROCESS, 0) + YIELDING)


def test_what_is_printed_while_working_does_not_get_between_the_replies(background):
    background.submit(print, "pickle?").result(PATIENCE)
    background.submit(os.write, 1, b"bytes").result(PATIENCE)
    assert background.submit(abs, -1).result(PATIENCE) == 1


def test_a_refusal_stays_one_and_another_error_tells_where(background):
    with refused(ValueError, None, "'x'"):
        background.submit(int, "x").result(PATIENCE)
    with refused(WorkFailed, None, "Traceback", "ZeroDivisionError"):
        background.submit(divmod, 1, 0).result(PATIENCE)
    with refused(WorkFailed, None, "pickle"):
        background.submit(lambda: 1).result(PATIENCE)
    assert background.submit(abs, -1).result(PATIENCE) == 1


def test_a_killed_process_is_said_and_replaced(background):
    process_id = background.submit(os.getpid).result(PATIENCE)
    work = background.submit(time.sleep, 60.0)
    time.sleep(0.2)
    os.kill(process_id, signal.SIGKILL)
    with refused(WorkFailed, None, "-9"):
        work.result(PATIENCE)
    assert background.submit(os.getpid).result(PATIENCE) != process_id


def test_ending_does_not_wait_for_the_work(background):
    process_id = background.submit(os.getpid).result(PATIENCE)
    background.submit(time.sleep, ENDLESS)
    time.sleep(0.2)
    began = time.monotonic()
    background.end()
    assert time.monotonic() - began < ENDLESS
    assert not alive(process_id)


def test_the_process_ends_with_the_one_that_started_it_even_if_that_is_killed():
    code = (
        "import os, time\n"
        "from stepdiag_ros.nodes.background import BackgroundProcess\n"
        "print(BackgroundProcess().submit(os.getpid).result(), flush=True)\n"
        "time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as parent:
        process_id = int(parent.stdout.readline())
        assert alive(process_id)
        parent.kill()
    deadline = time.monotonic() + PATIENCE
    while alive(process_id) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not alive(process_id)
