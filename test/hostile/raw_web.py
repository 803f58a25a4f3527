"""HTTP and WebSocket by hand, so that nothing keeps a client from sending what it must not."""

import os
import socket
import struct
from contextlib import contextmanager
from pathlib import Path

TEXT, BINARY, CONTINUED, CLOSE = 1, 2, 0, 8
_PATIENCE = 20.0


def http(port, request, patience=_PATIENCE):
    """Send bytes to a port and return all that is answered; empty if the connection is cut."""
    with socket.create_connection(("127.0.0.1", port), timeout=patience) as line:
        try:
            line.sendall(request)
            return _rest(line)
        except (ConnectionError, TimeoutError):
            return b""


def frame(payload, kind=TEXT, final=True, length=None, masked=True):
    """Return a frame; its length may be a lie."""
    told = len(payload) if length is None else length
    head = bytes([kind | (0x80 if final else 0)])
    mask = 0x80 if masked else 0
    if told < 126:
        head += bytes([told | mask])
    elif told < 2**16:
        head += bytes([126 | mask]) + struct.pack(">H", told)
    else:
        head += bytes([127 | mask]) + struct.pack(">Q", told)
    return head + (bytes(4) if masked else b"") + payload  # a mask of zeros changes nothing


@contextmanager
def websocket(port, path="/", **headers):
    """Connect, and yield the socket once the server has agreed."""
    told = {
        "Host": f"127.0.0.1:{port}",
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
        **{name.replace("_", "-"): value for name, value in headers.items()},
    }
    lines = [f"GET {path} HTTP/1.1", *(f"{name}: {value}" for name, value in told.items())]
    with socket.create_connection(("127.0.0.1", port), timeout=_PATIENCE) as line:
        line.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        answer = b""
        while b"\r\n\r\n" not in answer:
            more = line.recv(1)
            if not more:
                raise ConnectionError("the server does not agree")
            answer += more
        if b" 101 " not in answer.partition(b"\r\n")[0]:
            raise ConnectionError(answer.decode(errors="replace"))
        yield line


def is_cut_off(line, patience=_PATIENCE):
    """Say whether the server ends a connection within some seconds."""
    line.settimeout(patience)
    try:
        _rest(line)
    except ConnectionError:
        return True
    except TimeoutError:
        return False
    return True


def pour(line, piece, times):
    """Send a piece many times, until the server does not take it any more; return how often."""
    for number in range(times):
        try:
            line.sendall(piece)
        except (ConnectionError, TimeoutError):
            return number
    return times


def resident():
    """Return the bytes of memory that this process has."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")


def _rest(line):
    found = b""
    while more := line.recv(65_536):
        found += more
    return found
