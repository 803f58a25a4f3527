"""The OPC UA driver in front of a PLC that fails, is touched by others, or falls silent."""

import sys
import time

import pytest
from cable import Cable
from cnc_conformance import Operator, Rig
from opcua_rig import MACHINE, OpcUaPeer, node, operator_of, settings
from patience import PATIENCE
from refused import a_fault, refused
from ros_processes import wait_until

from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.cnc import CncState, MoveRefused
from stepdiag_ros.devices.cnc.opcua import SourceClock
from stepdiag_ros.devices.cnc.opcua_session import REQUEST_LIMIT
from stepdiag_ros.devices.cnc.opcua_settings import OpcUaSettings
from stepdiag_ros.metrology.refusal import Refusal

FAR = (0.05, 0.0, 0.0)
MS = 1_000_000


@pytest.fixture(scope="module")
def server():
    peer = OpcUaPeer()
    yield peer
    peer.close()


@pytest.fixture
def plc(server):
    """Return the PLC, in order and at its zero again."""
    server.restart()
    return server


@pytest.fixture
def opened(plc):
    operators = []

    def make(**changed):
        operators.append(operator_of(plc, **changed))
        return operators[-1]

    yield make
    for operator in operators:
        operator.device.close()


def moving(operator, feed=0.05):
    operator.ready()
    operator.move(FAR, "X", feed)
    operator.until(lambda: operator.position[0] > 2e-3)
    return operator


def fails(operator, words):
    with refused(OSError, words):
        operator.watch(PATIENCE)


def fault(operator, words):
    operator.until(
        lambda: operator.device.state is CncState.FAULT and words in operator.changes[-1].reason
    )


@pytest.mark.parametrize("method", [False, True], ids=["nodes", "method"])
def test_each_order_has_an_identity_and_is_carried_out_once(plc, opened, method):
    operator = opened(method=method).ready()
    before = plc.acknowledged
    for target, axes in (((2e-3, 0, 0), "X"), ((2e-3, 1e-3, 0), "Y"), ((0, 0, 5e-4), "XYZ")):
        operator.moved(target, axes)
        assert operator.device.state is CncState.READY
    assert plc.orders == [
        (before + 1, (2.0, 0.0, 0.0)),
        (before + 2, (2.0, 1.0, 0.0)),
        (before + 3, (0.0, 0.0, 0.5)),
    ]
    assert operator.position == pytest.approx((0.0, 0.0, 5e-4))
    assert operator.device.traits.dead_man == pytest.approx(1.0)


def test_motors_and_other_units_are_told(opened):
    inches = {axis: node(axis) for axis in "XYZ"} | {"unit_m": 0.0254, "measured": False}
    motors = {axis: node(f"Motor{axis}") for axis in "XYZ"}
    operator = opened(positions=inches | {"motors": motors, "resolution_m": 2e-6}).ready()
    operator.moved((0.0254, 0.0, 0.0), "X", 0.2)
    assert operator.samples[-1].motors == pytest.approx((1.001 * 0.0254, 25.4e-6, 25.4e-6))
    traits = operator.device.traits
    assert (traits.measured, traits.resolution[0]) == (False, 2e-6)


def test_a_fault_of_the_plc_is_told_in_words_and_needs_an_operator(plc, opened):
    operator = moving(opened())
    plc.fault_text, plc.fault = "axis X", 4
    fault(operator, "the PLC has a fault: number 4: following error: axis X")
    operator.watch(0.3)
    assert plc.position[0] < 49.0
    with refused(MoveRefused, "not_ready", "fault", aspect="state"):
        operator.move(FAR, "X")
    operator.reset()
    assert operator.device.state is CncState.READY
    assert len(plc.orders) == 1


def test_whoever_stops_the_plc_stops_the_step(plc, opened):
    operator = moving(opened())
    plc.stopped = True
    operator.until_state(CncState.STOPPED)
    assert operator.changes[-1].reason == "the PLC has stopped the machine"
    operator.reset()
    operator.watch(0.2)
    assert len(plc.orders) == 1


def test_a_plc_that_is_not_ready_or_moves_by_itself_is_a_fault(plc, opened):
    plc.ready = False
    operator = opened()
    fault(operator, "the PLC is not ready: is it in automatic mode")
    for _ in range(12):
        with pytest.raises(MoveRefused):
            operator.device.reset(time.time_ns())
        operator.watch(0.02)
    plc.ready = True
    operator.reset()
    operator.ready()
    plc.moves_by_itself = True
    fault(operator, "moved by the command of somebody else")
    with refused(MoveRefused, "busy", aspect="motion"):
        operator.device.reset(time.time_ns())


def test_an_order_that_ends_somewhere_else_is_a_fault(plc, opened):
    operator = opened().ready()
    plc.misses = 0.002
    operator.move((0.01, 0.0, 0.0), "X")
    fault(operator, "has ended the move at 10.0020, 0.0000, 0.0000 mm, away from the target")


def test_an_order_that_is_not_taken_is_an_error_and_never_given_twice(plc, opened):
    operator = opened().ready()
    plc.answering = False
    operator.move((0.01, 0.0, 0.0), "X")
    fails(operator, a_fault("undetermined"))
    operator.device.close()
    plc.answering = True
    time.sleep(0.3)
    operator = opened().ready()
    operator.watch(0.3)
    assert len(plc.orders) == 1
    first = plc.orders[0][0]
    operator.moved((0.011, 0.0, 0.0), "X")
    # An identity is never used again.
    assert len(plc.orders) == 2 and plc.orders[1][0] > first


def test_an_order_refused_by_the_method_is_a_fault(plc, opened):
    operator = opened(method=True, fault_words={7: "not now"}).ready()
    plc._begin, begin = (lambda *_: None), plc._begin
    plc.server._refuses = True
    try:
        plc._path = ([0, 0, 0], [0, 0, 1e-9], 1e-9, 0.0, 0)
        plc.frozen = True
        operator.move((0.01, 0.0, 0.0), "X")
        fault(operator, "the PLC refused the order: number 7: not now")
    finally:
        plc._begin = begin


def test_the_machine_brakes_when_nobody_polls(plc, opened):
    watchdog = {"node": node("Watchdog"), "limit_s": 0.6, "period_s": 0.05}
    operator = moving(opened(watchdog=watchdog), feed=0.015)
    begin = time.monotonic()
    plc.watchdog_limit = 0.6
    # The thread of the session lives on: what has died is what polls.
    assert wait_until(lambda: bool(plc.braked_by_watchdog))
    assert plc.braked_by_watchdog[0] > begin
    assert wait_until(lambda: plc.stopped)
    # It was braked on its way.
    assert plc.position[0] < 49.0
    operator.until_state(CncState.STOPPED)


def test_a_plc_program_that_stands_still_is_an_error(plc, opened):
    operator = opened().ready()
    plc.frozen = True
    operator.move((0.01, 0.0, 0.0), "X")
    fails(operator, a_fault("undetermined"))


def test_a_bad_value_is_an_error(plc, opened):
    operator = moving(opened())
    plc.bad = "Y"
    fails(operator, a_fault("failed", "position Y"))


def test_a_node_that_is_not_there_is_named(opened):
    operator = opened(positions={"X": node("Nix"), "Y": node("Y"), "Z": node("Z")})
    fails(operator, a_fault("lost", "s=Nix", "X", "ns=2"))


@pytest.fixture
def cable(plc):
    made = Cable(plc.port)
    yield made
    made.close()


def opened_behind(cable, **changed):
    prepared = prepare(
        "cnc",
        "opcua",
        settings(f"opc.tcp://127.0.0.1:{cable.port}/", **changed),
        Surroundings(MACHINE),
    )
    return Operator(Rig(MACHINE, lambda: prepared(time.time_ns()), time.time_ns, time.sleep, 0.05))


def test_a_silence_is_borne_as_long_as_the_settings_say(cable):
    operator = opened_behind(cable, silence_s=8.0).ready()
    told = len(operator.samples)
    cable.silent = True
    # The library would give a server up after 1 s, and a request was given up after 2 s.
    operator.watch(3.3)
    assert len(operator.samples) < told + 10
    cable.silent = False
    operator.moved((0.002, 0.0, 0.0), "X")
    assert operator.device.state is CncState.READY
    operator.device.close()


def test_a_longer_silence_is_an_error_in_plain_words(cable):
    operator = opened_behind(cable, silence_s=1.0).ready()
    cable.silent = True
    fails(operator, a_fault("silent", "1"))
    operator.device.close()
    cable.silent = False


def test_a_server_that_dies_and_comes_back():
    peer = OpcUaPeer()
    operator = operator_of(peer, silence_s=1.0)
    moving(operator)
    peer.close()
    fails(operator, a_fault("lost"))
    operator.device.close()
    operator = operator_of(peer, start_limit_s=3.0)
    fails(operator, a_fault("lost"))


def test_calls_never_wait_for_the_server(plc, opened):
    operator = opened()
    operator.ready()
    plc.frozen = True
    begin = time.monotonic()
    operator.move((0.01, 0.0, 0.0), "X")
    operator.device.stop(time.time_ns(), "why")
    operator.poll()
    # Whoever waits for an answer of a frozen server waits for REQUEST_LIMIT, each time.
    assert time.monotonic() - begin < REQUEST_LIMIT


async def secured(server, folder):
    from asyncua import ua
    from asyncua.crypto.cert_gen import setup_self_signed_certificate
    from asyncua.crypto.permission_rules import User, UserRole
    from asyncua.server.user_managers import UserManager
    from cryptography.x509.oid import ExtendedKeyUsageOID

    class Users(UserManager):
        def get_user(self, iserver, username=None, password=None, certificate=None):  # noqa: ARG002
            right = (username, password) == ("operator", "secret")
            return User(role=UserRole.User) if right else None

    for who, usage in (
        ("server", ExtendedKeyUsageOID.SERVER_AUTH),
        ("client", ExtendedKeyUsageOID.CLIENT_AUTH),
    ):
        await setup_self_signed_certificate(
            folder / f"{who}.pem", folder / f"{who}.der", f"urn:stepdiag_ros:{who}",
            "localhost", [usage], {"commonName": who},
        )  # fmt: skip
    await server.set_application_uri("urn:stepdiag_ros:server")
    server.set_security_policy([ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt])
    await server.load_certificate(str(folder / "server.der"))
    await server.load_private_key(str(folder / "server.pem"))
    server.iserver.user_manager = Users()


def test_signed_and_encrypted_with_a_user(tmp_path):
    peer = OpcUaPeer(secure=lambda server: secured(server, tmp_path))
    try:
        security = {
            "certificate": str(tmp_path / "client.der"),
            "private_key": str(tmp_path / "client.pem"),
            "server_certificate": str(tmp_path / "server.der"),
            "user": "operator",
            "password_file": str(tmp_path / "password"),
        }
        (tmp_path / "password").write_text("secret\n")
        # Encryption in Python beside other work is slow.
        operator = operator_of(peer, security=security, silence_s=10.0).ready()
        operator.moved((0.002, 0.0, 0.0), "X")
        assert operator.device.state is CncState.READY
        operator.device.close()
        (tmp_path / "password").write_text("guess\n")
        fails(operator_of(peer, security=security), a_fault("lost"))
        # Another server than the one whose certificate is known.
        (tmp_path / "password").write_text("secret\n")
        wrong = security | {"server_certificate": str(tmp_path / "client.der")}
        fails(operator_of(peer, security=wrong, start_limit_s=3.0), a_fault("lost"))
        plain = {"policy": "none", "anonymous": True}
        fails(operator_of(peer, security=plain), a_fault("lost"))
    finally:
        peer.close()


def test_the_clock_of_the_server_is_turned_into_ours():
    clock = SourceClock()
    behind = 7_000_000 * MS
    delays = [9, 4, 30, 4, 11]
    told = [
        clock.local(second * 1000 * MS - behind, second * 1000 * MS + delay * MS)
        for second, delay in enumerate(delays)
    ]
    # The shortest transport that was seen stays in it; how late a value came does not matter.
    assert told == [(1000 * s + d) * MS for s, d in enumerate([9, 4, 4, 4, 4])]
    assert clock.local(None, 77) == 77
    later = 100_000 * MS
    assert clock.local(later - behind, later + 8 * MS) == later + 8 * MS


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"url": "http://x"}, a_fault("malformed", "opc.tcp://host:port")),
        ({"security": {}}, a_fault("missing", "user", "anonymous: true")),
        ({"security": {"anonymous": True}}, a_fault("missing", about="certificate")),
        (
            {"security": {"policy": "none", "user": "a", "password_file": __file__}},
            a_fault("exposed", "policy"),
        ),
        (
            {"security": {"anonymous": True, "certificate": "/no", "private_key": "/no"}},
            a_fault("not_found", "certificate"),
        ),
        ({"positions": {"X": "i=1", "Y": "i=2"}}, a_fault("missing", about="Z")),
        ({"command": {"stop": "i=1", "reset": "i=2"}}, a_fault("missing", about="X")),
        (
            {
                "command": {
                    "stop": "i=1",
                    "reset": "i=2",
                    "method": {"object": "i=3", "node": "i=4", "arguments": ["X", "Y", "Z"]},
                }
            },
            a_fault("missing", "arguments"),
        ),
        (
            {"watchdog": {"node": "i=1", "limit_s": 0.2, "period_s": 0.2}},
            a_fault("out_of_range", "limit_s"),
        ),
        ({"fault_words": {"a": "b"}}, a_fault("malformed", "fault_words")),
        ({"watch_dog": {}}, a_fault("unknown", "watchdog", about="watch_dog")),
    ],
)
def test_wrong_settings_are_refused_without_a_device(changed, words):
    with refused(Refusal, words):
        OpcUaSettings.from_mapping(settings("opc.tcp://host:4840") | changed)


def test_it_needs_a_machine():
    with refused(Refusal, "missing", about="machine"):
        prepare("cnc", "opcua", settings("opc.tcp://host:4840"), Surroundings())
    assert prepare("cnc", "opcua", settings("opc.tcp://host:4840"), Surroundings(MACHINE))


def test_without_its_library_nothing_is_opened(monkeypatch):
    monkeypatch.setitem(sys.modules, "asyncua", None)
    with refused(Refusal, "not_installed", "asyncua"):
        prepare("cnc", "opcua", settings("opc.tcp://host:4840"), Surroundings(MACHINE))
