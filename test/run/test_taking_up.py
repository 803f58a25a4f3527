"""A run that begins waits a little for slow nodes, and for silent ones until they wake."""

import pytest

from stepdiag_ros.run.supervision import MISSES, REFUSES, SILENCE_LIMIT, Peer, Watch
from stepdiag_ros.run.taking_up import (
    HELD_LIMIT,
    TAKE_UP_LIMIT,
    Patience,
    TakingUp,
    starting_words,
)

RUN = "run-1"
ROLES = ("recorder", "solver")
PERIOD = 0.1


class Nodes:
    """Nodes that beat or not, on a clock of the test's own."""

    def __init__(self):
        self.watch, self.now = Watch(), 0.0
        self.runs = dict.fromkeys((*ROLES, "interferometer"), "")
        self.silent, self.facts = set(), {}
        self.taking_up = TakingUp(RUN, ROLES, ("interferometer",))

    def look(self):
        """Let one period pass and return what is found."""
        self.now += PERIOD
        for role, run in self.runs.items():
            if role not in self.silent:
                peer = Peer(role, self.now, f"session of {role}", run)
                peer.facts = self.facts.get(role, {})
                self.watch.heard(f"/{role}", peer)
        self.watch.check(self.now)
        return self.taking_up.look(self.watch, self.now)

    def until(self, condition, limit):
        """Return the time that passes before a look fulfils a condition, and that look."""
        begun = self.now
        while self.now - begun < limit:
            found = self.look()
            if condition(found):
                return self.now - begun, found
        raise AssertionError(f"not within {limit} s")


@pytest.fixture
def nodes():
    made = Nodes()
    made.look()
    return made


def take_up(nodes, *roles):
    nodes.runs.update(dict.fromkeys(roles, RUN))


def test_a_run_begins_once_all_have_taken_it_up(nodes):
    take_up(nodes, "solver")
    found = nodes.look()
    assert not found.begins and "recorder" in found.text and "solver" not in found.text
    take_up(nodes, "recorder")
    assert nodes.look().begins


def test_a_node_that_is_heard_but_does_not_take_up_the_run_ends_it(nodes):
    take_up(nodes, "solver")
    waited, found = nodes.until(lambda one: one.gives_up, 3 * TAKE_UP_LIMIT)
    assert waited == pytest.approx(TAKE_UP_LIMIT, abs=0.5)
    assert "recorder" in found.text


def test_a_node_that_need_not_take_up_the_run_may_refuse_it_too(nodes):
    take_up(nodes, *ROLES)
    nodes.facts["interferometer"] = {REFUSES: f"{RUN} the plan leaves the cell"}
    found = nodes.look()
    assert found.gives_up and found.text == "the plan leaves the cell"


def test_a_node_that_refuses_the_run_ends_it_at_once_with_its_reason(nodes):
    take_up(nodes, "recorder")
    assert not nodes.look().gives_up
    for run, ends in (("run-0", False), (RUN, True)):
        facts = {REFUSES: f"{run} the plan does not fit"}
        nodes.watch.heard(
            "/solver", Peer("solver", nodes.now, "session of solver", "", facts=facts)
        )
        found = nodes.taking_up.look(nodes.watch, nodes.now)
        assert (found.gives_up, found.text == "the plan does not fit") == (ends, ends)


@pytest.mark.parametrize("asleep", ["recorder", "interferometer"])
def test_a_silent_node_is_named_within_three_seconds_and_the_run_goes_on_when_it_wakes(
    nodes, asleep
):
    take_up(nodes, *(role for role in ROLES if role != asleep))
    nodes.silent.add(asleep)
    waited, found = nodes.until(lambda one: "silent" in one.text, 3.0)
    assert SILENCE_LIMIT < waited < 3.0
    assert asleep in found.text and "kill -CONT" in found.text
    # Far longer than one that is awake may take.
    for _ in range(round(4 * TAKE_UP_LIMIT / PERIOD)):
        found = nodes.look()
        assert not found.begins and not found.gives_up
    nodes.silent.clear()
    # It needs a while for what it has missed.
    for _ in range(round(0.8 * TAKE_UP_LIMIT / PERIOD)):
        found = nodes.look()
        assert not found.gives_up
    take_up(nodes, asleep)
    assert nodes.look().begins


def test_a_run_waits_until_each_node_hears_the_one_that_woke(nodes):
    take_up(nodes, *ROLES)
    nodes.facts["solver"] = {MISSES: "/recorder /gone"}
    found = nodes.look()
    assert not found.begins and not found.gives_up
    assert "solver" in found.text and "recorder" in found.text
    # One that is lost to all is judged by its silence, and may have been replaced.
    nodes.facts["solver"] = {MISSES: "/gone"}
    assert nodes.look().begins


def test_a_run_whose_nodes_never_hear_each_other_ends(nodes):
    take_up(nodes, *ROLES)
    nodes.facts["solver"] = {MISSES: "/recorder"}
    waited, found = nodes.until(lambda look: look.gives_up, 2 * TAKE_UP_LIMIT)
    assert waited == pytest.approx(TAKE_UP_LIMIT, abs=3 * PERIOD) and "recorder" in found.text


def test_a_run_is_not_held_for_ever(nodes):
    take_up(nodes, "solver")
    nodes.silent.add("recorder")
    waited, found = nodes.until(lambda one: one.gives_up, 2 * HELD_LIMIT)
    assert waited == pytest.approx(HELD_LIMIT + SILENCE_LIMIT, abs=1.0)
    assert "recorder" in found.text and "kill -CONT" in found.text


def test_a_node_that_was_started_again_in_place_of_a_silent_one_will_do(nodes):
    take_up(nodes, "solver")
    nodes.silent.add("recorder")
    nodes.until(lambda one: "silent" in one.text, 3.0)
    other = Peer("recorder", nodes.now, "another session", RUN)
    nodes.watch.heard("/another_recorder", other)
    assert nodes.taking_up.look(nodes.watch, nodes.now).begins


def test_patience_counts_waiting_and_being_held_apart():
    patience = Patience(limit=5.0, held_limit=60.0)
    assert not patience.is_over(False, 100.0)
    assert not patience.is_over(False, 104.0)
    assert not patience.is_over(True, 160.0)
    assert not patience.is_over(False, 164.0)
    assert patience.is_over(False, 166.0)
    held = Patience(limit=5.0, held_limit=60.0)
    held.is_over(True, 0.0)
    assert not held.is_over(True, 59.0) and held.is_over(True, 61.0)


def test_what_is_waited_for_is_named_where_nodes_start():
    assert "recorder" not in starting_words(["recorder"], {}, 1.0)
    assert "recorder" in starting_words(["recorder"], {}, 10.0)
    stopped = starting_words(["recorder", "solver"], {"recorder": 4711}, 1.0)
    assert "recorder" in stopped and "kill -CONT 4711" in stopped and "solver" not in stopped
