"""A controller with Grbl 1.1 on a TCP port of this computer, as its documentation describes it.

Written from "Grbl v1.1 Interface", "Grbl v1.1 Commands" and "Grbl v1.1 Configuration" alone: lines
with one answer each, real-time commands picked out of the stream, a queue of moves with
acceleration, feed hold, soft reset, alarms, homing. It runs in real time, in a thread of its own.
"""

import re
import select
import socket
import threading
import time
from math import copysign, sqrt

from patience import PATIENCE

SETTINGS = {
    0: 10, 1: 25, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 10: 1, 11: 0.01, 12: 0.002, 13: 0,
    20: 0, 21: 0, 22: 0, 23: 0, 24: 25.0, 25: 500.0, 26: 250, 27: 1.0, 30: 1000, 31: 0, 32: 0,
    100: 1000.0, 101: 1000.0, 102: 1000.0, 110: 30000.0, 111: 30000.0, 112: 12000.0,
    120: 2000.0, 121: 2000.0, 122: 2000.0, 130: 500.0, 131: 400.0, 132: 300.0,
}  # fmt: skip
WHOLE = {0, 1, 2, 3, 4, 5, 6, 10, 13, 20, 21, 22, 23, 26, 32}
MODAL = [{0, 1, 2, 3, 80}, {54, 55}, {17, 18, 19}, {90, 91}, {93, 94}, {20, 21}, {53, 4, 10, 92}]


class Block:
    """A straight move: way and largest speed along it, in mm and mm/s."""

    def __init__(self, start, end, feed, peer):
        self.start, self.end = list(start), list(end)
        ways = [b - a for a, b in zip(start, end, strict=True)]
        self.length = sqrt(sum(way * way for way in ways))
        self.unit = [way / self.length for way in ways]
        shares = [(abs(part), axis) for axis, part in enumerate(self.unit) if part]
        rates = [peer.settings[110 + axis] / share for share, axis in shares]
        self.speed = min([feed, *rates]) / 60.0
        self.acceleration = min(peer.settings[120 + axis] / share for share, axis in shares)
        self.done = 0.0
        self.now = 0.0


class GrblPeer(threading.Thread):
    """The controller; public attributes may be changed by a test at any time.

    Attributes:
        received: lines that came, in order.
        made: ends of moves that were begun, mm.
        mute: nothing is sent while this is set.
        reports: False: status queries are not answered.
        answers: False: lines are executed, but their answers are lost.
        garble: a function that changes what is sent (bytes → bytes).
        halfway: number of a move, from 1 → what happens, once, when half of its way is done.
    """

    def __init__(self, **settings):
        super().__init__(daemon=True)
        self.settings = SETTINGS | {int(key[1:]): value for key, value in settings.items()}
        self.startup = ["", ""]
        self.options = "V,15,128"
        self.received, self.made = [], []
        self.mute = False
        self.reports = self.answers = True
        self.garble = lambda data: data
        self.halfway = {}
        self.pins = ""
        self.door_open = False
        self.position = [0.0, 0.0, 0.0]
        self.wco = [0.0, 0.0, 0.0]
        self.connections = 0
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"socket://127.0.0.1:{self._server.getsockname()[1]}"
        self._client = None
        self._ending = False
        self._mail = []
        self._state = "Alarm" if self.settings[22] else "Idle"
        self._restart()
        self.start()

    # What a test does to it -----------------------------------------------------------------------

    def close(self):
        self._ending = True
        self.join(PATIENCE)

    def do(self, what, *arguments):
        """Let the controller's own thread do something: restart, alarm, press, send, hang_up."""
        done = threading.Event()
        self._mail.append((what, arguments, done))
        assert done.wait(PATIENCE)

    def power_cycle(self):
        self.position = [0.0, 0.0, 0.0]
        self._state = "Alarm" if self.settings[22] else "Idle"
        self._restart()
        self._welcome()

    def reset_button(self):
        self._real_time(0x18)

    def press(self, byte):
        self._real_time(byte)

    def alarm(self, code):
        self._blocks.clear()
        self._critical = code in (1, 2)
        self._state = "Alarm"
        self._say(f"ALARM:{code}")
        if self._critical:
            self._say("[MSG:Reset to continue]")

    def say(self, data):
        self._send(data)

    def hang_up(self):
        if self._client is not None:
            self._client.close()
            self._client = None

    def where_it_stops(self):
        """Wait until nothing moves, and return the position, mm."""
        deadline = time.monotonic() + 30.0
        while self._blocks:
            assert time.monotonic() < deadline, (self._state, self.position)
            time.sleep(0.002)
        return tuple(self.position)

    def jog(self, x):
        """As somebody at the machine would."""
        target = [x, *self.position[1:]]
        self._blocks.append(Block(self.position, target, 600.0, self))
        self._state = "Jog"

    # The controller -------------------------------------------------------------------------------

    def run(self):
        last = time.monotonic()
        while not self._ending:
            sockets = [self._server] + ([self._client] if self._client else [])
            for ready in select.select(sockets, [], [], 0.002)[0]:
                if ready is self._server:
                    self.hang_up()
                    self._client = self._server.accept()[0]
                    self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self.connections += 1
                else:
                    self._receive()
            while self._mail:
                what, arguments, done = self._mail.pop(0)
                getattr(self, what)(*arguments)
                done.set()
            now = time.monotonic()
            while last < now:
                self._move(min(now - last, 1e-3))
                last += 1e-3
            last = now
            if self._asked:
                self._asked = False
                self._report()
            if self._homing_until and now > self._homing_until:
                self._homing_until = 0.0
                self._state = "Idle"
                self.position = [-self.settings[27]] * 3
                self._answer("ok")
            self._lines()
        self.hang_up()
        self._server.close()

    def _receive(self):
        try:
            data = self._client.recv(4096)
        except OSError:
            data = b""
        if not data:
            self.hang_up()
        for byte in data:
            if byte in b"?!~\x18" or byte >= 0x80:
                self._real_time(byte)
            else:
                self._input.append(byte)

    def _real_time(self, byte):
        if byte == ord("?"):
            self._asked = not self._critical and self._state != "Home"
        elif byte == 0x18:
            self._soft_reset()
        elif byte == ord("!") and self._state in ("Idle", "Run"):
            self._state = "Hold:1" if self._blocks else "Hold:0"
        elif byte == ord("!") and self._state == "Jog":
            self._blocks.clear()
            self._state = "Idle"
        elif byte == ord("~") and self._state == "Hold:0":
            self._state = "Run" if self._blocks else "Idle"
        elif byte == 0x84 and self._state in ("Idle", "Run", "Hold:0", "Hold:1"):
            self.door_open = True
            self._say("[MSG:Check Door]")
            self._state = "Door:2" if self._blocks else "Door:1"

    def _soft_reset(self):
        moving = self._state in ("Run", "Jog", "Home", "Hold:1", "Door:2")
        if moving:
            self._say("ALARM:6" if self._state == "Home" else "ALARM:3")
        alarmed = moving or self._state.startswith("Alarm") or self._state == "Sleep"
        self._state = "Alarm" if alarmed else "Door:1" if self.door_open else "Idle"
        self._restart()
        self._welcome()

    def _restart(self):
        self._input = bytearray()
        self._asked = self._critical = False
        self._homing_until = 0.0
        self._blocks = []
        self._modes = {"motion": 0, "inches": False, "relative": False, "feed": 0.0}
        self._wco_due = self._ov_due = 0

    def _welcome(self):
        self._say("")
        self._say("Grbl 1.1h ['$' for help]")
        if self._state == "Alarm":
            self._say("[MSG:'$H'|'$X' to unlock]")
        elif not self.settings[22]:
            for code in filter(None, self.startup):
                self._say(f">{code}:{self._execute(code)}")

    def _lines(self):
        while b"\n" in self._input:
            # In a hold nothing is read, and only some moves fit into the queue.
            if self._critical or self._state[:4] in ("Hold", "Door", "Home", "Slee"):
                return
            line, _, rest = bytes(self._input).partition(b"\n")
            self._input = bytearray(rest)
            text = re.sub(r"\s|\(.*?\)|;.*", "", line.decode("latin-1")).upper()
            self.received.append(text)
            if len(line) > 79:
                self._answer("error:11")
            elif not text:
                self._answer("ok")
            elif text[0] == "$":
                answer = self._dollar(text)
                if answer:
                    self._answer(answer)
            elif self._state in ("Alarm", "Jog"):
                self._answer("error:9")
            else:
                self._answer(self._execute(text))

    def _dollar(self, text):
        if text == "$$" and self._state not in ("Run",):
            for number, value in self.settings.items():
                shown = f"{value:d}" if number in WHOLE else f"{value:.3f}"
                self._say(f"${number}={shown}")
            return "ok"
        if text in ("$$", "$I", "$N", "$H") and self._state not in ("Idle", "Alarm"):
            return "error:8"
        if text == "$I":
            self._say("[VER:1.1h.20190830:peer]")
            self._say(f"[OPT:{self.options}]")
            return "ok"
        if text == "$N":
            for number, code in enumerate(self.startup):
                self._say(f"$N{number}={code}")
            return "ok"
        if text == "$X":
            if self._state == "Alarm":
                self._say("[MSG:Caution: Unlocked]")
                self._state = "Idle"
            return "ok"
        if text == "$H":
            if not self.settings[22]:
                return "error:5"
            self._state = "Home"
            self._homing_until = time.monotonic() + 0.3
            return ""
        return "error:3"

    def _execute(self, text):
        words = re.findall(r"([A-Z])(-?\d*\.?\d*)", text)
        if "".join(letter + value for letter, value in words) != text:
            return "error:1"
        values, commands = {}, []
        for letter, value in words:
            if not re.search(r"\d", value):
                return "error:2"
            if letter == "G":
                commands.append(float(value))
            elif letter in values:
                return "error:25"
            else:
                values[letter] = float(value)
        if any(sum(c in group for c in commands) > 1 for group in MODAL):
            return "error:21"
        if not all(any(c in group for group in MODAL) for c in commands):
            return "error:20"
        modes = self._modes
        for command in commands:
            if command in (0, 1):
                modes["motion"] = command
            elif command in (20, 21):
                modes["inches"] = command == 20
            elif command in (90, 91):
                modes["relative"] = command == 91
        scale = 25.4 if modes["inches"] else 1.0
        if "F" in values:
            modes["feed"] = values["F"] * scale
        axes = {"XYZ".index(letter): value for letter, value in values.items() if letter in "XYZ"}
        if 92 in commands or 10 in commands or 4 in commands:
            return "ok"
        if 53 in commands and modes["motion"] not in (0, 1):
            return "error:30"
        if not axes:
            return "error:26" if {0, 1, 53} & set(commands) else "ok"
        if modes["motion"] == 1 and not modes["feed"]:
            return "error:22"
        end = list(self._blocks[-1].end if self._blocks else self.position)
        for axis, value in axes.items():
            if 53 in commands:
                end[axis] = value * scale
            elif modes["relative"]:
                end[axis] += value * scale
            else:
                end[axis] = value * scale + self.wco[axis]
        end = [
            round(value * self.settings[100 + axis]) / self.settings[100 + axis]
            for axis, value in enumerate(end)
        ]
        if self.settings[20] and any(
            not -self.settings[130 + axis] <= value <= 0.0 for axis, value in enumerate(end)
        ):
            self.alarm(2)
            return ""
        feed = modes["feed"] if modes["motion"] == 1 else 1e9
        start = self._blocks[-1].end if self._blocks else self.position
        self.made.append(tuple(end))
        if end != list(start):
            self._blocks.append(Block(start, end, feed, self))
            if self._state == "Idle":
                self._state = "Run"
        return "ok"

    def _move(self, seconds):
        if not self._blocks or self._state not in ("Run", "Jog", "Hold:1", "Door:2"):
            return
        block = self._blocks[0]
        braking = self._state in ("Hold:1", "Door:2")
        change = block.acceleration * seconds
        if braking:
            block.now = max(block.now - change, 0.0)
        else:
            left = max(block.length - block.done, 0.0)
            fastest = sqrt(2.0 * block.acceleration * left)
            block.now = min(block.now + change, block.speed, max(fastest, change))
        block.done += block.now * seconds
        if block.done >= block.length / 2:
            self.halfway.pop(len(self.made), lambda: None)()
        if block.done >= block.length - 1e-6:
            self.position = list(block.end)
            self._blocks.pop(0)
            if not self._blocks and not braking:
                self._state = "Idle"
        else:
            steps = self.settings[100]
            self.position = [
                round((start + part * block.done) * steps) / steps
                for start, part in zip(block.start, block.unit, strict=True)
            ]
        if braking and (block.now == 0.0 or not self._blocks):
            self._state = "Hold:0" if self._state == "Hold:1" else "Door:1"

    def _report(self):
        if not self.reports:
            return
        shown, scale = self.position, 1 / 25.4 if self.settings[13] else 1.0
        digits = 4 if self.settings[13] else 3
        kind = "MPos" if self.settings[10] & 1 else "WPos"
        if kind == "WPos":
            shown = [a - b for a, b in zip(shown, self.wco, strict=True)]

        def point(values):
            plain = (copysign(abs(v) * scale, v) for v in values)
            return ",".join(f"{value:.{digits}f}".replace("-0.000,", "0.000,") for value in plain)

        fields = [self._state, f"{kind}:{point(shown)}"]
        if self.settings[10] & 2:
            fields.append(f"Bf:{15 - len(self._blocks)},{128 - len(self._input)}")
        fields.append(f"FS:{round(self._blocks[0].now * 60) if self._blocks else 0},0")
        pins = self.pins + ("D" if self.door_open else "")
        if pins:
            fields.append(f"Pn:{pins}")
        if self._wco_due == 0:
            fields.append(f"WCO:{point(self.wco)}")
            self._wco_due, self._ov_due = 10, 1
        elif self._ov_due == 0:
            fields.append("Ov:100,100,100")
            self._ov_due = 20
        self._wco_due -= 1
        self._ov_due -= 1
        self._say(f"<{'|'.join(fields)}>")

    def _answer(self, text):
        if text and self.answers:
            self._say(text)

    def _say(self, text):
        self._send(self.garble(text.encode("latin-1") + b"\r\n"))

    def _send(self, data):
        if self._client is None or self.mute or not data:
            return
        try:
            self._client.sendall(data)
        except OSError:
            self.hang_up()
