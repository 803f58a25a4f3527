"""The driver against an agent that misbehaves; needs no LinuxCNC."""

import errno
import json
import select
import socket
import statistics
import tempfile
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from patience import PATIENCE
from refused import a_fault, refused
from ros_processes import wait_until

from stepdiag_ros.configuration import load_machine
from stepdiag_ros.devices.cnc import CncState, MoveRefused, PositionSample, linuxcnc
from stepdiag_ros.devices.cnc.linuxcnc import LinuxCnc
from stepdiag_ros.metrology.refusal import Refusal

MACHINE = load_machine("demo")[0]
FACTS = {
    "ok": True,
    "reason": "",
    "last_move": 7,
    "low": [-0.1, -0.1, -0.1],
    "high": [0.5, 0.6, 0.7],
    "velocity": [0.5, None, 0.5],
    "acceleration": [2.0, 2.0, None],
}
pytestmark = pytest.mark.timeout(2 * PATIENCE)


def line(**content) -> bytes:
    return json.dumps(content).encode() + b"\n"


def state(name, reason="", x=0.0, at=1_000):
    return line(event="state", time=at, state=name, reason=reason, position=[x, 0.0, 0.0])


def sample(x=0.0, at=1_000, motors=(0.0, 0.0, 0.0)):
    position = [x, 0.0, 0.0]
    return line(event="sample", time=at, position=position, motors=motors and list(motors))


class Agent:
    """Answers what is asked as the test wants it, and keeps what was asked."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "a.sock"
        self.listener = socket.socket(socket.AF_UNIX)
        self.listener.bind(str(self.path))
        self.listener.listen(1)
        self.asked: list[dict] = []
        self.answers = {"hello": FACTS, "start": {"ok": True, "reason": ""}}
        self.before = {"hello": b"", "start": b"", "move": b""}
        self.connection: socket.socket | None = None
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def serve(self) -> None:
        while not self.ended.is_set():
            if not select.select([self.listener], [], [], 0.02)[0]:
                continue
            self.connection = self.listener.accept()[0]
            data = b""
            while not self.ended.is_set():
                if not select.select([self.connection], [], [], 0.02)[0]:
                    continue
                try:
                    new = self.connection.recv(65536)
                except OSError:
                    break
                if not new:
                    break
                *lines, data = (data + new).split(b"\n")
                for text in lines:
                    self.take(json.loads(text))

    def take(self, message) -> None:
        self.asked.append(message)
        answer = self.answers.get(message["op"])
        told = self.before.get(message["op"], b"")
        if isinstance(answer, bytes):
            self.say(told + answer)
        elif answer is not None:
            self.say(told + line(answer=message["ask"], **answer))

    def say(self, data: bytes) -> None:
        assert self.connection is not None
        self.connection.sendall(data)

    def close(self) -> None:
        self.ended.set()
        self.thread.join()
        if self.connection is not None:
            self.connection.close()
        self.listener.close()


@pytest.fixture
def agent():
    with tempfile.TemporaryDirectory(prefix="la") as folder:
        made = Agent(Path(folder))
        yield made
        made.close()


@pytest.fixture
def driver(agent):
    agent.before["hello"] = state("ready") + sample()
    made = LinuxCnc(str(agent.path), MACHINE, 100.0, 0.4)
    polled(made, lambda events: bool(events))
    yield made
    made.close()


def polled(driver, condition, limit=PATIENCE):
    events, took, end = [], [], time.monotonic() + limit
    while not condition(events):
        assert time.monotonic() < end, events
        begun = time.monotonic()
        events += driver.poll(time.time_ns())
        took.append(time.monotonic() - begun)
        time.sleep(0.002)
    # A poll never waits; that one is late now and then is the computer's doing.
    assert not took or statistics.median(took) < 0.05
    return events


def test_the_facts_of_the_machine_are_taken_from_the_hello(agent, driver):
    hello = agent.asked[0]
    assert (hello["op"], hello["protocol"]) == ("hello", 1)
    assert (hello["window"], hello["hold"]) == (0.5e-6, 0.02)
    assert (hello["dead_man"], hello["rate"]) == (0.4, 100.0)
    # The tighter of LinuxCNC (-0.1 … 0.5, 0.6, 0.7) and the machine file.
    assert driver.soft_limits == ((-0.05, -0.05, -0.05), (0.5, 0.5, 0.35))
    assert driver.traits.feed_limit[0] == 0.5 and driver.traits.feed_limit[1] != 0.5
    assert driver.traits.dead_man == 0.4


def test_signs_of_life_come_often_enough_and_only_while_polled(agent, driver, monkeypatch):
    def alive():
        return sum(message["op"] == "alive" for message in agent.asked)

    now = time.monotonic()
    monkeypatch.setattr(linuxcnc, "time", SimpleNamespace(monotonic=lambda: now))
    for _ in range(250):
        now += 0.002
        driver.poll(0)
    now += 10.0
    assert wait_until(lambda: alive() >= 4)
    time.sleep(0.3)
    assert alive() <= 12


def test_half_lines_are_put_together(agent, driver):
    data = sample(0.01, 2_000) + state("moving", at=3_000) + sample(0.02, 4_000, motors=None)
    events = []
    for begin in range(0, len(data), 7):
        agent.say(data[begin : begin + 7])
        events += driver.poll(time.time_ns())
    events += polled(driver, lambda new: len(events) + len(new) >= 3)
    assert [event.time for event in events] == [2_000, 3_000, 4_000]
    assert driver.state is CncState.MOVING
    assert events[-1] == PositionSample(4_000, (0.02, 0.0, 0.0), None)


@pytest.mark.parametrize(
    "garbage",
    [
        b"\xff\xfe\x00\n",
        b"[]\n",
        b"{}\n",
        b"null\n",
        b'{"event": "sample"}\n',
        line(event="sample", time=1, position=[1.0, 2.0], motors=None),
        line(event="sample", time=1, position=["a", 0, 0], motors=None),
        b'{"event": "sample", "time": 1, "position": [NaN, 0, 0], "motors": null}\n',
        state("dancing"),
        b"x" * 70_000,
    ],
)
def test_garbage_is_refused_as_nonsense(agent, driver, garbage):
    agent.say(garbage)
    with refused(Refusal):
        polled(driver, lambda _: False)


def test_silence_is_an_os_error_within_a_second(driver):
    begun = time.monotonic()
    with refused(OSError, None, "1", errno=errno.ETIMEDOUT):
        polled(driver, lambda _: False)
    assert time.monotonic() - begun > 0.9


def test_a_move_that_is_not_answered_is_an_os_error_and_never_sent_again(agent, driver):
    with refused(OSError, errno=errno.ETIMEDOUT):
        driver.start_move(time.time_ns(), (0.01, 0.0, 0.0), 0.1, "X")
    # Whoever keeps the driver all the same cannot make it send the same number once more.
    with refused(OSError, errno=errno.ETIMEDOUT):
        driver.start_move(time.time_ns(), (0.01, 0.0, 0.0), 0.1, "X")
    moves = [message["move"] for message in agent.asked if message["op"] == "move"]
    assert moves == [8, 9]


def test_a_refused_move_does_not_use_up_its_number(agent, driver):
    agent.answers["move"] = {"ok": False, "reason": "the machine is not homed"}
    for _ in range(2):
        with refused(MoveRefused, "rejected") as caught:
            driver.start_move(time.time_ns(), (0.01, 0.0, 0.0), 0.1, "X")
        assert agent.answers["move"]["reason"] in str(caught.value)
    agent.answers["move"], agent.before["move"] = {"ok": True, "reason": ""}, state("moving")
    driver.start_move(time.time_ns(), (0.01, 0.0, 0.0), 0.1, "X")
    assert driver.state is CncState.MOVING
    moves = [message["move"] for message in agent.asked if message["op"] == "move"]
    assert moves == [8, 8, 8]


def test_answers_that_are_none_are_nonsense(agent, driver):
    agent.answers["start"] = {"ok": "yes"}
    with refused(Refusal, "malformed"):
        driver.reset(time.time_ns())


@pytest.mark.parametrize(
    ("hello", "error", "words"),
    [
        (None, OSError, a_fault(errno=errno.ETIMEDOUT)),
        (
            b'{"event": "refused", "reason": "another client is there"}\n',
            OSError,
            a_fault(errno=errno.EBUSY),
        ),
        ({"ok": True}, ValueError, a_fault("malformed")),
        ({**FACTS, "low": [0, 0]}, ValueError, a_fault()),
        ({**FACTS, "low": [0.95, 0, 0]}, ValueError, a_fault("mismatch", "X")),
    ],
)
def test_a_hello_that_cannot_be_used_is_said(agent, hello, error, words):
    agent.answers["hello"] = hello
    with refused(error, words):
        LinuxCnc(str(agent.path), MACHINE, 100.0, 0.5)


def test_an_agent_that_goes_away_is_an_os_error_whatever_is_done(agent, driver):
    agent.close()
    with refused(OSError, errno=errno.ECONNRESET):
        polled(driver, lambda _: False)
    for action in (
        lambda: driver.reset(0),
        lambda: driver.stop(0, "x"),
        lambda: driver.start_move(0, (0.0, 0.0, 0.0), 0.1, "X"),
    ):
        with refused(OSError, errno=errno.ECONNRESET):
            action()
    driver.close()
    driver.close()
