"""Whatever is published on a topic that a node hears: no exception leaves the node, no number
changes on its way between messages and data, and what cannot be used is said."""

import dataclasses
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from nodes_here import NODES, node_here
from odd_messages import MANY_TRIALS, damaged, messages
from rclpy.serialization import deserialize_message, serialize_message
from small_run import RUN_ID, small_stream

from stepdiag_ros import topics
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.diagnosis import from_diagnosis, to_diagnosis
from stepdiag_ros.messages.positioning import from_positioning_test, to_positioning_test
from stepdiag_ros.messages.types import message_type
from stepdiag_ros.messages.volumetric import from_volumetric_errors, to_volumetric_errors

LONG = 50
"""Times as many trials with ``--hypothesis-profile long``."""


def trials(examples):
    long = settings.default.max_examples >= MANY_TRIALS
    return settings(
        max_examples=examples * (LONG if long else 1),
        deadline=None,
        derandomize=True,
        database=None,
        phases=[phase for phase in Phase if phase is not Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )


@pytest.fixture(autouse=True)
def alone(monkeypatch, tmp_path):
    """Let nobody else hear or be heard, and nothing be left behind."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    monkeypatch.chdir(tmp_path)


def parameters(name):
    needed = {
        "monitor": ["port:=0"],
        "foxglove_server": ["port:=0"],
        "archive": ["place:=archive"],
    }
    return needed.get(name, [])


@st.composite
def given_to(draw, subscription):
    """Return a strategy for what a subscription is given: a message, or bytes that are none."""
    topic = topics.topic_of(subscription.topic)
    valid = [data for _, one, data in small_stream() if topic and one == topic[0]]
    type_name = topic[0].type_name if topic else "rcl_interfaces/msg/ParameterEvent"
    if valid and draw(st.booleans()):
        data = draw(st.sampled_from([valid[0], valid[len(valid) // 2], valid[-1]]))
        return draw(damaged(deserialize_message(data, subscription.msg_type)))
    if subscription.raw and draw(st.integers(0, 5)) == 0:
        cut = valid[0][: draw(st.integers(0, 60))] if valid else b""
        return cut + draw(st.binary(max_size=30))
    return draw(messages(type_name))


@pytest.mark.parametrize("name", NODES)
@trials(2)
@given(data=st.data())
def test_no_exception_leaves_a_node(name, data):
    bears_whatever_it_hears(name, data)


@pytest.mark.parametrize("name", NODES)
@trials(6)
@given(data=st.data())
def test_no_exception_leaves_a_node_that_hears_more(name, data):
    bears_whatever_it_hears(name, data)


def bears_whatever_it_hears(name, data):
    with node_here(name, *parameters(name)) as here:
        for _, topic, message in small_stream()[: data.draw(st.sampled_from([0, 60, 400]))]:
            here.give(topic, message)
        hears = here.hears
        for _ in range(data.draw(st.integers(1, 5))):
            subscription = hears[data.draw(st.integers(0, len(hears) - 1))]
            here.give_to(subscription, data.draw(given_to(subscription)))
            here.work()


CONVERSIONS = {
    "reading": (topics.READING, conversion.to_reading, lambda d: conversion.from_reading(d, "")),
    "command": (
        topics.MACHINE_COMMAND,
        conversion.to_command,
        lambda d: conversion.from_stop_command(d, RUN_ID, d.time, 0.1),
    ),
    "stop": (
        topics.STOP,
        conversion.to_settled_stop,
        lambda d: conversion.from_settled_stop(d, RUN_ID),
    ),
    "block": (topics.BLOCK, conversion.to_block, lambda d: conversion.from_block(d, RUN_ID)),
    "line": (
        topics.LINE,
        conversion.to_measured_line,
        lambda d: conversion.from_measured_line(d, RUN_ID),
    ),
    "result": (
        topics.VOLUMETRIC_ERRORS,
        to_volumetric_errors,
        lambda d: from_volumetric_errors(d, RUN_ID, 0),
    ),
    "test": (
        topics.POSITIONING_TEST,
        to_positioning_test,
        lambda d: from_positioning_test(d, RUN_ID, 0),
    ),
    "diagnosis": (topics.DIAGNOSIS, to_diagnosis, lambda d: from_diagnosis(d, RUN_ID)),
}


@pytest.mark.parametrize(("topic", "read", "write"), CONVERSIONS.values(), ids=CONVERSIONS)
@trials(60)
@given(data=st.data())
def test_no_number_changes_between_a_message_and_what_is_made_of_it(topic, read, write, data):
    valid = [one for _, other, one in small_stream() if other is topic]
    if valid and data.draw(st.booleans()):
        kind = message_type(topic.type_name)
        message = data.draw(damaged(deserialize_message(valid[-1], kind)))
    else:
        message = data.draw(messages(topic.type_name))
    try:
        made = read(message)
        again = read(write(made))
    except ValueError as error:
        assert str(error)
        return
    assert same(made, again)


def same(one, other):
    """Say whether two values are the same to the last bit; what is no number is like itself."""
    if dataclasses.is_dataclass(one):
        names = [field.name for field in dataclasses.fields(one)]
        return all(same(getattr(one, name), getattr(other, name)) for name in names)
    if isinstance(one, np.ndarray | float):
        return np.asarray(one).tobytes() == np.asarray(other).tobytes() or np.array_equal(
            one, other, equal_nan=True
        )
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return type(one) is type(other) and one == other


NOT_OF_THE_RUN = (topics.MACHINE_COMMAND, topics.COMMAND_STATUS)


def published(stream):
    """Return what an assembler publishes of a stream, to the byte, and what it says of itself."""
    said = []
    with pytest.MonkeyPatch.context() as patch, node_here("assembler") as here:
        made = {name: [] for name in ("_stops", "_blocks", "_lines")}
        for name, kept in made.items():
            patch.setattr(getattr(here.node, name), "publish", kept.append)
        for topic, message in stream:
            here.give(topic, message)
            here.work()
            said.append(max(finding_levels(here.node)))
    # What is not known is NaN, which no message with it equals.
    sent = {name: [serialize_message(one) for one in messages] for name, messages in made.items()}
    return sent, max(said)


def finding_levels(node):
    levels = [
        task.found.level for task in node.health._tasks if task.found and task.name != "clock"
    ]
    return [*levels, node.health._level]


@cache
def whole_stream():
    """Return the stream of a run that nobody disturbs, and what an assembler publishes of it."""
    stream = [(topic, one) for _, topic, one in small_stream()[:350]]
    return stream, published(stream)[0]


@trials(8)
@given(data=st.data())
def test_an_assembler_gives_the_same_numbers_or_says_what_is_wrong(data):
    whole, known = whole_stream()
    places = st.integers(20, len(whole) - 1)
    stream = list(whole)
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(places)
        topic = data.draw(st.sampled_from((topics.READING, *NOT_OF_THE_RUN)))
        near = next((one for other, one in whole[place:] if other is topic), None)
        if near is None:
            continue
        kind = message_type(topic.type_name)
        odd = data.draw(damaged(deserialize_message(near, kind)))
        stream.insert(place, (topic, serialize_message(odd)))
    made, level = published(stream)
    assert made == known or level > 0
