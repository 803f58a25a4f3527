"""Whom the result of a run waits for, for how long, and what it then says."""

import re
from pathlib import Path

import pytest
from refused import refused

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.run.conclusion import LAST_WORD_LIMIT, Aftermath, Outcome
from stepdiag_ros.run.supervision import WORKER_LIMIT, Peer, Watch

RUN = "20261121T110000Z-abcdef"
LIMIT = 60.0


class Scene:
    """A watch with nodes that the test lets speak, and a clock."""

    def __init__(self) -> None:
        self.watch = Watch()
        self.now = 100.0
        self.aftermath = Aftermath(RUN, LIMIT)

    def says(self, role, run_id=RUN, text="", faulty=False, **facts):
        said = {
            name: value if name == "work_left" else f"{RUN} {value}"
            for name, value in facts.items()
        }
        peer = Peer(role, self.now, f"{role} session", run_id, text, faulty, said)
        self.watch.heard(f"/{role}", peer)

    def ends(self):
        self.aftermath.over(self.now)

    def waits(self, seconds):
        self.now += seconds
        for peer in self.watch.peers.values():
            peer.last_seen = self.now

    def awaited(self):
        return self.aftermath.awaited(self.watch, self.now)

    def conclusion(self):
        return self.aftermath.conclusion(self.watch)


@pytest.fixture
def scene():
    return Scene()


def test_a_run_that_goes_on_has_no_aftermath(scene):
    with refused(Refusal, "busy", RUN):
        scene.awaited()


def test_the_bag_the_results_and_the_verdict_are_waited_for(scene):
    scene.says("recorder", bag="/bags/with a blank/run.mcap")
    scene.says("solver", work_left="2")
    scene.says("diagnosis", work_left="1")
    scene.ends()
    assert scene.awaited() == "waiting for the last results (diagnosis, solver)"
    scene.says("solver", work_left="0")
    assert scene.awaited() == "waiting for the last results (diagnosis)"
    # What is said of another run, or of a part of this one, is no verdict on it.
    scene.aftermath.diagnosed("another", "NAMED", "of another run", True)
    scene.aftermath.diagnosed(RUN, "NAMED", "of the lines so far", False)
    scene.says("diagnosis", work_left="0")
    assert scene.awaited() == "waiting for the verdict"
    scene.aftermath.diagnosed(RUN, "CONSISTENT", "They agree.", True)
    assert scene.awaited() == "waiting for the bag to be closed"
    scene.says("recorder", bag="/bags/with a blank/run.mcap", bag_closed="4340")
    assert scene.awaited() == ""
    said = scene.conclusion()
    assert (said.verdict, said.sentence) == ("CONSISTENT", "They agree.")
    assert said.bag == "/bags/with a blank/run.mcap"
    assert said.bag_closed and said.bag_text == "closed, 4340 messages"


def test_nobody_is_waited_for_longer_than_the_limit(scene):
    scene.says("recorder", bag="/run.mcap")
    scene.says("diagnosis", work_left="1")
    scene.ends()
    scene.waits(LIMIT)
    assert scene.awaited() == "waiting for the last results (diagnosis)"
    # Only the first end counts.
    scene.ends()
    scene.waits(0.1)
    assert scene.awaited() == ""
    said = scene.conclusion()
    assert said.verdict == "UNKNOWN"
    assert said.sentence == "the diagnosis was not done in time"
    assert said.bag == "/run.mcap" and not said.bag_closed
    assert said.bag_text == "the recorder has not closed the bag in time"


def test_a_diagnosis_that_has_nothing_to_say_is_waited_for_shortly(scene):
    scene.says("diagnosis", work_left="1")
    scene.ends()
    scene.waits(20.0)
    assert "results" in scene.awaited()
    scene.says("diagnosis", work_left="0")
    # Its last word may come after the heartbeat that says that it is done.
    scene.waits(LAST_WORD_LIMIT - 0.1)
    assert scene.awaited() == "waiting for the verdict"
    scene.waits(0.2)
    assert scene.awaited() == ""
    assert "not published" in scene.conclusion().sentence


def test_nodes_that_are_not_there_are_not_waited_for(scene):
    scene.ends()
    assert scene.awaited() == ""
    said = scene.conclusion()
    assert said.verdict == "UNKNOWN" and said.sentence == "no diagnosis node is running"
    assert said.bag == "" and not said.bag_closed and said.bag_text.startswith("no recorder")
    # Nor are those that work on another run, or know nothing of this one.
    scene.says("diagnosis", run_id="another", work_left="0")
    scene.says("recorder", run_id="another")
    assert scene.awaited() == ""
    assert scene.conclusion().bag == ""


def test_nodes_that_were_lost_are_not_waited_for_and_named(scene):
    scene.says("recorder", bag="/run.mcap")
    scene.says("diagnosis", work_left="1")
    scene.ends()
    scene.now += 3.0
    assert len(scene.watch.check(scene.now)) == 2
    # Nothing moves any more: a computer that is busy with the last results gets some time.
    assert scene.awaited() == "waiting for the last results (diagnosis)"
    scene.now += WORKER_LIMIT
    assert scene.awaited() == ""
    said = scene.conclusion()
    assert said.sentence == "diagnosis node /diagnosis is silent for 3.0 s"
    assert said.bag == "/run.mcap" and not said.bag_closed
    assert said.bag_text == "recorder node /recorder is silent for 3.0 s"


def test_failures_are_told_in_the_words_of_those_who_failed(scene):
    scene.says("recorder", bag="/run.mcap", bag_failure="/run.mcap: the disk is full")
    scene.says("diagnosis", faulty=True, text="the lines cannot be diagnosed: too few")
    scene.ends()
    scene.waits(LAST_WORD_LIMIT)
    assert scene.awaited() == ""
    said = scene.conclusion()
    assert said.sentence == "the lines cannot be diagnosed: too few"
    assert not said.bag_closed and said.bag_text == "/run.mcap: the disk is full"


def test_of_two_recorders_the_one_that_was_heard_last_counts(scene):
    scene.says("recorder", bag="/run.mcap")
    scene.now += 1.0
    peer = Peer("recorder", scene.now, "another", RUN, facts={"bag": f"{RUN} /run_part2.mcap"})
    scene.watch.heard("/second_recorder", peer)
    assert scene.conclusion().bag == "/run_part2.mcap"


def test_the_outcomes_are_those_of_the_action():
    text = (Path(__file__).parents[2] / "action" / "Measure.action").read_text(encoding="utf-8")
    found = re.findall(r"^uint8 OUTCOME_(\w+)=(\d+)", text, re.MULTILINE)
    assert {name: int(number) for name, number in found} == {
        outcome.name: outcome.value for outcome in Outcome
    }
