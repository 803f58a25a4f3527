"""The recorder on a computer where the many readings come later than the few stops."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import rclpy
from rclpy.serialization import serialize_message

from stepdiag_ros import topics
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.configuration import load_machine, load_plan
from stepdiag_ros.nodes.links import message_class
from stepdiag_ros.nodes.recorder import LINGER, RecorderNode
from stepdiag_ros.run.sequence import STORE_LIMIT
from stepdiag_ros.run.supervision import HEARD_UNTIL

RUN = "20260101T000000Z-abcdef"
SECOND = 1_000_000_000


@pytest.fixture
def recorder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RecorderNode]:
    rclpy.init(args=["--ros-args", "-p", f"folder:='{tmp_path}'"])
    node = RecorderNode()
    node.test_time = 100.0  # type: ignore[attr-defined]
    monkeypatch.setattr(node, "real_time", lambda: node.test_time)  # type: ignore[attr-defined]
    description = message_class(topics.RUN_DESCRIPTION)(
        run_id=RUN,
        schema_version=1,
        software_version="0",
        plan=load_plan("quick")[1],
        machine=load_machine("demo")[1],
    )
    node.on_run(description)
    node.run_id = RUN
    yield node
    node.close()
    node.destroy_node()
    rclpy.try_shutdown()


def stamped(topic: topics.Topic, seconds: float, **fields: Any) -> bytes:
    message = message_class(topic)(**fields)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(round(seconds * SECOND), SECOND)
    return bytes(serialize_message(message))


def stop(command: int, window_end: int) -> bytes:
    message = message_class(topics.STOP)(run_id=RUN, command_id=command)
    message.window_end.sec = window_end
    return bytes(serialize_message(message))


def test_a_stop_is_stored_with_the_readings_that_it_was_made_from(recorder: RecorderNode) -> None:
    recorder._record(topics.READING, stamped(topics.READING, 1.0))
    recorder._record(topics.STOP, stop(7, window_end=2))
    recorder._record(topics.STOP, stop(8, window_end=4))
    assert "stored" not in recorder.facts
    recorder._record(topics.READING, stamped(topics.READING, 1.999))
    assert "stored" not in recorder.facts
    recorder._record(topics.READING, stamped(topics.READING, 2.0))
    assert recorder.facts["stored"] == f"{RUN} 7"
    recorder._record(topics.READING, stamped(topics.READING, 5.0))
    assert recorder.facts["stored"] == f"{RUN} 8"


def test_the_bag_stays_open_for_the_readings_of_the_last_stop(
    recorder: RecorderNode, tmp_path: Path
) -> None:
    recorder._record(topics.STOP, stop(7, window_end=2))
    recorder.on_run_end()
    recorder.test_time += 3 * LINGER  # type: ignore[attr-defined]
    recorder._close_when_over()
    recorder._record(topics.READING, stamped(topics.READING, 2.0))
    recorder.test_time += 2 * LINGER  # type: ignore[attr-defined]
    recorder._close_when_over()
    with BagReader(tmp_path / f"{RUN}.mcap") as bag:
        assert "/interferometer/reading" in bag.topics


def test_readings_that_never_come_do_not_keep_the_bag_open(
    recorder: RecorderNode, tmp_path: Path
) -> None:
    recorder._record(topics.STOP, stop(7, window_end=2))
    recorder.on_run_end()
    for _ in range(2):
        recorder.test_time += STORE_LIMIT  # type: ignore[attr-defined]
        recorder._close_when_over()
    with BagReader(tmp_path / f"{RUN}.mcap") as bag:
        assert "/measurement/stop" in bag.topics


def test_the_heartbeat_says_how_far_the_readings_were_taken(
    recorder: RecorderNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[Any] = []
    monkeypatch.setattr(recorder.health, "_publisher", SimpleNamespace(publish=told.append))

    def heartbeat() -> dict[str, str]:
        recorder.beat()
        return {entry.key: entry.value for entry in told[-1].status[0].values}

    assert HEARD_UNTIL not in heartbeat()
    recorder._record(topics.READING, stamped(topics.READING, 2.5))
    assert heartbeat()[HEARD_UNTIL] == "2500000000"
