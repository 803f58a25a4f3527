"""A bag played to Foxglove viewers, without any node: they may pause it and go to and fro in it."""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from stepdiag_ros import topics
from stepdiag_ros.bags.bag import RecordedMessage
from stepdiag_ros.bags.folder import open_bag
from stepdiag_ros.bags.run import check_version
from stepdiag_ros.bags.runs import choose_run, records_of
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.run.pacing import Pace
from stepdiag_ros.topics import Topic
from stepdiag_ros.viewers.foxglove.recorded_scene import MADE, SOURCES, RecordedScene
from stepdiag_ros.viewers.foxglove.server import (
    FoxgloveServer,
    Playback,
    Playing,
    ServedPlace,
    Wish,
)

TICK = 0.02
"""Real seconds between two looks at what is due."""
TELL_PERIOD = 0.1
"""Real seconds between two messages of the time to viewers."""
TOOL_PERIOD = 1.0 / 30.0
"""Real seconds between two frames of the tool, at least."""
DRAW_PERIOD = 0.5
"""Real seconds between two pictures, at least."""
AT_ONCE = 1000
"""Messages sent between two looks, at most, so that a fast replay still listens to viewers."""
SLOWEST, FASTEST = 0.001, 1000.0
"""Recorded seconds in a real second. Faster, viewers would miss messages."""


class FoxgloveReplay:
    """A recorded run that is played as soon as the first viewer subscribes.

    Viewers are offered every topic of the run with the definitions of the bag, and frames and
    markers where the bag has none.

    Args:
        path: of the bag.
        run_id: which run, where the bag holds several.
        rate: recorded seconds in a real second.
        place: where viewers are served.
        log: called with a sentence on each refused client.

    Raises:
        BagError: the bag cannot be read, or holds no run or several and none is named.
        ValueError: foxglove-sdk is not installed.
    """

    def __init__(
        self,
        path: Path,
        run_id: str | None,
        rate: float,
        place: ServedPlace,
        log: Callable[[str], None],
    ) -> None:
        self._bag = open_bag(path)
        self._run = choose_run(self._bag, run_id)
        description = self._run.description
        check_version(path, description.schema_version, description.software_version)
        self._scene = RecordedScene(description)
        self._begin, self._end = self._span()
        self._wishes: deque[Wish] = deque()
        playback = Playback(self._begin, self._end, self._promise)
        self.server = FoxgloveServer(path.name, place, log, playback)
        self._names = self._offer_recorded()
        self._drawn = self._offer_drawn()
        self._sources = {topics.absolute(one, self._run.namespace): one for one in SOURCES}
        self._rate = rate
        self._goes_on, self._ended = True, False
        self._time = self._begin
        self._pace: Pace | None = None
        self._coming = self._records(self._begin)
        self._next = next(self._coming, None)
        self._told = self._tool_shown = self._picture_shown = 0.0

    def close(self) -> None:
        """Let the viewers go and close the bag."""
        self.server.close()
        self._bag.close()

    def play(self, stop: threading.Event) -> None:
        """Serve viewers, once the server was started, until asked to stop.

        Raises:
            BagError: a message cannot be decoded.
        """
        while not stop.wait(TICK):
            came = self.server.work()
            self._grant()
            if self._goes_on and self._pace is None and self.server.has_viewers:
                self._pace = Pace(self._rate, self._time, time.monotonic())
            if came:
                self.server.tell_playback(self._state())
            self._go_on()

    def _span(self) -> tuple[int, int]:
        if self._run.alone:
            return self._bag.start_time, self._bag.end_time
        times = [record.log_time for record, _ in records_of(self._bag, self._run)]
        return min(times, default=0), max(times, default=0)

    # What is offered -----------------------------------------------------------------------------

    def _offer_recorded(self) -> tuple[str, ...]:
        """Offer what is in the bag; of another cell beside that of the run, nothing."""
        definitions, names = self._bag.definitions(), []
        for name, type_name in self._bag.topics.items():
            found = topics.topic_of(name)
            if type_name not in definitions or (found is not None and self._is_elsewhere(*found)):
                continue
            topic = None if found is None else found[0]
            decode = partial(self._bag.types.decode, type_name)
            self.server.offer(name, type_name, definitions[type_name], decode, topic)
            names.append(name)
        return tuple(names)

    def _is_elsewhere(self, topic: Topic, namespace: str) -> bool:
        return not topic.name.startswith("/") and namespace != self._run.namespace

    def _offer_drawn(self) -> dict[Topic, str]:
        """Offer the frames and markers that the bag has not."""
        types, drawn = own_types(), {}
        for topic in MADE:
            name = topics.absolute(topic, self._run.namespace)
            if name not in self._names:
                kind = topic.type_name
                decode = partial(types.decode, kind)
                self.server.offer(name, kind, types.schema(kind), decode, topic)
                drawn[topic] = name
        return drawn

    # Playing -------------------------------------------------------------------------------------

    def _go_on(self) -> None:
        """Send what is due, and say what time it is."""
        real = time.monotonic()
        if self._pace is not None:
            self._send_due(self._pace.time(real))
            if self._next is None and self._time >= self._end:
                self._ended, self._goes_on, self._pace = True, False, None
                self.server.tell_playback(self._state())
        self._draw(real)
        if real - self._told >= TELL_PERIOD:
            self._told = real
            self.server.tell_time(self._time)

    def _send_due(self, due: int) -> None:
        sent = 0
        while self._next is not None and self._next.log_time <= due and sent < AT_ONCE:
            record, sent = self._next, sent + 1
            self.server.send(record.topic, record.data, record.log_time)
            self._see(record)
            self._next = next(self._coming, None)
        if self._next is not None:
            due = min(due, self._next.log_time)
        self._time = min(max(self._time, due), self._end)

    def _see(self, record: RecordedMessage) -> None:
        source = self._sources.get(record.topic)
        if source is not None and self._drawn:
            self._scene.take(source, self._bag.decode(record))

    def _draw(self, real: float) -> None:
        made: dict[Topic, bytes] = {}
        if real - self._tool_shown >= TOOL_PERIOD and topics.FRAMES in self._drawn:
            self._tool_shown = real
            tool = self._scene.tool()
            if tool is not None:
                made[topics.FRAMES] = tool
        if real - self._picture_shown >= DRAW_PERIOD:
            self._picture_shown = real
            made.update(self._scene.drawn(self._time))
        for topic, data in made.items():
            if topic in self._drawn:
                self.server.send(self._drawn[topic], data, self._time)

    def _state(self) -> Playing:
        return Playing(self._goes_on, self._ended, self._time, self._rate)

    # What viewers ask for ------------------------------------------------------------------------

    def _promise(self, wish: Wish) -> Playing:
        """Say where a wish will lead; it is granted in the thread that plays."""
        goal, rate = wish.goal, self._rate
        if goal is None and wish.goes_on and self._ended:
            goal = self._begin
        if goal is not None:
            goal = min(max(goal, self._begin), self._end)
        if wish.rate > 0.0:
            rate = min(max(wish.rate, SLOWEST), FASTEST)
        self._wishes.append(Wish(wish.goes_on, rate, goal))
        ended = self._ended and goal is None
        time = self._time if goal is None else goal
        return Playing(wish.goes_on, ended, time, rate, bound=goal is not None)

    def _grant(self) -> None:
        while self._wishes:
            wish = self._wishes.popleft()
            self._goes_on, self._rate, self._pace = wish.goes_on, wish.rate, None
            if wish.goal is not None:
                self._seek(wish.goal)

    def _seek(self, goal: int) -> None:
        """Go to a time, and send what held then."""
        self.server.begin_anew()
        self._scene.begin_anew()
        self._time, self._ended = goal, False
        self._coming = self._records(goal)
        self._next = next(self._coming, None)
        # Viewers drop what they show when they hear of the bound, and that goes another way in the
        # library than what they are to show then, which must not come first.
        time.sleep(TICK)
        self.server.say_what_holds()
        self._picture_shown = 0.0

    def _records(self, begin: int) -> Iterator[RecordedMessage]:
        """Go through the run from a time on; of what was before, what holds is taken note of."""
        tool: RecordedMessage | None = None
        for record, _ in records_of(self._bag, self._run, self._names):
            if record.log_time >= begin:
                if tool is not None:
                    self._see(tool)
                    tool = None
                yield record
            elif self._sources.get(record.topic) is topics.JOINT_STATES:
                tool = record
            else:
                self.server.hold(record.topic, record.data, record.log_time)
                self._see(record)
