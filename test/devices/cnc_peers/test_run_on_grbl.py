"""A whole measurement through the Grbl driver, over TCP, with a link that breaks in a move."""

import pytest
from grbl_peer import GrblPeer
from peer_run import PeerRun, answers_of, check_commands, check_displacements, check_result

from stepdiag_ros.bags.run import load_run
from stepdiag_ros.run.sequence import Answer, State

pytestmark = pytest.mark.timeout(600)
BREAKS_IN = 25
"""Number of the move, in the second step diagonal."""


@pytest.fixture(scope="module")
def peer():
    made = GrblPeer()
    made.halfway[BREAKS_IN] = made.hang_up
    made.where_held = []
    yield made
    made.close()


@pytest.fixture(scope="module")
def finished(peer, tmp_path_factory):
    settings = {
        "connection": {"url": peer.url},
        "report_rate_hz": 50,
        "without_homing": True,
        # A busy computer is no silence.
        "silence_s": 5.0,
    }
    return PeerRun(
        tmp_path_factory.mktemp("run"),
        "grbl",
        settings,
        lambda: peer.where_held.append((peer.where_it_stops(), len(peer.made))),
    )


@pytest.fixture(scope="module")
def recorded(finished):
    return load_run(finished.bag)


def test_the_broken_link_held_the_run_until_somebody_resumed_it(finished, peer, recorded):
    ((state, text),) = finished.held
    assert state is State.FAULT and "is broken" in text
    assert peer.connections == 2 and not peer.halfway
    # Grbl has no watchdog: it has finished the one line that it had, and nothing came after it.
    assert peer.where_held == [(peer.made[BREAKS_IN - 1], BREAKS_IN)]
    broken = ["is broken" in text for _, text in answers_of(finished.bag, Answer.FAULT)]
    assert sum(broken) == 1 and len(broken) <= finished.resumed
    attempts = {str(line.line): line.attempt for line in recorded.lines}
    assert len(recorded.lines) == len(attempts) == len(recorded.plan.lines)
    # Only a line that was broken off is measured again.
    assert 1 <= sum(attempts.values()) - len(attempts) <= finished.resumed


def test_no_move_is_lost_or_made_twice(finished, peer):
    check_commands(finished.bag, peer.made)


def test_the_lines_agree_with_the_twin_to_within_their_uncertainty(recorded):
    check_displacements(recorded)


def test_the_bag_gives_the_same_result_and_it_is_right(recorded):
    check_result(recorded)
