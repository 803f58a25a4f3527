#!/usr/bin/python3
"""The agent inside LinuxCNC: makes the moves of one client, and stops when that falls silent.

A program of its own, on nothing but the standard library and LinuxCNC's Python modules ``linuxcnc``
and ``hal``, for the Python that LinuxCNC uses (3.9 or later). It is LinuxCNC's display
(``[DISPLAY] DISPLAY``) or runs beside another one (``[APPLICATIONS] APP``); ``-ini FILE`` is what
LinuxCNC itself adds to the command line. Settings, in the section ``[STEPDIAG]`` of the INI file:

=========  ==================================================================================
SOCKET     path of the Unix socket on which the client is awaited; needed
MODE       mode of the socket, octal (660): a user with write access can move the machine
ERRORS     READ (default), or LEAVE where another display reads LinuxCNC's messages, which only
           one reader can have
MOTORS     HAL pins with the positions of the motors of X, Y, Z (``joint.N.motor-pos-fb``)
HALFILE    HAL file that is executed once the pins of the component ``stepdiag`` are there
=========  ==================================================================================

Protocol, version 1: lines of JSON in both directions, one client at a time, SI units, times in ns
of CLOCK_REALTIME. The client asks, ``ask`` being a number of its own, and is answered
``{"answer": ask, "ok": true or false, "reason": "..."}``:

- ``{"op": "hello", "protocol": 1, "window": m, "hold": s, "dead_man": s, "rate": Hz}``, first;
  answered with the facts of the machine.
- ``{"op": "start"}``: an operator has said that the machine may move. Ends with every stop, fault
  and silence.
- ``{"op": "move", "move": N, "target": [x, y, z], "feed": m/s, "axes": "X"}``: N is one more than
  that of the move before, as the hello states; a number that was used is never executed again.
- ``{"op": "stop", "reason": "..."}``: brake now.
- ``{"op": "alive"}``: not answered; the client's sign of life when it has nothing to ask.

Events: ``sample`` (actual position and that of the motors) at the asked rate, of single servo
cycles and with their time where HAL's sampler can be had (``stepdiag_cycles.py``), and ``state``
(ready, moving, stopped, fault) with the reason at each change. A move has ended in position when
ready follows on moving: LinuxCNC has then ended the command, and the *actual* position has been
within the window of the target for the hold time.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import select
import signal
import socket
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from stepdiag_controller import AXES, Controller

PROTOCOL = 1
PERIOD = 0.002
"""Seconds between two looks at the machine while a client is there."""
IDLE_PERIOD = 0.02
ERROR_LAG = 0.5
"""Seconds for which messages and states are awaited that explain a fault: they race, and an e-stop
is known up to two cycles of the I/O task (0.1 s each) after the machine is off."""
SETTLE_LIMIT = 5.0
"""Seconds after the end of a command within which the axes must be in position."""
DEAD_CLIENT = 3.0
"""Seconds of silence after which another client may take the place of this one."""
LONGEST_LINE = 65536
GONE = "the connection of the client has ended"
STANDING = 0.05
"""Seconds for which no axis may have left the window, for the machine to stand."""


class Refused(Exception):
    """A request that is not carried out; the text says why."""


def _ways(begin: Sequence[float], end: Sequence[float]) -> list[float]:
    return [end[axis] - begin[axis] for axis in range(3)]


class Move:
    """The move at work."""

    def __init__(self, number: int, target: list[float]) -> None:
        self.number = number
        self.target = target
        self.serial = 0
        self.ended_at: float | None = None
        self.within_since: float | None = None


class Client:
    """The connection to the one client."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self.connection = connection
        self.heard = time.monotonic()
        self.greeted = False
        self._in = b""
        self._out = b""

    def read(self) -> list[dict[str, Any]]:
        """Return the messages that have come.

        Raises:
            ValueError: it makes no sense.
            OSError: the client has gone.
        """
        data = self.connection.recv(LONGEST_LINE)
        if not data:
            raise OSError(errno.ECONNRESET, "closed")
        self.heard = time.monotonic()
        *lines, self._in = (self._in + data).split(b"\n")
        if len(self._in) > LONGEST_LINE:
            raise ValueError("a line without an end")
        messages = [json.loads(line) for line in lines if line.strip()]
        if not all(isinstance(message, dict) for message in messages):
            raise ValueError("a message that is not an object")
        return messages

    def send(self, **message: Any) -> None:
        """Send as much as fits; a client that does not read is given up when it has 1 MB to."""
        self._out += json.dumps(message).encode() + b"\n"
        try:
            sent = self.connection.send(self._out)
        except BlockingIOError:
            sent = 0
        self._out = self._out[sent:]
        if len(self._out) > 1_000_000:
            raise OSError(errno.ENOBUFS, "the client does not read")


class Agent:
    """Makes the moves that the client asks for, and watches over them."""

    def __init__(self, controller: Controller, listener: socket.socket) -> None:
        self._controller = controller
        self._listener = listener
        self._client: Client | None = None
        self._window, self._hold, self._dead_man, self._rate = 0.0, 0.0, 0.0, 0.0
        self._next_sample, self._sampled = 0.0, 0
        self._session = False
        self._starting: Any = None
        self._move: Move | None = None
        self._last_move = 0
        # Why the machine is to stand until the next start, and whether that is a fault.
        self._halted, self._faulty = "", False
        self._braking = ""
        self._stood_at = controller.position
        self._stands_since = 0.0
        self._errors: list[str] = []
        self._fault_since: float | None = None
        self._told: tuple[str, str] = ("", "")
        self.identity = f"{os.getpid()}-{time.time_ns()}"

    def run(self, goes_on: Callable[[], bool]) -> None:
        """Work until asked to end."""
        while goes_on():
            period = IDLE_PERIOD if self._client is None else PERIOD
            sockets = [self._listener] + ([self._client.connection] if self._client else [])
            asked = time.monotonic()
            ready = select.select(sockets, [], [], period)[0]
            self._controller.look()
            self._errors += self._controller.errors()
            if self._client is not None and self._client.connection in ready:
                self._hear(self._client)
            if self._listener in ready:
                self._accept()
            self._watch_client(asked)
            self._watch_machine()
            self._tell()
        self._end_session("the agent ends")

    # The client ---------------------------------------------------------------------------------

    def _accept(self) -> None:
        connection = self._listener.accept()[0]
        # Who has gone and comes again at once finds the place free.
        for _ in range(100):
            if self._client is None or not select.select([self._client.connection], [], [], 0)[0]:
                break
            self._hear(self._client)
        if self._client is not None:
            with contextlib.suppress(OSError):
                connection.send(b'{"event": "refused", "reason": "another client is there"}\n')
            connection.close()
            return
        self._client = Client(connection)
        self._told = ("", "")

    def _lose_client(self, reason: str) -> None:
        if self._client is not None:
            self._client.connection.close()
            self._client = None
        self._starting = None
        self._end_session(reason)

    def _hear(self, client: Client) -> None:
        try:
            for message in client.read():
                if message.get("op") != "alive":
                    self._do(client, message)
        except OSError:
            self._lose_client(GONE)
        except (ValueError, KeyError, TypeError) as error:
            with contextlib.suppress(OSError):
                client.send(event="refused", reason=f"this makes no sense: {error!r}")
            self._lose_client("the client has sent what makes no sense")

    def _do(self, client: Client, message: dict[str, Any]) -> None:
        ask, op = message["ask"], message["op"]
        if not client.greeted and op != "hello":
            raise ValueError("no hello")
        try:
            if op == "hello":
                self._greet(client, message)
                return
            if op == "start":
                self._start(ask)
                return
            if op == "stop":
                self._stop(str(message["reason"]))
                client.send(answer=ask, ok=True, reason="")
                return
            if op != "move":
                raise ValueError("an unknown op")
            target = [float(value) for value in message["target"]]
            number, feed, axes = int(message["move"]), float(message["feed"]), str(message["axes"])
            self._check(number, target, feed, axes)
        except Refused as refused:
            client.send(answer=ask, ok=False, reason=str(refused))
            return
        # Used up before anything moves: whatever happens now, it is not executed again.
        self._last_move = number
        self._errors.clear()
        self._move = Move(number, target)
        # The state goes first: who has the answer knows that the machine moves.
        self._tell()
        client.send(answer=ask, ok=True, reason="")
        self._move.serial = self._controller.move(target, feed)

    def _greet(self, client: Client, message: dict[str, Any]) -> None:
        if message["protocol"] != PROTOCOL:
            raise ValueError(f"the protocol is {PROTOCOL}")
        client.greeted = True
        self._window, self._hold = float(message["window"]), float(message["hold"])
        self._dead_man, self._rate = float(message["dead_man"]), float(message["rate"])
        if not (self._window > 0.0 and 0.05 <= self._dead_man <= 5.0 and 1 <= self._rate <= 500):
            raise ValueError("window, dead_man (0.05 to 5 s) or rate (1 to 500 Hz)")
        low, high = self._controller.limits()
        client.send(
            answer=message["ask"],
            ok=True,
            reason="",
            agent=self.identity,
            version=self._controller.version,
            last_move=self._last_move,
            low=low,
            high=high,
            velocity=self._controller.largest("MAX_VELOCITY"),
            acceleration=self._controller.largest("MAX_ACCELERATION"),
        )
        self._next_sample = time.monotonic()

    def _start(self, ask: Any) -> None:
        trouble = self._controller.trouble() or self._controller.hindrance()
        if not trouble and not self._stands():
            trouble = "the axes still move"
        if trouble:
            raise Refused(trouble)
        if not self._controller.in_mdi():
            self._controller.take_over()
        # Answered when LinuxCNC has done it.
        self._starting = ask

    def _finish_start(self) -> None:
        if self._client is not None and self._starting is not None and self._controller.in_mdi():
            ask, self._starting, self._session = self._starting, None, True
            self._halted, self._faulty = "", False
            self._errors.clear()
            self._controller.component["stop"] = False
            self._tell()
            self._answer(ask)

    def _answer(self, ask: Any) -> None:
        if self._client is not None:
            try:
                self._client.send(answer=ask, ok=True, reason="")
            except OSError:
                self._lose_client(GONE)

    def _check(self, number: int, target: list[float], feed: float, axes: str) -> None:
        controller = self._controller
        if number != self._last_move + 1:
            raise Refused(f"move {number} is not the next one after {self._last_move}")
        if not self._session:
            raise Refused(self._halted or "nobody has said that the machine may move")
        if self._move is not None or self._braking:
            raise Refused("the machine moves")
        trouble = controller.trouble() or controller.hindrance()
        if not trouble and not controller.in_mdi():
            trouble = "the machine was taken over at the control"
        if trouble:
            raise Refused(trouble)
        low, high = controller.limits()
        ways = _ways(controller.commanded(), target)
        length = sum(way * way for way in ways) ** 0.5
        fastest = controller.largest("MAX_VELOCITY")
        if not 0.0 < feed < 100.0:
            raise Refused(f"the feed {feed!r} m/s is not between 0 and 100 m/s")
        moved = [name for way, name in zip(ways, AXES) if abs(way) > self._window]  # noqa: B905
        if not set(moved) <= set(axes):
            asked = f"one of {' and '.join(axes)}" if axes else "none"
            raise Refused(f"the move is of {' and '.join(moved)}, but was asked for as {asked}")
        for axis, name in enumerate(AXES):
            if not low[axis] <= target[axis] <= high[axis]:
                raise Refused(
                    f"{name} = {target[axis]:.7g} m lies beyond LinuxCNC's soft limits"
                    f" {low[axis]:.7g} m to {high[axis]:.7g} m"
                )
            speed = feed * abs(ways[axis]) / length if length else 0.0
            if speed > (fastest[axis] or speed) * 1.000001:
                raise Refused(
                    f"{name} would move at {speed:.4g} m/s,"
                    f" but LinuxCNC moves it at {fastest[axis]:.4g} m/s at most"
                )

    def _stop(self, reason: str) -> None:
        self._session, self._starting = False, None
        self._controller.abort()
        self._braking = self._braking or reason or "stopped"

    def _end_session(self, reason: str) -> None:
        if self._session:
            self._stop(reason)

    # The machine --------------------------------------------------------------------------------

    def _watch_client(self, asked: float) -> None:
        """End the session of a client that had said nothing for too long when it was asked.

        What passed since then, perhaps because this process was stopped, is not its silence.
        """
        if self._client is None:
            return
        silent = asked - self._client.heard
        if silent > self._dead_man:
            self._end_session(f"the client was silent for {silent:.2f} s")
        if silent > DEAD_CLIENT:
            self._lose_client(f"the client was silent for {silent:.2f} s")

    def _watch_machine(self) -> None:
        controller, now = self._controller, time.monotonic()
        position = controller.position
        moved = max(map(abs, _ways(self._stood_at, position))) > self._window
        if moved or not controller.at_rest():
            self._stood_at, self._stands_since = position, now
        controller.component["session"] = self._session
        if self._starting is not None:
            self._finish_start()
        fault = controller.trouble()
        if not fault and self._session and not controller.in_mdi():
            fault = "the machine was taken over at the control"
        if not fault and self._move is not None and controller.failed(self._move.serial):
            fault = "LinuxCNC has refused the move"
        moving = self._move is not None
        if ((self._session or moving) and fault) or (moving and self._errors):
            self._fault_since = self._fault_since or now
            if now - self._fault_since > ERROR_LAG:
                reasons = [*self._errors, fault] if fault else self._errors
                self._fail("; ".join(dict.fromkeys(reasons)))
        else:
            self._fault_since = None
            if self._move is not None:
                self._follow(self._move, now)
        if self._braking and self._stands():
            self._halted, self._faulty = self._braking, False
            self._braking, self._move = "", None

    def _fail(self, reason: str) -> None:
        """End session and move as a fault, which it stays until the next start."""
        self._halted, self._faulty = reason, True
        self._fault_since, self._move, self._braking, self._session = None, None, "", False
        self._errors.clear()
        self._controller.abort()

    def _follow(self, move: Move, now: float) -> None:
        controller = self._controller
        if self._braking or not controller.ended(move.serial):
            move.ended_at = move.within_since = None
            return
        move.ended_at = move.ended_at or now
        off = [abs(way) for way in _ways(controller.position, move.target)]
        if max(off) > self._window:
            move.within_since = None
            if now - move.ended_at > SETTLE_LIMIT:
                name = AXES[off.index(max(off))]
                self._fail(
                    f"LinuxCNC calls the move done, but {name} is {1e6 * max(off):.3g} um off"
                )
            return
        # From after the first position within to before the last: a busy computer, which may
        # interrupt this between position and clock, makes the hold longer, never shorter.
        if move.within_since is None:
            move.within_since = time.monotonic()
        elif controller.looked - move.within_since >= self._hold:
            self._move = None

    def _stands(self) -> bool:
        return time.monotonic() - self._stands_since >= STANDING

    def _state(self) -> tuple[str, str]:
        if self._move is not None or self._braking:
            return "moving", ""
        if self._halted:
            return "fault" if self._faulty else "stopped", self._halted
        trouble = self._controller.trouble()
        return ("fault", trouble) if trouble else ("ready", "")

    def _tell(self) -> None:
        """Send the state to the client if it has changed, and the position."""
        client, controller = self._client, self._controller
        if client is None or not client.greeted:
            return
        state, reason = self._state()
        told = {"time": controller.time, "position": controller.position}
        try:
            # Positions are at most as late as the status.
            self._send_positions(client, told)
            if (state, reason) != self._told:
                self._told = (state, reason)
                client.send(event="state", state=state, reason=reason, **told)
        except OSError as error:
            deaf = error.errno == errno.ENOBUFS
            self._lose_client("the client does not read the messages sent to it" if deaf else GONE)

    def _send_positions(self, client: Client, now: dict[str, Any]) -> None:
        """Send the positions that are due: those of recorded cycles, else the present one."""
        controller = self._controller
        if controller.cycles is not None:
            # Half a cycle less than asked for, so that it is every n-th one whatever its time.
            apart = 1e9 / self._rate - 0.5 * controller.cycles.clock.period
            for at, position, motors in controller.samples:
                if at - self._sampled >= apart:
                    self._sampled = at
                    client.send(event="sample", time=at, position=position, motors=motors)
        elif time.monotonic() >= self._next_sample and controller.time > self._sampled:
            self._sampled = controller.time
            period = 1.0 / self._rate
            self._next_sample = max(self._next_sample + period, time.monotonic() - period)
            client.send(event="sample", motors=controller.motors(), **now)


def listen(path: str, mode: int) -> socket.socket:
    """Return the socket on which the client is awaited.

    Raises:
        SystemExit: another agent has it.
    """
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(path)
        except OSError:
            with contextlib.suppress(FileNotFoundError):
                Path(path).unlink()
        else:
            raise SystemExit(f"another agent listens on {path}")
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(path)
    Path(path).chmod(mode)
    listener.listen(2)
    return listener


def main() -> int:
    """Run the agent until LinuxCNC ends it."""
    inifile = sys.argv[sys.argv.index("-ini") + 1] if "-ini" in sys.argv[:-1] else ""
    if not inifile:
        print("usage: linuxcnc_agent.py -ini FILE", file=sys.stderr)
        return 2
    ended: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda got, _: ended.append(got))
    controller = Controller(inifile)
    path = controller.setting("SOCKET", "")
    if not path:
        print(f"{inifile}: SOCKET is missing in [STEPDIAG]", file=sys.stderr)
        return 1
    listener = listen(path, int(controller.setting("MODE", "660"), 8))
    try:
        Agent(controller, listener).run(lambda: not ended)
    finally:
        if controller.cycles is not None:
            controller.cycles.close()
        with contextlib.suppress(OSError):
            Path(path).unlink()
    return 0


if __name__ == "__main__":
    sys.exit(main())
