"""Viewers are served what was published; whoever is late, stalls or meddles harms nobody."""

import socket
import sys

import pytest
from foxglove_viewer import Viewer
from refused import refused
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import stepdiag_ros.client  # noqa: F401 - makes message classes importable
from stepdiag_ros import topics
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.messages.conversion import new_message
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.viewers.foxglove.server import BACKLOG, FoxgloveServer, ServedPlace

READING, LINE, STOP = (topics.absolute(one) for one in (topics.READING, topics.LINE, topics.STOP))
DESCRIPTION, FRAMES = topics.absolute(topics.RUN_DESCRIPTION), topics.FIXED_FRAMES.name


def comes(served, viewer, *names):
    """Subscribe and wait until the server knows."""
    before = {name: served.server.viewers(name) for name in names}
    viewer.subscribe(*names)
    viewer.wait(
        lambda: all(served.server.viewers(name) > before[name] for name in names),
        work=served.server.work,
    )


def frames(*names):
    made = []
    for name in names:
        made.append(new_message("geometry_msgs/msg/TransformStamped"))
        made[-1].child_frame_id = name
    return made


def test_messages_arrive_as_they_are_and_say_how_they_are_read(served):
    with Viewer(served.port) as viewer:
        assert viewer.info["capabilities"] == ["time"]
        channel = viewer.channels[READING]
        kind = topics.READING.type_name
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
        assert channel["schemaName"] == kind
        comes(served, viewer, READING)
        sent = [
            served.send(topics.READING, sequence=number, raw_displacement=0.5 * number)
            for number in range(100)
        ]
        viewer.wait(lambda: len(viewer.messages[READING]) == len(sent))
        assert viewer.messages[READING] == sent
        assert list(viewer.messages) == [READING]
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(channel["schema"], kind))
        read = store.deserialize_cdr(viewer.messages[READING][7][1], kind)
        assert (read.sequence, read.raw_displacement) == (7, 3.5)
        served.server.tell_time(123)
        viewer.wait(lambda: viewer.times == [123])


def test_who_comes_late_is_sent_what_holds_and_nobody_hears_it_twice(served):
    with Viewer(served.port) as early, Viewer(served.port) as late:
        comes(served, early, LINE, DESCRIPTION, STOP)
        served.send(topics.RUN_DESCRIPTION, run_id="old")
        served.send(topics.LINE, run_id="old", line_index=5, attempt=1)
        description = served.send(topics.RUN_DESCRIPTION, run_id="a")
        first = served.send(topics.LINE, run_id="a", line_index=1, attempt=1, setup="x")
        again = served.send(topics.LINE, run_id="a", line_index=1, attempt=1, setup="y")
        other = served.send(topics.LINE, run_id="a", line_index=2, attempt=1)
        stop = served.send(topics.STOP, run_id="a")
        comes(served, late, LINE, DESCRIPTION, STOP)
        last = served.send(topics.LINE, run_id="a", line_index=3, attempt=1)
        end = served.send(topics.STOP, run_id="a")
        for viewer in (early, late):
            viewer.wait(lambda viewer=viewer: end in viewer.messages[STOP])
            viewer.wait(lambda viewer=viewer: last in viewer.messages[LINE])
        assert late.messages[LINE] == [again, other, last]
        assert late.messages[DESCRIPTION] == [description]
        assert late.messages[STOP] == [end]
        assert early.messages[LINE][1:] == [first, again, other, last]
        assert len(early.messages[DESCRIPTION]) == 2
        assert early.messages[STOP] == [stop, end]


def test_lines_that_come_before_the_description_of_their_run_hold(served):
    line = served.send(topics.LINE, run_id="a", line_index=0)
    served.send(topics.RUN_DESCRIPTION, run_id="a")
    with Viewer(served.port) as viewer:
        comes(served, viewer, LINE)
        viewer.wait(lambda: viewer.messages[LINE] == [line])
    viewer.wait(lambda: not served.server.has_viewers, work=served.server.work)
    # A new run: who comes now is not shown the lines of the one before.
    served.send(topics.RUN_DESCRIPTION, run_id="b")
    with Viewer(served.port) as viewer:
        comes(served, viewer, LINE, DESCRIPTION)
        viewer.wait(lambda: viewer.messages[DESCRIPTION])
        assert not viewer.messages[LINE]


def test_fixed_frames_of_two_publishers_hold_side_by_side(served):
    served.send(topics.FIXED_FRAMES, transforms=frames("laser", "mirror"))
    robot = served.send(topics.FIXED_FRAMES, transforms=frames("robot"))
    moved = served.send(topics.FIXED_FRAMES, transforms=frames("laser", "mirror"))
    with Viewer(served.port) as viewer:
        comes(served, viewer, FRAMES)
        viewer.wait(lambda: len(viewer.messages[FRAMES]) == 2)
        assert sorted(viewer.messages[FRAMES]) == [robot, moved]


def test_a_viewer_that_stalls_loses_messages_and_the_others_none(served):
    batch, batches = 2000, 8
    _, data = served.send(topics.STOP, run_id="x" * 2000)
    sent = []
    with Viewer(served.port, reads=False) as stalled, Viewer(served.port) as other:
        comes(served, stalled, STOP)
        comes(served, other, STOP)
        while len(sent) < batch * batches:
            for _ in range(batch):
                sent.append((len(sent), data))
                served.server.send(STOP, data, sent[-1][0])
            last = [sent[-1]]
            other.wait(lambda last=last: other.messages[STOP][-1:] == last)
        assert other.messages[STOP] == sent
        assert not stalled.messages[STOP]
        stalled.wake()
        stalled.wait(lambda: stalled.messages[STOP][-1:] == last)
        assert BACKLOG <= len(stalled.messages[STOP]) < len(sent)


def test_who_looks_on_can_do_nothing_else(served):
    with Viewer(served.port) as viewer:
        channel = {"id": 1, "topic": "/machine/permit", "encoding": "cdr", "schemaName": "x"}
        viewer.say({"op": "advertise", "channels": [channel]})
        viewer.wait(lambda: len(viewer.complaints) == 1)
        viewer.say({"op": "setParameters", "parameters": [{"name": "port", "value": 1}]})
        viewer.wait(lambda: len(viewer.complaints) == 2)
        viewer.say({"op": "subscribeConnectionGraph"})
        viewer.wait(lambda: len(viewer.complaints) == 3)
        assert all("not support" in text for text in viewer.complaints), viewer.complaints


def test_who_has_gone_is_forgotten(served):
    with Viewer(served.port) as viewer:
        comes(served, viewer, READING, LINE)
        viewer.unsubscribe(READING)
        viewer.wait(lambda: not served.server.viewers(READING), work=served.server.work)
        assert served.server.viewers(LINE)
    viewer.wait(lambda: not served.server.has_viewers, work=served.server.work)


def test_what_is_no_message_of_its_type_is_refused(served):
    with refused(BagError, "malformed", "stepdiag_ros/msg/MeasuredLine"):
        served.server.send(LINE, b"\0\1\0\0no", 1)


def test_who_speaks_another_protocol_is_turned_away_and_that_is_said(served):
    with socket.create_connection(("127.0.0.1", served.port)) as link:
        link.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
        assert link.recv(1000) == b""
    with Viewer(served.port) as viewer:
        viewer.wait(lambda: served.told)
    assert "handshake failed" in served.told[0]


@pytest.mark.parametrize("address", ["0.0.0.0", "::", "192.0.2.1", "cell.example"])
def test_an_address_that_others_can_reach_must_be_wanted(address):
    with refused(Refusal, "exposed") as caught:
        ServedPlace(address)
    assert address in str(caught.value) and "open_to_network" in str(caught.value)
    assert not ServedPlace(address, open_to_network=True).is_local


def test_a_port_in_use_and_an_address_of_nobody_are_said(served):
    for place in (ServedPlace(port=served.port), ServedPlace("192.0.2.1", 0, open_to_network=True)):
        server = FoxgloveServer("test", place, print)
        with refused(Refusal, "busy") as caught:
            server.start()
        server.close()
        assert f"{place.address} port {place.port}: " in str(caught.value)
        assert "choose another port" in str(caught.value)


def test_a_missing_library_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with refused(Refusal, "not_installed", "stepdiag_ros[foxglove]"):
        FoxgloveServer("test", ServedPlace(port=0), print)
