"""The agent's own pace, by a clock of the test and on a machine that stands; needs no LinuxCNC."""

import json
import socket
import sys
import tempfile
import time
from pathlib import Path
from types import ModuleType

import pytest

from stepdiag_ros.devices.cnc import linuxcnc_agent

RATE, HOLD = 200.0, 0.02
LOOK = 0.002


class Standing:
    """A controller whose machine is where it is told to be, at once."""

    version = "0"

    def __init__(self, clock):
        self.clock, self.component, self.position = clock, {}, (0.0, 0.0, 0.0)
        self.look()

    def look(self):
        self.time, self.looked = time.time_ns(), time.monotonic()
        # What passes until the agent judges by what it has seen.
        self.clock.now += self.clock.after

    def move(self, target, _):
        self.position = tuple(target)
        return 1

    def limits(self):
        return [-1.0] * 3, [1.0] * 3

    def largest(self, _):
        return [None] * 3

    def commanded(self):
        return list(self.position)

    motors = commanded

    def abort(self):
        """Stand on."""

    def errors(self):
        return []

    def trouble(self):
        return ""

    hindrance = trouble

    def at_rest(self):
        return True

    in_mdi = at_rest

    def ended(self, _):
        return True

    def failed(self, _):
        return False


class Bench:
    """The agent, its client, and the clock by which it works."""

    def __init__(self, module, folder):
        self.now, self.after, self.asked = 1000.0, 0.0, 0
        listener = module.listen(str(Path(folder) / "a"), 0o600)
        self.agent = module.Agent(Standing(self), listener)
        self.client = socket.socket(socket.AF_UNIX)
        self.client.connect(listener.getsockname())

    def ask(self, op, **content):
        self.asked += 1
        text = json.dumps({"ask": self.asked, "op": op, **content})
        self.client.sendall(text.encode() + b"\n")

    def greet(self):
        yield from self.looks(1)
        self.ask("hello", protocol=1, window=1e-6, hold=HOLD, dead_man=5.0, rate=RATE)
        yield from self.looks(50)
        self.told("")

    def looks(self, count, period=LOOK, after=0.0):
        """Let the agent look so often, and the client give a sign of life each time."""
        for _ in range(count):
            self.ask("alive")
            self.now, self.after = self.now + period, after
            yield True

    def told(self, event):
        """Return what the client was told of an event since the last time."""
        data = self.client.recv(1 << 20).decode()
        told = [json.loads(line) for line in data.splitlines()]
        return [one for one in told if one.get("event") == event]

    def execute(self, course):
        self.agent.run(lambda: next(course, False))


@pytest.fixture
def bench(monkeypatch):
    controller = ModuleType("stepdiag_controller")
    controller.AXES, controller.Controller = "XYZ", Standing
    monkeypatch.setitem(sys.modules, controller.__name__, controller)
    monkeypatch.syspath_prepend(Path(linuxcnc_agent.__file__).parent)
    import stepdiag_agent

    # What is sent is there already when the agent looks.
    monkeypatch.setattr(stepdiag_agent, "PERIOD", 0.0)
    monkeypatch.setattr(stepdiag_agent, "IDLE_PERIOD", 0.0)
    with tempfile.TemporaryDirectory(prefix="la") as folder, monkeypatch.context() as patched:
        made = Bench(stepdiag_agent, folder)
        patched.setattr(time, "monotonic", lambda: made.now)
        patched.setattr(time, "time_ns", lambda: round(1e9 * made.now))
        yield made
        made.client.close()
    del sys.modules["stepdiag_agent"]


def test_samples_come_at_the_rate_that_was_asked_or_with_each_look(bench):
    def course():
        yield from bench.greet()
        yield from bench.looks(500)
        assert len(bench.told("sample")) == pytest.approx(RATE, abs=2)
        # A busy computer: there is nothing to tell between two looks ...
        yield from bench.looks(50, period=0.02)
        assert len(bench.told("sample")) == 50
        # ... and what was not told then is not told later.
        yield from bench.looks(1, period=1.0)
        yield from bench.looks(500)
        assert len(bench.told("sample")) == pytest.approx(RATE, abs=3)

    bench.execute(course())


@pytest.mark.parametrize(
    ("pace", "latest"),
    [
        ([(40, LOOK, 0.0)], 0.024),
        ([(40, 0.05, 0.0)], 0.051),
        # The agent is interrupted between its second look and what it makes of that.
        ([(1, LOOK, 0.0), (1, LOOK, 0.05), (40, LOOK, 0.0)], 0.06),
    ],
)
def test_a_move_ends_after_the_hold_time_between_two_positions(bench, pace, latest):
    def course():
        yield from bench.greet()
        bench.ask("start")
        yield from bench.looks(50)
        bench.told("state")
        bench.ask("move", move=1, target=[0.5, 0.0, 0.0], feed=0.1, axes="X")
        for some in pace:
            yield from bench.looks(*some)
        moving, ready = bench.told("state")
        assert (moving["state"], ready["state"]) == ("moving", "ready")
        # The machine is there within the look in which it is told to move.
        assert HOLD <= (ready["time"] - moving["time"]) * 1e-9 < latest

    bench.execute(course())
