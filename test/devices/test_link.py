"""The link: bytes on every kind of URL, never waiting, and every way in which it can break."""

import errno
import os
import pty
import time

import pytest
from instrument_peers import TcpPeer
from patience import PATIENCE
from refused import a_fault, refused
from serial import rfc2217, serial_for_url

from stepdiag_ros.devices import link as link_module
from stepdiag_ros.devices.link import MOST_UNSENT, Link, LinkSettings
from stepdiag_ros.devices.link_framing import Between, FixedLength, FramingSettings, Lines
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.refusal import Lost, Refusal


def settings(**keys):
    return LinkSettings.from_section(Section(keys, "connection"))


def received(link, count, seconds=PATIENCE):
    """Return what comes, until it is that much."""
    data, end = b"", time.monotonic() + seconds
    while len(data) < count and time.monotonic() < end:
        data += link.receive()
        time.sleep(0.001)
    return data


@pytest.fixture
def peer():
    peer = TcpPeer()
    yield peer
    peer.close()


def connected(peer):
    link = Link(settings(url=peer.url))
    end = time.monotonic() + PATIENCE
    while (peer.connection is None or not link.ready) and time.monotonic() < end:
        peer.attend()
        time.sleep(0.001)
    return link


def test_bytes_go_both_ways_over_tcp(peer):
    link = connected(peer)
    assert link.receive() == b""
    peer.say(b"one\r\ntw")
    assert received(link, 7) == b"one\r\ntw"
    link.send(b"?\n")
    end = time.monotonic() + PATIENCE
    while not (heard := peer.heard()) and time.monotonic() < end:
        time.sleep(0.001)
    assert heard == b"?\n"
    link.close()
    with refused(Lost, "stopped"):
        link.receive()


def test_what_came_before_the_end_is_given_and_then_the_end(peer):
    link = connected(peer)
    peer.say(b"x" * 100_000 + b"last")
    peer.hang_up()
    assert received(link, 100_004).endswith(b"last")
    for _ in range(3):
        with refused(Lost, "lost", aspect="link"):
            received(link, 1)
    with refused(Lost, "lost", aspect="link"):
        link.send(b"?")
    link.close()


def test_a_peer_that_takes_nothing_never_holds_up_the_caller(peer):
    link = connected(peer)
    began = time.monotonic()
    with refused(Lost, "lost", aspect="writing"):
        for _ in range(100_000):
            link.send(b"x" * 1000)
    # Whoever waits for room waits for ever: nobody makes any.
    assert time.monotonic() - began < PATIENCE / 2.0
    # What was accepted goes out when there is room again.
    sent = 0
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        heard = peer.heard()
        sent += len(heard or b"")
        link.receive()
        if sent > 2 * MOST_UNSENT and not heard:
            break
        time.sleep(0.0005)
    assert sent % 1000 == 0 and sent > MOST_UNSENT
    link.close()


def test_opening_is_not_waited_for(monkeypatch):
    wait, released = link_module.Event(), []

    def slow(_):
        wait.wait(PATIENCE)
        return serial_for_url("loop://", timeout=0)

    monkeypatch.setattr(link_module, "_opened", slow)
    began = time.monotonic()
    link = Link(settings(url="socket://far.away:1"))
    link.send(b"early")
    assert not link.ready and link.receive() == b""
    assert time.monotonic() - began < PATIENCE / 2.0
    wait.set()
    assert received(link, 5) == b"early"
    link.close()
    # Closed before it was open: it is closed as soon as it is.
    wait.clear()
    link = Link(settings(url="socket://far.away:1"))
    link.close()
    monkeypatch.setattr(Link, "_close", lambda _: released.append(True))
    wait.set()
    end = time.monotonic() + PATIENCE
    while not released and time.monotonic() < end:
        time.sleep(0.001)
    assert released


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("socket://127.0.0.1:1", os.strerror(errno.ECONNREFUSED)),
        ("/dev/no-such-port", os.strerror(errno.ENOENT)),
    ],
)
def test_a_device_that_is_not_there_is_named_with_the_reason(url, reason):
    with refused(Lost, "lost", url, aspect="opening") as caught:
        link = Link(settings(url=url))
        received(link, 1)
    assert reason in str(caught.value), "the operating system's own words"


def test_a_serial_port_belongs_to_one_program_and_may_be_pulled_out():
    ours, theirs = pty.openpty()
    name = os.ttyname(theirs)
    link = Link(settings(url=name, baud_rate=115200, parity="none"))
    os.write(ours, b"12.5\r\n")
    assert received(link, 6) == b"12.5\r\n"
    link.send(b"?\n")
    assert os.read(ours, 10) == b"?\n"
    with refused(Lost, "lost", aspect="opening"):
        received(Link(settings(url=name)), 1)
    os.close(theirs)
    os.close(ours)
    with refused(Lost, "lost", aspect="link"):
        received(link, 1)
    link.close()


def test_a_loop_gives_back_what_it_was_sent():
    link = Link(settings(url="loop://"))
    data = os.urandom(3000)
    link.send(data)
    assert received(link, 3000) == data
    link.close()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_port_behind_a_terminal_server(peer):
    """The server side of RFC 2217 is pyserial's own port manager."""
    link = Link(settings(url=f"rfc2217://127.0.0.1:{peer.port}", baud_rate=19200))

    class Wire:
        def write(self, data):
            peer.say(data)

    port = serial_for_url("loop://", timeout=0)
    manager, data, end = None, b"", time.monotonic() + PATIENCE
    while time.monotonic() < end and data != b"ping\n":
        peer.attend()
        if peer.connection is not None:
            manager = manager or rfc2217.PortManager(port, Wire())
            for byte in manager.filter(peer.heard() or b""):
                data += byte
        if link.ready and not data:
            link.send(b"ping\n")
            peer.say(b"".join(manager.escape(b"pong\xff\n")))
            assert received(link, 6) == b"pong\xff\n"
        time.sleep(0.001)
    assert data.startswith(b"ping\n") and port.baudrate == 19200
    link.close()


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"url": "10.0.0.1:90"}, a_fault("malformed", "TCP", "socket://10.0.0.1:90")),
        ({"url": "socket://host"}, a_fault("malformed", "socket://host:port")),
        ({"url": "socket://host:99999"}, a_fault("malformed", "socket://host:port")),
        ({"url": "tcp://host:9"}, a_fault("malformed", "socket://")),
        ({"url": ""}, a_fault("malformed")),
        ({"url": "loop://", "parity": "off"}, a_fault("unknown", "off", about="parity")),
        ({"url": "loop://", "stop_bits": 1.7}, a_fault("unknown", "1", "1.5", "2")),
        ({"url": "loop://", "baud": 9600}, a_fault("unknown", "baud_rate", about="baud")),
        ({}, a_fault("missing", about="url")),
    ],
)
def test_settings_are_checked(keys, words):
    with refused(Refusal, words):
        settings(**keys)


class TestFraming:
    def test_lines_whole_and_in_halves(self):
        text = b"a,1\r\nb,2\r\n\r\nc,3\nd"
        assert Lines().take(text) == [b"a,1", b"b,2", b"c,3"]
        lines = Lines()
        found = [line for k in range(len(text)) for line in lines.take(text[k : k + 1])]
        assert found == [b"a,1", b"b,2", b"c,3"]
        assert lines.take(b"d\n") == [b"dd"]

    def test_lines_of_another_terminator(self):
        assert Lines(b"\r").take(b"1\r2\r3") == [b"1", b"2"]
        lines = Lines(b"END")
        assert lines.take(b"1E") == [] and lines.take(b"ND2END") == [b"1", b"2"]

    def test_a_line_without_an_end_is_refused_and_no_memory_grows(self):
        lines = Lines(longest=10)
        assert lines.take(b"1234567890") == []
        with refused(Refusal, "too_many", "\\n", "10"):
            lines.take(b"1")
        assert lines.take(b"ok\n") == [b"ok"]
        with refused(Refusal, "too_many", "10"):
            lines.take(b"12345678901\n")

    def test_records_of_one_length(self):
        records = FixedLength(4)
        assert records.take(b"abcdef") == [b"abcd"] and records.take(b"gh") == [b"efgh"]
        records = FixedLength(4, b"$")
        assert records.take(b"xx$12") == [] and records.take(b"3yy$4") == [b"$123"]
        assert records.take(b"56") == [b"$456"]

    def test_records_between_marks(self):
        records = Between(b"<<", b">")
        found = []
        for byte in b"noise<<1><x<<22><<3<<4>tail":
            found += records.take(bytes([byte]))
        assert found == [b"1", b"22", b"4"], "what lost its end begins anew with the next mark"
        with refused(Refusal, "too_many", "5"):
            Between(b"<", b">", 5).take(b"<123456")
        same = Between(b'"', b'"')
        assert same.take(b'x"1"y"2"') == [b"1", b"2"]

    def test_settings(self):
        def made(**keys):
            return FramingSettings.from_section(Section(keys, "framing")).make()

        assert isinstance(made(), Lines)
        assert isinstance(made(kind="fixed", length=3), FixedLength)
        assert isinstance(made(kind="between", start="\x02", end="\x03"), Between)
        for keys, words in (
            ({"kind": "fixed"}, a_fault("missing", about="length")),
            ({"kind": "between", "start": "a"}, a_fault("missing", about="end")),
            ({"terminator": ""}, a_fault("malformed", "terminator")),
            ({"length": 3}, a_fault("unknown", about="length")),
        ):
            with refused(Refusal, words):
                made(**keys)
