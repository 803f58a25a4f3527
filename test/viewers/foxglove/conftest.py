"""A server on a free port that offers what a node offers, and a bag of a small run."""

from functools import partial

import pytest
from shown_run import small_run

from stepdiag_ros import topics
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.messages.conversion import new_message
from stepdiag_ros.viewers.foxglove.server import FoxgloveServer, ServedPlace

__all__ = ["small_run"]
SHOWN = (topics.RUN_DESCRIPTION, topics.READING, topics.LINE, topics.FIXED_FRAMES, topics.STOP)


class Served:
    """A server, and what was sent on it."""

    def __init__(self):
        self.told, self.count = [], 0
        self.server = FoxgloveServer("test", ServedPlace(port=0), self.told.append)
        types = own_types()
        for topic in SHOWN:
            kind = topic.type_name
            decode = partial(types.decode, kind)
            name = topics.absolute(topic)
            self.server.offer(name, kind, types.schema(kind), decode, topic)
        self.server.start()

    @property
    def port(self):
        return int(self.server.url.rpartition(":")[2])

    def send(self, topic, **fields):
        """Send a message; return its time and its bytes."""
        message = new_message(topic.type_name)
        for name, value in fields.items():
            setattr(message, name, value)
        data = own_types().encode(topic.type_name, message)
        self.count += 1
        self.server.send(topics.absolute(topic), data, self.count)
        return self.count, data


@pytest.fixture
def served():
    made = Served()
    yield made
    made.server.close()


@pytest.fixture(scope="package")
def bag(tmp_path_factory, small_run):
    """A bag of the run that is shown."""
    return small_run.write(tmp_path_factory.mktemp("bag") / "run.mcap")
