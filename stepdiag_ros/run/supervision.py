"""Who takes part in a run and who has fallen silent, from heartbeats alone."""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from math import inf

HEARTBEAT = "heartbeat"
"""Task of /diagnostics by which nodes know each other; its values hold the next three."""
ROLE, RUN_ID, SESSION = "role", "run_id", "session"
FAULTY_LEVEL = 2
"""Level of a heartbeat, ERROR of diagnostic_msgs/DiagnosticStatus, with which no run can go on."""
TIME_SOURCE = "time_source"
"""Fact by which a node says where its ROS time comes from: /clock or computer."""
HELD = "STEPDIAG_HELD"
"""Environment variable of a node process that joins the ROS graph when its input ends."""
HEARTBEAT_PERIOD = 0.5
"""Real seconds between two heartbeats of a node."""
SILENCE_LIMIT = 2.0
"""Real seconds without a heartbeat after which a node counts as lost, unless a cell has another."""
LONGEST_LOOK = 0.5
"""Real seconds between two looks at the silence of others that count in full."""
WORK_LEFT = "work_left"
"""Fact by which a node states how many results it still owes to the messages received."""
REFUSES = "refuses"
"""Fact by which a node says why it does not take up a run: identity of the run, then the reason."""
GETTING_READY = "getting_ready"
"""Fact by which a node says that it will be ready in a moment, by itself; on the status of a task,
that its subject has not begun yet and may still be about to."""
START_PATIENCE = 10.0
"""Real seconds for which what is not ready counts as starting, and for which a run waits for it."""
WORKER_LIMIT = 10.0
"""Real seconds without a heartbeat after which results that a node owes are not waited for any
more: after a run nothing moves, and a computer that is busy with the last results is not a loss."""
MISSES = "misses"
"""Fact by which a node names, in full, the nodes whose heartbeats are missing."""
CLOCK_ROLE = "clock"
"""Role of the node that publishes simulated time."""
BY_HAND_ROLE = "by_hand"
"""Role of the node that follows a run by its readings alone; positions are not published then."""
OPERATOR_ROLE = "operator"
"""Role of a command that starts, steers or follows a run; a run goes on when it ends."""
ONLOOKERS = ("archive", "foxglove_server", "monitor", "scene")
"""Roles of nodes that look on, or come after a run: they come and go, and a run misses none."""
BYSTANDERS = frozenset({*ONLOOKERS, OPERATOR_ROLE, "player", "viewer"})
"""Roles of nodes that no run needs: commands and views may outlive it or end before it. They bring
no data into it either."""
UNMISSED = (*ONLOOKERS, OPERATOR_ROLE)
"""Roles that come and go as they like: nobody reports their silence."""
DISPENSABLE = ("evaluator", "diagnosis", *ONLOOKERS)
"""Nodes that a run goes on without."""
HEARD_UNTIL = "heard_until"
"""Fact by which a recorder says up to which time, ns, it has taken the readings."""

MOST_PEERS = 100
"""Nodes that are kept in mind; of more, those that are silent are forgotten."""
_LONGEST_HEARTBEAT = 20_000
"""Characters of all that a node says of itself at once."""
_LONGEST_NAME = 255
_MOST_MISSED = 20
"""Nodes that a heartbeat names as silent; all that there may be would make it too long."""
_NODE_NAME = re.compile(r"([A-Za-z_][A-Za-z0-9_]*/)*[A-Za-z_][A-Za-z0-9_]*")


@dataclass
class Peer:
    """One node as its heartbeats show it.

    Attributes:
        role: what it is in a run, for example ``recorder``.
        last_seen: time of the last heartbeat, s of a clock that never steps.
        session: identity of the process; a node that was started again has another.
        run_id: of the run that it says it works on; empty if none.
        text: what it says of itself.
        faulty: it says that something is wrong with itself.
        facts: what else it says, for example which stop a recorder has stored last.
    """

    role: str
    last_seen: float
    session: str
    run_id: str
    text: str = ""
    faulty: bool = False
    facts: dict[str, str] = field(default_factory=dict)


def peer_of(
    name: str, level: int, message: str, values: Mapping[str, str], heard: float
) -> "tuple[str, Peer] | None":
    """Return whose heartbeat a status of /diagnostics is; None for another status.

    Args:
        name: of the status, for example ``cell/recorder: heartbeat``.
        level: 0 good, 1 warning, 2 error.
        message: what the node says of itself.
        values: of the status.
        heard: s of a clock that never steps.

    Returns:
        the node's full name, for example ``/cell/recorder``, and what is known of it.

    Raises:
        ValueError: no node has such a name, or none says as much.
    """
    node, _, task = name.rpartition(": ")
    if task != HEARTBEAT or ROLE not in values or SESSION not in values:
        return None
    if len(node) > _LONGEST_NAME or not _NODE_NAME.fullmatch(node):
        raise ValueError(
            f"a heartbeat names the node '{node[:60]}', which is not a valid node name"
        )
    if (
        len(message) + sum(len(key) + len(said) for key, said in values.items())
        > _LONGEST_HEARTBEAT
    ):
        raise ValueError(f"the heartbeat of {node} is longer than {_LONGEST_HEARTBEAT} characters")
    return "/" + node, Peer(
        role=values[ROLE],
        last_seen=heard,
        session=values[SESSION],
        run_id=values.get(RUN_ID, ""),
        text=message,
        faulty=level >= FAULTY_LEVEL,
        facts=dict(values),
    )


def measure_together(namespace: str, simulated: bool, name: str, peer: Peer) -> bool:
    """Say whether another node belongs to the measurement of a node, and is not of another cell.

    /diagnostics is one for all cells of a domain, but the nodes of a measurement share a namespace;
    only the clock may be one for all whose time is simulated.

    Args:
        namespace: of the node, for example ``/cell``.
        simulated: the node's time is that of /clock, or it starts nodes whose time is.
        name: of the other node, in full.
        peer: the other node.
    """
    if simulated and peer.role == CLOCK_ROLE:
        return True
    return (name.rpartition("/")[0] or "/") == namespace


def fact_of_run(run_id: str, value: str) -> str:
    """Return how a node says a fact that holds in one run only."""
    return f"{run_id} {value}"


def said_of_run(peer: Peer, fact: str, run_id: str) -> str:
    """Return what a node says of a fact in this run; empty if nothing."""
    run, _, value = peer.facts.get(fact, "").partition(" ")
    return value if run == run_id else ""


@dataclass
class Watch:
    """Keeps count of the nodes that answer, and of those that have gone.

    Attributes:
        silence_limit: real s without a heartbeat after which a node counts as lost.
        peers: node name → what is known of it.
        lost: node name → sentence that says so; cleared when the node answers again.
        twins: names under which two processes speak at the same time.
    """

    silence_limit: float = SILENCE_LIMIT
    peers: dict[str, Peer] = field(default_factory=dict)
    lost: dict[str, str] = field(default_factory=dict)
    twins: set[str] = field(default_factory=set)
    _looked: float = inf
    # Node name → for how many s of its silence this process could not have heard it.
    _deaf: dict[str, float] = field(default_factory=dict)

    @property
    def patience(self) -> float:
        """How many times as long as usual nodes may take to answer."""
        return self.silence_limit / SILENCE_LIMIT

    def heard(self, name: str, peer: Peer) -> None:
        """Take note of a heartbeat.

        Raises:
            ValueError: ``MOST_PEERS`` other nodes are alive.
        """
        before = self.peers.get(name)
        if before is None and len(self.peers) >= MOST_PEERS:
            self._forget_silent()
        # A node that died and came back was silent at least for the time that a start takes.
        if (
            before is not None
            and before.session != peer.session
            and peer.last_seen - before.last_seen < HEARTBEAT_PERIOD
        ):
            self.twins.add(name)
        self.peers[name] = peer
        self.lost.pop(name, None)
        self._deaf.pop(name, None)

    def _forget_silent(self) -> None:
        if not self.lost:
            raise ValueError(f"more than {MOST_PEERS} nodes say that they take part")
        gone = next(iter(self.lost))
        for kept in (self.peers, self.lost, self._deaf):
            kept.pop(gone, None)
        self.twins.discard(gone)

    def check(self, now: float) -> list[str]:
        """Return the sentences about nodes that have been found lost just now, and are missed.

        A process that did not get the computer for a while finds in one moment that time has
        passed, and what was sent meanwhile still unread: it listens before it judges.

        Args:
            now: time on the clock of ``Peer.last_seen``, s; called several times a second.
        """
        asleep = max(0.0, now - self._looked - LONGEST_LOOK)
        self._looked = now
        found = []
        for name, peer in self.peers.items():
            self._deaf[name] = self._deaf.get(name, 0.0) + asleep
            silence = now - peer.last_seen - self._deaf[name]
            if silence > self.silence_limit and name not in self.lost:
                self.lost[name] = f"{peer.role} node {name} is silent for {silence:.1f} s"
                if peer.role not in UNMISSED:
                    found.append(self.lost[name])
        return found

    def present(self, role: str, run_id: str | None = None) -> bool:
        """Say whether a node of that role is alive (and, if asked, works on that run)."""
        return any(
            peer.role == role and name not in self.lost and run_id in (None, peer.run_id)
            for name, peer in self.peers.items()
        )

    def sessions(self) -> set[str]:
        """Return the identities of the processes that are alive."""
        return {peer.session for name, peer in self.peers.items() if name not in self.lost}

    def workers(self, now: float) -> list[str]:
        """Return the roles, in order, of nodes that still owe results and may yet give them.

        Args:
            now: time on the clock of ``Peer.last_seen``, s.
        """
        owing = (peer for peer in self.peers.values() if peer.facts.get(WORK_LEFT, "0") != "0")
        return sorted({peer.role for peer in owing if now - peer.last_seen < WORKER_LIMIT})

    @property
    def missed(self) -> str:
        """The nodes that are silent and should not be, latest first, as ``MISSES`` names them."""
        names = [name for name in self.lost if self.peers[name].role not in UNMISSED]
        names.sort(key=lambda name: -self.peers[name].last_seen)
        return " ".join(names[:_MOST_MISSED])

    def deaf(self, roles: Collection[str]) -> list[str]:
        """Return a sentence for each pair of nodes of these roles of which one misses the other.

        Each node discovers a process again that was stopped for long, one after another. What a
        node publishes before that never arrives there.
        """
        alive = {
            name: peer
            for name, peer in self.peers.items()
            if peer.role in roles and name not in self.lost
        }
        return [
            f"the {peer.role} has not found the {alive[missed].role} again yet"
            for peer in alive.values()
            for missed in peer.facts.get(MISSES, "").split()
            if missed in alive
        ]

    def missing(self, roles: tuple[str, ...]) -> list[str]:
        """Return a sentence for each of these roles that no healthy node fills."""
        found = []
        for role in roles:
            if self.present(role):
                faults = [
                    f"{role}: {peer.text}"
                    for name, peer in self.peers.items()
                    if peer.role == role and peer.faulty and name not in self.lost
                ]
                found += faults
            else:
                said = [text for name, text in self.lost.items() if self.peers[name].role == role]
                found += said or [f"there is no {role} node"]
        return found
