"""Node of ``stepdiag replay``: publishes a recorded run into a live graph, with /clock."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import rclpy
from rosgraph_msgs.msg import Clock as ClockMessage

from stepdiag_ros import topics
from stepdiag_ros.bags.bag import Bag, RecordedMessage
from stepdiag_ros.bags.runs import FoundRun, records_of
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.nodes.base import StepdiagNode
from stepdiag_ros.nodes.links import Outlet
from stepdiag_ros.run.pacing import Pace
from stepdiag_ros.topics import Topic

TICK = 0.001
"""Real seconds between two ticks of /clock, at least."""
LOOK_AROUND = 1.5
"""Real seconds in which other nodes would be discovered."""
NEVER_REPLAYED = (
    topics.DIAGNOSTICS,
    *(topic for topic in topics.TOPICS if not topic.recorded),
)
"""Heartbeats of nodes that are long gone would be taken for live ones. What our recorder does not
keep, other recorders do: time, frames and markers, which live nodes make again."""


@dataclass(frozen=True)
class Played:
    """What a replay did.

    Attributes:
        messages: published.
        recorded_seconds: of the recording.
        real_seconds: that it took.
        same: topic → its live messages equal the recorded ones; empty if not compared.
        differences: topic → in words, for those that are not the same.
    """

    messages: int
    recorded_seconds: float
    real_seconds: float
    same: dict[str, bool] = field(default_factory=dict)
    differences: dict[str, str] = field(default_factory=dict)


def difference(recorded: list[bytes], heard: list[bytes]) -> str:
    """Say in what two sequences of messages differ."""
    pairs = enumerate(zip(recorded, heard, strict=False), start=1)
    first = next((number for number, (a, b) in pairs if a != b), None)
    counts = f"{len(recorded)} messages recorded, {len(heard)} received"
    if first is None:
        return f"{counts}; those there are, are the same"
    return f"{counts}; number {first} is the first that differs"


class PlayerNode(StepdiagNode):
    """Publishes a bag's messages byte for byte, in order and at a rate.

    A message of an earlier definition, without fields that were added later, is converted to the
    present one.

    Args:
        bag: that holds the run.
        run: which.
        derived: publish the lines too; for a bag without readings.
        late: the recording was begun while the run was going on: publish the lines instead of what
            only some of them can be assembled from, and compare the newest results of each kind.
    """

    role = "player"

    def __init__(self, bag: Bag, run: FoundRun, derived: bool, late: bool) -> None:
        super().__init__("stepdiag_player")
        self._bag = bag
        self._run = run
        self._late = late
        self._outlets: dict[str, Outlet] = {}
        self._derived: dict[str, Topic] = {}
        self._heard: dict[str, list[bytes]] = {}
        self._last_heard = 0.0
        self._played: dict[str, Topic] = {}
        self._differing = frozenset(filter(bag.types.differs, bag.topics.values()))
        for name, type_name in bag.topics.items():
            found = topics.topic_of(name)
            if found is None or found[0] in NEVER_REPLAYED:
                continue
            if not found[0].name.startswith("/") and found[1] != run.namespace:
                continue
            if late and found[0] in (topics.MACHINE_COMMAND, topics.COMMAND_STATUS):
                continue
            topic = replace(found[0], name=name, type_name=type_name)
            if found[0].derived and not ((derived or late) and found[0] is topics.LINE):
                self._derived[name] = topic
                continue
            self._played[name] = topic

    def open(self) -> None:
        """Announce what will be published: a bridge stops a machine beside such a publisher."""
        self._clock_publisher = self.announce(topics.CLOCK)
        for name, topic in self._played.items():
            # Keep all: a hurried replay waits for a slow subscriber instead of losing messages.
            self._outlets[name] = self.announce(topic, keep_all=True)

    def refuse_company(self, roles: Sequence[str]) -> None:
        """Refuse to go on while other nodes of these roles would answer as well.

        Raises:
            ValueError: there is one.
        """
        self._wait_until(self.real_time() + LOOK_AROUND)
        for role in roles:
            if self.watch.present(role):
                raise ValueError(
                    f"a {role} node runs already: end it, or set ROS_DOMAIN_ID to another number"
                )

    def wait_for(self, roles: Sequence[str], limit: float, ended: Callable[[], str]) -> None:
        """Wait until nodes of these roles are up and listen.

        Raises:
            ValueError: one has ended or does not come up within ``limit`` real seconds.
        """
        deadline = self.real_time() + limit
        description = next(
            outlet for name, outlet in self._outlets.items() if name.endswith("run/description")
        )
        while not all(self.watch.present(role) for role in roles) or (
            description.get_subscription_count() < len(roles)
        ):
            if ended():
                raise ValueError(ended())
            if self.real_time() > deadline:
                raise ValueError(f"the nodes {', '.join(roles)} did not come up in {limit:g} s")
            rclpy.spin_once(self, timeout_sec=0.1)

    def listen_to_derived(self, wanted: Sequence[Topic]) -> None:
        """Keep what the live nodes publish on these of the topics that the recording derives."""
        for name, topic in self._derived.items():
            if not any(topic.type_name == one.type_name for one in wanted):
                continue
            self._heard[name] = []

            def hear(data: bytes, name: str = name, type_name: str = topic.type_name) -> None:
                if type_name in self._differing:
                    data = self._bag.types.converted(type_name, data, own_types())
                self._heard[name].append(data)
                self._last_heard = self.real_time()

            self.listen(topic, hear, keep_all=True, raw=True)

    def play(self, rate: float, progress: Callable[[float], None]) -> Played:
        """Publish everything.

        Args:
            rate: seconds of the recording in a real second; 0 for as fast as possible.
            progress: called with the part that has been published, 0..1.
        """
        start, end = self._span()
        began = self.real_time()
        pace = Pace(rate or 1.0, origin=start, real_start=began)
        count, last_tick, last_progress = 0, began - TICK, began
        for record, _ in records_of(self._bag, self._run, self._outlets.keys()):
            if rate:
                self._wait_until(pace.real(record.log_time))
            real = self.real_time()
            if real - last_tick >= TICK:
                self._tick(record.log_time)
                last_tick = real
            self._outlets[record.topic].publish(self._present(record))
            count += 1
            if real - last_progress > 0.1:
                progress(pace.part(record.log_time, end))
                last_progress = real
                rclpy.spin_once(self, timeout_sec=0.0)
        self._tick(end)
        return Played(count, pace.span(end), self.real_time() - began)

    def compare(self, played: Played, quiet: float, patience: float) -> Played:
        """Wait until the live nodes are done and compare their messages with the recorded ones.

        Args:
            played: what was published.
            quiet: real seconds without a new message after which the nodes are taken to be done.
            patience: the same while messages are missing: the computer may be busy.
        """
        recorded = self._recorded()
        self._last_heard = self.real_time()
        while not self._all_has_come(recorded, quiet, patience):
            rclpy.spin_once(self, timeout_sec=0.1)
        heard = {name: self._conclusive(name, found) for name, found in self._heard.items()}
        for name in recorded:
            if recorded[name] != heard[name]:
                recorded[name] = self._normal(name, recorded[name])
                heard[name] = self._normal(name, heard[name])
        return replace(
            played,
            same={name: recorded[name] == heard[name] for name in recorded},
            differences={
                name: difference(recorded[name], heard[name])
                for name in recorded
                if recorded[name] != heard[name]
            },
        )

    def _present(self, record: RecordedMessage) -> bytes:
        """Return a recorded message in the present definition of its type."""
        if record.type_name not in self._differing:
            return record.data
        return own_types().converted(record.type_name, record.data, self._bag.types)

    def _recorded(self) -> dict[str, list[bytes]]:
        """Return the recorded messages to compare with, by topic."""
        found: dict[str, list[bytes]] = {name: [] for name in self._heard}
        for record, _ in records_of(self._bag, self._run, self._heard.keys()):
            found[record.topic].append(record.data)
        return {name: self._conclusive(name, messages) for name, messages in found.items()}

    def _all_has_come(
        self, recorded: dict[str, list[bytes]], quiet: float, patience: float
    ) -> bool:
        silence = self.real_time() - self._last_heard
        if silence < quiet or self.watch.workers(self.real_time()):
            return False
        return silence >= patience or all(
            len(self._conclusive(name, self._heard[name])) >= len(messages)
            for name, messages in recorded.items()
        )

    def _normal(self, name: str, messages: list[bytes]) -> list[bytes]:
        """Return messages without what some middlewares leave in the gaps between fields."""
        kind = self._derived[name].type_name
        return [self._bag.types.normal(kind, data) for data in messages]

    def _conclusive(self, name: str, messages: list[bytes]) -> list[bytes]:
        """Return the messages that must be the same however fast the computer is."""
        topic = self._derived[name]
        if not topic.conclusive and not self._late:
            return messages
        decoded = [(data, self._bag.types.decode(topic.type_name, data)) for data in messages]
        if topic.conclusive:
            return [data for data, message in decoded if getattr(message, topic.conclusive)][-1:]
        newest = {
            tuple(getattr(message, field) for field in topic.newest_of_each): data
            for data, message in decoded
        }
        return [newest[kind] for kind in sorted(newest)]

    def _span(self) -> tuple[int, int]:
        """Return the first and the last log time of the run, ns."""
        if self._run.alone:
            return self._bag.start_time, self._bag.end_time
        times = [record.log_time for record, _ in records_of(self._bag, self._run)]
        return min(times, default=0), max(times, default=0)

    def _wait_until(self, real: float) -> None:
        while (left := real - self.real_time()) > 0.0:
            rclpy.spin_once(self, timeout_sec=min(left, 0.1))

    def _tick(self, time: int) -> None:
        message = ClockMessage()
        message.clock.sec, message.clock.nanosec = divmod(time, 1_000_000_000)
        self._clock_publisher.publish(message)
