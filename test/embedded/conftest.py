"""Fixtures of the tests on live nodes."""

from ros_processes import Peer, domain, node, peer, ros, spin_until, wait_until

__all__ = ["Peer", "domain", "node", "peer", "ros", "spin_until", "wait_until"]
