"""The driver and the agent on a real LinuxCNC: moves, limits, and everything that goes wrong."""

import contextlib
import errno
import json
import math
import re
import select
import socket
import time

import numpy as np
import pytest
from cnc_conformance import CHECKS, Rig
from linuxcnc_watched import DEAD_MAN, SLOW, Watched, at_rest, velocity
from patience import PATIENCE
from refused import a_fault, refused

from stepdiag_ros.configuration import load_machine
from stepdiag_ros.devices.cnc import CncState, MoveRefused
from stepdiag_ros.devices.cnc.linuxcnc import LinuxCnc
from stepdiag_ros.metrology.refusal import Refusal

WINDOW = 0.5e-6
pytestmark = pytest.mark.timeout(2 * PATIENCE)


class RawClient:
    """Speaks the agent's protocol by hand, past the checks of the driver."""

    def __init__(self, path) -> None:
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.settimeout(PATIENCE)
        self.socket.connect(str(path))
        self.lines = self.socket.makefile("rb")
        self.asked, self.state = 0, {}

    def say(self, text: bytes) -> None:
        self.socket.sendall(text)

    def ask(self, op, **content):
        self.asked += 1
        self.say(json.dumps({"ask": self.asked, "op": op, **content}).encode() + b"\n")
        return self.answer()

    def answer(self):
        return next(told for told in self.told() if "answer" in told)

    def told(self):
        for line in self.lines:
            told = json.loads(line)
            if told.get("event") == "state":
                self.state = told
            yield told

    def hello(self):
        # The longest dead-man that there is: nobody says that he lives while the test waits.
        return self.ask("hello", protocol=1, window=WINDOW, hold=0.02, dead_man=5.0, rate=50)

    def start(self):
        """Say start as an operator does: again, until the axes stand."""
        end = time.monotonic() + PATIENCE
        while not (told := self.ask("start"))["ok"]:
            assert time.monotonic() < end, told
            time.sleep(0.02)

    def move(self, number, x, feed=0.1, axes="X"):
        return self.ask("move", move=number, target=[x, 0.0, 0.0], feed=feed, axes=axes)

    def until(self, wanted):
        """Return the event of the present state, once that is the wanted one."""
        while self.state.get("state") != wanted:
            next(self.told())
        return self.state

    def close(self):
        self.lines.close()
        self.socket.close()


@pytest.fixture
def raw(machine_tool):
    clients = []

    def connect():
        clients.append(RawClient(machine_tool.socket))
        return clients[-1]

    yield connect
    for client in clients:
        client.close()


def test_a_move_ends_when_the_actual_position_is_there_and_stays(watched):
    begun = time.time_ns()
    watched.go(30.0, 0.0, 0.0)
    assert watched.driver.state is CncState.MOVING
    end = watched.until_state(CncState.READY)
    assert [change.state for change in watched.states()] == [CncState.MOVING, CncState.READY]
    assert abs(end.position[0] - 0.03) <= WINDOW
    # One more sample, in case that none has come since the position is within the window.
    watched.position()
    samples = watched.samples()
    times = np.array([sample.time for sample in samples])
    assert np.all(np.diff(times) > 0)
    assert begun < end.time <= times[-1] < time.time_ns()
    # Never faster than asked; how much slower a busy computer is, LinuxCNC's agent cannot help:
    # test_linuxcnc_agent.py has its rate.
    assert (len(times) - 1) / (times[-1] - times[0]) * 1e9 < 220.0
    # Within the window for the hold time before the end. How long beyond that, if LinuxCNC's task
    # has to wait for the computer before it calls the move done, test_linuxcnc_agent.py has.
    outside = [s.time for s in samples if abs(s.position[0] - 0.03) > WINDOW]
    assert end.time - max(outside) >= 0.02e9
    # The lag of the drives is seen: these are no commanded positions.
    assert np.all(np.diff([sample.position[0] for sample in samples]) > -1e-9)
    for sample in samples:
        if abs(sample.position[0] - 0.03) <= WINDOW:
            assert sample.motors == pytest.approx(sample.position, abs=1e-6)
    watched.until(lambda: abs(watched.samples()[-1].position[0] - 0.03) < 1e-9)


def test_a_move_has_the_feed_that_was_asked(watched, machine_tool):
    watched.go(500.0, 0.0, 0.0)
    watched.until_moved()

    def full_speed():
        told = 0.0
        while told < 99.9999 and watched.driver.state is CncState.MOVING:
            told = velocity(machine_tool)
        return told

    assert watched.meanwhile(full_speed) == pytest.approx(100.0)
    watched.driver.stop(time.time_ns(), "enough")
    watched.until_state(CncState.STOPPED)


@pytest.fixture(scope="module")
def stiff(make_instance):
    """A LinuxCNC whose drives do not lag, so that a position at rest is exact."""
    return make_instance(lag_s=0.0)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__[6:])
def test_the_driver_keeps_to(check, stiff):
    with contextlib.ExitStack() as drivers:

        def opened():
            made = Watched(stiff.socket, patience=PATIENCE)
            drivers.callback(made.driver.close)
            made.reset()
            return made.driver

        check(Rig(load_machine("demo")[0], opened, time.time_ns, time.sleep))


def test_machine_coordinates_whatever_offsets_are_active(watched, machine_tool):
    machine_tool.run(
        "/usr/bin/python3",
        "-c",
        "import linuxcnc\nc = linuxcnc.command()\n"
        "for line in ('G20', 'G10 L2 P1 X5 Y-3 Z1', 'G54', 'G91', 'G43.1 Z2', 'G93'):\n"
        "    c.mdi(line)\n    c.wait_complete()\n",
    )
    watched.go(0.0, 0.0, 12.0, axes="Z")
    end = watched.until_state(CncState.READY)
    assert end.position == pytest.approx((0.0, 0.0, 0.012), abs=WINDOW)
    watched.go(10.0, 5.0, 22.0, axes="XYZ")
    end = watched.until_state(CncState.READY)
    assert end.position == pytest.approx((0.01, 0.005, 0.022), abs=WINDOW)
    machine_tool.run(
        "/usr/bin/python3",
        "-c",
        "import linuxcnc\nc = linuxcnc.command()\n"
        "for line in ('G21', 'G10 L2 P1 X0 Y0 Z0', 'G90', 'G49', 'G94'):\n"
        "    c.mdi(line)\n    c.wait_complete()\n",
    )


@pytest.mark.parametrize(
    ("target", "feed", "axes", "aspect"),
    [
        ((901.0, 0.0, 0.0), 0.1, "X", "limits"),
        ((-50.001, 0.0, 0.0), 0.1, "X", "limits"),
        ((10.0, 0.0, 0.0), 0.1, "Y", "axes"),
        ((10.0, 1.0, 0.0), 0.1, "X", "axes"),
        ((10.0, 0.0, 0.0), 0.0, "X", "feed"),
        ((10.0, 0.0, 0.0), -0.1, "X", "feed"),
        ((10.0, 0.0, 0.0), math.nan, "X", "feed"),
        ((10.0, 0.0, 0.0), 0.6, "X", "feed"),
        ((math.nan, 0.0, 0.0), 0.1, "X", "target"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_moves(watched, target, feed, axes, aspect):
    with refused(MoveRefused, aspect=aspect):
        watched.go(*target, feed=feed, axes=axes)
    watched.wait(0.1)
    watched.position()
    assert watched.driver.state is CncState.READY
    assert np.ptp([sample.position for sample in watched.samples()], axis=0).max() < WINDOW
    # And the next one is made: no number was lost.
    watched.go(1.0, 0.0, 0.0)
    assert watched.until_state(CncState.READY).position[0] == pytest.approx(0.001, abs=WINDOW)


def test_the_agent_itself_refuses_what_the_driver_would_have_let_pass(machine_tool, raw):
    client = raw()
    last = client.hello()["last_move"]
    assert not client.move(last + 1, 0.01)["ok"], "nobody has said start"
    client.start()
    here = client.until("ready")["position"][0]
    for x, feed, axes, why in (
        (0.9001, 0.1, "X", "beyond LinuxCNC's soft limits"),
        (here + 0.01, 0.6, "X", "LinuxCNC moves it at 0.5 m/s at most"),
        (here + 0.01, 0.0, "X", "the feed 0.0 m/s is not between 0 and 100 m/s"),
        (here + 0.01, 0.1, "Z", "the move is of X"),
    ):
        told = client.move(last + 1, x, feed, axes)
        assert not told["ok"] and why in told["reason"], told
    time.sleep(0.1)
    assert float(machine_tool.run("halcmd", "getp", "joint.0.motor-pos-fb")) == pytest.approx(
        1e3 * here, abs=1e3 * WINDOW
    )


def test_a_stop_brakes_at_once_and_holds_until_a_reset(watched):
    watched.go(500.0, 0.0, 0.0, feed=SLOW)
    watched.until_moved()
    before = watched.samples()[-1].position[0]
    watched.driver.stop(time.time_ns(), "enough")
    with refused(MoveRefused, "busy", aspect="motion"):
        watched.driver.reset(time.time_ns())
    end = watched.until_state(CncState.STOPPED)
    assert end.reason == "enough"
    # 20 mm/s: braked within 0.1 mm, and what it goes until the word is there on a busy computer.
    assert end.position[0] - before < 0.05
    with refused(MoveRefused, "not_ready", "stopped", aspect="state"):
        watched.go(0.0, 0.0, 0.0)
    watched.wait(0.3)
    assert watched.position()[0] == pytest.approx(end.position[0], abs=WINDOW)
    watched.reset()
    watched.go(0.0, 0.0, 0.0, feed=0.4)
    assert watched.until_state(CncState.READY).position[0] == pytest.approx(0.0, abs=WINDOW)


@pytest.mark.parametrize(
    ("step", "words"), [("STATE_ESTOP", "e-stop"), ("STATE_OFF", "the machine is switched off")]
)
def test_e_stop_and_power_off_are_faults_until_an_operator_has_seen_to_it(
    watched, machine_tool, step, words
):
    watched.go(500.0, 0.0, 0.0, feed=SLOW)
    watched.until_moved()
    watched.meanwhile(lambda: machine_tool.operate(step))
    fault = watched.until_state(CncState.FAULT)
    assert fault.reason == words
    assert 0.001 < fault.position[0] < 0.499, "it is not on its way"
    with refused(MoveRefused, "rejected") as caught:
        watched.driver.reset(time.time_ns())
    assert words in str(caught.value), "the reason of the fault"
    machine_tool.operate("STATE_ESTOP_RESET", "STATE_ON")
    watched.wait(0.2)
    assert watched.driver.state is CncState.FAULT, "only a reset ends a fault"
    stood = watched.position()[0]
    watched.reset()
    watched.wait(0.2)
    assert watched.position()[0] == pytest.approx(stood, abs=1e-6), "the old move goes on"


def test_a_frozen_encoder_is_a_following_error(watched, machine_tool):
    watched.go(500.0, 0.0, 0.0, feed=SLOW)
    watched.until_moved()
    watched.meanwhile(lambda: machine_tool.freeze("X"))
    fault = watched.until_state(CncState.FAULT)
    machine_tool.thaw("X")
    assert "joint 0 following error" in fault.reason and "switched off" in fault.reason
    machine_tool.operate("STATE_ON")
    watched.wait(0.3)
    watched.reset()


def test_a_frozen_encoder_at_the_end_of_a_move_is_not_in_position(watched, machine_tool):
    # Too short a way for a following error: LinuxCNC itself calls the move done.
    machine_tool.freeze("X")
    watched.go(0.1, 0.0, 0.0)
    watched.until(lambda: watched.driver.state is not CncState.MOVING)
    machine_tool.thaw("X")
    fault = watched.states()[-1]
    assert fault.state is CncState.FAULT
    off = re.fullmatch(r"LinuxCNC calls the move done, but X is (\S+) um off", fault.reason)
    assert float(off[1]) == pytest.approx(100.0, abs=1.0)
    watched.reset()


def test_silence_of_the_client_brakes_the_machine(machine_tool, watched):
    watched.go(800.0, 0.0, 0.0, feed=SLOW)
    watched.until_moved()
    begun = watched.samples()[-1].position[0]
    # Nobody polls: the bridge hangs.
    place = at_rest(machine_tool)
    watched.until(lambda: watched.driver.state is CncState.STOPPED)
    reason = watched.states()[-1].reason
    silent = re.fullmatch(r"the client was silent for (\d+\.\d+) s", reason)
    assert float(silent.group(1)) >= DEAD_MAN
    # The dead-man and the braking, and more on a busy computer: the agent is no real-time program.
    # The move is of 800 mm.
    assert place - 1e3 * begun < 1e3 * SLOW * DEAD_MAN + 200.0


def test_a_connection_that_ends_brakes_the_machine_and_no_move_is_repeated(machine_tool, watched):
    watched.go(800.0, 0.0, 0.0, feed=SLOW)
    watched.until_moved()
    watched.driver.close()
    first = at_rest(machine_tool)
    again = Watched(machine_tool.socket)
    again.until(lambda: again.driver.state is CncState.STOPPED)
    assert "the connection of the client has ended" in again.states()[-1].reason
    with pytest.raises(MoveRefused):
        again.go(800.0, 0.0, 0.0)
    again.reset()
    again.wait(0.2)
    assert 1e3 * again.position()[0] < first + 1.0, "the old move goes on"
    again.go(5.0, 0.0, 0.0, feed=0.4)
    assert again.until_state(CncState.READY).position[0] == pytest.approx(0.005, abs=WINDOW)
    again.driver.close()


def test_a_move_is_executed_once_whoever_sends_it_again(raw):
    client = raw()
    last = client.hello()["last_move"]
    client.start()
    here = client.until("ready")["position"][0]
    assert client.move(last + 1, here + 0.001)["ok"]
    client.until("ready")
    # Back, and then the first one once more: a repeated message must not move the machine.
    assert client.move(last + 2, here)["ok"]
    client.until("ready")
    for number in (last + 1, last + 2, last + 4):
        told = client.move(number, here + 0.001)
        assert not told["ok"] and "not the next one" in told["reason"]
    client.close()
    other = raw()
    assert other.hello()["last_move"] == last + 2
    other.start()
    assert not other.move(last + 2, here + 0.001)["ok"]
    assert other.until("ready")["position"][0] == pytest.approx(here, abs=WINDOW)


def test_half_lines_are_put_together_and_garbage_ends_the_connection(raw):
    for garbage in (b"\xff\xfe\n", b"[1]\n", b'{"op": "hello"}\n', b'{"ask": 1, "op": "move"}\n'):
        client = raw()
        client.say(garbage)
        told = list(client.told())
        assert told and told[-1]["event"] == "refused", garbage
        client.close()
    client = raw()
    hello = b'{"ask": 1, "op": "hello", "protocol": 1, "window": 1e-6, "hold": 0.02, '
    client.say(hello)
    assert not select.select([client.socket], [], [], 0.1)[0]
    client.say(b'"dead_man": 1.0, "rate": 100}\n')
    assert client.answer()["ok"]
    client.say(b'{"ask": 2, "op": "dance"}\n')
    assert list(client.told())[-1]["event"] == "refused"


def test_another_protocol_is_refused(raw):
    client = raw()
    client.say(b'{"ask": 1, "op": "hello", "protocol": 2}\n')
    assert "the protocol is 1" in list(client.told())[-1]["reason"]


def test_a_second_client_is_refused_and_the_first_one_goes_on(machine_tool, watched):
    for target in (30.0, 0.0) * 3:
        watched.go(target, 0.0, 0.0)
        with refused(OSError, errno=errno.EBUSY):
            watched.meanwhile(lambda: Watched(machine_tool.socket))
        ended = watched.until_state(CncState.READY, CncState.STOPPED)
        if ended.state is CncState.READY:
            assert ended.position[0] == pytest.approx(1e-3 * target, abs=WINDOW)
            return
        # A busy computer has kept this process from a word for as long as the dead-man waits.
        assert "silent" in ended.reason
        watched.reset()
    raise AssertionError("held each time")


def test_whoever_takes_the_machine_over_at_the_control_has_it(watched, machine_tool):
    machine_tool.run(
        "/usr/bin/python3",
        "-c",
        "import linuxcnc\nc = linuxcnc.command()\nc.mode(linuxcnc.MODE_MANUAL)\nc.wait_complete()",
    )
    fault = watched.until_state(CncState.FAULT)
    assert fault.reason == "the machine was taken over at the control"
    with pytest.raises(MoveRefused):
        watched.go(1.0, 0.0, 0.0)
    watched.reset()
    watched.go(1.0, 0.0, 0.0)
    watched.until_state(CncState.READY)


def test_only_its_users_may_reach_the_agent(machine_tool):
    mode = machine_tool.socket.stat().st_mode & 0o777
    assert mode == 0o660
    listening = machine_tool.run("cat", "/proc/net/tcp")
    # 5005 and 5007, on which LinuxCNC's own servers would listen to the network.
    ports = {line.split()[1].rpartition(":")[2] for line in listening.splitlines()[1:]}
    assert not ports & {f"{5005:04X}"}


def test_the_driver_is_found_by_its_name_and_its_settings_are_checked():
    from stepdiag_ros.configuration import load_device, load_machine
    from stepdiag_ros.devices import Surroundings, prepare

    machine = load_machine("demo")[0]
    settings = load_device("linuxcnc")[0]
    opener = prepare("cnc", "linuxcnc", settings, Surroundings(machine))
    with refused(OSError, errno=errno.ENOENT):
        opener(0)
    for wrong, why in (
        ({}, a_fault("missing", about="socket")),
        ({**settings, "dead_man_s": 0.01}, a_fault("out_of_range", "0.01", about="dead_man_s")),
        ({**settings, "silence_s": 0.1}, a_fault("out_of_range", "0.1", about="silence_s")),
        ({**settings, "port": 5}, a_fault("unknown", about="port")),
    ):
        with refused(Refusal, why):
            prepare("cnc", "linuxcnc", wrong, Surroundings(machine))
    with refused(Refusal, "missing", about="machine"):
        prepare("cnc", "linuxcnc", settings, Surroundings())
    assert isinstance(LinuxCnc.__doc__, str)
