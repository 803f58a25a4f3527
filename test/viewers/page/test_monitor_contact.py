"""Who is heard, who has gone, and what the sections say of it."""

import re
from dataclasses import replace

import pytest

from stepdiag_ros import topics
from stepdiag_ros.evaluation.diagnosing import diagnose_lines
from stepdiag_ros.metrology.discrepancy import CONSISTENT, NOT_TESTABLE
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.run.sequence import State as RunState
from stepdiag_ros.run.supervision import BYSTANDERS, SILENCE_LIMIT, Peer, Watch
from stepdiag_ros.viewers.page.contact import FRESH, QUIET_AFTER, contact_of
from stepdiag_ros.viewers.page.items import AxisPlace, Said
from stepdiag_ros.viewers.page.state import PageState

NODES = ("sequencer", "cnc_bridge", "interferometer", "recorder", "operator")
AIR = Environment(20.5, 101_325.0, 0.45, 20.0)


class Graph:
    """Nodes that beat until they are ended, as an onlooker hears them; time is told."""

    def __init__(self, state, roles=NODES):
        self.state, self.watch, self.newest, self.now = state, Watch(), {}, 0.0
        self.alive = set(roles)
        self.pass_by(0.5)

    def pass_by(self, seconds):
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.now += 0.25
            for role in self.alive:
                self.watch.heard(f"/{role}", Peer(role, self.now, f"session of {role}", ""))
            self.watch.check(self.now)
            self.state.take(contact_of(self.watch, self.newest, self.now))

    def faults(self):
        told = self.state.document("faults")
        return [one["text"] for one in told["faults"]], told["note"]


@pytest.fixture
def state(small_run):
    made = PageState()
    made.take(small_run.begin)
    return made


def read(graph):
    graph.newest[topics.READING.name] = graph.newest[topics.JOINT_STATES.name] = graph.now
    graph.state.take(Reading(0, 1, 0.1, 0.1, 0.9, 0, AIR))
    graph.state.take(AxisPlace(0, (0.01, 0.02, 0.03)))


def test_nobody_heard_is_not_said_to_be_well():
    state = PageState()
    assert state.document("faults")["note"] == "no message yet"
    graph = Graph(state, ())
    faults, note = graph.faults()
    assert not faults and {"'stepdiag run'", "'stepdiag measure'"} <= set(re.findall("'.+?'", note))
    graph.alive = set(NODES)
    graph.pass_by(0.5)
    assert graph.faults() == ([], "")


def test_a_bag_has_no_contact_and_lacks_none():
    state = PageState()
    state.take(Said("recorder: disk", 0, "fine"))
    assert state.document("faults") == {
        "faults": [],
        "more": 0,
        "starting": [],
        "note": "",
    }
    assert state.document("run")["refused_start"] == ""


def test_nodes_that_end_with_their_run_are_no_fault(state, small_run):
    graph = Graph(state)
    state.take(small_run.status(state=RunState.FINISHED))
    graph.alive.clear()
    graph.pass_by(SILENCE_LIMIT + 0.5)
    assert graph.faults() == ([], "the run is over, and its nodes have ended")
    # They are back for the next run.
    graph.alive = set(NODES)
    graph.pass_by(0.5)
    assert graph.faults() == ([], "")


def test_one_silent_node_stays_a_fault(state, small_run):
    graph = Graph(state)
    state.take(small_run.status(state=RunState.FINISHED))
    graph.alive.remove("recorder")
    graph.pass_by(SILENCE_LIMIT + 5.0)
    (text,), note = graph.faults()
    assert text == "recorder node /recorder is silent" and note == ""
    # The operator's command ends with its run, and no node is missed by that.
    graph.alive.remove("operator")
    graph.pass_by(SILENCE_LIMIT + 0.5)
    assert len(graph.faults()[0]) == 1


def test_all_nodes_silent_in_a_run_are_one_fault(state, small_run):
    graph = Graph(state)
    state.take(small_run.status())
    graph.alive.clear()
    graph.pass_by(SILENCE_LIMIT + 0.5)
    (text,), note = graph.faults()
    assert all((f"/{name}" in text) == (name not in BYSTANDERS) for name in NODES) and note == ""


def test_a_beam_that_nobody_tells_of_is_not_known(state):
    graph = Graph(state)
    read(graph)
    graph.pass_by(1.0)
    assert state.document("beam")["state"] == "good" and state.document("position")["at"]
    graph.alive -= {"interferometer", "cnc_bridge"}
    graph.pass_by(SILENCE_LIMIT + 0.5)
    told = state.document("beam")
    assert told["words"] == "not known: the interferometer is silent"
    assert (told["state"], told["strength"], told["percent"]) == (None, None, "unknown")
    told = state.document("position")
    assert told["words"] == "not known: the bridge to the machine is silent"
    assert told["at"] is None and set(told["texts"].values()) == {"unknown"}


def test_readings_that_come_no_more_are_not_what_holds_now(state):
    graph = Graph(state)
    read(graph)
    graph.pass_by(QUIET_AFTER + 0.5)
    assert state.document("beam")["words"] == "not known: no reading has come for 3 s"
    assert state.document("position")["words"] == "not known: no position has come for 3 s"
    read(graph)
    graph.pass_by(0.25)
    assert state.document("beam")["state"] == "good"
    assert state.document("position")["words"] == ""
    assert state.document("position")["at"] == [10.0, 20.0, 30.0]


def test_what_never_came_is_not_said_to_have_stopped(state):
    graph = Graph(state)
    graph.pass_by(QUIET_AFTER + 1.0)
    assert state.document("beam")["words"] == "no reading has come yet"
    assert state.document("position")["words"] == "not known: no position has come yet"


def test_nothing_can_be_started_where_nobody_leads(state):
    assert state.document("run")["refused_start"] == ""
    graph = Graph(state, ("recorder",))
    assert state.document("run")["refused_start"] == "no message from a sequencer"
    graph.alive.add("by_hand")
    graph.pass_by(0.5)
    assert state.document("run")["refused_start"] == ""
    graph.alive.remove("by_hand")
    graph.pass_by(SILENCE_LIMIT + 0.5)
    assert state.document("run")["refused_start"] == "no message from a sequencer"


def test_only_what_has_changed_is_told_again(state):
    graph = Graph(state)
    known = state.revision
    graph.pass_by(2.0)
    assert state.revision == known


def test_who_was_heard_a_moment_ago_is_still_at_work():
    watch = Watch()
    watch.heard("/solver", Peer("solver", 1.0, "a", ""))
    watch.heard("/scene", Peer("scene", 9.0, "b", ""))
    assert contact_of(watch, {}, 1.0 + FRESH - 0.1).at_work
    assert not contact_of(watch, {}, 1.0 + FRESH + 0.1).at_work


@pytest.fixture(scope="module")
def summary(small_run):
    return diagnose_lines(small_run.measurement, small_run.plan, "name: free\n", 0)


def test_what_later_lines_may_tell_is_not_advised_before(state, summary):
    planned = summary.lines_planned
    untold = replace(summary, verdict=NOT_TESTABLE, lines=1, run_over=False)
    state.take(untold)
    assert state.document("verdict") == {
        "verdict": None,
        "sentence": f"not yet: 1 of {planned} passes do not show whether model and run agree",
    }
    # Once no line is left, or the run is over, it is as the diagnosis has it.
    for final in (replace(untold, lines=planned), replace(untold, run_over=True)):
        state.take(final)
        assert state.document("verdict")["verdict"] == NOT_TESTABLE
        assert state.document("verdict")["sentence"] == summary.sentence


def test_an_early_verdict_that_tells_something_is_told(state, summary):
    state.take(replace(summary, verdict=CONSISTENT, lines=1, run_over=False))
    assert state.document("verdict")["verdict"] == CONSISTENT
