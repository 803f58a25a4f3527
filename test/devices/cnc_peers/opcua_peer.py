"""A PLC with an OPC UA server (that of asyncua), and a small program that moves three axes.

The program keeps to what docs/controllers.md asks of a PLC. It runs in a thread of its own.
"""

import asyncio
import threading
import time
from datetime import datetime, timezone
from math import sqrt

from asyncua import Server, ua
from patience import PATIENCE
from ros_processes import wait_until

URI = "http://example.org/machine"
KINDS = {
    "X": (0.0, "Double"), "Y": (0.0, "Double"), "Z": (0.0, "Double"),
    "MotorX": (0.0, "Double"), "MotorY": (0.0, "Double"), "MotorZ": (0.0, "Double"),
    "Busy": (False, "Boolean"), "Acknowledged": (0, "UInt32"), "Done": (0, "UInt32"),
    "Stopped": (False, "Boolean"), "Fault": (0, "Int16"), "FaultText": ("", "String"),
    "Ready": (True, "Boolean"),
    "TargetX": (0.0, "Double"), "TargetY": (0.0, "Double"), "TargetZ": (0.0, "Double"),
    "Feed": (0.0, "Float"), "Axes": (0, "Byte"), "Identity": (0, "UInt32"),
    "Stop": (False, "Boolean"), "Reset": (False, "Boolean"), "Watchdog": (0, "Int16"),
}  # fmt: skip


class OpcUaPeer:
    """The PLC; public attributes may be changed by a test at any time.

    Attributes:
        orders: identity and target (mm) of each order that was carried out.
        position: mm.
        frozen: the program does nothing; the server answers.
        answering: False: an order is carried out, but not acknowledged.
        misses: mm added to each target.
        override: part of the feed that somebody at the machine has set, above 0.
        halfway: number of an order, from 1 → what happens, once, when half of its way is done.
        watchdog_limit: s without a count after which it brakes.
        counts: how often the client has counted the watchdog.
        braked_by_watchdog: times of that, by ``time.monotonic``.
    """

    def __init__(self, secure=None):
        self.acknowledged = self.done = 0
        self.counts = 0
        self._initialize()
        self._secure = secure
        self._scans = 0
        self._inputs = {}
        self._counted = time.monotonic()
        self._started = threading.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._started.wait(PATIENCE)

    def _initialize(self):
        self.orders, self.braked_by_watchdog = [], []
        self.position = [0.0, 0.0, 0.0]
        self.frozen, self.answering = False, True
        self.misses, self.override, self.halfway = 0.0, 1.0, {}
        # A busy computer does not brake a machine in tests that are about something else.
        self.watchdog_limit = PATIENCE
        self.fault, self.fault_text, self.ready, self.stopped = 0, "", True, False
        self.bad, self.moves_by_itself = "", False
        self._path = None

    def restart(self):
        """Be as it was switched on, once nobody is connected who could still write."""
        assert wait_until(lambda: not self.server.bserver.clients)
        for name in ("Stop", "Reset"):
            writing = self.nodes[name].write_value(False)
            asyncio.run_coroutine_threadsafe(writing, self._loop).result(PATIENCE)
        # The scan that goes on has read the old inputs; an order may have waited.
        self.frozen = False
        self._wait_for_scans()
        self._initialize()
        self._wait_for_scans()

    def _wait_for_scans(self):
        last = self._scans
        assert wait_until(lambda: self._scans >= last + 2)

    def close(self):
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result(PATIENCE)
        self._thread.join(PATIENCE)

    def _run(self):
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self._build())
        self._program = self._loop.create_task(self._work())
        self._started.set()
        self._loop.run_forever()

    async def _end(self):
        self._program.cancel()
        await self.server.stop()
        # The server leaves tasks behind of each connection that was lost.
        left = asyncio.all_tasks() - {asyncio.current_task()}
        for task in left:
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)
        self._loop.call_soon(self._loop.stop)

    async def _build(self):
        self.server = Server()
        await self.server.init()
        self.server.set_endpoint("opc.tcp://127.0.0.1:0/")
        if self._secure is None:
            self.server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        else:
            await self._secure(self.server)
        index = await self.server.register_namespace(URI)
        machine = await self.server.nodes.objects.add_object(f"ns={index};s=Machine", f"{index}:M")
        self.nodes = {}
        for name, (value, kind) in KINDS.items():
            node = await machine.add_variable(
                f"ns={index};s={name}", f"{index}:{name}", ua.Variant(value, ua.VariantType[kind])
            )
            await node.set_writable()
            self.nodes[name] = node
        doubles, whole = [ua.VariantType.Double] * 4, [ua.VariantType.UInt32]
        await machine.add_method(
            f"ns={index};s=Order", f"{index}:Order", self._on_method,
            whole + doubles + whole, [ua.VariantType.Int32],
        )  # fmt: skip
        self._index = index
        await self.server.start()
        self.port = self.server.bserver._server.sockets[0].getsockname()[1]
        self.url = f"opc.tcp://127.0.0.1:{self.port}/"

    def _on_method(self, _, identity, x, y, z, feed, axes):  # noqa: ARG002
        values = [argument.Value for argument in (x, y, z, feed, identity)]
        if self.stopped or self.fault or self._path is not None:
            return [ua.Variant(7, ua.VariantType.Int32)]
        self._begin(values[4], values[:3], values[3])
        return [ua.Variant(0, ua.VariantType.Int32)]

    async def _work(self):
        last = time.monotonic()
        identity = 0
        while True:
            await asyncio.sleep(0.004)
            now = time.monotonic()
            if not self.frozen:
                inputs = {}
                for name in (*("Target" + axis for axis in "XYZ"), "Feed", "Identity", "Stop",
                             "Reset", "Watchdog"):  # fmt: skip
                    inputs[name] = await self.nodes[name].read_value()
                if inputs["Watchdog"] != self._inputs.get("Watchdog"):
                    self._counted = now
                    self.counts += 1
                self._inputs = inputs
                if inputs["Stop"]:
                    self.stopped = True
                elif inputs["Reset"]:
                    self.stopped, self.fault, self.fault_text = False, 0, ""
                if self._path is not None and now - self._counted > self.watchdog_limit:
                    self.braked_by_watchdog.append(now)
                    self.stopped = True
                if inputs["Identity"] != identity:
                    identity = inputs["Identity"]
                    target = [inputs["Target" + axis] for axis in "XYZ"]
                    self._begin(identity, target, inputs["Feed"])
                self._move(now - last)
            last = now
            await self._tell()
            self._scans += 1

    def _begin(self, identity, target, feed):
        if self.answering:
            self.acknowledged = identity
        # Never carried out later either.
        if self.stopped or self.fault or not self.ready or self._path is not None:
            return
        self.orders.append((identity, tuple(round(value, 4) for value in target)))
        end = [value + self.misses if value != at else value
               for value, at in zip(target, self.position, strict=True)]  # fmt: skip
        ways = [b - a for a, b in zip(self.position, end, strict=True)]
        length = sqrt(sum(way * way for way in ways))
        self._path = (list(self.position), ways, length, feed / 60.0, identity)
        self._along = self._speed = 0.0

    def _move(self, seconds):
        if self.moves_by_itself:
            self.position[0] += 1.0 * seconds
        if self._path is None:
            return
        start, ways, length, fastest, identity = self._path
        braking = self.stopped or self.fault
        if braking:
            self._speed = max(self._speed - 2000.0 * seconds, 0.0)
        else:
            left = sqrt(2.0 * 2000.0 * max(length - self._along, 0.0))
            self._speed = min(self._speed + 2000.0 * seconds, fastest * self.override, left + 1e-3)
        self._along = min(self._along + self._speed * seconds, length)
        if self._along >= length / 2:
            self.halfway.pop(len(self.orders), lambda: None)()
        share = self._along / length if length else 1.0
        self.position = [a + way * share for a, way in zip(start, ways, strict=True)]
        if self._along >= length - 1e-6:
            self.position = [a + way for a, way in zip(start, ways, strict=True)]
            self._path = None
            self.done = identity if self.answering else self.done
        elif braking and self._speed == 0.0:
            self._path = None

    async def _tell(self):
        values = dict(zip("XYZ", self.position, strict=True))
        values |= {f"Motor{axis}": value + 0.001 for axis, value in values.items()}
        values |= {
            "Busy": self._path is not None or self.moves_by_itself,
            "Acknowledged": self.acknowledged, "Done": self.done, "Stopped": self.stopped,
            "Fault": self.fault, "FaultText": self.fault_text, "Ready": self.ready,
        }  # fmt: skip
        # One scan of the program: all of it has one time.
        now = datetime.now(timezone.utc)
        for name, value in values.items():
            kind = ua.VariantType[KINDS[name][1]]
            status = ua.StatusCode(ua.StatusCodes.BadSensorFailure if name == self.bad else 0)
            known = getattr(self, "_told", {})
            if known.get(name) == (value, status.value):
                continue
            self._told = known | {name: (value, status.value)}
            data = ua.DataValue(ua.Variant(value, kind), status, now, now)
            await self.nodes[name].write_value(data)
