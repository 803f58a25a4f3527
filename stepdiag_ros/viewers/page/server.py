"""Serves the page and the state to browsers, in a thread and an event loop of its own.

A viewer gets all sections when it comes, and then those that have changed, at most ``RATE`` times a
second. It says of each update that it has taken it, and only then gets the next, with what is the
newest by then: a slow viewer skips what is old, and nothing piles up for it anywhere. Who takes
nothing for ``STALL_LIMIT``, or talks more than that, is cut off; so is who connects and asks for
nothing. No viewer is ever waited for by a node or another viewer.
"""

import asyncio
import json
import logging
import os
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import dataclass
from importlib import resources
from typing import TYPE_CHECKING, Any

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.text.intake import parse_json
from stepdiag_ros.text.sparing import Handler, Sparing
from stepdiag_ros.viewers.page.access import PageAccess
from stepdiag_ros.viewers.page.control import ACTIONS, Ask, RequestAnswer
from stepdiag_ros.viewers.page.state import PageState

if TYPE_CHECKING:
    from aiohttp import web

RATE = 20.0
"""Updates of a viewer in a second, at most."""
BEAT = 1.0
"""Real seconds after which a viewer gets an update though nothing has changed."""
STALL_LIMIT = 5.0
"""Real seconds after which a viewer that has not taken an update is cut off."""
TOKEN_LIMIT = 5.0
"""Real seconds that a viewer has to show its token."""
ANSWER_LIMIT = 8.0
"""Real seconds that a request for control may take."""
MOST_VIEWERS = 32
"""Viewers at the same time; more are turned away."""
MOST_CONNECTIONS = 128
"""Connections at the same time, of viewers and of who has not asked for anything yet."""
REQUEST_LIMIT = 5.0
"""Real seconds within which who has connected must have asked for something."""
MOST_SURPLUS = 20
"""Messages of a viewer in a row that do not answer an update."""
START_LIMIT = 60.0
"""Real seconds in which the server must have begun, or ended."""
CLOSING = 1.0
"""Real seconds that viewers have to go when the server ends."""
_LONGEST_MESSAGE = 4096
_TOKEN_HEADER = "X-Stepdiag-Token"
_PAGE = {
    "": ("index.html", "text/html"),
    "style.css": ("style.css", "text/css"),
    "main.js": ("main.js", "text/javascript"),
    "sections.js": ("sections.js", "text/javascript"),
    "charts.js": ("charts.js", "text/javascript"),
    "volume.js": ("volume.js", "text/javascript"),
    "uPlot.iife.min.js": ("uPlot.iife.min.js", "text/javascript"),
    "uPlot.min.css": ("uPlot.min.css", "text/css"),
    "uPlot.LICENSE.txt": ("uPlot.LICENSE.txt", "text/plain"),
}
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}


@dataclass(frozen=True)
class Offer:
    """What is served.

    Attributes:
        state: of the run.
        access: who may see and control it.
        source: what the page says that it shows: ``run``, or ``replay`` of a bag.
        title: in words, such as the name of the bag.
        ask: for control; None where there is nothing to control.
        log: called with a sentence on each request for control and each refused client.
    """

    state: PageState
    access: PageAccess
    source: str
    title: str
    ask: Ask | None
    log: Callable[[str], None]


class MonitorServer:
    """The server; ``start`` and ``close`` are called from another thread than it runs in.

    Args:
        offer: what is served.
        port: 0 for any that is free.
    """

    def __init__(self, offer: Offer, port: int) -> None:
        self._offer = offer
        self._wanted_port = port
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._end: asyncio.Event | None = None
        self._refused = Sparing(offer.log)
        # Connections on which something was asked for.
        self._asked: set[Any] = set()
        self._viewing: set[web.WebSocketResponse] = set()
        self.port = 0
        self.viewers = 0
        self._files = _read_page()

    @property
    def url(self) -> str:
        """Return where the page is, without the token."""
        address = self._offer.access.address
        host = f"[{address}]" if ":" in address else address
        return f"http://{host}:{self.port}/"

    @property
    def url_with_token(self) -> str:
        """Return the same with the token; it stands behind a #, which browsers do not send."""
        return f"{self.url}#token={self._offer.access.token}"

    def start(self) -> None:
        """Begin to serve.

        Raises:
            ValueError: the address or the port cannot be had, or aiohttp is not installed.
        """
        try:
            import aiohttp.web  # noqa: F401 - here, so that the thread has nothing to import
        except ImportError:
            raise ValueError("the page needs aiohttp: pip install aiohttp") from None
        begun: Future[int] = Future()
        self._thread = threading.Thread(target=self._run, args=(begun,), name="monitor page")
        self._thread.daemon = True
        self._thread.start()
        try:
            self.port = begun.result(START_LIMIT)
        except FutureTimeout:
            raise ValueError(f"the page's server did not start in {START_LIMIT:g} s") from None
        except OSError as error:
            where = f"{self._offer.access.address} port {self._wanted_port}"
            # What asyncio says instead repeats the address as Python writes it.
            code = error.errno or 0
            said = os.strerror(code) if code > 0 else error.strerror or error
            raise Refusal(
                f"the page cannot be served on {where}: {said}; choose another port (--port,"
                " parameter port), or 0 for any that is free",
                fault="busy",
            ) from None

    def close(self) -> None:
        """End all viewers and the thread; harmless if it was never started."""
        if self._loop is not None and self._end is not None:
            try:
                self._loop.call_soon_threadsafe(self._end.set)
            except RuntimeError:
                return
        if self._thread is not None:
            self._thread.join(START_LIMIT)

    # In the server's thread ----------------------------------------------------------------------

    def _run(self, begun: "Future[int]") -> None:
        try:
            asyncio.run(self._serve(begun))
        except Exception as error:
            if begun.done():
                raise
            begun.set_exception(error)

    async def _serve(self, begun: "Future[int]") -> None:
        from aiohttp import WSCloseCode, web

        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        application = web.Application(middlewares=[self._guard], client_max_size=_LONGEST_MESSAGE)
        application.router.add_get("/live", self._live)
        application.router.add_post("/control/{action}", self._control)
        application.router.add_get("/{name:[A-Za-z.]*}", self._file)
        logger = logging.Logger("page")
        logger.addHandler(Handler(self._refused, "the page"))
        runner = web.AppRunner(application, access_log=None, logger=logger)
        await runner.setup()
        served = runner.server
        assert served is not None
        place = self._offer.access.address, self._wanted_port
        try:
            door = await self._loop.create_server(lambda: self._let_in(served), *place)
            begun.set_result(door.sockets[0].getsockname()[1])
            looking = asyncio.ensure_future(self._turn_out(served))
            await self._end.wait()
            looking.cancel()
            door.close()
            await asyncio.gather(
                *(one.close(code=WSCloseCode.GOING_AWAY) for one in self._viewing),
                return_exceptions=True,
            )
            await served.shutdown(CLOSING)
        finally:
            await runner.cleanup()

    def _let_in(self, served: "web.Server") -> asyncio.Protocol:
        """Return who talks to a client that has just connected."""
        if len(served.connections) < MOST_CONNECTIONS:
            return served()
        self._refused(f"more than {MOST_CONNECTIONS} connections: another one is refused")
        return _Refusal()

    async def _turn_out(self, served: "web.Server") -> None:
        """Cut off, again and again, who has connected and asks for nothing."""
        since: dict[Any, float] = {}
        while True:
            now = asyncio.get_running_loop().time()
            self._asked.intersection_update(served.connections)
            silent = [one for one in served.connections if one not in self._asked]
            since = {one: since.get(one, now) for one in silent}
            for connection, first in since.items():
                if now - first > REQUEST_LIMIT and connection.transport is not None:
                    self._refused(f"who connected asked for nothing in {REQUEST_LIMIT:g} s")
                    connection.transport.abort()
            await asyncio.sleep(1.0)

    @property
    def _guard(self) -> Any:
        """Return what turns away requests that another site has brought about."""
        from aiohttp import web

        access = self._offer.access

        @web.middleware
        async def guard(
            request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
        ) -> web.StreamResponse:
            self._asked.add(request.protocol)
            host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
            if access.refuses_host(host) or access.refuses_origin(origin, host):
                self._refused(f"a request from {request.remote} to {host!r} was refused")
                raise web.HTTPForbidden(text="this page is not served under that name")
            return await handler(request)

        return guard

    async def _file(self, request: "web.Request") -> "web.Response":
        from aiohttp import web

        found = self._files.get(request.match_info["name"])
        if found is None:
            raise web.HTTPNotFound
        body, kind = found
        return web.Response(body=body, content_type=kind, charset="utf-8", headers=_HEADERS)

    async def _control(self, request: "web.Request") -> "web.Response":
        from aiohttp import web

        offer, action = self._offer, request.match_info["action"]
        if action not in ACTIONS:
            raise web.HTTPNotFound
        if not offer.access.knows(request.headers.get(_TOKEN_HEADER, "")):
            self._refused(f"{request.remote} asked to {action} without the token: refused")
            return _told(RequestAnswer(False, "control needs the token"), 403)
        if offer.ask is None:
            return _told(RequestAnswer(False, "a recording cannot be controlled"), 409)
        offer.log(f"{request.remote} asks to {action} the run")
        try:
            waited = asyncio.wrap_future(offer.ask(action))
            answer = await asyncio.wait_for(waited, ANSWER_LIMIT)
        except asyncio.TimeoutError:
            text = f"nobody has answered; whether {action} was done is not known: see the state"
            answer = RequestAnswer(False, text)
        offer.log(f"{request.remote} asked to {action} the run: {answer.text}")
        return _told(answer, 200 if answer.done else 409)

    async def _live(self, request: "web.Request") -> "web.StreamResponse":
        from aiohttp import web

        if request.headers.get("Upgrade", "").lower() != "websocket":
            raise web.HTTPUpgradeRequired
        if self.viewers >= MOST_VIEWERS:
            raise web.HTTPServiceUnavailable(text="too many viewers")
        socket = web.WebSocketResponse(max_msg_size=_LONGEST_MESSAGE, timeout=1.0)
        self.viewers += 1
        try:
            await socket.prepare(request)
            self._viewing.add(socket)
            await self._show(request, socket)
        finally:
            self._viewing.discard(socket)
            self.viewers -= 1
        return socket

    async def _show(self, request: "web.Request", socket: "web.WebSocketResponse") -> None:
        """Send updates until the viewer goes or stalls."""
        offer = self._offer
        try:
            text = await asyncio.wait_for(socket.receive_str(), TOKEN_LIMIT)
            first = parse_json(text, "what the page has sent")
            token = str(first.get("token", "")) if isinstance(first, dict) else ""
        except (asyncio.TimeoutError, TypeError, ValueError) as error:
            why = str(error) if isinstance(error, ValueError) else "it sent no text in time"
            self._refused(
                f"{request.remote} does not follow the protocol of the page, connection"
                f" closed: {why}"
            )
            await socket.close()
            return
        if not offer.access.may_view(token):
            self._refused(f"{request.remote} wanted to look on without the token: refused")
            await socket.send_str(json.dumps({"refused": "this page needs the token"}))
            await socket.close()
            return
        controls = offer.ask is not None and offer.access.knows(token)
        hello = {"source": offer.source, "title": offer.title, "controls": controls}
        taken = asyncio.Event()
        listening = asyncio.ensure_future(_listen(socket, taken))
        try:
            await self._updates(socket, taken, listening, json.dumps(hello))
        except (asyncio.TimeoutError, ConnectionError, _TooTalkative) as error:
            if isinstance(error, _TooTalkative):
                self._refused(f"{request.remote} talks too much, and is cut off")
            # Closing in order would wait for the viewer, which does not listen.
            if request.transport is not None and not socket.closed:
                request.transport.abort()
        finally:
            listening.cancel()

    async def _updates(
        self,
        socket: "web.WebSocketResponse",
        taken: asyncio.Event,
        listening: "asyncio.Future[None]",
        hello: str,
    ) -> None:
        state, known, number, quiet = self._offer.state, 0, 0, 0.0
        while not listening.done():
            if state.revision != known or quiet >= BEAT:
                known, sections = state.update(known)
                number, quiet = number + 1, 0.0
                text = f'{{"number":{number},"hello":{hello},"sections":{sections}}}'
                taken.clear()
                await asyncio.wait_for(socket.send_str(text), STALL_LIMIT)
                await asyncio.wait_for(taken.wait(), STALL_LIMIT)
            await asyncio.sleep(1.0 / RATE)
            quiet += 1.0 / RATE
        listening.result()


class _TooTalkative(Exception):
    """A viewer sends more than answers to updates."""


class _Refusal(asyncio.Protocol):
    """Lets a client go as soon as it has come."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport.close()


async def _listen(socket: "web.WebSocketResponse", taken: asyncio.Event) -> None:
    """Take note of what the viewer has taken, until it goes.

    Raises:
        _TooTalkative: it sends far more than that.
    """
    surplus = 0
    try:
        async for _ in socket:
            surplus = surplus + 1 if taken.is_set() else 0
            if surplus > MOST_SURPLUS:
                raise _TooTalkative
            taken.set()
    finally:
        # Whoever waits for it is to see that it has gone.
        taken.set()


def _told(answer: RequestAnswer, status: int) -> "web.Response":
    from aiohttp import web

    return web.json_response({"done": answer.done, "text": answer.text}, status=status)


def _read_page() -> dict[str, tuple[bytes, str]]:
    folder = resources.files("stepdiag_ros.viewers.page").joinpath("static")
    return {
        name: (folder.joinpath(file).read_bytes(), kind) for name, (file, kind) in _PAGE.items()
    }
