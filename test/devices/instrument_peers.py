"""Peers of instrument drivers: what stands at the other end of the link, led by the test."""

import json
import socket
import time

START = 1_700_000_000_000_000_000
MS = 1_000_000
SECOND = 1_000_000_000


def is_open(device):
    """Say whether all links of a device are open: what is said before is lost, as on a port."""
    if hasattr(device, "_sensors"):
        return all(sensor and sensor._talk._link.ready for sensor in device._sensors)
    talk = getattr(device, "_source", device)
    return not hasattr(talk, "_link") or talk._link.ready


class TcpPeer:
    """A device at a TCP port, which says what the test says."""

    def __init__(self):
        self.server = socket.create_server(("127.0.0.1", 0))
        self.server.setblocking(False)
        self.port = self.server.getsockname()[1]
        self.url = f"socket://127.0.0.1:{self.port}"
        self.connection = None
        self.connections = 0

    def attend(self):
        """Accept whoever wants to connect."""
        try:
            self.connection, _ = self.server.accept()
        except BlockingIOError:
            return
        self.connections += 1
        self.connection.setblocking(False)
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def say(self, text):
        self.connection.sendall(text if isinstance(text, bytes) else text.encode())

    def heard(self):
        """Return what has come since the last call; None when the other side has gone."""
        if self.connection is None:
            return b""
        try:
            return self.connection.recv(65536) or None
        except (BlockingIOError, ConnectionError):
            return b""

    def hang_up(self):
        if self.connection is not None:
            self.connection.close()
            self.connection = None

    def close(self):
        self.hang_up()
        self.server.close()


class Ids3010Peer(TcpPeer):
    """An IDS3010, from the maker's public interface: requests by line, answers with CR LF."""

    def __init__(self, family="com.attocube.ids", mode="measurement running"):
        super().__init__()
        self.family, self.mode = family, mode
        self.displacement_pm = 0.0
        self.warning = 0
        self.contrast = 800
        self.index = [0, 1.00027]
        self.silent = False
        self.garbage = b""
        self.words = {4001: "Beam interrupted", 4002: "Velocity too high", 4003: "Contrast is low"}
        self.asked = []
        self.rest = b""

    def attend(self):
        super().attend()
        *lines, self.rest = (self.rest + (self.heard() or b"")).split(b"\n")
        for line in lines:
            self.answer(json.loads(line))

    def answer(self, request):
        method, parameters = request["method"], request["params"]
        assert request["jsonrpc"] == "2.0" and request["api"] == 2
        self.asked.append((method, parameters))
        if self.silent:
            return
        if self.garbage:
            self.say(self.garbage)
            return
        answer = {"jsonrpc": "2.0", "id": request["id"]}
        result = self.result(method, parameters)
        if result is None:
            answer["error"] = {"code": -32601, "message": "Method not found"}
        else:
            answer["result"] = result
        self.say(json.dumps(answer) + "\r\n")

    def result(self, method, parameters):
        if method == "com.attocube.ecu.getRefractiveIndexForCompensation":
            return self.index if parameters == [-1] else [1]
        if method == "com.attocube.system.errorNumberToString":
            return [0, self.words[parameters[1]]]
        if not method.startswith(self.family):
            return None
        name = method.removeprefix(self.family + ".")
        if name == "system.getCurrentMode":
            return [0, self.mode]
        if name == "system.startMeasurement":
            self.mode = "measurement starting"
            return [0]
        if name == "system.resetError":
            self.warning = 0
            return [0]
        if name == "displacement.getAxisDisplacement":
            return [self.warning, self.displacement_pm]
        if name == "displacement.getAxisSignalQuality":
            return [self.warning, self.contrast, 500]
        return None


class Bench:
    """A device and its peer, on a clock that goes on by one step with every look."""

    def __init__(self, peer, step=2 * MS):
        self.peer, self.step = peer, step
        self.now = START
        self.device = None
        self.taken, self.late = [], 0

    def open(self, opener):
        self.device = opener(self.now)
        return self.device

    def look(self):
        """Let one step pass on the bench's clock: the peer attends, the device is polled once.

        Return the readings of this poll alone, often none; ``taken`` has all of them.
        """
        self.now += self.step
        if self.peer is not None:
            self.peer.attend()
        began = time.monotonic()
        new = self.device.poll(self.now)
        # One that is late now and then is the computer's doing.
        self.late += time.monotonic() - began > 1.0
        assert self.late < 3, "a poll must not wait"
        self.taken += new
        time.sleep(0.0004)
        return new

    def until(self, count=1, looks=2000):
        """Look until some more readings have come; return all of them."""
        wanted, before = len(self.taken) + count, len(self.taken)
        for _ in range(looks):
            if len(self.taken) >= wanted:
                return self.taken[before:]
            self.look()
        raise AssertionError(f"only {len(self.taken) - before} of {count} readings have come")

    def until_true(self, holds, looks=2000):
        for _ in range(looks):
            if holds():
                return
            self.look()
        raise AssertionError("it has not come true")

    def for_looks(self, count):
        before = len(self.taken)
        for _ in range(count):
            self.look()
        return self.taken[before:]

    def connect(self):
        self.until_true(lambda: self.peer.connection is not None and is_open(self.device), 20_000)
