"""A run on live nodes, with viewers: one hears all, one comes late, one takes nothing."""

import re
import signal
import subprocess
from pathlib import Path

import pytest
from foxglove_viewer import Viewer
from patience import PATIENCE

from stepdiag_ros import topics
from stepdiag_ros.bags.folder import open_bag
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.metrology.frames import LASER, MIRROR, TOOL, WORKPIECE
from stepdiag_ros.nodes.foxglove_server import SHOWN, STREAMS, FoxgloveServerNode
from stepdiag_ros.processes.following import FollowedRun
from stepdiag_ros.processes.node_process import NodeProcess
from stepdiag_ros.run.sequence import State
from stepdiag_ros.run.supervision import ONLOOKERS

LAYOUT = Path(__file__).parents[3] / "config" / "foxglove" / "stepdiag.json"
SETTLED = tuple(one for one in SHOWN if one.recorded and one not in (*STREAMS, topics.DIAGNOSTICS))
"""What comes seldom, and is recorded; of the heartbeats some come before the bag is open."""


class Seen:
    """The viewers of one run, and the bag of it: topic → bytes in the order of recording."""

    def __init__(self, cell):
        self.all = Viewer(cell.port)
        self.stalled = Viewer(cell.port, reads=False)
        self.late = Viewer(cell.port)
        self.bag, self.recorded_at = {}, {}

    def follow(self, cell):
        joined = []

        def tell(told):
            if told.done > told.total // 2 and not joined:
                joined.append(self.late.__enter__())
                self.late.subscribe()

        with self.all, self.stalled:
            for viewer in (self.all, self.stalled):
                viewer.subscribe()
            cell.wait(lambda: self.all.times, "the server tells the time")
            FollowedRun(
                cell.operator, tell, lambda: None, lambda state, _: state is State.WAITING_FOR_SETUP
            ).measure()
            with open_bag(cell.bag()) as bag:
                for record in bag.records():
                    self.bag.setdefault(record.topic, []).append(record.data)
                    self.recorded_at[record.data] = record.log_time
            name = topics.absolute(topics.RUN_STATE)
            for viewer in (self.all, self.late):
                cell.wait(
                    lambda viewer=viewer: self.bag[name][-1] in received(viewer, topics.RUN_STATE),
                    "the end of the run is told",
                )
            self.late.__exit__()
            self.taken_while_stalled = dict(self.stalled.messages)
        return self


def received(viewer, topic):
    found = [data for _, data in viewer.messages[topics.absolute(topic)]]
    if topic is topics.RUN_DESCRIPTION:
        # The recorder writes it anew, and CDR leaves open what stands behind the last field.
        found = [own_types().normal(topic.type_name, data) for data in found]
    return found


@pytest.fixture(scope="module")
def seen(cell):
    return Seen(cell).follow(cell)


def test_every_topic_of_the_layout_is_on_offer(seen):
    named = set(re.findall(r'"(/[\w/]+)', LAYOUT.read_text()))
    assert len(named) > 6
    assert named <= set(seen.all.channels)
    assert set(seen.all.channels) == {topics.absolute(topic) for topic in SHOWN}
    for topic in SHOWN:
        channel = seen.all.channels[topics.absolute(topic)]
        assert channel["schemaName"] == topic.type_name
        assert channel["schema"] == own_types().schema(topic.type_name)


@pytest.mark.parametrize("topic", SETTLED, ids=lambda topic: topic.name)
def test_a_viewer_gets_what_the_recorder_gets(seen, topic):
    wanted = seen.bag.get(topics.absolute(topic), [])
    got = received(seen.all, topic)
    if not wanted:
        assert topic is topics.DIAGNOSIS and not got
        return
    if topic.qos.depth == 1:
        # Each takes the place of the one before, which a slow subscriber may then never get.
        places = [wanted.index(data) for data in got if data in wanted]
        assert places == sorted(places) and places[-1] == len(wanted) - 1
        return
    first = got.index(wanted[0])
    assert got[first : first + len(wanted)] == wanted


@pytest.mark.parametrize("topic", STREAMS, ids=lambda topic: topic.name)
def test_what_comes_often_is_what_was_recorded(seen, topic):
    recorded = seen.bag.get(topics.absolute(topic), [])
    got = received(seen.all, topic)
    if not recorded:
        assert topic is topics.SAMPLES and not got
        return
    places = {data: place for place, data in enumerate(recorded)}
    inside = [data for data in got if data in places]
    assert len(inside) > 0.5 * len(recorded)
    # In order, and nothing in between that the recorder did not hear.
    first, last = got.index(inside[0]), len(got) - got[::-1].index(inside[-1])
    assert got[first:last] == inside
    assert [places[data] for data in inside] == sorted(places[data] for data in inside)


def test_log_times_are_those_of_the_run(seen):
    # In simulated time, as the recorder's; real time would be most of a minute behind at the end.
    time, data = seen.all.messages[topics.absolute(topics.STOP)][-1]
    assert abs(time - seen.recorded_at[data]) < 10_000_000_000
    assert seen.all.times == sorted(seen.all.times)


def test_frames_and_markers_come_through(seen):
    types = own_types()
    (fixed,) = received(seen.late, topics.FIXED_FRAMES)[:1]
    frames = types.decode(topics.FIXED_FRAMES.type_name, fixed).transforms
    assert {one.child_frame_id for one in frames} == {WORKPIECE, MIRROR, LASER}
    moving = types.decode(topics.FRAMES.type_name, received(seen.all, topics.FRAMES)[-1])
    assert [one.child_frame_id for one in moving.transforms] == [TOOL]
    for topic in (topics.RUN_MARKERS, topics.ERROR_MARKERS):
        assert types.decode(topic.type_name, received(seen.late, topic)[0]).markers


@pytest.mark.parametrize(
    "topic", (topics.RUN_DESCRIPTION, topics.LINE), ids=lambda topic: topic.name
)
def test_who_comes_late_gets_what_holds_once(seen, topic):
    assert received(seen.late, topic) == seen.bag[topics.absolute(topic)]


def test_who_comes_late_hears_nothing_that_is_over(seen):
    stops = received(seen.late, topics.STOP)
    assert 0 < len(stops) < len(seen.bag[topics.absolute(topics.STOP)])


def test_a_viewer_that_takes_nothing_has_held_up_nobody(seen):
    # The run is finished, and the other viewers have all of it; this one has taken nothing.
    assert not seen.taken_while_stalled


@pytest.mark.usefixtures("seen")
def test_it_hears_what_comes_often_only_while_a_viewer_wants_it(cell):
    node, names = "foxglove_server", {topics.absolute(topic) for topic in STREAMS}

    def heard():
        told = cell.operator.get_subscriber_names_and_types_by_node(node, "/")
        return names & {name for name, _ in told}

    cell.wait(lambda: not heard(), "nothing is heard when nobody looks on")
    with Viewer(cell.port) as viewer:
        viewer.subscribe(topics.absolute(topics.READING))
        cell.wait(lambda: heard() == {topics.absolute(topics.READING)}, "readings are heard")
        cell.wait(lambda: received(viewer, topics.READING), "a reading comes")
    cell.wait(lambda: not heard(), "nothing is heard when nobody looks on any more")


def test_a_measurement_may_be_started_beside_it():
    assert FoxgloveServerNode.role in ONLOOKERS


def test_a_second_server_on_the_port_says_so_and_ends(cell):
    command = NodeProcess("foxglove_server", {"port": cell.port}).command()
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 1
    assert "stepdiag: error: viewers cannot be served on 127.0.0.1 port" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.usefixtures("seen")
def test_it_ends_in_order(cell):
    process = cell.processes.running["foxglove_server"]
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE) == 0
    assert "Traceback" not in cell.log("foxglove_server")
