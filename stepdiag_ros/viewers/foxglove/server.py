"""Serves messages as they are, CDR bytes with their ros2msg schema, to viewers such as Foxglove.

The protocol is that of ``foxglove-sdk`` (``foxglove.sdk.v1``), which runs the server in threads of
its own. A viewer takes part in nothing: it cannot publish, call services or set parameters.

Of a viewer that does not read, the library drops the oldest messages beyond ``BACKLOG``; nobody
waits for it. A message that holds until the next (``Qos.repeated``) is sent to each viewer once,
and to one that comes late when it subscribes.
"""

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from stepdiag_ros.bags.writer import MESSAGE_ENCODING, SCHEMA_ENCODING
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.text.sparing import Handler, Sparing
from stepdiag_ros.topics import RUN_DESCRIPTION, Topic
from stepdiag_ros.viewers.foxglove.holding import Holding
from stepdiag_ros.viewers.page.access import is_loopback

if TYPE_CHECKING:
    from foxglove import Channel
    from foxglove.websocket import (
        ChannelView,
        Client,
        PlaybackControlRequest,
        PlaybackState,
        WebSocketServer,
    )

INSTALL = "foxglove-sdk is not installed: pip install 'stepdiag_ros[foxglove]'"
BACKLOG = 4096
"""Messages that wait for a slow viewer; the oldest are dropped beyond."""
DEFAULT_PORT = 8765
"""That Foxglove asks for first."""
_LOGGER = "foxglove"
"""Under which the library logs."""

Decode = Callable[[bytes], Any]


@dataclass(frozen=True)
class ServedPlace:
    """Where viewers are served, and who may come.

    Attributes:
        address: to bind to.
        port: 0 for any that is free.
        open_to_network: viewers on other computers are wanted.

    Raises:
        ValueError: others can reach the address, and are not said to be wanted.
    """

    address: str = "127.0.0.1"
    port: int = DEFAULT_PORT
    open_to_network: bool = False

    def __post_init__(self) -> None:
        if not self.is_local and not self.open_to_network:
            raise Refusal(
                f"other computers can reach the address '{self.address}', and everyone there"
                " could view the run, because viewers do not log in. If you want that, set"
                " open_to_network too; otherwise stay on 127.0.0.1 and use ssh -L",
                fault="exposed",
            )

    @property
    def is_local(self) -> bool:
        """Say whether nobody but this computer can reach the address."""
        return is_loopback(self.address)


@dataclass(frozen=True)
class Playing:
    """Where the playing of a recording is.

    Attributes:
        goes_on: or is paused.
        ended: all of it was played.
        time: that it has come to, ns.
        rate: recorded seconds in a real second.
        bound: it has just gone there at one bound, so that what viewers show holds no more.
    """

    goes_on: bool
    ended: bool
    time: int
    rate: float
    bound: bool = False


@dataclass(frozen=True)
class Wish:
    """How a viewer wants a recording to be played.

    Attributes:
        goes_on: or is paused.
        rate: recorded seconds in a real second; may be anything.
        goal: time to go to, ns; may be anything. None: on from where it is.
    """

    goes_on: bool
    rate: float
    goal: int | None


Answer = Callable[[Wish], Playing]


@dataclass(frozen=True)
class Playback:
    """What viewers may do with a recording.

    Attributes:
        begin: of its time, ns.
        end: ns.
        answer: is asked, in a thread of the library, where the playing will be by a viewer's wish.
    """

    begin: int
    end: int
    answer: Answer


@dataclass
class _Feed:
    """One topic: its channel, its viewers, and the messages that hold on it."""

    topic: Topic | None
    channel: "Channel"
    decode: Decode
    holding: Holding | None
    viewers: list[int] = field(default_factory=list)


class FoxgloveServer:
    """The server. Everything is called from one thread; only ``log`` is called from others too.

    Args:
        title: that viewers show.
        place: where.
        log: called with a sentence on each refused client.
        playback: of a recording; None where things happen now.
    """

    def __init__(
        self,
        title: str,
        place: ServedPlace,
        log: Callable[[str], None],
        playback: Playback | None = None,
    ) -> None:
        try:
            import foxglove
        except ImportError:
            raise Refusal(INSTALL, fault="not_installed") from None
        self._title = title
        self._place = place
        self._playback = playback
        self._context = foxglove.Context()
        self._feeds: dict[str, _Feed] = {}
        self._listener = _Listener(playback)
        self._server: WebSocketServer | None = None
        self._log_handler = Handler(Sparing(log), "Foxglove")

    def offer(
        self, name: str, type_name: str, schema: str, decode: Decode, topic: Topic | None
    ) -> None:
        """Offer a topic to viewers.

        Args:
            name: in full.
            type_name: such as ``stepdiag_ros/msg/RunState``.
            schema: its ``ros2msg`` text.
            decode: makes an object of a message's bytes.
            topic: which it is; None for one from outside the suite.
        """
        from foxglove import Channel, Schema

        self._feeds[name] = _Feed(
            topic=topic,
            channel=Channel(
                name,
                message_encoding=MESSAGE_ENCODING,
                schema=Schema(name=type_name, encoding=SCHEMA_ENCODING, data=schema.encode()),
                context=self._context,
            ),
            decode=decode,
            holding=Holding(topic) if topic is not None and topic.qos.repeated else None,
        )

    def start(self) -> None:
        """Begin to serve.

        Raises:
            ValueError: the address or the port cannot be had.
        """
        import foxglove
        from foxglove.websocket import Capability

        logger = logging.getLogger(_LOGGER)
        logger.addHandler(self._log_handler)
        logger.propagate = False
        place, playback = self._place, self._playback
        listener: Any = self._listener  # has what the library asks of a listener that looks on
        try:
            self._server = foxglove.start_server(
                name=self._title,
                host=place.address,
                port=place.port,
                capabilities=[Capability.Time],
                server_listener=listener,
                context=self._context,
                playback_time_range=None if playback is None else (playback.begin, playback.end),
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:
            reason = str(error).removeprefix("FoxgloveError: ").removeprefix("Failed to bind port:")
            raise Refusal(
                f"viewers cannot be served on {place.address} port {place.port}: {reason.strip()};"
                " choose another port (--port, parameter port), or 0 for any that is free",
                fault="busy",
            ) from None

    def close(self) -> None:
        """Let the viewers go; harmless if it was never started."""
        server, self._server = self._server, None
        if server is not None:
            server.stop()
        logging.getLogger(_LOGGER).removeHandler(self._log_handler)

    @property
    def url(self) -> str:
        """Return what viewers connect to."""
        address = self._place.address
        host = f"[{address}]" if ":" in address else address
        return f"ws://{host}:{0 if self._server is None else self._server.port}"

    def viewers(self, name: str) -> int:
        """Return how many viewers subscribe to this topic."""
        return len(self._feeds[name].viewers)

    @property
    def has_viewers(self) -> bool:
        """Return whether a viewer subscribes to any topic."""
        return any(feed.viewers for feed in self._feeds.values())

    def work(self) -> bool:
        """Take up viewers that have come and gone since; send new ones the messages that hold.

        Returns:
            Whether somebody has come.
        """
        somebody = False
        for (viewer, name), (went, came) in self._listener.news().items():
            feed = self._feeds[name]
            if went:
                feed.viewers = [one for one in feed.viewers if one != viewer]
            if came and viewer not in feed.viewers:
                feed.viewers.append(viewer)
                somebody = True
                if feed.holding is not None:
                    for data, time in feed.holding.messages:
                        feed.channel.log(data, log_time=time, sink_id=viewer)
        return somebody

    def send(self, name: str, data: bytes, time: int) -> None:
        """Send a message to the viewers of its topic.

        Args:
            name: of the topic, in full.
            data: CDR bytes.
            time: at which it was received, ns.

        Raises:
            ValueError: it is one that holds, and its bytes are not a message of the type.
        """
        feed = self._feeds[name]
        if feed.holding is None:
            feed.channel.log(data, log_time=time)
            return
        self.hold(name, data, time)
        # One by one: a viewer of which ``work`` does not know yet is sent it there.
        for viewer in feed.viewers:
            feed.channel.log(data, log_time=time, sink_id=viewer)

    def hold(self, name: str, data: bytes, time: int) -> None:
        """Take note of what holds without sending it; see ``send``."""
        feed = self._feeds[name]
        if feed.holding is None:
            return
        message = feed.decode(data)
        feed.holding.said(message, data, time)
        if feed.topic is RUN_DESCRIPTION:
            for other in self._feeds.values():
                if other.holding is not None:
                    other.holding.begin_run(message.run_id)

    def begin_anew(self) -> None:
        """Forget what holds: time goes to another place of a recording."""
        for feed in self._feeds.values():
            if feed.holding is not None:
                feed.holding.forget()

    def say_what_holds(self) -> None:
        """Send what holds to every viewer again, after time went elsewhere."""
        for feed in self._feeds.values():
            for data, time in feed.holding.messages if feed.holding is not None else ():
                for viewer in feed.viewers:
                    feed.channel.log(data, log_time=time, sink_id=viewer)

    def tell_time(self, time: int) -> None:
        """Send the time to all viewers, ns."""
        if self._server is not None:
            self._server.broadcast_time(time)

    def tell_playback(self, at: Playing) -> None:
        """Send the position in the played recording to all viewers."""
        if self._server is not None:
            self._server.broadcast_playback_state(_state(at, ""))


class _Listener:
    """Takes note, in the library's threads, of what viewers ask for (``foxglove.ServerListener``).

    However often a viewer comes and goes, only where it is in the end counts. ``Client.id`` is also
    the number by which the library sends to that viewer alone: it counts viewers and their outlets
    alike, from 1 on, and nothing else in this process has an outlet. Newer versions have a name for
    it.
    """

    def __init__(self, playback: Playback | None) -> None:
        self._lock = threading.Lock()
        self._news: dict[tuple[int, str], tuple[bool, bool]] = {}
        self._playback = playback

    def news(self) -> dict[tuple[int, str], tuple[bool, bool]]:
        """Return what is new since the last call: (viewer, topic) → (it went, it came last)."""
        with self._lock:
            news, self._news = self._news, {}
        return news

    def on_subscribe(self, client: "Client", channel: "ChannelView") -> None:
        key = _outlet(client), channel.topic
        with self._lock:
            went, _ = self._news.get(key, (False, True))
            self._news[key] = (went, True)

    def on_unsubscribe(self, client: "Client", channel: "ChannelView") -> None:
        with self._lock:
            self._news[_outlet(client), channel.topic] = (True, False)

    def on_playback_control_request(
        self, request: "PlaybackControlRequest"
    ) -> "PlaybackState | None":
        if self._playback is None:
            return None
        goes_on = request.playback_command.name == "Play"
        wish = Wish(goes_on, request.playback_speed, request.seek_time)
        return _state(self._playback.answer(wish), request.request_id)


def _state(at: Playing, request: str) -> "PlaybackState":
    from foxglove.websocket import PlaybackState, PlaybackStatus

    status = PlaybackStatus.Playing if at.goes_on else PlaybackStatus.Paused
    status = PlaybackStatus.Ended if at.ended else status
    return PlaybackState(status, at.time, at.rate, at.bound, request or None)


def _outlet(client: "Client") -> int:
    return int(getattr(client, "sink_id", client.id))
