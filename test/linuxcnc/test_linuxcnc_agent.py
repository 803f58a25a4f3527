"""The agent's own pace, by a clock of the test and on a machine that stands; needs no LinuxCNC."""

import json
import socket
import sys
import tempfile
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from stepdiag_ros.devices.cnc import linuxcnc_agent

RATE, HOLD = 200.0, 0.02
LOOK = 0.002


class Standing:
    """A controller whose machine is where it is told to be, at once."""

    version = "0"

    def __init__(self, clock):
        self.clock, self.component, self.position = clock, {}, (0.0, 0.0, 0.0)
        self.cycles, self.samples = None, []
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


def test_a_stop_of_the_agent_is_no_silence_of_the_client(bench):
    lasts = bench.agent._controller.component

    def course():
        yield from bench.greet()
        bench.ask("start")
        yield from bench.looks(3)
        assert lasts["session"]
        # It is stopped once it has asked the client, who goes on to give signs of life.
        bench.now, bench.after = bench.now + LOOK, 10.0
        yield True
        yield from bench.looks(10)
        assert lasts["session"]
        bench.now, bench.after = bench.now + 10.0, 0.0
        yield True

    bench.execute(course())
    assert not lasts["session"]


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


class Channel:
    """A status channel that, once broken, stays so; a new one works when LinuxCNC does."""

    linuxcnc_works, opened = True, 0

    def __init__(self):
        type(self).opened += 1
        self.broken = False
        # As before the first poll.
        self.task_state, self.linear_units, self.joints, self.joint = 0, 0.0, 0, []
        self.actual_position = (0.0,) * 9

    def poll(self):
        if self.broken or not self.linuxcnc_works:
            self.broken = True
            raise RuntimeError("emcStatusBuffer invalid err=5")
        self.task_state, self.linear_units, self.joints = 4, 1.0, 3
        self.joint = [
            {"fault": 0, "min_hard_limit": 0, "max_hard_limit": 0, "homed": 1} for _ in range(3)
        ]


class Messages:
    """An error channel with one message, behind an internal error."""

    opened = 0

    def __init__(self):
        type(self).opened += 1
        self.left = [RuntimeError("err=5")] if self.opened == 1 else [(1, "joint 0 lags"), None]

    def poll(self):
        message = self.left.pop(0)
        if isinstance(message, Exception):
            raise message
        return message


class Component(dict):
    """A component of HAL."""

    def newpin(self, name, *_):
        self[name] = False

    def ready(self):
        """Be ready."""


@pytest.fixture
def clock(monkeypatch):
    monkeypatch.setitem(sys.modules, "hal", ModuleType("hal"))
    monkeypatch.syspath_prepend(Path(linuxcnc_agent.__file__).parent)
    import stepdiag_cycles

    yield stepdiag_cycles.CycleClock(1_000_000)
    del sys.modules["stepdiag_cycles"]


ZERO = 1_800_000_000_000_000_000
"""ns, of the cycle with the number 0."""


def watch(clock, numbers, zero=ZERO):
    """Let a program see cycles up to 0.7 ms late, some of them by a further 40 ms."""
    for number in numbers:
        late = 700_000 * (number * 7 % 11) // 10 + (40_000_000 if number % 50 == 3 else 0)
        clock.see(number, zero + number * clock.period + late)


def test_cycles_have_their_times_however_late_they_are_seen(clock):
    watch(clock, range(0, 3000, 2))
    assert clock.time(2998) == ZERO + 2998 * clock.period
    assert clock.time(100) - clock.time(99) == clock.period


def test_a_clock_that_is_set_back_acts_at_once_and_one_set_forward_later(clock):
    watch(clock, range(0, 3000, 2))
    watch(clock, range(3000, 3100), ZERO - 5_000_000)
    assert clock.time(3099) == ZERO - 5_000_000 + 3099 * clock.period
    watch(clock, range(3100, 4000), ZERO + 8_000_000)
    assert clock.time(3999) == ZERO - 5_000_000 + 3999 * clock.period
    watch(clock, range(4000, 16000), ZERO + 8_000_000)
    assert clock.time(15999) == ZERO + 8_000_000 + 15999 * clock.period


def test_cycles_are_later_than_a_status_that_was_told_while_they_stalled(clock, monkeypatch):
    import stepdiag_cycles

    cycles, numbers = object.__new__(stepdiag_cycles.Cycles), []
    cycles.clock, cycles.latest = clock, 0
    cycles._stream = SimpleNamespace(sampleno=0)

    def read():
        if not numbers:
            return None
        cycles._stream.sampleno = numbers.pop(0)
        return [0.0]

    cycles._stream.read = read
    seen = [0]
    monkeypatch.setattr(stepdiag_cycles.time, "time_ns", lambda: ZERO + seen[0])
    numbers[:], seen[0] = range(1, 100), 100_000_000
    before = [at for at, _ in cycles.read(0)]
    # The thread stands still for 300 ms; its cycles, counted on, go on after what was told then.
    told = before[-1] + 250_000_000
    numbers[:], seen[0] = range(100, 500), 800_000_000
    later = [at for at, _ in cycles.read(told)]
    assert before == sorted(set(before)) and later == sorted(set(later))
    assert later[0] > told and later[-1] - later[-2] == clock.period


@pytest.fixture
def controller(monkeypatch):
    for made in (Channel, Messages):
        monkeypatch.setattr(made, "opened", 0)
    linuxcnc = ModuleType("linuxcnc")
    for name, value in {
        "error": RuntimeError,
        "version": "0",
        "stat": Channel,
        "command": object,
        "error_channel": Messages,
        "ini": lambda _: SimpleNamespace(find=lambda *_: None),
        "NML_ERROR": 1,
        "OPERATOR_ERROR": 11,
        "STATE_ESTOP": 1,
        "STATE_ON": 4,
    }.items():
        setattr(linuxcnc, name, value)
    hal = ModuleType("hal")
    hal.error, hal.component, hal.HAL_BIT, hal.HAL_OUT = RuntimeError, lambda _: Component(), 1, 32
    hal.component_is_ready = lambda _: True
    hal.get_value = lambda name: name == "iocontrol.0.emc-enable-in"
    monkeypatch.setitem(sys.modules, "linuxcnc", linuxcnc)
    monkeypatch.setitem(sys.modules, "hal", hal)
    monkeypatch.syspath_prepend(Path(linuxcnc_agent.__file__).parent)
    import stepdiag_controller

    yield stepdiag_controller.Controller("machine.ini")
    del sys.modules["stepdiag_controller"]


def test_an_internal_error_of_the_status_channel_does_not_end_the_session(controller):
    assert controller.trouble() == ""
    controller.stat.broken = True
    controller.look()
    assert controller.trouble() == "" and not controller.stat.broken


def test_a_status_that_stays_away_holds_the_machine_until_it_is_back(controller, monkeypatch):
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now)
    monkeypatch.setattr(Channel, "linuxcnc_works", False)
    for _ in range(20):
        controller.look()
        now += 0.002
        assert "err=5" in controller.trouble()
    # Opened at the start, and then not with every look.
    assert 2 <= Channel.opened <= 4
    monkeypatch.setattr(Channel, "linuxcnc_works", True)
    now += 1.0
    controller.look()
    assert controller.trouble() == ""


def test_messages_come_again_after_an_internal_error_of_their_channel(controller):
    assert controller.errors() == []
    assert controller.errors() == ["joint 0 lags"]
