"""A bag played to a viewer: all of it, byte for byte, and frames and markers as a live run has."""

import re
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import fake_launch
import pytest
from foxglove_viewer import Viewer
from patience import PATIENCE
from refused import refused
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import stepdiag_ros.client  # noqa: F401 - makes message classes importable
from stepdiag_ros import topics
from stepdiag_ros.bags.folder import open_bag
from stepdiag_ros.bags.runs import choose_run, records_of
from stepdiag_ros.cli import main
from stepdiag_ros.metrology.frames import LASER, MIRROR, TOOL, WORKPIECE
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.topics import Qos
from stepdiag_ros.viewers.foxglove.replay import FoxgloveReplay
from stepdiag_ros.viewers.foxglove.server import ServedPlace

ROOT = Path(__file__).parents[3]
OLD = ROOT / "test" / "data" / "bags" / "schema_1.mcap"
PLAYING, PAUSED, ENDED = 0, 1, 3
STATE, LINE = topics.absolute(topics.RUN_STATE), topics.absolute(topics.LINE)
MADE = (topics.FRAMES, topics.FIXED_FRAMES, topics.RUN_MARKERS, topics.ERROR_MARKERS)


@pytest.fixture(scope="module")
def recorded(bag):
    """Return name of the topic → (log time, bytes) in the bag."""
    found = {}
    with open_bag(bag) as opened:
        for record, _ in records_of(opened, choose_run(opened)):
            found.setdefault(record.topic, []).append((record.log_time, record.data))
    return found


def read(channel, data):
    """Return a message, read by what was advertised alone."""
    kind = channel["schemaName"]
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(channel["schema"], kind))
    return store.deserialize_cdr(data, kind)


class Played:
    """A replay in a thread, and a viewer that hears all of it from the beginning."""

    def __init__(self, path, rate):
        self._replay = FoxgloveReplay(path, None, rate, ServedPlace(port=0), print)
        self._replay.server.start()
        self.port = int(self._replay.server.url.rpartition(":")[2])
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._replay.play, args=(self._stop,))

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join(PATIENCE)
        self._replay.close()


@pytest.fixture(scope="module")
def played(bag):
    with Played(bag, 100.0) as made, Viewer(made.port) as viewer:
        viewer.subscribe()
        viewer.wait(lambda: viewer.states and viewer.states[-1][0] == ENDED)
        yield made, viewer


def test_all_of_the_run_arrives_byte_for_byte(bag, played, recorded):
    _, viewer = played
    counts = {name: len(found) for name, found in recorded.items()}
    viewer.wait(lambda: all(len(viewer.messages[name]) >= counts[name] for name in counts))
    assert counts[topics.absolute(topics.READING)] > 200
    assert {name: viewer.messages[name] for name in counts} == recorded
    with open_bag(bag) as opened:
        for name, type_name in opened.topics.items():
            assert viewer.channels[name]["schema"] == opened.definitions()[type_name]
            assert viewer.channels[name]["schemaName"] == type_name
    assert set(viewer.channels) == set(counts) | {topics.absolute(one) for one in MADE}


def test_viewers_know_when_it_was(played, recorded):
    _, viewer = played
    times = sorted(time for found in recorded.values() for time, _ in found)
    span = [viewer.info["dataStartTime"], viewer.info["dataEndTime"]]
    assert [one["sec"] * 1_000_000_000 + one["nsec"] for one in span] == [times[0], times[-1]]
    assert viewer.times == sorted(viewer.times) and times[0] <= viewer.times[0]
    viewer.wait(lambda: viewer.times[-1] == times[-1])


def newest(viewer, topic):
    name = topics.absolute(topic)
    return read(viewer.channels[name], viewer.messages[name][-1][1])


def test_frames_are_there_though_the_bag_has_none(played, recorded):
    _, viewer = played
    fixed = {one.child_frame_id for one in newest(viewer, topics.FIXED_FRAMES).transforms}
    assert fixed == {WORKPIECE, MIRROR, LASER}
    joints = topics.absolute(topics.JOINT_STATES)
    last = read(viewer.channels[joints], recorded[joints][-1][1])

    def tool():
        (found,) = newest(viewer, topics.FRAMES).transforms
        return found

    viewer.wait(lambda: tool().header.stamp == last.header.stamp)
    at = tool().transform.translation
    assert tool().child_frame_id == TOOL and (at.x, at.y, at.z) == tuple(last.position)


def test_markers_are_there_though_the_bag_has_none(played):
    _, viewer = played

    def shown(topic, group):
        return [one for one in newest(viewer, topic).markers if one.ns.endswith(group)]

    viewer.wait(lambda: shown(topics.ERROR_MARKERS, "/vectors"))
    # Seven lines in space, all of them done, and no beam after the end.
    viewer.wait(lambda: not shown(topics.RUN_MARKERS, "beam"))
    assert len(shown(topics.RUN_MARKERS, "lines")) == 7
    names = " ".join(one.text for one in shown(topics.RUN_MARKERS, "line_names"))
    assert names.count("2/2") == 7


def test_who_comes_late_sees_what_holds(played):
    made, first = played
    with Viewer(made.port) as late:
        late.subscribe()
        latched = [
            name
            for name in late.channels
            if topics.topic_of(name)[0].qos in (Qos.LATCHED, Qos.RESULTS, Qos.HISTORY)
        ]
        late.wait(lambda: set(latched) <= set(late.messages))
        for name in latched:
            assert late.messages[name][-1] == first.messages[name][-1]
        assert late.messages[LINE] == first.messages[LINE]
        assert not late.messages[topics.absolute(topics.READING)]
        # The playing has ended, and whoever comes is told.
        late.wait(lambda: late.states and late.states[-1][0] == ENDED)


def test_a_viewer_pauses_and_goes_to_another_time(bag, recorded):
    states = recorded[STATE]
    middle = states[len(states) // 2][0]
    with Played(bag, 0.01) as made, Viewer(made.port) as viewer:
        viewer.subscribe()
        viewer.wait(lambda: viewer.states)
        assert viewer.states[0][0] == PLAYING
        viewer.control(play=False, seek=middle + 1, request="there")
        viewer.wait(lambda: viewer.states[-1][-1] == "there")
        assert viewer.states[-1][:4] == (PAUSED, middle + 1, 1.0, 1)
        held = max(one for one in states if one[0] <= middle)
        viewer.wait(lambda: held in viewer.messages[STATE])
        # On from there, and to the end, without anything twice.
        count = len(viewer.messages[STATE])
        viewer.control(play=True, rate=500.0, request="on")
        viewer.wait(lambda: viewer.states[-1][0] == ENDED)
        later = [one for one in states if one[0] > middle]
        assert viewer.messages[STATE][count:] == later
        assert [state[3] for state in viewer.states if state[-1] == "on"] == [0]
        # Played again after its end, it begins anew.
        count = len(viewer.messages[STATE])
        viewer.control(play=True, rate=1000.0, request="again")
        viewer.wait(lambda: len(viewer.messages[STATE]) == count + len(states))
        assert viewer.messages[STATE][count:] == states


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--rate", "2"], "--rate is for a bag, and none is given"),
        (["--run", "a"], "--run is for a bag, and none is given"),
        (["none.mcap", "--port", "0"], "there is no bag none.mcap"),
        ([str(OLD), "--address", "0.0.0.0"], "everyone there could view the run"),
        ([str(OLD), "--use-sim-time"], "--use-sim-time is for live nodes"),
        ([str(OLD), "--namespace", "/cell_1"], "--namespace is for live nodes"),
        ([str(OLD), "--run", "a", "--port", "0"], "holds no run 'a'"),
    ],
)
def test_what_cannot_be_shown_is_refused_in_one_sentence(arguments, said, capsys):
    assert main(["foxglove", *arguments]) == 1
    error = capsys.readouterr().err
    assert error.startswith("stepdiag: error: ") and said in error and error.count("\n") == 1


def test_the_command_serves_a_bag_until_it_is_told_to_end(bag):
    process = subprocess.Popen(
        [sys.executable, "-m", "stepdiag_ros.cli", "foxglove", str(bag), "--port", "0"],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        said = process.stderr.readline()
        port = re.search(r"viewers connect to ws://127\.0\.0\.1:(\d+); Ctrl-C ends it", said)
        with Viewer(int(port.group(1))) as viewer:
            viewer.subscribe()
            viewer.wait(lambda: viewer.messages[STATE])
            process.send_signal(signal.SIGINT)
            assert process.wait(PATIENCE) == 0
    finally:
        process.kill()
        _, more = process.communicate()
    assert "Traceback" not in more


def test_the_server_is_launched_where_it_is_asked_for(monkeypatch):
    for name, module in fake_launch.modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    sys.modules.pop("stepdiag_ros.processes.launching", None)
    file = ROOT / "launch" / "monitor.launch.py"
    given = {"foxglove": "true", "foxglove_address": "192.0.2.1", "use_sim_time": "true"}
    try:
        _, actions = fake_launch.launched(file, **given, foxglove_open_to_network="true")
        scene, server = actions
        assert [one.options["executable"] for one in actions] == ["scene", "foxglove_server"]
        wanted = {"use_sim_time": True, "port": 8765, "open_to_network": True}
        (parameters,) = server.options["parameters"]
        assert {name: parameters[name] for name in wanted} == wanted
        assert "192.0.2.1" in str(vars(parameters["address"])) and scene.options["parameters"]
        with refused(Refusal, "malformed", "x", "foxglove_port"):
            fake_launch.launched(file, foxglove="true", foxglove_port="x")
    finally:
        sys.modules.pop("stepdiag_ros.processes.launching", None)


def test_a_port_in_use_is_refused_in_one_sentence(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["foxglove", str(OLD), "--port", str(port)]) == 1
    error = capsys.readouterr().err
    assert f"viewers cannot be served on 127.0.0.1 port {port}" in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [("--rate", "0", "is not between 0.001 and 1000"), ("--port", "http", "is not a port")],
)
def test_options_are_numbers_that_make_sense(option, value, said, capsys):
    with refused(SystemExit, code=2):
        main(["foxglove", str(OLD), option, value])
    assert said in capsys.readouterr().err
