"""Conformance: what any rclpy must do. These tests use its public interface and nothing else.

They run on whatever client library ``import rclpy`` gives: on the embedded one by default, on a
sourced ROS 2 by ``colcon test --packages-select stepdiag_ros``. They need pytest alone, without the
``conftest.py`` above this one: CMakeLists.txt leaves it out.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from patience import PATIENCE
from ros_processes import domain, node, peer, ros

from .action_cell import Cell

__all__ = ["cell", "domain", "node", "peer", "ros", "spin"]


@pytest.fixture
def spin(ros: Any) -> Iterator[Callable[..., None]]:
    """Return a function that spins nodes in threads of their own until the test ends."""
    from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor

    assert ros.ok()
    executor = MultiThreadedExecutor(4)
    failures: list[BaseException] = []

    def work() -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            pass
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=work, daemon=True)

    def start(*nodes: Any) -> None:
        for item in nodes:
            executor.add_node(item)
        if not thread.is_alive():
            thread.start()

    yield start
    executor.shutdown(timeout_sec=PATIENCE)
    if thread.ident is not None:
        thread.join(PATIENCE)
        assert not thread.is_alive()
    assert not failures, failures


@pytest.fixture
def cell(ros: Any, spin: Callable[..., None]) -> Iterator[Cell]:
    made = Cell(ros, spin)
    yield made
    made.close()
