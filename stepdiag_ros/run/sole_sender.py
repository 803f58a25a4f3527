"""Who commands the machine: one node, bound when a run is released, and nobody beside it.

Every participant of an open ROS 2 graph can publish commands, and a message does not say who has
sent it. The graph does say who has a publisher on a topic. So the bridge takes commands only while
the one sequencer that it was released for is the one that publishes them: another publisher stops
the machine before its first message counts. Who forges the graph itself is kept out by DDS Security
alone (``docs/security.md``).
"""

from collections.abc import Sequence
from dataclasses import dataclass

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.run.health import HealthFinding, Level

GHOST_LIMIT = 30.0
"""Real seconds for which the graph may still show publishers of a process that has died: a
middleware gives it up after a lease of 10 s (Cyclone DDS) or 20 s (Fast DDS)."""


@dataclass(frozen=True)
class Sender:
    """A publisher in the graph.

    Attributes:
        topic: it publishes on, as ``topics`` names it.
        node: full name of its node; empty where the graph does not state one.
        gid: its identity in the middleware, hexadecimal digits.
    """

    topic: str
    node: str
    gid: str

    @property
    def who(self) -> str:
        """Return in words whose it is."""
        return f"node {self.node}" if self.node else f"a publisher without a node ({self.gid})"


class SoleSender:
    """Keeps the one node from which commands are taken, by what the graph shows.

    Args:
        topics: that it must publish on, and nobody else may.
    """

    def __init__(self, topics: Sequence[str]) -> None:
        self._topics = tuple(topics)
        self._bound: frozenset[Sender] = frozenset()
        self._silent = False
        self._ghosts: frozenset[str] = frozenset()
        self._lost_at = 0.0

    def begin_run(self) -> None:
        """Take up another run, for which nobody is bound yet."""
        self._bound, self._silent = frozenset(), False

    def lost(self, real: float) -> None:
        """Take note that the sender is dead, or silent (s of a clock that never steps)."""
        if self._bound:
            self._ghosts = frozenset(one.gid for one in self._bound)
            self._silent, self._lost_at = True, real

    def bind(self, present: Sequence[Sender], real: float) -> None:
        """Take commands of this run from the one node that publishes on the topics.

        Args:
            present: all publishers on the topics.
            real: s of a clock that never steps.

        Raises:
            ValueError: no publisher, several publishers, or another one was bound for this run; one
                sentence that names them.
        """
        found = self.judge(present, real)
        if found.forbids:
            raise Refusal(found.message, fault="busy")
        alive = frozenset(self._alive(present, real))
        for topic in self._topics:
            if not any(one.topic == topic for one in alive):
                raise ValueError(f"no node publishes {topic}: there is no sequencer to follow")
        if not all(one.node for one in alive):
            raise ValueError("it is not known yet which node publishes commands: ask again")
        if self._bound and {one.gid for one in alive} != {one.gid for one in self._bound}:
            raise Refusal(
                "this run was begun by another sequencer: start a new one", fault="mismatch"
            )
        self._bound, self._silent = alive, False
        self._ghosts -= {one.gid for one in alive}

    def judge(self, present: Sequence[Sender], real: float) -> HealthFinding:
        """Return how it is; commands are taken only where all is well (see ``bind``)."""
        alive = self._alive(present, real)
        if not self._bound or self._silent:
            doubt = self._doubt(alive)
            return (
                HealthFinding(Level.ERROR, doubt, forbids=True)
                if doubt
                else HealthFinding(Level.OK, "nobody commands the machine: no run is released")
            )
        own = {one.gid: one for one in self._bound}
        owner = next(iter(own.values())).who
        stranger = next((one for one in alive if one.gid not in own), None)
        if stranger is None:
            identities = {f"identity on {one.topic}": one.gid for one in self._bound}
            return HealthFinding(Level.OK, f"commands are taken from {owner} alone", identities)
        does = f"{stranger.who} publishes {stranger.topic}"
        if not any(one.gid in own for one in present):
            gone = f"{does} in place of {owner}, which has gone: start a new run"
            return HealthFinding(Level.WARN, gone)
        beside = f"{does} beside {owner}, from which this run takes its commands"
        return HealthFinding(Level.ERROR, f"{beside}: end it, then resume", forbids=True)

    def _doubt(self, alive: Sequence[Sender]) -> str:
        """Say who could command while nobody is bound, if that is more than one."""
        # What belongs to no node that is known yet may be of one node.
        owners = sorted({one.node: one.who for one in reversed(alive)}.values())
        doubled = [t for t in self._topics if sum(one.topic == t for one in alive) > 1]
        if len(owners) < 2 and not doubled:
            return ""
        topic = doubled[0] if doubled else self._topics[0]
        who = " and ".join(owners)
        who = who if len(owners) > 1 else f"two processes named {who}"
        return f"{who} publish what commands the machine ({topic}): end all but the sequencer"

    def _alive(self, present: Sequence[Sender], real: float) -> list[Sender]:
        """Return the publishers without those of a process that has died, if there are others.

        One that is alone may have been silent for a while and be well again.
        """
        gone = self._ghosts if real <= self._lost_at + GHOST_LIMIT else frozenset()
        others = [one for one in present if one.gid not in gone]
        return others or list(present)
