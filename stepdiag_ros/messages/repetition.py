"""Descriptions, states, lines and results are repeated slowly; receivers drop repetitions.

A monitor that joins late over a bridge (rosbridge, Foxglove, Zenoh) subscribes volatile: what was
published before it came is never sent to it. So the publisher of such a message repeats
it, the same bytes with the same stamp, and a subscriber drops what it has received already. No ROS
client
here: publishers and subscriptions (``nodes/links.py``) and bags (``bags/repetitions.py``) share it.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from hashlib import blake2b
from typing import Any

from stepdiag_ros.topics import Topic

REPEAT_PERIOD = 5.0
"""Real seconds after which a message that still holds is repeated."""
_REMEMBERED = 20_000
"""Messages of a topic that are known again; more than a run has lines, results or states in an
hour, and far less memory than the messages."""


@dataclass
class _Said:
    data: bytes
    time: float


class Repeater:
    """Messages of one publisher that still hold, so that it can repeat them.

    Of a topic the newest message holds, or the newest of each kind that ``Topic.newest_of_each``
    distinguishes. A message about another run than the newest message no longer holds.

    Args:
        topic: a topic with ``Qos.repeated``.
        period: real seconds between two repetitions of a message; ``REPEAT_PERIOD``.
    """

    def __init__(self, topic: Topic, period: float) -> None:
        self._topic = topic
        self._period = period
        self._run_id = ""
        self._said: OrderedDict[Hashable, _Said] = OrderedDict()

    def said(self, message: Any, data: bytes, time: float) -> None:
        """Take note of what was just published.

        Args:
            message: with the fields of ``Topic.newest_of_each`` and, where it has one, ``run_id``.
            data: its bytes.
            time: on a clock that never steps, s.
        """
        run_id = getattr(message, "run_id", "")
        if run_id != self._run_id:
            self._run_id = run_id
            self._said.clear()
        kind = tuple(getattr(message, field) for field in self._topic.newest_of_each)
        self._said.pop(kind, None)
        self._said[kind] = _Said(data, time)
        if len(self._said) > self._topic.depth:
            self._said.popitem(last=False)

    def forget(self) -> None:
        """Say nothing of that again: a new run begins, even if it has the same identity."""
        self._said.clear()

    def due(self, time: float) -> list[bytes]:
        """Return the messages to repeat now, in the order of their first publication.

        Args:
            time: on the clock of ``said``, s.
        """
        due = [said for said in self._said.values() if time - said.time >= self._period]
        for said in due:
            said.time = time
        return [said.data for said in due]


class Memory:
    """Messages received on one topic, so that a repetition is recognised.

    A recorded run can be played twice. Then the same bytes come as news again, while nodes that
    took part the first time may still repeat what they made of it.
    """

    def __init__(self) -> None:
        self._heard: OrderedDict[bytes, int] = OrderedDict()
        self._round = 0

    def is_news(self, data: bytes, has_happened: Callable[[], bool] = lambda: True) -> bool:
        """Return whether these bytes are received for the first time, and remember them.

        Args:
            data: the message.
            has_happened: called for bytes received before time began again; returns whether
                their event has happened by now. If not, the message still belongs to the time
                before.
        """
        digest = blake2b(data, digest_size=16).digest()
        heard = self._heard.get(digest)
        if heard == self._round or (heard is not None and not has_happened()):
            return False
        self._heard[digest] = self._round
        self._heard.move_to_end(digest)
        if len(self._heard) > _REMEMBERED:
            self._heard.popitem(last=False)
        return True

    def begin_anew(self) -> None:
        """Accept earlier messages as new: a recorded run starts again."""
        self._round += 1
