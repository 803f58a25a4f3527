"""Fixtures for tests on live nodes: a ROS domain of one's own, a node, and processes as peers.

Only rclpy's public interface is used, so that they serve tests on any client library.
"""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from domains import own_domain
from patience import PATIENCE

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable

_ROOT = Path(__file__).parents[1]


@contextmanager
def nodes_ended() -> Iterator[None]:
    """Destroy at the end what nodes were made in the block and are left in this process.

    A node that is only forgotten goes on speaking, to the test that gets its domain next.
    """
    from rclpy.node import Node

    made: list[weakref.ref[Node]] = []
    begin = Node.__init__

    def noted(self: Node, *arguments: object, **options: object) -> None:
        begin(self, *arguments, **options)
        made.append(weakref.ref(self))

    with mock.patch.object(Node, "__init__", noted):
        yield
    for one in made:
        node = one()
        if node is not None:
            node.destroy_node()


@pytest.fixture(autouse=True)
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    # A sourced ROS 2 has its own entries there, which its processes need.
    before = os.environ.get("PYTHONPATH")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (before, str(_ROOT)))))
    with own_domain() as number, nodes_ended():
        yield number


@pytest.fixture
def ros() -> Iterator[Any]:
    import rclpy

    rclpy.init(args=[])
    yield rclpy
    rclpy.try_shutdown()


@pytest.fixture
def node(ros: Any) -> Iterator[Any]:
    made = ros.create_node("tester")
    yield made
    made.destroy_node()


class Peer:
    """Another process that runs a piece of code."""

    def __init__(self, code: str, arguments: tuple[str, ...]) -> None:
        program = "import stepdiag_ros.client\nimport rclpy\n" + textwrap.dedent(code)
        self.process = subprocess.Popen(
            [sys.executable, "-c", program, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def wait_for_line(self, wanted: str) -> str:
        """Return the next line on standard output that contains a text."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if wanted in line:
                return line
        raise AssertionError(f"'{wanted}' never came: {self.process.stderr.read()}")  # type: ignore[union-attr]

    def finish(self, timeout: float = PATIENCE) -> tuple[int, str, str]:
        """Return the exit code, standard output and standard error."""
        out, err = self.process.communicate(timeout=timeout)
        return self.process.returncode, out, err


@pytest.fixture
def peer() -> Iterator[Callable[..., Peer]]:
    peers: list[Peer] = []

    def start(code: str, *arguments: str) -> Peer:
        peers.append(Peer(code, arguments))
        return peers[-1]

    yield start
    for item in peers:
        item.process.terminate()
    for item in peers:
        try:
            item.process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            item.process.kill()
            item.process.communicate()


def spin_until(node: Any, condition: Callable[[], bool], timeout: float = PATIENCE) -> bool:
    """Spin a node until a condition holds; return whether it does in time."""
    import rclpy

    end = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > end:
            return False
        rclpy.spin_once(node, timeout_sec=0.02)
    return True


def wait_until(condition: Callable[[], bool], timeout: float = PATIENCE) -> bool:
    """Wait without spinning until a condition holds; return whether it does in time."""
    end = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.005)
    return True
