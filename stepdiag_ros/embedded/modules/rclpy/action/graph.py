"""Which actions there are, and who serves and calls them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.node import Node

_NamesAndTypes = list[tuple[str, list[str]]]
_TOPIC = "/_action/feedback"
_TYPE = "_FeedbackMessage"


def get_action_names_and_types(node: Node) -> _NamesAndTypes:
    """Return all actions and their types."""
    return _actions(node.get_topic_names_and_types())


def get_action_client_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str
) -> _NamesAndTypes:
    """Return the actions of which a node has clients, and their types."""
    return _actions(
        node.get_subscriber_names_and_types_by_node(remote_node_name, remote_node_namespace)
    )


def get_action_server_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str
) -> _NamesAndTypes:
    """Return the actions a node serves, and their types."""
    return _actions(
        node.get_publisher_names_and_types_by_node(remote_node_name, remote_node_namespace)
    )


def _actions(topics: _NamesAndTypes) -> _NamesAndTypes:
    return [
        (topic.removesuffix(_TOPIC), [kind.removesuffix(_TYPE) for kind in kinds])
        for topic, kinds in topics
        if topic.endswith(_TOPIC)
    ]
