"""A connection by TCP that can be silent, as when a switch on the way has lost its power.

Nothing is lost by that: what was sent meanwhile arrives when the connection is there again.
"""

import asyncio
import threading
from contextlib import suppress

from patience import PATIENCE

LOOK_AGAIN = 0.005
"""s between two looks whether something may pass again."""


class Cable:
    """Passes on, in both directions, between whoever connects to it and a port of this computer.

    Args:
        port: to which it leads.

    Attributes:
        port: to connect to.
        silent: nothing passes while this is set; a test may do so at any time.
    """

    def __init__(self, port):
        self._leads_to = port
        self.silent = False
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        laid = asyncio.start_server(self._connect, "127.0.0.1", 0)
        self._server = asyncio.run_coroutine_threadsafe(laid, self._loop).result(PATIENCE)
        self.port = self._server.sockets[0].getsockname()[1]

    def close(self):
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result(PATIENCE)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(PATIENCE)

    async def _end(self):
        self._server.close()
        passing = asyncio.all_tasks() - {asyncio.current_task()}
        for task in passing:
            task.cancel()
        await asyncio.gather(*passing, return_exceptions=True)

    async def _connect(self, reader, writer):
        far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._leads_to)
        await asyncio.gather(self._pass(reader, far_writer), self._pass(far_reader, writer))

    async def _pass(self, source, sink):
        try:
            with suppress(ConnectionError):
                while data := await source.read(65536):
                    while self.silent:
                        await asyncio.sleep(LOOK_AGAIN)
                    sink.write(data)
                    await sink.drain()
        finally:
            sink.close()
