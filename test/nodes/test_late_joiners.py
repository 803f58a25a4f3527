"""Who joins a run late gets all that holds: a second recorder, and a monitor over a bridge."""

import subprocess
import sys

from patience import PATIENCE
from rclpy.qos import QoSProfile

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros import topics
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.repetitions import without_repetitions
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.evaluation.recorded_run import measurement_of
from stepdiag_ros.nodes.links import message_class
from stepdiag_ros.run.sequence import State

HELD = (topics.RUN_DESCRIPTION, topics.LINE, topics.VOLUMETRIC_ERRORS, topics.POSITIONING_TEST)
VOLATILE = QoSProfile(depth=1000)


def normal(topic, data):
    """Return the bytes of a message without what a middleware may have filled up behind it."""
    types = own_types()
    return types.encode(topic.type_name, types.decode(topic.type_name, data))


def said(bag, topic):
    return [normal(topic, record.data) for record in bag.records(topics=(topics.absolute(topic),))]


def newest(bag, topic):
    """Return the newest message of each kind that holds side by side."""
    found = {}
    for data in said(bag, topic):
        message = bag.types.decode(topic.type_name, data)
        found[tuple(getattr(message, field) for field in topic.newest_of_each)] = data
    return found


def test_a_late_recorder_and_a_volatile_monitor_get_everything(make_cell, tmp_path):
    late_folder = tmp_path / "late"
    late_recorder = [sys.executable, "-m", "stepdiag_ros.nodes.recorder", "--ros-args"]
    late_recorder += ["-r", "__node:=late_recorder", "-p", "use_sim_time:=true"]
    late_recorder += ["-p", f"folder:='{late_folder}'"]
    with make_cell() as cell:
        run_id = cell.start()
        cell.wait(lambda: len(cell.lines) >= 2, "two lines")
        cell._insist(lambda: cell.operator.call("sequencer/pause"))
        cell.wait_for_state(State.PAUSED)
        process = subprocess.Popen(late_recorder)
        peers = cell.operator.watch.peers
        cell.wait(
            lambda: "/late_recorder" in peers and peers["/late_recorder"].run_id == run_id,
            "the late recorder has taken up the run",
        )
        seen = {topic: set() for topic in HELD}
        for topic in HELD:
            cell.operator.create_subscription(
                message_class(topic),
                topic.name,
                lambda data, topic=topic: seen[topic].add(normal(topic, data)),
                VOLATILE,
                raw=True,
            )
        # Who looks on asks for what was before, and who acts on stops is told of no old ones.
        asked, new = [], []
        cell.operator.listen(topics.STOP, new.append)
        assert not cell.operator.spin_until(lambda: new, 1.0)
        cell.operator.listen(topics.STOP, asked.append, past=True)
        cell.wait(lambda: len(asked) == len(cell.stops), "all stops so far")
        assert [one.command_id for one in asked] == [one.command_id for one in cell.stops]
        assert len(asked) > 5
        cell.resume()
        cell.wait_for_state(State.FINISHED)
        cell.wait(lambda: len(asked) == len(cell.stops), "all stops")
        before = len(asked) - len(new)
        assert asked == cell.stops and new == asked[before:] and before > 5

        def both_are_closed():
            recorders = [p for p in cell.operator.watch.peers.values() if p.role == "recorder"]
            closed = [peer.text.startswith("ready; recorded") for peer in recorders]
            return closed == [True, True]

        cell.wait(both_are_closed, "both bags are closed")
        (whole,) = cell.folder.glob("*.mcap")
        run = load_run(whole)
        cell.wait(
            lambda: len(seen[topics.LINE]) == len(run.lines),
            "every line is said again",
        )
        process.terminate()
        assert process.wait(PATIENCE) == 0

    (late,) = late_folder.glob("*.mcap")
    with BagReader(whole) as first, BagReader(late) as second:
        for bag in (first, second):
            records = list(bag.records())
            # Once each, however often it was said.
            assert len(said(bag, topics.RUN_DESCRIPTION)) == 1
            assert list(without_repetitions(records)) == records
        # In any order: a late recorder is sent what is latched before or after what is new.
        assert set(said(second, topics.LINE)) == set(said(first, topics.LINE))
        for topic in HELD[2:]:
            assert newest(second, topic) == newest(first, topic), topic.name
        for topic in HELD:
            assert set(newest(first, topic).values()) <= seen[topic], topic.name
            assert seen[topic] <= set(said(first, topic)), topic.name

    again = load_run(late)
    assert again.begun_late
    assert not run.begun_late
    measurement, words = measurement_of(again, False, lambda _done, _text="": None)
    assert "the recording began after the run" in words
    assert len(measurement.lines) == len(run.measurement.lines)
