"""A session with an OPC UA server, in a thread of its own; nobody waits for it.

Source: OPC UA (IEC 62541) Part 4, Services: sessions, subscriptions, Read, Write, Call; by the
library asyncua, whose event loop is why there is a thread.
"""

import asyncio
import logging
import threading
import time
from collections import deque
from collections.abc import Coroutine, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

from stepdiag_ros.devices.cnc.opcua_settings import OpcUaSettings, Security
from stepdiag_ros.metrology.refusal import Lost

if TYPE_CHECKING:
    from asyncua import Client, Node

REQUEST_LIMIT = 2.0
"""s in which the server answers a request, at least."""
AFTER_SILENCE = 1.0
"""s by which a request may take longer than the silence at which the driver gives up the PLC."""
CLOSING = 1.0
"""s for closing the session in the background."""


@dataclass(frozen=True)
class Value:
    """A value of a node.

    Attributes:
        name: our name of the node.
        value: it has.
        heard: time of arrival, by ``time.monotonic_ns``.
        source: when the server says that it was sampled, ns since 1970; None if it does not say.
        asked: when it was asked for, by ``time.monotonic_ns``; None if it came by subscription.
    """

    name: str
    value: Any
    heard: int
    source: int | None
    asked: int | None


@dataclass(frozen=True)
class Finished:
    """A request has ended.

    Attributes:
        request: what it was called when it was made.
        failure: why it failed; empty if it did not.
        result: of a method.
    """

    request: str
    failure: str
    result: Any = None


class OpcUaSession:
    """Connects, subscribes, and carries out requests, each in the order in which they were made.

    Args:
        settings: of the driver.

    Attributes:
        open: connected, and every node found.
    """

    def __init__(self, settings: OpcUaSettings) -> None:
        self.open = False
        self._settings = settings
        # Whoever set a longer silence has a slow network: no request may fail before.
        self._limit = max(REQUEST_LIMIT, settings.silence + AFTER_SILENCE)
        self._news: deque[Value | Finished] = deque()
        self._failure = ""
        self._halted = False
        self._loop = asyncio.new_event_loop()
        self._client: Client | None = None
        self._nodes: dict[str, Node] = {}
        self._types: dict[str, Any] = {}
        self._order: asyncio.Lock | None = None
        self._thread = threading.Thread(target=self._run, daemon=True, name=settings.url)
        self._thread.start()

    def news(self) -> list[Value | Finished]:
        """Return what has come since the last time.

        Raises:
            OSError: the connection cannot be made, or is lost.
        """
        if self._failure:
            raise Lost(self._failure, fault="lost")
        taken = []
        while self._news:
            taken.append(self._news.popleft())
        return taken

    def write(self, request: str, *steps: Sequence[tuple[str, Any]]) -> None:
        """Write values to nodes; each step only after the one before has been answered."""
        self._submit(request, self._write(steps))

    def order(self, *steps: Sequence[tuple[str, Any]]) -> None:
        """Write an order, unless it is halted before its last step."""
        self._submit("order", self._write(steps, order=True))

    def call(self, arguments: Sequence[Any]) -> None:
        """Give an order by the method, unless it is halted before."""
        self._submit("order", self._call(arguments))

    def count(self, number: int) -> None:
        """Write the watchdog, whatever else is on its way."""
        self._submit("count", self._write([[("watchdog", number)]]), ordered=False)

    def halt(self) -> None:
        """Write the stop, before all that waits; no order is given until ``resume``."""
        self._halted = True
        self._submit("stop", self._write([[("stop", True)]]), ordered=False)

    def resume(self) -> None:
        """Take the stop back, then write the reset; orders are given again."""
        self._halted = False
        self._submit("reset", self._write([[("stop", False)], [("reset", True)]]))

    def read(self, request: str, names: Sequence[str]) -> None:
        """Read nodes; the values come as news."""
        self._submit(request, self._read(names), ordered=False)

    def close(self) -> None:
        """End the session, in the background."""
        with suppress(RuntimeError):
            # It is closed already where the connection was lost.
            self._loop.call_soon_threadsafe(lambda: self._loop.create_task(self._end()))

    # In the thread --------------------------------------------------------------------------------

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._order = asyncio.Lock()
        self._loop.create_task(self._connect())
        self._loop.run_forever()
        self._loop.close()

    async def _connect(self) -> None:
        settings = self._settings
        try:
            await asyncio.wait_for(self._establish(), settings.start_limit)
        except asyncio.TimeoutError:
            self._failure = f"{settings.url} has not answered in {settings.start_limit:g} s"
        except Exception as error:
            # The library raises its own errors, those of sockets, and of certificates.
            self._failure = f"cannot connect to {settings.url}: {_words(error)}"

    async def _establish(self) -> None:
        from asyncua import Client, ua

        # What fails is told by the driver, in one sentence.
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        settings = self._settings
        # The library looks itself whether the server is there, and would give it up after 1 s.
        client = self._client = Client(
            settings.url, timeout=self._limit, watchdog_intervall=self._limit
        )
        client.application_uri = settings.security.application_uri
        client.connection_lost_callback = self._on_lost
        await _secure(client, settings.security)
        await client.connect()
        for name, text in settings.nodes.items():
            self._nodes[name] = await self._found(client, name, text)
        for name, node in self._nodes.items():
            if name not in ("object", "method"):
                try:
                    self._types[name] = await node.read_data_type_as_variant_type()
                except ua.UaError as error:
                    raise ConnectionError(f"the node of '{name}': {_words(error)}") from error
        watched = settings.watched
        names = {self._nodes[name].nodeid: name for name in watched}
        subscription = await client.create_subscription(
            settings.interval * 1e3, _Handler(self._news, names)
        )
        await subscription.subscribe_data_change(
            [self._nodes[name] for name in watched],
            # Every change between two publications, not only the last.
            queuesize=100,
            sampling_interval=settings.interval * 1e3,
        )
        self.open = True

    async def _found(self, client: "Client", name: str, text: str) -> "Node":
        from asyncua import ua

        try:
            if text.startswith("/"):
                return await client.nodes.root.get_child(text.strip("/").split("/"))
            if text.startswith("nsu="):
                uri, _, rest = text[4:].partition(";")
                text = f"ns={await client.get_namespace_index(uri)};{rest}"
            node = client.get_node(text)
            await node.read_browse_name()
            return node
        except (ua.UaError, ValueError) as error:
            raise ConnectionError(
                f"there is no node '{text}' for '{name}' ({_words(error)})"
            ) from (error)

    async def _on_lost(self, error: Exception) -> None:
        self._failure = f"the connection to {self._settings.url} is lost: {_words(error)}"
        # The library would try to publish for ever.
        self._loop.call_soon(lambda: self._loop.create_task(self._end()))

    def _submit(
        self, request: str, work: Coroutine[Any, Any, Any], *, ordered: bool = True
    ) -> None:
        if self._failure:
            work.close()
            raise ConnectionError(self._failure)
        asyncio.run_coroutine_threadsafe(self._finish(request, work, ordered), self._loop)

    async def _finish(self, request: str, work: Coroutine[Any, Any, Any], ordered: bool) -> None:
        try:
            if ordered:
                assert self._order is not None
                async with self._order:
                    result = await asyncio.wait_for(work, self._limit)
            else:
                result = await asyncio.wait_for(work, self._limit)
            self._news.append(Finished(request, "", result))
        except Exception as error:
            self._news.append(Finished(request, _words(error)))

    async def _write(
        self, steps: Sequence[Sequence[tuple[str, Any]]], *, order: bool = False
    ) -> None:
        from asyncua import ua

        assert self._client is not None
        for step in steps:
            if order and self._halted:
                return
            values = [
                ua.DataValue(ua.Variant(_fitting(value, self._types[name]), self._types[name]))
                for name, value in step
            ]
            await self._client.write_values([self._nodes[name] for name, _ in step], values)

    async def _call(self, arguments: Sequence[Any]) -> Any:
        from asyncua import ua

        if self._halted:
            return None
        given = []
        for value in arguments:
            kind = {bool: ua.VariantType.Boolean, int: ua.VariantType.UInt32}.get(
                type(value), ua.VariantType.Double
            )
            kind = ua.VariantType.String if isinstance(value, str) else kind
            given.append(ua.Variant(value, kind))
        return await self._nodes["object"].call_method(self._nodes["method"], *given)

    async def _read(self, names: Sequence[str]) -> None:
        from asyncua import ua

        assert self._client is not None
        asked = time.monotonic_ns()
        found = await self._client.read_attributes(
            [self._nodes[name] for name in names], ua.AttributeIds.Value
        )
        heard = time.monotonic_ns()
        for name, value in zip(names, found, strict=True):
            if not value.StatusCode.is_good():
                raise ConnectionError(f"the value of '{name}' is bad: {value.StatusCode.name}")
            self._news.append(
                Value(name, value.Value.Value, heard, _nanoseconds(value.SourceTimestamp), asked)
            )

    async def _end(self) -> None:
        if self._client is not None:
            with suppress(Exception):
                await asyncio.wait_for(self._client.disconnect(), CLOSING)
        for task in asyncio.all_tasks(self._loop):
            if task is not asyncio.current_task():
                task.cancel()
        self._loop.call_soon(self._loop.stop)


class _Handler:
    """Takes the changes that a subscription brings."""

    def __init__(self, news: "deque[Value | Finished]", names: dict[Any, str]) -> None:
        self._news, self._names = news, names

    def datachange_notification(self, node: "Node", value: Any, data: Any) -> None:
        told = data.monitored_item.Value
        name = self._names[node.nodeid]
        if not told.StatusCode.is_good():
            failure = f"the value of '{name}' is bad: {told.StatusCode.name}"
            self._news.append(Finished("subscription", failure))
            return
        source = _nanoseconds(told.SourceTimestamp)
        self._news.append(Value(name, value, time.monotonic_ns(), source, None))


async def _secure(client: "Client", security: Security) -> None:
    if security.user:
        client.set_user(security.user)
        client.set_password(security.password)
    if security.policy == "none":
        return
    from asyncua import ua
    from asyncua.crypto import security_policies

    policy = getattr(security_policies, f"SecurityPolicy{security.policy}")
    await client.set_security(
        policy,
        certificate=security.certificate,
        private_key=security.private_key,
        server_certificate=security.server_certificate or None,
        mode=getattr(ua.MessageSecurityMode, security.mode),
    )


def _fitting(value: Any, kind: Any) -> Any:
    """Return a value as a node of some type takes it."""
    name = kind.name
    if name == "Boolean":
        return bool(value)
    if name in ("Float", "Double"):
        return float(value)
    return str(value) if name == "String" else round(value)


def _nanoseconds(stamp: datetime | None) -> int | None:
    if stamp is None:
        return None
    aware = stamp if stamp.tzinfo else stamp.replace(tzinfo=timezone.utc)
    since = aware - datetime(1970, 1, 1, tzinfo=timezone.utc)
    return ((since.days * 86400 + since.seconds) * 1_000_000 + since.microseconds) * 1000


def _words(error: BaseException) -> str:
    text = str(error).strip().rstrip(".")
    # Two classes up to Python 3.10.
    if not text and isinstance(error, asyncio.TimeoutError | TimeoutError):
        return "no answer in time"
    return text or type(error).__name__
