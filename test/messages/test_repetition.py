"""What is said again slowly, and how a repetition is known."""

from types import SimpleNamespace as Message

import pytest

from stepdiag_ros import topics
from stepdiag_ros.messages.repetition import Memory, Repeater


def said(repeater, time, data, **fields):
    repeater.said(Message(**fields), data, time)


def test_of_a_state_the_newest_alone_is_said_again_and_never_too_early():
    repeater = Repeater(topics.RUN_STATE, 5.0)
    said(repeater, 0.0, b"idle", run_id="")
    said(repeater, 2.0, b"running", run_id="a")
    assert repeater.due(6.9) == []
    assert repeater.due(7.0) == [b"running"]
    assert repeater.due(11.9) == []
    assert repeater.due(12.0) == [b"running"]
    # One that is said often enough anyway is never due.
    for time in (13.0, 17.0, 21.0):
        assert repeater.due(time) == []
        said(repeater, time, b"running on", run_id="a")


def test_of_results_the_newest_of_each_method_and_of_lines_each_attempt_holds():
    results = Repeater(topics.VOLUMETRIC_ERRORS, 5.0)
    for number in range(3):
        for method in ("conventional", "setup_robust"):
            said(results, 0.0, f"{method} {number}".encode(), run_id="a", method=method)
    assert results.due(5.0) == [b"conventional 2", b"setup_robust 2"]
    lines = Repeater(topics.LINE, 5.0)
    for index, attempt in ((0, 1), (1, 1), (1, 2), (2, 1)):
        data = f"{index} {attempt}".encode()
        said(lines, 0.1 * index, data, run_id="a", line_index=index, attempt=attempt)
    assert lines.due(5.05) == [b"0 1"]
    assert lines.due(9.0) == [b"1 1", b"1 2", b"2 1"]
    assert lines.due(10.1) == [b"0 1"]


def test_what_was_said_of_another_run_holds_no_more():
    lines = Repeater(topics.LINE, 5.0)
    said(lines, 0.0, b"old", run_id="a", line_index=7, attempt=1)
    said(lines, 1.0, b"new", run_id="b", line_index=0, attempt=1)
    assert lines.due(100.0) == [b"new"]


def test_no_more_is_said_again_than_a_late_subscriber_can_keep():
    lines = Repeater(topics.LINE, 5.0)
    for index in range(topics.LINE.depth + 5):
        said(lines, 0.0, b"%d" % index, run_id="a", line_index=index, attempt=1)
    due = lines.due(5.0)
    assert (len(due), due[0]) == (topics.LINE.depth, b"5")


def test_the_same_bytes_are_news_once_until_time_begins_anew():
    memory = Memory()
    assert [memory.is_news(data) for data in (b"a", b"b", b"a", b"b", b"c")] == [
        True,
        True,
        False,
        False,
        True,
    ]
    memory.begin_anew()
    # Said by who has not begun anew yet, and then when it happens again.
    assert not memory.is_news(b"a", lambda: False)
    assert memory.is_news(b"a", lambda: True)
    assert not memory.is_news(b"a", lambda: True)
    # What was never heard is news whatever the time.
    assert memory.is_news(b"d", lambda: False)


def test_a_run_that_begins_anew_takes_back_what_was_said_of_it():
    lines = Repeater(topics.LINE, 5.0)
    said(lines, 0.0, b"old", run_id="a", line_index=0, attempt=1)
    lines.forget()
    assert lines.due(100.0) == []


def test_what_holds_is_told_apart_by_fields_that_the_messages_have():
    from stepdiag_ros.bags.types import own_types

    for topic in topics.TOPICS:
        message = own_types().new(topic.type_name)
        for field in (*topic.newest_of_each, *filter(None, (topic.conclusive,))):
            assert hasattr(message, field), (topic.name, field)
        if topic.newest_of_each:
            assert topic.qos.repeated


@pytest.mark.parametrize("topic", topics.TOPICS, ids=lambda topic: topic.name)
def test_quality_of_service_follows_from_meaning(topic):
    kinds = {
        topics.Qos.STREAM: (False, False, topic.highest_rate > 0.0),
        topics.Qos.COMMAND: (False, False, True),
        topics.Qos.EVENTS: (True, False, True),
        topics.Qos.LATCHED: (True, True, True),
        topics.Qos.RESULTS: (True, True, True),
        topics.Qos.HISTORY: (True, True, True),
    }
    assert len(set(topics.Qos)) == len(kinds), "two kinds of the same values are one"
    transient_local, repeated, fits = kinds[topic.qos]
    assert (topic.qos.transient_local, topic.qos.repeated) == (transient_local, repeated)
    assert fits, "a stream must say how many messages come in a second"
    assert topic.depth >= topic.highest_rate * topics.KEPT_SECONDS


def test_no_parameter_allows_a_higher_rate_than_the_topics_keep_a_second_of():
    from stepdiag_ros.parameters.nodes import declared_node

    def high(role, name):
        return declared_node(role).find(name).high

    assert high("interferometer", "reading_rate_limit") == topics.READING.highest_rate
    assert high("cnc_bridge", "position_rate") == topics.JOINT_STATES.highest_rate
    assert high("weather", "rate") == topics.AIR_PRESSURE.highest_rate
    assert 1.0 / declared_node("clock").find("period").low == topics.CLOCK.highest_rate
