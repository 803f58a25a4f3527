"""Layouts for RViz, Foxglove and PlotJuggler: every topic is ours, every field is in its type."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from stepdiag_ros import topics
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.metrology.frames import FRAMES, MACHINE
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.nodes.foxglove_server import SHOWN

CONFIG = Path(__file__).parents[3] / "config"
RVIZ = yaml.safe_load((CONFIG / "rviz" / "stepdiag.rviz").read_text())["Visualization Manager"]
FOXGLOVE = json.loads((CONFIG / "foxglove" / "stepdiag.json").read_text())
PLOTJUGGLER = ElementTree.parse(CONFIG / "plotjuggler" / "stepdiag.xml").getroot()


def topic_called(name):
    return next(topic for topic in topics.TOPICS if topics.absolute(topic) == name)


def leads_to_a_number(topic, fields):
    """Say whether fields such as ``position[0]`` or ``header.stamp`` lead to a number."""
    value = own_types().new(topic.type_name)
    for part in fields:
        name, _, index = part.partition("[")
        if not hasattr(value, name):
            return False
        value = getattr(value, name)
        if bool(index) != isinstance(value, list):
            return False
        if index:
            value = 0.0  # the arrays that are plotted are of numbers
    return isinstance(value, int | float)


def foxglove_paths():
    for panel, config in FOXGLOVE["configById"].items():
        for path in config.get("paths", []):
            yield pytest.param(path["value"], id=f"{panel} {path['value']}")


@pytest.mark.parametrize("path", list(foxglove_paths()))
def test_every_curve_of_foxglove_is_a_number_of_ours(path):
    name, *fields = path.split(".")
    assert fields and leads_to_a_number(topic_called(name), fields)
    index = re.search(r"\[(\d+)\]", path)
    assert index is None or int(index[1]) < len(AXES)


@pytest.mark.parametrize("name", [curve.get("name") for curve in PLOTJUGGLER.iter("curve")])
def test_every_curve_of_plotjuggler_is_a_number_of_ours(name):
    topic, field = next(
        (topic, name.removeprefix(topics.absolute(topic) + "/"))
        for topic in topics.TOPICS
        if name.startswith(topics.absolute(topic) + "/")
    )
    if topic is topics.JOINT_STATES:
        # PlotJuggler sorts joint states by the joints' names.
        joint, field = field.split("/")
        assert joint in AXES and field == "position"
        field += "[0]"
    assert leads_to_a_number(topic, field.split("/"))
    (selected,) = PLOTJUGGLER.iter("selected_topics")
    assert topics.absolute(topic) in selected.get("value").split(";")


def test_a_wrong_field_would_be_noticed():
    assert not leads_to_a_number(topics.READING, ["displacement"])
    assert not leads_to_a_number(topics.READING, ["header"])
    assert not leads_to_a_number(topics.JOINT_STATES, ["position"])
    assert leads_to_a_number(topics.READING, ["header", "stamp", "sec"])


def test_foxglove_is_served_every_topic_of_the_layout():
    names = re.findall(r'"(/[\w/]+)', (CONFIG / "foxglove" / "stepdiag.json").read_text())
    assert len(set(names)) > 6
    assert {topic_called(name) for name in names} <= set(SHOWN)


def panels_in(layout):
    if isinstance(layout, str):
        return [layout]
    assert layout["direction"] in ("row", "column") and 0 < layout["splitPercentage"] < 100
    return panels_in(layout["first"]) + panels_in(layout["second"])


def test_foxglove_shows_every_panel_with_topics_of_the_right_type():
    panels = FOXGLOVE["configById"]
    assert sorted(panels_in(FOXGLOVE["layout"])) == sorted(panels)
    scene = panels["3D!scene"]
    assert scene["fixedFrame"] == MACHINE
    assert set(scene["transforms"]) == {f"frame:{name}" for name in FRAMES}
    markers = {topics.absolute(topic) for topic in (topics.ERROR_MARKERS, topics.RUN_MARKERS)}
    assert set(scene["topics"]) == markers
    assert panels["DiagnosticSummary!health"]["topicToRender"] == topics.DIAGNOSTICS.name
    assert topic_called(panels["RawMessages!run"]["topicPath"]) is topics.RUN_STATE


def test_rviz_listens_as_the_scene_speaks():
    assert RVIZ["Global Options"]["Fixed Frame"] == MACHINE
    assert RVIZ["Views"]["Current"]["Target Frame"] in FRAMES
    shown = {display["Class"].split("/")[1]: [] for display in RVIZ["Displays"]}
    for display in RVIZ["Displays"]:
        shown[display["Class"].split("/")[1]].append(display)
        assert display["Enabled"] is True
    assert len(shown["TF"]) == 1
    heard = []
    for display in shown["MarkerArray"]:
        topic = topic_called(display["Topic"]["Value"])
        assert topic.type_name == "visualization_msgs/msg/MarkerArray"
        durability = "Transient Local" if topic.qos.transient_local else "Volatile"
        assert display["Topic"]["Durability Policy"] == durability
        assert display["Topic"]["Reliability Policy"] == "Reliable"
        heard.append(topic)
    assert heard == [topics.ERROR_MARKERS, topics.RUN_MARKERS]
