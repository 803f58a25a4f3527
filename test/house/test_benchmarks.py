"""The benchmarks are no tests, but they can run, and what compares two clients counts right."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"


def test_every_benchmark_finds_what_it_imports() -> None:
    started = {
        path.name: subprocess.Popen(
            [sys.executable, "-c", f"import {path.stem}"], cwd=FOLDER, stderr=subprocess.PIPE
        )
        for path in FOLDER.glob("*.py")
    }
    assert len(started) >= 8
    for name, process in started.items():
        _, err = process.communicate(timeout=600)
        assert process.returncode == 0, (name, err.decode())


@pytest.fixture
def clients(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(FOLDER))
    import clients

    return clients


def test_ratios_are_of_one_round_and_held_against_the_bars(clients: Any) -> None:
    def run(trip: float, rate: float) -> dict[str, Any]:
        figures = {"round_trip_us": trip, "messages_per_second": rate}
        return dict.fromkeys(clients.names(), figures)

    ours = [run(100.0, 40_000.0), run(200.0, 20_000.0), run(90.0, 45_000.0)]
    others = [run(200.0, 8_000.0), run(400.0, 4_000.0), run(300.0, 4_500.0)]
    found = clients.ratios(ours, others)
    assert set(found) == {"text_100", "text_10000", "numbers_100", "numbers_10000"}
    assert found["text_100"]["round_trip"] == {"median": 0.5, "of": [0.3, 0.5]}
    assert found["text_100"]["rate"] == {"median": 5.0, "of": [5.0, 10.0]}
    assert clients.met(found)
    found["numbers_10000"]["rate"]["median"] = 3.9
    assert not clients.met(found)


def test_messages_have_their_size_and_number(clients: Any) -> None:
    import stepdiag_ros.client  # noqa: F401 - makes rclpy importable

    for name in clients.KINDS:
        for size in clients.SIZES:
            kind = clients.Kind(name, size)
            message = kind.make(7)
            content = message.data.encode() if name == "text" else message.data.tobytes()
            assert kind.number(message) == 7
            assert size - 8 < len(content) <= size
