"""The table of topics."""

import pytest

from stepdiag_ros import topics
from stepdiag_ros.bags.types import own_types


def test_every_type_exists_and_names_are_unique():
    assert all(topic.type_name in own_types() for topic in topics.TOPICS)
    assert len({topic.name for topic in topics.TOPICS}) == len(topics.TOPICS)


@pytest.mark.parametrize("namespace", ["/", "/cell", "/hall/cell_1"])
@pytest.mark.parametrize("topic", topics.TOPICS)
def test_a_full_name_leads_back_to_topic_and_namespace(topic, namespace):
    name = topics.absolute(topic, namespace)
    assert name.startswith("/")
    assert "//" not in name
    expected = "/" if topic.name.startswith("/") else namespace
    assert topics.topic_of(name) == (topic, expected)


def test_a_foreign_name_is_no_topic():
    assert topics.topic_of("/chatter") is None
    assert topics.topic_of("/myrun/state") is None
