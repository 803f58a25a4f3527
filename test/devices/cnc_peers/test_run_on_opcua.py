"""A whole measurement through the OPC UA driver, with a network that is silent in a move."""

import threading
import time

import pytest
from cable import Cable
from opcua_rig import OpcUaPeer, settings
from patience import PATIENCE
from peer_run import PeerRun, answers_of, check_commands, check_displacements, check_result

from stepdiag_ros.bags.run import load_run
from stepdiag_ros.run.sequence import Answer, State

pytestmark = pytest.mark.timeout(600)
SILENT_IN = 25
"""Number of the order, in the second step diagonal."""
SLOW = 0.002
"""Part of the feed with which the axes would still move when the silence is noticed."""
KNOWN = 4
"""Counts of the watchdog after which the driver has read that the order was taken."""


class SilentNetwork:
    """The PLC behind a cable that is silent from the middle of an order on, until it is mended.

    Attributes:
        where_held: position, mm, of the PLC when the run was held, and how many orders it had.
    """

    def __init__(self, peer):
        self.peer, self.where_held = peer, []
        self.cable = Cable(peer.port)
        peer.halfway[SILENT_IN] = self._slow_down

    def _slow_down(self):
        peer = self.peer
        peer.override = SLOW
        given = (peer.counts + KNOWN, len(peer.orders))
        threading.Thread(target=self._cut, args=given, daemon=True).start()

    def _cut(self, counts, orders):
        peer = self.peer
        self._wait(lambda: peer.counts >= counts or len(peer.orders) > orders)
        if len(peer.orders) == orders:
            self.cable.silent, peer.watchdog_limit = True, 1.0
            return
        # A node for which this computer had no time held the run first: the next order is cut.
        peer.override = 1.0
        peer.halfway[len(peer.orders) + 1] = self._slow_down

    def _wait(self, condition):
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline
            time.sleep(0.01)

    def mend(self):
        # Nobody mends before the PLC has noticed the silence too, however busy this computer is.
        self._wait(lambda: not self.cable.silent or self.peer.braked_by_watchdog)
        self.where_held.append((tuple(self.peer.position), len(self.peer.orders)))
        self.cable.silent, self.peer.override = False, 1.0
        self.peer.watchdog_limit = PATIENCE


@pytest.fixture(scope="module")
def peer():
    made = OpcUaPeer()
    yield made
    made.close()


@pytest.fixture(scope="module")
def network(peer):
    made = SilentNetwork(peer)
    yield made
    made.cable.close()


@pytest.fixture(scope="module")
def finished(network, tmp_path_factory):
    given = settings(f"opc.tcp://127.0.0.1:{network.cable.port}/", confirm_s=0.05)
    return PeerRun(tmp_path_factory.mktemp("run"), "opcua", given, network.mend)


@pytest.fixture(scope="module")
def recorded(finished):
    return load_run(finished.bag)


def test_the_watchdog_stopped_the_machine_and_somebody_resumed_the_run(
    finished, network, peer, recorded
):
    ((state, text),) = finished.held
    assert state is State.FAULT and "has not answered for 2 s" in text
    # The PLC braked on its way, before anybody could tell it to.
    assert len(peer.braked_by_watchdog) >= 1 and not peer.halfway
    ((where, orders),) = network.where_held
    assert orders >= SILENT_IN
    start, end = (peer.orders[number][1] for number in (orders - 2, orders - 1))
    (way,) = (axis for axis in range(3) if start[axis] != end[axis])
    share = (where[way] - start[way]) / (end[way] - start[way])
    assert 0.5 <= share < 0.99
    broken = ["has not answered" in text for _, text in answers_of(finished.bag, Answer.FAULT)]
    assert sum(broken) == 1 and len(broken) <= finished.resumed
    attempts = {str(line.line): line.attempt for line in recorded.lines}
    assert len(recorded.lines) == len(attempts) == len(recorded.plan.lines)
    # Only a line that was broken off is measured again.
    assert 1 <= sum(attempts.values()) - len(attempts) <= finished.resumed


def test_no_order_is_lost_or_carried_out_twice(finished, peer):
    check_commands(finished.bag, [target for _, target in peer.orders])
    identities = [identity for identity, _ in peer.orders]
    assert identities == list(range(identities[0], identities[0] + len(identities)))


def test_the_lines_agree_with_the_twin_to_within_their_uncertainty(recorded):
    check_displacements(recorded)


def test_the_bag_gives_the_same_result_and_it_is_right(recorded):
    check_result(recorded)
