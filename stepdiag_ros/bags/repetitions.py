"""Repetitions for late subscribers, which a bag of ``ros2 bag record`` holds as well."""

from collections.abc import Iterable, Iterator

from stepdiag_ros.bags.bag import RecordedMessage
from stepdiag_ros.messages.repetition import Memory
from stepdiag_ros.topics import topic_of


class Repetitions:
    """Knows what has come before in one bag; see ``stepdiag_ros.messages.repetition``."""

    def __init__(self) -> None:
        self._heard: dict[str, Memory | None] = {}

    def is_news(self, record: RecordedMessage) -> bool:
        """Say whether a message comes for the first time, and remember it."""
        if record.topic not in self._heard:
            found = topic_of(record.topic)
            repeated = found is not None and found[0].qos.repeated
            self._heard[record.topic] = Memory() if repeated else None
        memory = self._heard[record.topic]
        return memory is None or memory.is_news(record.data)


def without_repetitions(records: Iterable[RecordedMessage]) -> Iterator[RecordedMessage]:
    """Leave out the repeated messages."""
    return filter(Repetitions().is_news, records)
