"""The talk with a device that speaks in messages: commands, requests and replies, silence.

A device sends by itself, or answers requests, one at a time; either way it is never waited for.
What it says is given on message by message; that it says nothing is an error, once it has lasted.
"""

from collections import deque
from dataclasses import dataclass

from stepdiag_ros.devices.link import Link, LinkSettings
from stepdiag_ros.devices.link_framing import FramingSettings
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.refusal import Silent
from stepdiag_ros.metrology.units import NANOSECONDS

CONNECT_WITHIN = 20 * NANOSECONDS
"""ns after which a device that is not connected counts as not there; pyserial gives up before."""


@dataclass(frozen=True)
class TalkSettings:
    """How to talk with a device.

    Attributes:
        link: where it is.
        framing: of its messages.
        line_end: put after each command and request.
        start: sent when it is connected.
        stop: sent before the link is closed.
        zero: sent when its count is to be zeroed.
        requests: sent in turn, each when the one before is answered; none: it sends by itself.
        period: ns between two rounds of requests.
        silence: ns without any message, or without the answer to a request, that are allowed.
        echo: it repeats what it is sent; these messages are left out.
    """

    link: LinkSettings
    framing: FramingSettings
    line_end: bytes
    start: tuple[bytes, ...]
    stop: tuple[bytes, ...]
    zero: tuple[bytes, ...]
    requests: tuple[bytes, ...]
    period: int
    silence: int
    echo: bool

    @classmethod
    def from_section(cls, section: Section, rate: float) -> "TalkSettings":
        """Take the settings from ``connection``, ``framing`` and ``commands``.

        Args:
            section: settings of the device; other keys are left to the caller.
            rate: of the requests, Hz, where the settings state none.

        Raises:
            ValueError: a setting is wrong.
        """
        commands = section.section("commands")

        def sent(key: str) -> tuple[bytes, ...]:
            return tuple(_bytes(text, key, commands) for text in commands.texts(key, default=()))

        settings = cls(
            link=LinkSettings.from_section(section.section("connection")),
            framing=FramingSettings.from_section(section.section("framing")),
            line_end=_bytes(commands.text("line_end", default="\r\n"), "line_end", commands),
            start=sent("start"),
            stop=sent("stop"),
            zero=sent("zero"),
            requests=sent("request"),
            period=round(
                NANOSECONDS / commands.number("rate_hz", low=1e-3, high=1e4, default=rate)
            ),
            silence=round(
                NANOSECONDS * section.number("silence_s", low=0.01, high=86400.0, default=3.0)
            ),
            echo=commands.flag("echo", default=False),
        )
        commands.finish()
        return settings


class Talk:
    """A talk that goes on until ``close``.

    Args:
        settings: how to talk.
        time_ns: now.

    Raises:
        OSError: the device is not there.
    """

    def __init__(self, settings: TalkSettings, time_ns: int) -> None:
        self._settings = settings
        self._link = Link(settings.link)
        self._framing = settings.framing.make()
        self._waiting: deque[bytes] = deque()
        self._awaited: tuple[bytes, int] | None = None
        self._begun = False
        self._next_round = time_ns
        self._heard = time_ns

    @property
    def url(self) -> str:
        """Return where the device is."""
        return self._link.url

    def poll(self, time_ns: int) -> list[bytes]:
        """Return the messages that have come since the last call, in order.

        Raises:
            OSError: the link is broken, or the device has been silent for too long.
            ValueError: what comes has no end where there should be one.
        """
        data = self._link.receive()
        if not self._begun:
            self._begin(time_ns)
        messages = self._framing.take(data) if data else []
        if self._settings.echo:
            sent = {text.strip() for text in (*self._settings.requests, *self._settings.start)}
            messages = [message for message in messages if message.strip() not in sent]
        if messages:
            self._heard = time_ns
            self._awaited = None
        if self._begun:
            self._ask(time_ns)
            self._judge_silence(time_ns)
        return messages

    def zero(self) -> None:
        """Ask the device to zero its count.

        Raises:
            OSError: the link is broken.
        """
        self._send(self._settings.zero)

    def close(self) -> None:
        """End the talk; a broken link is closed all the same."""
        try:
            if self._begun:
                self._send(self._settings.stop)
        except OSError:
            pass
        finally:
            self._link.close()

    def _begin(self, time_ns: int) -> None:
        if not self._link.ready:
            if time_ns - self._heard > CONNECT_WITHIN:
                limit = CONNECT_WITHIN // NANOSECONDS
                raise TimeoutError(f"{self.url} does not accept a connection within {limit} s")
            return
        self._begun = True
        self._heard = self._next_round = time_ns
        self._send(self._settings.start)

    def _ask(self, time_ns: int) -> None:
        """Send the next request, if the last one is answered and the next one is due."""
        if self._awaited is not None or not self._settings.requests:
            return
        if not self._waiting:
            if time_ns < self._next_round:
                return
            self._waiting.extend(self._settings.requests)
            # What could not be asked in time is left out, not asked all at once.
            self._next_round = max(self._next_round + self._settings.period, time_ns)
        request = self._waiting.popleft()
        self._awaited = (request, time_ns)
        self._send((request,))

    def _judge_silence(self, time_ns: int) -> None:
        limit = self._settings.silence
        if self._awaited is not None:
            request, since = self._awaited
            if time_ns - since > limit:
                raise Silent(
                    f"{self.url} has not answered {request!r} within {limit / NANOSECONDS:g} s",
                    fault="silent",
                )
        elif not self._settings.requests and time_ns - self._heard > limit:
            raise Silent(
                f"{self.url} has sent nothing for {limit / NANOSECONDS:g} s", fault="silent"
            )

    def _send(self, commands: tuple[bytes, ...]) -> None:
        for command in commands:
            self._link.send(command + self._settings.line_end)


def _bytes(text: str, key: str, section: Section) -> bytes:
    try:
        return text.encode("latin-1")
    except UnicodeEncodeError:
        raise ValueError(f"{section.source}: '{key}' is {text!r}; expected bytes") from None
