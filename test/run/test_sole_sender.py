"""One node commands the machine; whoever else could is named, and stops it."""

import pytest
from refused import refused

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.run.health import Level
from stepdiag_ros.run.sole_sender import GHOST_LIMIT, Sender, SoleSender

COMMAND, PERMIT = TOPICS = "machine/command", "machine/permit"


def of(node, tag):
    return [Sender(topic, node, f"{tag}{number}") for number, topic in enumerate(TOPICS)]


ONE, OTHER = of("/sequencer", "a"), of("/rogue", "b")
AGAIN = of("/sequencer", "c")


@pytest.fixture
def sole():
    return SoleSender(TOPICS)


def test_one_node_is_bound_and_told(sole):
    assert sole.judge(ONE, 0.0).level is Level.OK
    sole.bind(ONE, 0.0)
    found = sole.judge(ONE, 1.0)
    assert found.level is Level.OK and "/sequencer alone" in found.message
    assert set(found.values.values()) == {"a0", "a1"}
    # A publisher that the graph does not show for a moment is no stranger.
    assert sole.judge(ONE[:1], 1.0).level is sole.judge([], 1.0).level is Level.OK


@pytest.mark.parametrize(
    ("present", "said"),
    [
        ([], "no node publishes machine/command"),
        (ONE[:1], "no node publishes machine/permit"),
        (ONE + OTHER, "/rogue and node /sequencer"),
        (ONE + OTHER[1:], "/rogue and node /sequencer"),
        (ONE[:1] + OTHER[1:], "/rogue and node /sequencer"),
        (ONE + AGAIN, "two processes named node /sequencer"),
        (ONE + of("", "d"), "a publisher without a node (d0)"),
        (of("", "d"), "not known yet which node"),
    ],
)
def test_nobody_is_bound_unless_he_is_alone(sole, present, said):
    with pytest.raises(ValueError) as refused:
        sole.bind(present, 0.0)
    assert said in str(refused.value)
    assert sole.judge(ONE, 0.0).message == "nobody commands the machine: no run is released"


@pytest.mark.parametrize("stranger", [*OTHER, *AGAIN, Sender(PERMIT, "", "e0")])
def test_a_stranger_is_named_and_forbids_the_run(sole, stranger):
    sole.bind(ONE, 0.0)
    found = sole.judge([*ONE, stranger], 1.0)
    assert found.forbids and found.level is Level.ERROR
    assert found.message.startswith(f"{stranger.who} publishes {stranger.topic} beside node /seq")
    with refused(Refusal, "busy"):
        sole.bind([*ONE, stranger], 1.0)
    # Alone, he is still not the one that this run was bound to.
    instead = sole.judge([stranger], 1.0)
    assert instead.level is Level.WARN and "in place of node /sequencer" in instead.message
    with pytest.raises(ValueError):
        sole.bind([stranger], 1.0)
    both = [Sender(topic, stranger.node, f"f{topic}") for topic in TOPICS]
    if stranger.node:
        with refused(Refusal, "mismatch"):
            sole.bind(both, 1.0)
    assert sole.judge(ONE, 2.0).level is Level.OK


def test_another_run_may_be_of_another_sequencer(sole):
    sole.bind(ONE, 0.0)
    sole.begin_run()
    sole.bind(AGAIN, 1.0)
    assert sole.judge(AGAIN, 2.0).level is Level.OK
    assert "beside" in sole.judge(ONE + AGAIN, 2.0).message


def test_what_the_graph_still_shows_of_a_dead_process_is_no_stranger_for_a_while(sole):
    sole.bind(ONE, 0.0)
    sole.lost(5.0)
    assert sole.judge(AGAIN + ONE, 6.0).level is Level.OK
    with refused(Refusal, "mismatch"):
        sole.bind(AGAIN + ONE, 6.0)
    sole.begin_run()
    sole.bind(AGAIN + ONE, 6.0)
    assert sole.judge(AGAIN + ONE, 5.0 + GHOST_LIMIT).level is Level.OK
    assert "beside" in sole.judge(AGAIN + ONE, 6.0 + GHOST_LIMIT).message
    # Nobody else profits from it.
    assert "/rogue" in sole.judge(AGAIN + OTHER, 7.0).message
    assert "/rogue" in sole.judge(AGAIN + ONE + OTHER, 7.0).message


def test_one_that_was_only_silent_goes_on(sole):
    sole.bind(ONE, 0.0)
    sole.lost(5.0)
    assert sole.judge(ONE, 5.5).level is Level.OK
    sole.bind(ONE, 6.0)
    assert "taken from" in sole.judge(ONE, 7.0).message
    # It lives: beside another one it is no ghost.
    sole.begin_run()
    with refused(Refusal, "busy", "/rogue", "/sequencer"):
        sole.bind(ONE + OTHER, 8.0)
