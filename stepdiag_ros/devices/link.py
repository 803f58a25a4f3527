"""A link to a device that sends bytes: serial port, TCP connection, remote serial port, loop.

The link is a URL of pyserial ("URL handlers", pyserial documentation): ``/dev/ttyUSB0``,
``hwgrep://SERIAL-NUMBER``, ``socket://host:port``, ``rfc2217://host:port``, ``loop://``. None of
its methods waits for the device. What pyserial does slowly is done beside: opening (a host that
does not answer takes seconds) and closing (pyserial pauses after it). What it does endlessly is not
asked of it: it spins in ``write`` while the other side takes nothing, so a link writes only where
there is room, and keeps the rest, up to a limit. Only behind ``rfc2217://`` pyserial does
not report how much room there is: a terminal server that takes nothing holds up what does not fit
into the buffers of the network.

A link does not come back by itself. It raises OSError once it is broken; the caller closes
the device then, and opens a new one.
"""

import io
import os
import re
import select
import socket
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from queue import Queue
from threading import Event, Thread
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.refusal import Lost, Refusal

if TYPE_CHECKING:
    from serial import SerialBase

WITHOUT_WAITING = 0.05
"""s for which opening is waited for: a port, or a host that answers, is open by then."""
MOST_AT_ONCE = 1 << 20
"""Bytes that are taken from the device in one call."""
MOST_UNSENT = 1 << 16
"""Bytes that may wait to be sent; more means that nobody listens at the other end."""

_SCHEMES = ("socket", "rfc2217", "loop", "hwgrep")
_PARITIES = {"none": "N", "even": "E", "odd": "O", "mark": "M", "space": "S"}
_FLOWS = ("none", "rtscts", "xonxoff", "dsrdtr")
_LOOP_BUFFER = 4096


@dataclass(frozen=True)
class LinkSettings:
    """Where a device is, and how its port is set; a TCP connection needs the URL alone.

    Attributes:
        url: of pyserial.
        baud_rate: bit/s.
        data_bits: 5 to 8.
        parity: none, even, odd, mark or space.
        stop_bits: 1, 1.5 or 2.
        flow_control: none, rtscts, xonxoff or dsrdtr.
        dtr: level of DTR while the port is open; False keeps boards from being reset by it.
    """

    url: str
    baud_rate: int = 9600
    data_bits: int = 8
    parity: str = "none"
    stop_bits: float = 1.0
    flow_control: str = "none"
    dtr: bool = True

    @classmethod
    def from_section(cls, section: Section, baud_rate: int = 9600) -> "LinkSettings":
        """Take the settings from the keys ``url``, ``baud_rate`` …; ``url`` alone is needed.

        Args:
            section: of the device's settings; it is finished here.
            baud_rate: where the section does not state one.

        Raises:
            ValueError: a setting is wrong.
        """
        url = section.text("url")
        stop_bits = section.number("stop_bits", low=1.0, high=2.0, default=1.0)
        if stop_bits not in (1.0, 1.5, 2.0):
            raise Refusal(
                f"{section.source}: 'stop_bits' is {stop_bits:g}; expected 1, 1.5 or 2",
                fault="unknown",
            )
        settings = cls(
            url=url,
            baud_rate=section.integer("baud_rate", low=50, high=20_000_000, default=baud_rate),
            data_bits=section.integer("data_bits", low=5, high=8, default=8),
            parity=section.names("parity", tuple(_PARITIES), default=("none",))[0],
            stop_bits=stop_bits,
            flow_control=section.names("flow_control", _FLOWS, default=("none",))[0],
            dtr=section.flag("dtr", default=True),
        )
        section.finish()
        if trouble := _trouble(url):
            raise Refusal(f"{section.source}: 'url' is '{url}'; {trouble}", fault="malformed")
        return settings


def _trouble(url: str) -> str:
    """Say what is wrong with a URL; empty if it can be used."""
    scheme, separator, rest = url.partition("://")
    if not separator:
        if re.fullmatch(r"[\w.-]+:\d+", url):
            return f"for a TCP connection write socket://{url}"
        return "" if url.strip() else "expected a serial port or socket://host:port"
    if scheme not in _SCHEMES:
        return f"expected a serial port, or one of {', '.join(f'{s}://…' for s in _SCHEMES)}"
    if scheme in ("socket", "rfc2217"):
        try:
            parts = urlsplit(url)
            whole = bool(parts.hostname and parts.port)
        except ValueError:
            whole = False
        return "" if whole else f"expected {scheme}://host:port"
    return "expected something to look for after it" if scheme == "hwgrep" and not rest else ""


class Link:
    """Bytes to and from a device, without waiting.

    Args:
        settings: where it is.

    Raises:
        OSError: it cannot be opened, and that became known at once; otherwise ``receive`` and
            ``send`` say so later.
    """

    def __init__(self, settings: LinkSettings) -> None:
        self.url = settings.url
        self._port: SerialBase | None = None
        self._failure = ""
        self._closed = False
        self._done = Event()
        self._unsent = bytearray()
        Thread(target=self._open, args=(settings,), daemon=True, name=f"open {self.url}").start()
        self._done.wait(WITHOUT_WAITING)
        self._check()

    @property
    def ready(self) -> bool:
        """Say whether the device is connected; before, nothing comes, and what is sent waits."""
        return self._done.is_set() and not self._failure

    def receive(self) -> bytes:
        """Return the bytes that have come; empty if none have.

        Raises:
            OSError: the link is broken, or could not be opened.
        """
        self._check()
        if not self._done.is_set():
            return b""
        self._flush()
        received = bytearray()
        while len(received) < MOST_AT_ONCE:
            try:
                new = self._do(_read)
            except OSError:
                # What came before the end is whole; the next call finds the end again.
                if received:
                    break
                raise
            if not new:
                break
            received += new
        return bytes(received)

    def send(self, data: bytes) -> None:
        """Send bytes, as far as there is room; the rest follows with the next call of a method.

        Raises:
            OSError: the link is broken, could not be opened, or the device takes nothing any more.
        """
        self._check()
        if len(self._unsent) + len(data) > MOST_UNSENT:
            raise Lost(
                f"{self.url} does not accept the data sent to it", fault="lost", aspect="writing"
            )
        self._unsent += data
        if self._done.is_set():
            self._flush()

    def close(self) -> None:
        """Let the device go; what has not been sent yet is tried once more."""
        if self._closed:
            return
        with suppress(OSError):
            if self.ready:
                self._flush()
        self._closed = True
        if self._done.is_set():
            Thread(target=self._close, daemon=True, name=f"close {self.url}").start()

    # ----------------------------------------------------------------------------------------------

    def _open(self, settings: LinkSettings) -> None:
        try:
            self._port = _opened(settings)
        except Exception as error:
            # Pyserial raises OSError, ValueError and NotImplementedError alike.
            self._failure = f"cannot open {self.url}: {_why(error)}"
        self._done.set()
        if self._closed:
            self._close()

    def _close(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            with suppress(Exception):
                port.close()

    def _check(self) -> None:
        if self._closed:
            raise Lost(f"{self.url} is closed", fault="stopped")
        if self._failure:
            aspect = "opening" if self._port is None else "link"
            raise Lost(self._failure, fault="lost", aspect=aspect)

    def _flush(self) -> None:
        while self._unsent and (room := self._do(_room)):
            part = bytes(self._unsent[:room])
            sent = self._do(partial(_write, part))
            del self._unsent[: len(part) if sent is None else sent]

    def _do(self, action: "Callable[[SerialBase], Any]") -> Any:
        assert self._port is not None
        try:
            return action(self._port)
        except Exception as error:
            # Beside OSError, a port that is pulled out brings TypeError, struct.error and others.
            self._failure = f"the link {self.url} is broken: {_why(error)}"
            raise Lost(self._failure, fault="lost", aspect="link") from error


def _opened(settings: LinkSettings) -> "SerialBase":
    import serial

    port = serial.serial_for_url(settings.url, do_not_open=True)
    port.baudrate = settings.baud_rate
    port.bytesize = settings.data_bits
    port.parity = _PARITIES[settings.parity]
    port.stopbits = settings.stop_bits
    port.rtscts = settings.flow_control == "rtscts"
    port.xonxoff = settings.flow_control == "xonxoff"
    port.dsrdtr = settings.flow_control == "dsrdtr"
    port.dtr = settings.dtr
    port.timeout = 0
    scheme = urlsplit(settings.url).scheme
    if scheme in ("", "hwgrep"):
        # Two programs that read one port each get a part of the bytes.
        port.exclusive = True
        port.write_timeout = 0
    elif scheme == "socket":
        port.write_timeout = 0
    port.open()
    if scheme == "socket":
        _send_at_once(int(port.fileno()))
    return port


def _send_at_once(handle: int) -> None:
    """Let no small message wait for the acknowledgement of the one before (40 ms and more)."""
    with socket.socket(fileno=os.dup(handle)) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


def _waiting(port: Any) -> int:
    return int(port.in_waiting)


def _write(data: bytes, port: "SerialBase") -> int | None:
    return port.write(data)


def _handle(port: "SerialBase") -> int | None:
    """Return what ``select`` can wait for; None where pyserial keeps the bytes in a queue."""
    try:
        return int(port.fileno())
    except io.UnsupportedOperation:
        return None


def _how_many(port: "SerialBase") -> int:
    # Asked for more than is there, the queue of loop:// and rfc2217:// gives it byte by byte, and
    # fails at its end.
    return 65536 if _handle(port) is not None else min(_waiting(port), 65536)


def _read(port: "SerialBase") -> bytes:
    return bytes(port.read(_how_many(port)))


def _room(port: "SerialBase") -> int:
    """Return how many bytes can be written without waiting."""
    handle = _handle(port)
    if handle is not None:
        return 4096 if select.select([], [handle], [], 0)[1] else 0
    if isinstance(getattr(port, "queue", None), Queue):
        return _LOOP_BUFFER - _waiting(port)
    return MOST_UNSENT


def _why(error: Exception) -> str:
    """Return the reason alone: pyserial repeats the port, and the text of errors within errors."""
    text = str(error) or type(error).__name__
    if "exclusively lock" in text:
        return "another program uses it"
    if reasons := re.findall(r"\[Errno -?\d+\] ([^'\":\[]+)", text):
        return str(reasons[-1]).strip()
    return re.sub(r"^could not open port \S+: ", "", text, flags=re.IGNORECASE)
