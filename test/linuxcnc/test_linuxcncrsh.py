"""The driver of LinuxCNC's own text server, against that server."""

import contextlib
import errno
import socket
import time

import pytest
from cnc_conformance import CHECKS, Rig
from linuxcnc_watched import SLOW, at_rest
from patience import PATIENCE
from refused import refused

from stepdiag_ros.configuration import load_device, load_machine
from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.cnc import CncState, MoveRefused, PositionSample, StateChange
from stepdiag_ros.metrology.refusal import Refusal

MACHINE = load_machine("demo")[0]
pytestmark = pytest.mark.timeout(2 * PATIENCE)


@pytest.fixture(scope="module")
def server(make_instance):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    # Passwords of its own, since it listens to the whole network.
    words = {"connect_password": "c4711x", "enable_password": "e0815y", "silence_s": 20.0}
    program = (
        f"linuxcncrsh --port {port} --connectpw {words['connect_password']}"
        f" --enablepw {words['enable_password']} -- -ini machine.ini"
    )
    instance = make_instance(lag_s=0.0, beside=True, programs=[program])
    end = time.monotonic() + PATIENCE
    while True:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)):
            return instance, {**load_device("linuxcncrsh")[0], **words, "port": port}
        assert time.monotonic() < end
        time.sleep(0.05)


def opened(settings):
    """Return the driver, open, when LinuxCNC has told its state and an operator has said go."""
    device = prepare("cnc", "linuxcncrsh", {**settings, "position_rate_hz": 100.0}, around())(0)
    end = time.monotonic() + PATIENCE
    while True:
        device.poll(time.time_ns())
        try:
            device.reset(time.time_ns())
            return device
        except MoveRefused as refused:
            assert time.monotonic() < end, refused
            time.sleep(0.01)


def around():
    return Surroundings(MACHINE)


def until(device, condition, limit=PATIENCE):
    events, end = [], time.monotonic() + limit
    while not condition():
        begun = time.monotonic()
        assert begun < end, events[-3:]
        events += device.poll(time.time_ns())
        time.sleep(0.002)
    return events


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__[6:])
def test_the_driver_keeps_to(check, server):
    check(Rig(MACHINE, lambda: opened(server[1]), time.time_ns, time.sleep))


def test_positions_are_metres_whatever_units_the_program_has(server):
    instance, settings = server
    instance.run(
        "/usr/bin/python3",
        "-c",
        "import linuxcnc\nc = linuxcnc.command()\nc.mode(linuxcnc.MODE_MDI)\nc.wait_complete()\n"
        "for line in ('G20', 'G10 L2 P1 X5', 'G91'):\n    c.mdi(line)\n    c.wait_complete()\n",
    )
    device = opened(settings)
    until(device, lambda: device.state is CncState.READY)
    x, y, z = until_sampled(device)[-1].position
    device.start_move(time.time_ns(), (0.0254, y, z), 0.1, "X")
    events = until(device, lambda: device.state is not CncState.MOVING)
    assert events[-1].position == pytest.approx((0.0254, y, z), abs=0.5e-6)
    assert x != 0.0254
    told = float(instance.run("halcmd", "getp", "joint.0.motor-pos-fb"))
    assert told == pytest.approx(25.4, abs=0.5e-3)
    device.close()


def until_changed(device):
    found, end = [], time.monotonic() + PATIENCE
    while not found:
        assert time.monotonic() < end
        events = device.poll(time.time_ns())
        found = [event for event in events if isinstance(event, StateChange)]
        time.sleep(0.002)
    return found[-1]


def until_sampled(device):
    found = []

    def sampled():
        found.extend(e for e in device.poll(time.time_ns()) if isinstance(e, PositionSample))
        return bool(found)

    until(device, sampled)
    return found


def begin_to_move(device, y, z):
    """Start a long move of X, and wait until the axis moves."""
    begun = until_sampled(device)[-1].position[0]
    device.start_move(time.time_ns(), (0.8, y, z), SLOW, "X")
    while until_sampled(device)[-1].position[0] < begun + 0.01:
        assert device.state is CncState.MOVING


def test_an_acknowledged_move_that_an_e_stop_breaks_is_a_fault(server):
    instance, settings = server
    device = opened(settings)
    _, y, z = until_sampled(device)[0].position
    begin_to_move(device, y, z)
    instance.operate("STATE_ESTOP")
    events = until(device, lambda: device.state is not CncState.MOVING)
    change = [e for e in events if isinstance(e, StateChange)][-1]
    assert change.state is CncState.FAULT and change.reason == "e-stop"
    with refused(MoveRefused, "not_ready") as caught:
        device.reset(time.time_ns())
    assert change.reason in str(caught.value)
    # Whoever comes now sees the e-stop, though the server refuses nearly everything meanwhile.
    device.close()
    device = prepare("cnc", "linuxcncrsh", settings, around())(0)
    assert until_changed(device).reason == "e-stop"
    instance.operate("STATE_ESTOP_RESET", "STATE_ON")
    end = time.monotonic() + 0.3
    until(device, lambda: time.monotonic() > end)
    device.close()
    device = opened(settings)
    # And beyond what LinuxCNC allows, though the driver lets it pass: told in its own words.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(device), "soft_limits", ((-1.0,) * 3, (2.0,) * 3))
        device.start_move(time.time_ns(), (1.5, y, z), 0.1, "X")
    events = until(device, lambda: device.state is not CncState.MOVING)
    change = [e for e in events if isinstance(e, StateChange)][-1]
    assert change.state is CncState.FAULT
    assert "exceed X's positive limit" in change.reason
    assert change.position[0] < 0.2
    device.close()


def test_closing_in_mid_move_aborts_it(server):
    instance, settings = server
    device = opened(settings)
    _, y, z = until_sampled(device)[0].position
    begin_to_move(device, y, z)
    device.close()
    assert at_rest(instance) < 700.0


def test_wrong_passwords_and_wrong_servers_are_said(server):
    settings = server[1]
    for key in ("connect_password", "enable_password"):
        with refused(Refusal, "rejected"):
            opened({**settings, key: "wrong"})
    with refused(OSError, errno=errno.ECONNREFUSED):
        opened({**settings, "port": 1})
    with refused(Refusal, "malformed"):
        opened({**settings, "enable_password": "a b"})
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen(1)
        with refused(OSError, errno=errno.ETIMEDOUT):
            opened({**settings, "port": silent.getsockname()[1], "silence_s": 0.5})


@pytest.mark.parametrize("garbage", [b"HELLO ACK x 1\r\nBONJOUR\r\n", b"\xff\r\n", b"HELLO ACK"])
def test_a_server_that_talks_nonsense_is_refused(garbage):
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen(1)
        settings = {"port": server.getsockname()[1]}
        opener = prepare("cnc", "linuxcncrsh", settings, around())
        import threading

        def babble():
            connection = server.accept()[0]
            connection.sendall(garbage)
            time.sleep(1.5)
            connection.close()

        thread = threading.Thread(target=babble)
        thread.start()
        with refused((OSError, ValueError)):
            opener(0)
        thread.join()
