"""How far discovery reaches: domain, range and static peers, as ROS 2's variables say."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from domains import taken_domain
from refused import refused

from stepdiag_ros.embedded import ddsdomain, ddslib

from .conftest import spin_until

TALKER = """
import sys
import stepdiag_ros.client
import rclpy
from std_msgs.msg import String
rclpy.init(args=[])
node = rclpy.create_node("talker")
publisher = node.create_publisher(String, "chat", 10)
node.create_timer(0.05, lambda: publisher.publish(String(data=sys.argv[1])))
print("up", flush=True)
rclpy.spin(node)
"""


@pytest.fixture(autouse=True)
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("CYCLONEDDS_URI", "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS"):
        monkeypatch.delenv(name, raising=False)


def config(monkeypatch: pytest.MonkeyPatch, wanted: str, peers: str = "") -> str:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", wanted)
    monkeypatch.setenv("ROS_STATIC_PEERS", peers)
    return ddsdomain.discovery_config()


def test_each_range_has_its_configuration(monkeypatch: pytest.MonkeyPatch) -> None:
    for wanted in ("", "LOCALHOST"):
        here = config(monkeypatch, wanted)
        assert "<AllowMulticast>false" in here and '"localhost" PruneDelay="inf"' in here
        # Real nodes that are not limited to this computer find this one by what it goes on sending.
        assert "<SPDPInterval>2s" in here
        # Real nodes announce themselves there: without it, late ones would never be found.
        assert '<NetworkInterface address="127.0.0.1"' in here
        assert "autodetermine" not in here
    subnet = config(monkeypatch, "SUBNET")
    assert "AllowMulticast" not in subnet and '<NetworkInterface autodetermine="true"/>' in subnet
    assert '<NetworkInterface address="127.0.0.1"' in subnet and '"localhost"' in subnet
    off = config(monkeypatch, "OFF", "10.0.0.7")
    assert f"<Tag>off_{os.getpid()}</Tag>" in off and "10.0.0.7" not in off
    assert config(monkeypatch, "SYSTEM_DEFAULT", "10.0.0.7") == ""
    with refused(ddslib.DdsError, None, "ROS_AUTOMATIC_DISCOVERY_RANGE", "HERE", "LOCALHOST"):
        config(monkeypatch, "HERE")


def test_static_peers_are_asked_over_the_network_card(monkeypatch: pytest.MonkeyPatch) -> None:
    for wanted in ("LOCALHOST", "SUBNET"):
        found = config(monkeypatch, wanted, "10.0.0.7;192.0.2.9")
        assert '"10.0.0.7"' in found and '"192.0.2.9"' in found and "autodetermine" in found
    assert 'autodetermine="true" multicast="false"' in config(monkeypatch, "LOCALHOST", "a")


def test_localhost_only_comes_before_all_else(monkeypatch: pytest.MonkeyPatch) -> None:
    here = config(monkeypatch, "LOCALHOST")
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    assert config(monkeypatch, "SUBNET", "10.0.0.7") == here
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "0")
    assert config(monkeypatch, "SUBNET", "10.0.0.7") != here


def test_large_packets_stay_on_the_loopback(monkeypatch: pytest.MonkeyPatch) -> None:
    """A network card would have to cut them up, and lose all of one for the loss of a part."""
    assert "<FragmentSize>65000B" in config(monkeypatch, "LOCALHOST")
    assert "FragmentSize" not in config(monkeypatch, "LOCALHOST", "10.0.0.7")
    assert "FragmentSize" not in config(monkeypatch, "SUBNET")


def test_who_configures_cyclone_chooses_the_interfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    own = "<CycloneDDS><Domain/></CycloneDDS>"
    monkeypatch.setenv("CYCLONEDDS_URI", own)
    for wanted in ("LOCALHOST", "SUBNET"):
        found = config(monkeypatch, wanted)
        assert "NetworkInterface" not in found and found.endswith(f",{own}")


@contextmanager
def talker(name: str, **variables: str) -> Iterator[None]:
    """Run a process that says its name all the time."""
    process = subprocess.Popen(
        [sys.executable, "-c", TALKER, name],
        env={**os.environ, **variables},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None and process.stdout.readline() == "up\n"
        yield
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("own", ["LOCALHOST", "SUBNET"])
def test_nodes_find_those_that_they_shall(monkeypatch: pytest.MonkeyPatch, own: str) -> None:
    import rclpy
    from std_msgs.msg import String

    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", own)
    with (
        taken_domain() as other,
        talker("here", ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST"),
        talker("network", ROS_AUTOMATIC_DISCOVERY_RANGE="SUBNET"),
        talker("alone", ROS_AUTOMATIC_DISCOVERY_RANGE="OFF"),
        talker("elsewhere", ROS_DOMAIN_ID=str(other)),
    ):
        rclpy.init(args=[])
        heard: set[str] = set()
        node = rclpy.create_node("listener")

        def listen(message: Any) -> None:
            heard.add(message.data)

        node.create_subscription(String, "chat", listen, 10)
        assert spin_until(node, lambda: heard >= {"here", "network"})
        end = time.monotonic() + 0.5
        spin_until(node, lambda: time.monotonic() > end)
        rclpy.try_shutdown()
    assert heard == {"here", "network"}
