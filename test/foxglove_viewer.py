"""A viewer that speaks the protocol of foxglove-sdk by a plain WebSocket client."""

import asyncio
import contextlib
import json
import struct
import threading
import time
from collections import defaultdict

import aiohttp
from patience import PATIENCE

PROTOCOL = "foxglove.sdk.v1"
MESSAGE, TIME, PLAYBACK_STATE = 1, 2, 5
"""Kinds of binary messages of the server."""
PLAYBACK_REQUEST = 3
"""Kind of a binary message of a viewer."""


class Viewer:
    """A viewer in a thread of its own; a context manager.

    Args:
        port: of the server.
        reads: or subscribes to what there is and then takes nothing until ``wake``.

    Attributes:
        info: what the server says of itself.
        channels: name of the topic → what was advertised.
        messages: name of the topic → (log time, bytes) as received.
        times: that were told, ns.
        states: of the playback, as (status, time, rate, did seek, request).
        complaints: status messages of the server.
    """

    def __init__(self, port, reads=True):
        self._url = f"http://127.0.0.1:{port}"
        self._reads = threading.Event()
        if reads:
            self._reads.set()
        self.info, self.channels, self.messages = {}, {}, defaultdict(list)
        self.times, self.states, self.complaints = [], [], []
        self._names, self._failure = {}, None
        self._advertised = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self):
        self._thread.start()
        assert self._advertised.wait(PATIENCE), self._failure
        assert self._failure is None
        return self

    def __exit__(self, *_):
        self._reads.set()
        # Where the server has ended first, so has the loop.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._task.cancel)
        self._thread.join(PATIENCE)

    def subscribe(self, *names):
        """Subscribe to topics; to all if none is named."""
        wanted = [self.channels[name]["id"] for name in names or self.channels]
        subscriptions = [{"id": number, "channelId": number} for number in wanted]
        self.say({"op": "subscribe", "subscriptions": subscriptions})

    def unsubscribe(self, name):
        self.say({"op": "unsubscribe", "subscriptionIds": [self.channels[name]["id"]]})

    def control(self, play, rate=1.0, seek=None, request="asked"):
        """Ask for another place, or another rate, of a recording."""
        head = struct.pack(
            "<BBfBQI", PLAYBACK_REQUEST, not play, rate, seek is not None, seek or 0, len(request)
        )
        self._send(self._socket.send_bytes(head + request.encode()))

    def say(self, text):
        self._send(self._socket.send_json(text))

    def wake(self):
        """Begin to read."""
        self._reads.set()

    def wait(self, condition, limit=PATIENCE, work=lambda: None):
        """Wait until a condition holds; ``work`` is called again and again meanwhile."""
        end = time.monotonic() + limit
        while not condition():
            assert time.monotonic() < end, f"not in {limit:g} s: {self._seen()}"
            work()
            time.sleep(0.005)

    def _seen(self):
        counts = {name: len(found) for name, found in self.messages.items()}
        return f"{counts}, states {self.states[-3:]}, {self.complaints}, {self._failure}"

    def _send(self, what):
        asyncio.run_coroutine_threadsafe(what, self._loop).result(PATIENCE)

    def _run(self):
        try:
            asyncio.run(self._talk())
        except (asyncio.CancelledError, OSError, aiohttp.ClientError) as error:
            self._failure = error
            self._advertised.set()

    async def _talk(self):
        self._loop, self._task = asyncio.get_running_loop(), asyncio.current_task()
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(self._url, protocols=[PROTOCOL], max_msg_size=0) as self._socket,
        ):
            while not self._advertised.is_set() or self._reads.is_set():
                await self._take(await self._socket.receive())
            while not self._reads.is_set():
                await asyncio.sleep(0.01)
            while True:
                await self._take(await self._socket.receive())

    async def _take(self, received):
        if received.type is aiohttp.WSMsgType.BINARY:
            self._take_binary(received.data)
        elif received.type is aiohttp.WSMsgType.TEXT:
            text = json.loads(received.data)
            if text["op"] == "serverInfo":
                self.info = text
            elif text["op"] == "advertise":
                self.channels |= {one["topic"]: one for one in text["channels"]}
                self._names |= {one["id"]: one["topic"] for one in text["channels"]}
                self._advertised.set()
            elif text["op"] == "status":
                self.complaints.append(text["message"])
        else:
            raise ConnectionError(f"the server said {received.type}")

    def _take_binary(self, data):
        if data[0] == MESSAGE:
            number, log_time = struct.unpack_from("<IQ", data, 1)
            self.messages[self._names[number]].append((log_time, data[13:]))
        elif data[0] == TIME:
            self.times.append(struct.unpack_from("<Q", data, 1)[0])
        elif data[0] == PLAYBACK_STATE:
            *state, length = struct.unpack_from("<BQfBI", data, 1)
            self.states.append((*state, data[19 : 19 + length].decode()))
