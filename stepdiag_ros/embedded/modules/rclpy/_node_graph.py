"""The part of a node that looks at the graph of nodes, topics and services."""

from __future__ import annotations

import time
from typing import Any

from rclpy.qos import QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo, TopicEndpointTypeEnum
from stepdiag_ros.embedded import dds, naming
from stepdiag_ros.embedded.graph import Graph, NodeEntry

_NamesAndTypes = list[tuple[str, list[str]]]


class NodeGraph:
    """What a node can report about its peers."""

    _ros_graph: Graph

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """Return a topic's full name."""
        raise NotImplementedError

    def resolve_service_name(self, service: str, *, only_expand: bool = False) -> str:
        """Return a service's full name."""
        raise NotImplementedError

    def get_node_names(self) -> list[str]:
        """Return the names of all nodes."""
        return [node.name for node in self._ros_graph.nodes()]

    def get_fully_qualified_node_names(self) -> list[str]:
        """Return the names of all nodes, with their namespaces."""
        return [
            naming.full_node_name(node.namespace, node.name) for node in self._ros_graph.nodes()
        ]

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        """Return the names and namespaces of all nodes."""
        return [(node.name, node.namespace) for node in self._ros_graph.nodes()]

    def get_topic_names_and_types(self, no_demangle: bool = False) -> _NamesAndTypes:
        """Return all topics and their types."""
        if no_demangle:
            raise NotImplementedError("The embedded ROS 2 client shows ROS topics only.")
        return _sorted(self._ros_graph.topics(self._ros_graph.endpoints()))

    def get_service_names_and_types(self) -> _NamesAndTypes:
        """Return all services and their types."""
        return _sorted(self._ros_graph.services(self._ros_graph.endpoints()))

    def get_publisher_names_and_types_by_node(
        self,
        node_name: str,
        node_namespace: str,
        no_demangle: bool = False,  # noqa: ARG002 - rclpy's signature
    ) -> _NamesAndTypes:
        """Return the topics a node publishes, and their types."""
        return _sorted(self._ros_graph.topics(self._of_node(node_name, node_namespace, True)))

    def get_subscriber_names_and_types_by_node(
        self,
        node_name: str,
        node_namespace: str,
        no_demangle: bool = False,  # noqa: ARG002 - rclpy's signature
    ) -> _NamesAndTypes:
        """Return the topics a node subscribes to, and their types."""
        return _sorted(self._ros_graph.topics(self._of_node(node_name, node_namespace, False)))

    def get_service_names_and_types_by_node(
        self, node_name: str, node_namespace: str
    ) -> _NamesAndTypes:
        """Return the services a node offers, and their types."""
        found = self._of_node(node_name, node_namespace, False)
        return _sorted(self._ros_graph.services([e for e in found if e.topic.startswith("rq/")]))

    def get_client_names_and_types_by_node(
        self, node_name: str, node_namespace: str
    ) -> _NamesAndTypes:
        """Return the services of which a node has clients, and their types."""
        found = self._of_node(node_name, node_namespace, True)
        return _sorted(self._ros_graph.services([e for e in found if e.topic.startswith("rq/")]))

    def count_publishers(self, topic_name: str) -> int:
        """Return how many publishers a topic has."""
        return self._count(naming.dds_topic(self.resolve_topic_name(topic_name)), True)

    def count_subscribers(self, topic_name: str) -> int:
        """Return how many subscriptions a topic has."""
        return self._count(naming.dds_topic(self.resolve_topic_name(topic_name)), False)

    def count_clients(self, service_name: str) -> int:
        """Return how many clients a service has."""
        return self._count(naming.dds_request(self.resolve_service_name(service_name)), True)

    def count_services(self, service_name: str) -> int:
        """Return how many nodes offer a service."""
        return self._count(naming.dds_request(self.resolve_service_name(service_name)), False)

    def get_publishers_info_by_topic(
        self,
        topic_name: str,
        no_mangle: bool = False,  # noqa: ARG002 - rclpy's signature
    ) -> list[TopicEndpointInfo]:
        """Return what is known of a topic's publishers."""
        return self._info(topic_name, TopicEndpointTypeEnum.PUBLISHER)

    def get_subscriptions_info_by_topic(
        self,
        topic_name: str,
        no_mangle: bool = False,  # noqa: ARG002 - rclpy's signature
    ) -> list[TopicEndpointInfo]:
        """Return what is known of a topic's subscriptions."""
        return self._info(topic_name, TopicEndpointTypeEnum.SUBSCRIPTION)

    def wait_for_node(self, fully_qualified_node_name: str, timeout: float) -> bool:
        """Wait for a node to appear; return whether it did within ``timeout`` seconds."""
        wanted = "/" + fully_qualified_node_name.lstrip("/")
        end = time.monotonic() + timeout
        while wanted not in self.get_fully_qualified_node_names():
            if time.monotonic() >= end:
                return False
            time.sleep(0.01)
        return True

    def _count(self, topic: str, writers: bool) -> int:
        return sum(endpoint.topic == topic for endpoint in self._ros_graph.endpoints_of(writers))

    def _of_node(self, name: str, namespace: str, writers: bool) -> list[dds.EndpointInfo]:
        guids: set[bytes] = set()
        for node in self._ros_graph.nodes():
            if (node.name, node.namespace) == (name, namespace):
                guids.update(node.writers if writers else node.readers)
        every = self._ros_graph.endpoints_of(writers)
        return [endpoint for endpoint in every if endpoint.guid in guids]

    def _info(self, topic_name: str, kind: TopicEndpointTypeEnum) -> list[TopicEndpointInfo]:
        topic = naming.dds_topic(self.resolve_topic_name(topic_name))
        writers = kind is TopicEndpointTypeEnum.PUBLISHER
        owners: dict[bytes, NodeEntry] = {}
        for node in self._ros_graph.nodes():
            owners.update(dict.fromkeys(node.writers if writers else node.readers, node))
        found: list[TopicEndpointInfo] = []
        for endpoint in self._ros_graph.endpoints_of(writers):
            if endpoint.topic != topic:
                continue
            owner = owners.get(endpoint.guid)
            found.append(
                TopicEndpointInfo(
                    owner.name if owner else "_NODE_NAME_UNKNOWN_",
                    owner.namespace if owner else "_NODE_NAMESPACE_UNKNOWN_",
                    naming.ros_type(endpoint.type_name) or endpoint.type_name,
                    _hash(endpoint.user_data),
                    kind,
                    list(endpoint.guid),
                    QoSProfile._from_dds(endpoint.qos),
                )
            )
        return found


def _sorted(found: dict[str, set[str]]) -> _NamesAndTypes:
    return [(name, sorted(found[name])) for name in sorted(found)]


def _hash(user_data: str) -> Any:
    for part in user_data.split(";"):
        if part.startswith("typehash="):
            return part.removeprefix("typehash=")
    return ""
