"""What still holds on one topic, so that a viewer that comes late is shown it."""

from collections.abc import Hashable
from typing import Any

from stepdiag_ros.messages.repetition import Repeater
from stepdiag_ros.topics import FIXED_FRAMES, Topic


class Holding:
    """The messages of a topic that hold: the newest, or the newest of each kind.

    ``Topic.newest_of_each`` determines which message replaces which, as for the publisher.
    Fixed frames come from several publishers, and each message holds for the frames that it names.

    Args:
        topic: one with ``Qos.repeated``.
    """

    def __init__(self, topic: Topic) -> None:
        self._topic = topic
        self._repeaters: dict[Hashable, Repeater] = {}
        self._times: dict[bytes, int] = {}
        self._run_id = ""

    def said(self, message: Any, data: bytes, time: int) -> None:
        """Take note of a message.

        Args:
            message: decoded.
            data: its bytes.
            time: at which it was received, ns.
        """
        self._run_id = getattr(message, "run_id", "")
        frames: tuple[str, ...] = ()
        if self._topic is FIXED_FRAMES:
            frames = tuple(one.child_frame_id for one in message.transforms)
        if frames not in self._repeaters:
            self._repeaters[frames] = Repeater(self._topic, period=0.0)
        self._repeaters[frames].said(message, data, 0.0)
        times = {**self._times, data: time}
        self._times = {held: times[held] for held in self._held()}

    def forget(self) -> None:
        """Forget everything."""
        self._repeaters.clear()
        self._times.clear()

    def begin_run(self, run_id: str) -> None:
        """Forget what follows from another run than the one that begins."""
        if self._topic.derived and self._run_id != run_id:
            self.forget()

    @property
    def messages(self) -> list[tuple[bytes, int]]:
        """Return the bytes of messages that hold, in order of publication, and their times."""
        return [(data, self._times[data]) for data in self._held()]

    def _held(self) -> list[bytes]:
        return [data for one in self._repeaters.values() for data in one.due(0.0)]
