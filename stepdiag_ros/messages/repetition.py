"""Descriptions, states, lines and results are said again slowly; nobody takes that for news.

A monitor that joins late over a bridge (rosbridge, Foxglove, Zenoh) subscribes volatile: what was
published before it came is never sent to it. So whoever publishes such a message says it again, the
same bytes with the same stamp, and whoever listens drops what it has heard already. No ROS client
here: publishers and subscriptions (``nodes/links.py``) and bags (``bags/repetitions.py``) share it.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from hashlib import blake2b
from typing import Any

from stepdiag_ros.topics import Topic

REPEAT_PERIOD = 5.0
"""Real seconds after which a message that still holds is said again."""
_REMEMBERED = 20_000
"""Messages of a topic that are known again; more than a run has lines, results or states in an
hour, and far less memory than the messages."""


@dataclass
class _Said:
    data: bytes
    time: float


class Repeater:
    """What one publisher has said and still holds, so that it can be said again.

    Of a topic the newest message holds, or the newest of each kind that ``Topic.newest_of_each``
    tells apart. What was said of another run than the newest message holds no more.

    Args:
        topic: a topic with ``Qos.repeated``.
        period: real seconds between two times that a message is said; ``REPEAT_PERIOD``.
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
        """Return what is to be said again now, in the order in which it was first said.

        Args:
            time: on the clock of ``said``, s.
        """
        due = [said for said in self._said.values() if time - said.time >= self._period]
        for said in due:
            said.time = time
        return [said.data for said in due]


class Memory:
    """What was heard on one topic, so that a repetition is known when it comes.

    A recorded run can be played twice. Then the same bytes come as news again, while nodes that
    took part the first time may still repeat what they made of it.
    """

    def __init__(self) -> None:
        self._heard: OrderedDict[bytes, int] = OrderedDict()
        self._round = 0

    def is_news(self, data: bytes, has_happened: Callable[[], bool] = lambda: True) -> bool:
        """Say whether these bytes are heard for the first time, and remember them.

        Args:
            data: the message.
            has_happened: called where they were heard before time began anew; says whether what
                they tell has happened by now. What has not is still said of the time before.
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
        """Take for news what has been heard before: a recorded run begins anew."""
        self._round += 1
