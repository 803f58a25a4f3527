"""Contacts of a live view: which nodes are there, which have gone, which topics are silent.

A bag has no contacts: its messages about nodes held when it was recorded.
"""

from collections.abc import Mapping
from typing import NamedTuple

from stepdiag_ros.run.supervision import BYSTANDERS, Watch

FRESH = 1.2
"""Real seconds since its last heartbeat in which a node is surely still there: two heartbeats."""
QUIET_AFTER = 3.0
"""Real seconds without a message after which the last one is not what holds now."""


class SilentNode(NamedTuple):
    """A node that has fallen silent."""

    name: str
    role: str


class Contact(NamedTuple):
    """Which nodes answer.

    Attributes:
        known: some node has answered at all.
        roles: of those that answer now.
        silent: those that have fallen silent.
        at_work: one that a run needs answered just now.
        quiet: names of topics on which something has come, but nothing for some seconds.
    """

    known: bool
    roles: frozenset[str]
    silent: tuple[SilentNode, ...]
    at_work: bool
    quiet: frozenset[str]

    def misses(self, role: str) -> bool:
        """Say whether all nodes of a role have fallen silent."""
        return role not in self.roles and any(node.role == role for node in self.silent)


def contact_of(watch: Watch, newest: Mapping[str, float], now: float) -> Contact:
    """Return which nodes answer.

    Args:
        watch: on the heartbeats.
        newest: name of a topic → when its newest message was taken up, s.
        now: s of the same clock, that of ``Peer.last_seen``.
    """
    heard = [peer for name, peer in watch.peers.items() if name not in watch.lost]
    silent = (SilentNode(name, watch.peers[name].role) for name in watch.lost)
    return Contact(
        known=bool(watch.peers),
        roles=frozenset(peer.role for peer in heard),
        silent=tuple(sorted(silent)),
        at_work=any(peer.role not in BYSTANDERS and now - peer.last_seen < FRESH for peer in heard),
        quiet=frozenset(name for name, when in newest.items() if now - when > QUIET_AFTER),
    )
