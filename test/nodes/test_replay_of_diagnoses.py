"""A replay compares the conclusive diagnosis alone, and has it made as it was made in the run."""

from dataclasses import replace
from pathlib import Path

import pytest
import rclpy
from patience import PATIENCE

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros import topics
from stepdiag_ros.bags.header import RunHeader
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.bags.runs import FoundRun
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.messages.diagnosis import from_diagnosis
from stepdiag_ros.processes.replay import _compared_as, _judged_by

NAME = topics.absolute(topics.DIAGNOSIS, "/cell")
TYPE = topics.DIAGNOSIS.type_name
EARLIER = Path(__file__).parents[1] / "data" / "bags" / "schema_1.mcap"
(RECORDED,) = load_run(EARLIER).diagnoses


def encoded(**changes):
    message = from_diagnosis(replace(RECORDED, **changes), "run", own_types().new)
    return own_types().encode(TYPE, message)


@pytest.fixture
def bag(tmp_path):
    header = RunHeader("run", "plan", "0.1.0", 1, "none", 1, "", "", "")
    with BagWriter(tmp_path / "a.mcap", header) as writer:
        for time, run_over in enumerate((False, False, True), start=1):
            writer.write(NAME, TYPE, encoded(lines=time, run_over=run_over), time)
    with BagReader(tmp_path / "a.mcap") as reader:
        yield reader


RUN = FoundRun("/cell", None, -(2**63), 2**63, alone=True)


def test_the_node_is_given_model_and_seed_of_the_recording(bag, tmp_path):
    given = _compared_as(bag, RUN, tmp_path)
    assert given["model"].read_text(encoding="utf-8") == RECORDED.model.text
    assert given["seed"] == RECORDED.seed != 0


@pytest.mark.parametrize("tolerance", [1e-5, float("nan")])
def test_the_solver_judges_by_the_tolerance_of_the_recording(tmp_path, tolerance):
    header = RunHeader("run", "plan", "0.1.0", 1, "none", 1, "", "", "")
    kind = topics.RUN_VERDICT.type_name
    name = topics.absolute(topics.RUN_VERDICT, "/cell")
    with BagWriter(tmp_path / "v.mcap", header) as writer:
        message = own_types().new(kind)
        message.run_id, message.tolerance = "run", tolerance
        writer.write(name, kind, own_types().encode(kind, message), 1)
    with BagReader(tmp_path / "v.mcap") as reader:
        assert _judged_by(reader, RUN) == ({"tolerance": 1e-5} if tolerance == 1e-5 else {})


def test_a_bag_without_a_verdict_has_no_tolerance(bag):
    assert _judged_by(bag, RUN) == {}


def test_only_the_last_conclusive_diagnosis_is_compared(bag):
    from stepdiag_ros.nodes.player import Played, PlayerNode

    rclpy.init(args=[])
    try:
        player = PlayerNode(bag, RUN, derived=False, late=False)
        player.listen_to_derived((topics.DIAGNOSIS,))
        conclusive = encoded(lines=3, run_over=True)
        heard = player._heard[NAME]
        # A slower computer: fewer before it, and one of too few lines when the run was over.
        heard += [encoded(lines=2, run_over=True), conclusive]
        compared = player.compare(Played(0, 0.0, 0.0), quiet=0.0, patience=0.0)
        assert compared.same == {NAME: True}
        heard[-1] = encoded(lines=3, run_over=True, noise=1.0000001e-7)
        compared = player.compare(Played(0, 0.0, 0.0), quiet=0.0, patience=0.0)
        assert compared.same == {NAME: False}
        assert "number 1 is the first that differs" in compared.differences[NAME]
        heard.clear()
        assert player.compare(Played(0, 0.0, 0.0), quiet=0.0, patience=0.0).same == {NAME: False}
        # A busy computer is quiet for a while before the last diagnosis.
        player.every(0.2, lambda: heard or heard.append(conclusive), real=True)
        compared = player.compare(Played(0, 0.0, 0.0), quiet=0.0, patience=PATIENCE)
        assert compared.same == {NAME: True}
    finally:
        rclpy.try_shutdown()


def test_messages_of_an_earlier_definition_are_played_to_nodes_of_today():
    from stepdiag_ros.nodes.player import PlayerNode

    rclpy.init(args=[])
    try:
        with BagReader(EARLIER) as earlier:
            assert earlier.types.differs(topics.RUN_DESCRIPTION.type_name)
            player = PlayerNode(earlier, replace(RUN, namespace="/"), derived=False, late=False)
            player.open()
            names = set(player._played)
            # The client refuses bytes that are not a message of its own definition.
            played = player.play(0.0, lambda _part: None)
            recorded = [one for one in earlier.records() if one.topic in names]
            assert played.messages == len(recorded) > 5
            player.destroy_node()
    finally:
        rclpy.try_shutdown()
