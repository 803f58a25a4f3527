"""Whatever anybody publishes, nodes go on; and what was wrong is said no longer than it is."""

from types import SimpleNamespace

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import serialize_message

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros import topics
from stepdiag_ros.configuration import load_plan
from stepdiag_ros.messages import conversion
from stepdiag_ros.nodes import base
from stepdiag_ros.nodes.lines import LineNode
from stepdiag_ros.nodes.onlooker import Onlooker
from stepdiag_ros.nodes.recorder import RecorderNode
from stepdiag_ros.run.supervision import SILENCE_LIMIT, peer_of
from stepdiag_ros.viewers.page.state import PageState

RUN_ID = "20260102T030405-abcd"


def filled(topic, **fields):
    message = conversion.new_message(topic.type_name)
    for name, value in fields.items():
        setattr(message, name, value)
    return message


class Lines(LineNode):
    role = "solver"
    time = 100.0

    def __init__(self):
        super().__init__("solver")
        self.follow_lines()

    def real_time(self):
        return self.time

    def take_up(self, description):
        if not description.plan:
            raise ValueError("the plan is empty")

    def text(self):
        """Return level and text of the heartbeat."""
        said = []
        self.health._publisher = SimpleNamespace(publish=said.append)
        self.beat()
        status = said[-1].status[0]
        return ord(status.level), status.message


@pytest.fixture
def node():
    rclpy.init(args=[])
    made = Lines()
    yield made
    made.destroy_node()
    rclpy.try_shutdown()


def begin(node, run_id=RUN_ID, plan="a plan"):
    node._on_description(filled(topics.RUN_DESCRIPTION, run_id=run_id, plan=plan))


def test_a_line_that_makes_no_sense_is_said_and_the_next_is_taken_up(node):
    begin(node)
    odd = {"line": "x", "kind": "linear", "direction": "forward", "run_id": RUN_ID}
    hear = next(one for one in node.subscriptions if one.topic == "/measurement/line").callback
    hear(serialize_message(filled(topics.LINE, time=[0.0, 1.0], displacement=[0.0], **odd)))
    level, text = node.text()
    assert level == 2 and "measurement/line" in text and node.lines == []
    node.time += base.HOLDS + 0.1
    node._look_around()
    assert node.text() == (0, f"run {RUN_ID}")
    plan = load_plan("quick")[0]
    line = plan.lines[0]
    stops = line.stops(plan.volume)
    good = {name: [0.0] * len(stops) for name in ("time", "displacement", "standard_uncertainty")}
    for name in ("air_temperature", "air_pressure", "relative_humidity", "material_temperature"):
        good[name] = [20.0] * len(stops)
    target = [float(value) for value in stops.reshape(-1)]
    node._hear_line(filled(topics.LINE, target=target, setup="x", **good, **odd))
    assert len(node.lines) == 1


@pytest.mark.parametrize("ended", [False, True])
def test_a_run_that_cannot_be_taken_up_is_no_fault_once_it_is_none(node, ended):
    begin(node, plan="")
    told = (2, f"cannot take part in run {RUN_ID}: the plan is empty")
    assert node.text() == told
    state = filled(topics.RUN_STATE, run_id=RUN_ID)
    state.state = state.STATE_RUNNING
    node.time += 60.0
    node._on_run_state(state)
    assert node.text() == told, "that run goes on"
    if ended:
        state.state = state.STATE_ABORTED
    else:
        # The state of the run before may come after the description of the next.
        begin(node, plan="")
        state.run_id = "another"
        node._on_run_state(state)
        assert node.text() == told
        node.time += base.HOLDS + 0.1
    node._on_run_state(state)
    assert node.text() == (0, f"ready; run {RUN_ID} was not taken up")


def test_what_else_is_wrong_stays_wrong(node):
    begin(node, plan="")
    node.unwell("the disk is full")
    state = filled(topics.RUN_STATE, run_id=RUN_ID)
    state.state = state.STATE_ABORTED
    node._on_run_state(state)
    assert node.text() == (2, "the disk is full")


def test_a_second_node_of_the_name_is_a_fault_as_long_as_it_is_there(node, monkeypatch):
    values = {"role": "solver", "session": "of another process"}
    twin = peer_of("solver: heartbeat", 0, "ready", values, 0.0)
    monkeypatch.setattr(node.health, "peers_in", lambda _array: [twin])
    node._on_diagnostics(DiagnosticArray())
    told = (2, "two nodes are named /solver: end one of them or rename it")
    assert node.text() == told
    node.time += SILENCE_LIMIT - 0.1
    node._look_around()
    assert node.text() == told
    node.time += 0.2
    node._look_around()
    assert node.text() == (0, "ready")
    # Nor does the one that is left miss itself.
    node.time += 60.0
    node._look_around()
    assert node.text() == (0, "ready") and "/solver" not in node.watch.peers


class View(Onlooker):
    role = "viewer"

    def __init__(self):
        super().__init__("view", PageState(), 10.0)


def test_a_view_goes_on_after_messages_that_make_no_sense():
    rclpy.init(args=[])
    view = View()
    try:
        plan = "name: small\norigin_m: [0, 0, 0]\nstep_m: [0.01, 0.01, 0.01]\nblocks: 3\n"
        plan += "feed_m_per_s: 0.1\nlines:\n  - {kind: linear, names: [x]}\n"
        view._on_description(filled(topics.RUN_DESCRIPTION, run_id=RUN_ID, plan=plan))
        assert view.state.document("run")["plan"] == "small"
        view._on_run_state(filled(topics.RUN_STATE, run_id=RUN_ID, state=77))
        for source in view_sources():
            view.take(source, odd(source.topic))
        view._on_run_state(filled(topics.RUN_STATE, run_id=RUN_ID, state=1, line="x", stop=2))
        told = view.state.document("run")
        assert (told["words"], told["stop"]) == ("measuring", 2)
        view.state.update()
    finally:
        view.destroy_node()
        rclpy.try_shutdown()


def view_sources():
    from stepdiag_ros.viewers.page.items import SOURCES

    return [one for one in SOURCES if one.topic is not topics.RUN_DESCRIPTION]


def odd(topic):
    """Return a message of a topic in which every name is unknown and every number too large."""
    message = conversion.new_message(topic.type_name)
    for name, kind in message.get_fields_and_field_types().items():
        if name == "run_id":
            setattr(message, name, RUN_ID)
        elif kind == "string":
            setattr(message, name, "zzz")
        elif kind in ("uint32", "uint64"):
            setattr(message, name, 4_000_000_000)
        elif kind in ("double", "float64"):
            setattr(message, name, float("inf"))
    return message


def test_a_bag_stays_in_its_folder_whatever_the_run_is_called(tmp_path):
    folder = tmp_path / "bags"
    rclpy.init(args=["x", "--ros-args", "-p", f"folder:={folder}"])
    recorder = RecorderNode()
    try:
        for run_id in ("../../evil", "/tmp/evil", "-x", "a\0b", "e" * 5000, RUN_ID):
            run = filled(topics.RUN_DESCRIPTION, run_id=run_id, plan=load_plan("quick")[1])
            recorder.on_run(run)
    finally:
        recorder.close()
        recorder.destroy_node()
        rclpy.try_shutdown()
    names = [path.name for path in folder.iterdir()]
    assert len(names) == 6 and f"{RUN_ID}.mcap" in names
    assert not any(name.startswith(("-", ".")) for name in names)
    assert [path.name for path in tmp_path.iterdir()] == ["bags"]
