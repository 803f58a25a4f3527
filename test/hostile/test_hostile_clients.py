"""Clients of the page and of the Foxglove server that do everything but look on.

Each is cut off or ignored, in a few sentences of the log; whoever looks on meanwhile goes on
looking; memory does not grow with what they send.
"""

import json
import re
import socket
import threading
import time
from contextlib import contextmanager, suppress
from functools import partial

import pytest
from raw_web import BINARY, CONTINUED, frame, http, is_cut_off, pour, resident, websocket

from stepdiag_ros import topics
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.text.sparing import MOST, Sparing
from stepdiag_ros.viewers.foxglove import server as foxglove_module
from stepdiag_ros.viewers.foxglove.server import FoxgloveServer
from stepdiag_ros.viewers.page import server as page_module
from stepdiag_ros.viewers.page.access import PageAccess
from stepdiag_ros.viewers.page.items import AxisPlace
from stepdiag_ros.viewers.page.server import MonitorServer, Offer
from stepdiag_ros.viewers.page.state import PageState

DEEP = 2**16
PIECE = bytes(2**16)
MUCH = 1600
"""Pieces, 100 MB."""
END = b"\x88"
"""With which a frame begins that ends the connection."""
GOING_AWAY = END + b"\x02\x03\xe9"
"""Close code 1001 (RFC 6455, 7.4.1)."""
LINES = 200
"""That hold, so that whoever subscribes is sent them."""
ROOM = 60_000_000
"""Bytes that the process may grow while 100 MB are poured into it."""
FOXGLOVE = {"Sec_WebSocket_Protocol": "foxglove.sdk.v1"}


class Page:
    """A page, one viewer of it that does as it should, and what was logged."""

    def __init__(self):
        self.state, self.log, self._places = PageState(), [], 0
        access = PageAccess("127.0.0.1", "0123456789abcdef", made=True)
        offer = Offer(self.state, access, "run", "a title", None, self.log.append)
        self.server = MonitorServer(offer, 0)
        self.server.start()
        self.port = self.server.port
        self._seen = 0
        self._viewer = threading.Thread(target=self._look_on)
        self._viewer.start()
        self._wait(lambda: self._seen)

    def close(self):
        self.server.close()
        self._viewer.join()

    def is_well(self):
        """Say whether the viewer is told what is new, and a request is answered."""
        before = self._seen
        self._places += 1
        self.state.take(AxisPlace(self._places, (0.1, 0.2, 0.3)))
        host = f"Host: 127.0.0.1:{self.port}\r\nConnection: close\r\n\r\n".encode()
        answer = http(self.port, b"GET / HTTP/1.1\r\n" + host)
        self._wait(lambda: self._seen > before)
        return b" 200 " in answer[:20]

    def _look_on(self):
        with websocket(self.port, "/live") as line:
            line.sendall(frame(b'{"token":""}'))
            # Who is told that the page ends leaves it; the server would wait for one who stays.
            while (told := line.recv(2**20)) and not told.startswith(END):
                self._seen += 1
                line.sendall(frame(b"1"))

    def _wait(self, holds):
        until = time.monotonic() + 20.0
        while not holds():
            assert time.monotonic() < until, "who looks on is told nothing"
            time.sleep(0.01)


@pytest.fixture
def page(monkeypatch):
    for name in ("TOKEN_LIMIT", "REQUEST_LIMIT"):
        monkeypatch.setattr(page_module, name, 0.5)
    monkeypatch.setattr(page_module, "STALL_LIMIT", 2.0)
    made = Page()
    yield made
    made.close()


def after_greeting(*frames):
    return lambda line: [line.sendall(frame(b'{"token":""}')), *map(line.sendall, frames)]


def pouring(head, piece, times):
    return lambda line: [line.sendall(head), pour(line, piece, times)]


CLIENTS = {
    "deep": lambda line: line.sendall(frame(b"[" * 4000)),
    "deep and long": lambda line: line.sendall(frame(b"[" * DEEP)),
    "half a character": lambda line: line.sendall(frame(b'{"token":"\\ud800"}')),
    "no UTF-8": lambda line: line.sendall(frame(b"\xff\xfe")),
    "no text": lambda line: line.sendall(frame(b"{}", BINARY)),
    "no object": lambda line: line.sendall(frame(b"[NaN, 1e999]")),
    "not masked": lambda line: line.sendall(frame(b"{}", masked=False)),
    "no kind of frame": lambda line: line.sendall(frame(b"{}", 7)),
    "longer than can be": lambda line: line.sendall(frame(b"x", length=2**63)),
    "100 MB": pouring(frame(b"", length=100 * 2**20), PIECE, MUCH),
    "pieces without end": pouring(
        frame(b"x", final=False), frame(PIECE, CONTINUED, final=False), MUCH
    ),
    "talks": pouring(frame(b'{"token":""}'), frame(b"1") * 1000, 2000),
    "long after the greeting": after_greeting(frame(PIECE)),
    "no UTF-8 after the greeting": after_greeting(frame(b"\xff\xfe")),
    "says nothing": lambda _: None,
}


@pytest.mark.parametrize("client", CLIENTS.values(), ids=CLIENTS)
def test_what_is_no_viewer_of_the_page_is_cut_off(page, client, capfd):
    before = resident()
    with websocket(page.port, "/live") as line:
        # The server may be quicker than what is sent to it.
        with suppress(ConnectionError):
            client(line)
        assert is_cut_off(line)
        assert page.is_well()
    assert resident() - before < ROOM
    assert len(page.log) <= 2
    assert all(one.isprintable() for one in page.log)
    assert capfd.readouterr().err == ""


REQUESTS = {
    "up": b"GET /../../etc/passwd HTTP/1.1",
    "up, in other words": b"GET /%2e%2e/..%2f..%2fetc/passwd HTTP/1.1",
    "another root": b"GET //etc/passwd HTTP/1.1",
    "from a file": b"GET /main.js/../../server.py HTTP/1.1",
    "zero": b"GET /%00 HTTP/1.1",
    "no UTF-8": b"GET /\xff\xfe HTTP/1.1",
    "no path": b"GET * HTTP/1.1",
    "long": b"GET /" + b"a" * 100_000 + b" HTTP/1.1",
    "no method": b"BOOM / HTTP/1.1",
    "another name": b"GET / HTTP/1.1\r\nHost: evil.example",
    "control characters": b"GET / HTTP/1.1\r\nHost: \x1b[2J",
    "another site": b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://evil.example",
    "no site": b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://\xff",
    "50,000 headers": b"GET / HTTP/1.1" + b"\r\nX: y" * 50_000,
    "a long header": b"GET / HTTP/1.1\r\nX: " + b"y" * 1_000_000,
    "no token": b"POST /control/start HTTP/1.1\r\nHost: 127.0.0.1",
    "half a character": b"POST /control/start HTTP/1.1\r\nHost: 127.0.0.1"
    b"\r\nX-Stepdiag-Token: \xff\xfe",
    "nothing to be done": b"POST /control/%0a%1b[2J HTTP/1.1\r\nHost: 127.0.0.1",
    "a length that is none": b"POST /control/start HTTP/1.1\r\nContent-Length: -1",
    "a length beyond all": b"POST /control/start HTTP/1.1\r\nContent-Length: " + b"9" * 30,
    "no HTTP": b"\x16\x03\x01" + bytes(1000),
}


@pytest.mark.parametrize("request_", REQUESTS.values(), ids=REQUESTS)
def test_a_request_that_makes_no_sense_is_refused(page, request_, capfd):
    answer = http(page.port, request_ + b"\r\nConnection: close\r\n\r\n")
    assert answer[:12].endswith((b" 400", b" 403", b" 404", b" 405")) or answer == b""
    assert b"root:" not in answer and b"import " not in answer
    assert page.is_well()
    assert len(page.log) <= 1
    assert all(one.isprintable() and len(one) < 400 for one in page.log)
    assert capfd.readouterr().err == ""


def test_a_page_that_ends_bids_its_viewers_farewell(page):
    with websocket(page.port, "/live") as line:
        line.sendall(frame(b'{"token":""}'))
        seen = line.recv(2**20)
        ending = threading.Thread(target=page.server.close)
        ending.start()
        while not seen.endswith(GOING_AWAY):
            line.sendall(frame(b"1"))
            more = line.recv(2**20)
            assert more, "it is cut off"
            seen += more
    ending.join()


def test_who_connects_to_the_page_and_asks_for_nothing_is_cut_off(page):
    slow = [
        socket.create_connection(("127.0.0.1", page.port))
        for _ in range(3 * page_module.MOST_CONNECTIONS)
    ]
    for line in slow:
        with suppress(ConnectionError):
            line.sendall(b"GET / HT")
    assert all(is_cut_off(line) for line in slow)
    for line in slow:
        line.close()
    assert page.is_well()
    assert len(page.log) <= 2 * MOST


class Foxglove:
    """A Foxglove server that is led from a thread of its own, and what was logged."""

    def __init__(self):
        self.log, self.sent = [], 0
        self.server = FoxgloveServer("test", foxglove_module.ServedPlace(port=0), self.log.append)
        types, kind = own_types(), topics.LINE.type_name
        self.name = topics.absolute(topics.LINE)
        decode = partial(types.decode, kind)
        self.server.offer(self.name, kind, types.schema(kind), decode, topics.LINE)
        self.server.start()
        self.port = int(self.server.url.rpartition(":")[2])
        for number in range(LINES):
            line = types.new(kind)
            line.line_index = number
            self._line = types.encode(kind, line)
            self.server.send(self.name, self._line, number)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._work)
        self._thread.start()

    def _work(self):
        while not self._end.wait(0.02):
            self.server.work()

    def close(self):
        self._end.set()
        self._thread.join()
        self.server.close()

    @contextmanager
    def connect(self):
        """Connect; yield the socket and the number of the channel."""
        with websocket(self.port, **FOXGLOVE) as line:
            found = b""
            while not (told := re.search(rb'"advertise".*?"id":(\d+)', found, re.DOTALL)):
                found += line.recv(65_536)
            yield line, int(told[1])

    def is_well(self):
        """Say whether a new viewer is shown what holds."""
        with self.connect() as (line, channel):
            line.sendall(subscribing([channel]))
            found = 0
            while found < LINES * len(self._line):
                found += len(line.recv(65_536))
        return True


def subscribing(channels, op="subscribe"):
    """Return the frame by which a viewer asks for channels, by numbers that may be none."""
    told = {
        "op": op,
        "subscriptions": [{"id": one, "channelId": one} for one in channels],
        "subscriptionIds": channels,
        "channelIds": channels,
    }
    return frame(json.dumps(told).encode())


LOOKERS = {
    "deep": frame(b"[" * DEEP),
    "deep in an object": frame(b'{"op":"subscribe","subscriptions":' + b"[" * DEEP),
    "no UTF-8": frame(b"\xff\xfe"),
    "not masked": frame(b"{}", masked=False),
    "no kind of frame": frame(b"{}", 7),
    "longer than can be": frame(b"x", length=2**63),
    "100 MB": frame(b"", length=100 * 2**20) + PIECE,
    "nothing that can be asked": frame(b'{"op":"boom"}') * 5000,
    "no object": frame(b"[1, 2]") + frame(b"null") + frame(b"5"),
    "numbers that are none": b"".join(
        subscribing([one]) for one in (1.5, -1, 10**30, "a", None, [1], {})
    ),
    "10,000 channels that are none": subscribing(list(range(10**6, 10**6 + 10_000))),
    "one channel 5,000 times": lambda channel: subscribing([channel] * 5000),
    "to and fro": lambda channel: (
        subscribing([channel]) + subscribing([channel], "unsubscribe")
    ) * 5000,
    "publishes": frame(b'{"op":"advertise","channels":[{"id":1,"topic":"/x","encoding":"cdr",'
    b'"schemaName":"x"}]}') + frame(b"\x01" + bytes(100), BINARY),
    "sets parameters": frame(b'{"op":"setParameters","parameters":[{"name":"x","value":1}]}'),
    "asks for files": frame(b'{"op":"fetchAsset","uri":"file:///etc/passwd","requestId":1}'),
}  # fmt: skip


@pytest.fixture
def foxglove():
    made = Foxglove()
    yield made
    made.close()


@pytest.mark.parametrize("sent", LOOKERS.values(), ids=LOOKERS)
def test_what_is_no_viewer_harms_no_foxglove_server(foxglove, sent, capfd):
    before = resident()
    with foxglove.connect() as (line, channel):
        pour(line, sent(channel) if callable(sent) else sent, 1)
        assert foxglove.is_well()
    assert resident() - before < ROOM
    assert len(foxglove.log) <= 2 * MOST
    assert all(one.isprintable() and len(one) < 400 for one in foxglove.log)
    assert capfd.readouterr().err == ""


def test_pieces_without_end_are_cut_off_by_the_foxglove_server(foxglove):
    before = resident()
    with foxglove.connect() as (line, _):
        line.sendall(frame(b"{", final=False))
        piece = frame(PIECE, CONTINUED, final=False)
        assert pour(line, piece, 2 * MUCH) < 2 * MUCH
    assert foxglove.is_well()
    assert resident() - before < 2 * ROOM


def test_who_connects_to_the_foxglove_server_and_asks_for_nothing_delays_nobody(foxglove):
    slow = [socket.create_connection(("127.0.0.1", foxglove.port)) for _ in range(200)]
    for line in slow:
        line.sendall(b"GET / HT")
    assert foxglove.is_well()
    for line in slow:
        line.close()


def test_what_strangers_bring_about_is_said_sparingly_and_counted(monkeypatch):
    from stepdiag_ros.text import sparing

    said, now = [], [100.0]
    monkeypatch.setattr(sparing.time, "monotonic", lambda: now[0])
    say = Sparing(said.append)
    for number in range(1000):
        say(f"refused {number}\x1b[2J\n" + "x" * 10_000)
    assert len(said) == MOST and all(one.isprintable() and len(one) < 400 for one in said)
    now[0] += sparing.SPAN
    say("refused once more")
    assert said[-1].startswith("refused once more") and str(1000 - MOST) in said[-1]
