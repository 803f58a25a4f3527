"""Which client library is used, how fast it starts, and what it says it lacks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from patience import PATIENCE
from refused import refused

from stepdiag_ros.embedded import dds, ddslib

ROOT = Path(__file__).parents[2]


def run(code: str, *path: Path, **env: str) -> subprocess.CompletedProcess[str]:
    where = os.pathsep.join(str(item) for item in (*path, ROOT))
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        env={**os.environ, "PYTHONPATH": where, **env},
        check=False,
    )


def test_real_ros_wins(tmp_path: Path) -> None:
    for package in ("rclpy", "std_msgs/msg"):
        folder = tmp_path / package
        folder.mkdir(parents=True)
        (folder / "__init__.py").write_text("REAL = True\n")
    (tmp_path / "std_msgs" / "__init__.py").write_text("")
    code = (
        "import sys, stepdiag_ros.client, rclpy, std_msgs.msg\n"
        "from stepdiag_ros.embedded import client\n"
        "assert rclpy.REAL and std_msgs.msg.REAL and client() == 'rclpy'\n"
        "assert not any(item.endswith('embedded/modules') for item in sys.path)\n"
        "assert not any('Interface' in repr(item) for item in sys.meta_path)\n"
        "assert not any('embedded.' in name for name in sys.modules), sys.modules\n"
    )
    result = run(code, tmp_path)
    assert result.returncode == 0, result.stderr


def test_embedded_is_used_without_ros() -> None:
    code = (
        "import sys, stepdiag_ros.client, rclpy\n"
        "from stepdiag_ros.embedded import activate, client\n"
        "assert rclpy.IS_EMBEDDED and client() == 'embedded' == activate()\n"
        "assert sys.path[-1].endswith('modules')\n"
        "assert sum(path.endswith('modules') for path in sys.path) == 1\n"
    )
    result = run(code)
    assert result.returncode == 0, result.stderr


def test_start_is_light() -> None:
    code = (
        "import sys, stepdiag_ros.client, rclpy\n"
        "from rclpy.node import Node\n"
        "from std_msgs.msg import Header\n"
        "from diagnostic_msgs.msg import DiagnosticArray\n"
        "from sensor_msgs.msg import Temperature\n"
        "heavy = {'numpy', 'scipy', 'rosbags', 'yaml', 'cyclonedds'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    assert_light(code)


def test_lifecycle_and_actions_are_loaded_by_those_who_use_them() -> None:
    code = (
        "import sys, stepdiag_ros.client, rclpy\n"
        "from rclpy.node import Node\n"
        "parts = ('rclpy.lifecycle', 'rclpy.action', 'stepdiag_ros.embedded.actions')\n"
        "assert not any(name.startswith(parts) for name in sys.modules)\n"
        "from rclpy.lifecycle import LifecycleNode\n"
        "from lifecycle_msgs.srv import ChangeState\n"
        "from tf2_msgs.msg import TFMessage\n"
        "from visualization_msgs.msg import MarkerArray\n"
        "heavy = {'scipy', 'rosbags', 'yaml', 'cyclonedds'}\n"
        "assert not ({'numpy'} | heavy) & set(sys.modules)\n"
        "from rclpy.action import ActionServer\n"
        "from example_interfaces.action import Fibonacci\n"
        "# A goal's identity is a fixed array, which is numpy's in rclpy too.\n"
        "assert not heavy & set(sys.modules)\n"
    )
    assert_light(code)


def assert_light(code: str) -> None:
    """Check that a program, which itself checks what is imported, runs without error."""
    result = run(code)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("import rclpy.waitable", "no rclpy.waitable"),
        ("from rclpy.impl.implementation_singleton import x", "no rclpy.impl"),
        ("import rclpy; rclpy.logging_service_x", "no rclpy.logging_service_x"),
        (
            "import rclpy; rclpy.init(); rclpy.create_node('a').add_waitable(1)",
            "no attribute 'add_waitable'",
        ),
    ],
)
def test_missing_parts_are_named(code: str, reason: str) -> None:
    result = run(f"import stepdiag_ros.client\n{code}")
    assert result.returncode == 1
    assert reason in result.stderr.splitlines()[-1]


def test_bad_environment_is_explained() -> None:
    code = "import stepdiag_ros.client, rclpy; rclpy.init()"
    for env, reason in (
        ({"ROS_DOMAIN_ID": "abc"}, "ROS_DOMAIN_ID is 'abc'"),
        ({"ROS_DOMAIN_ID": "233"}, "ROS_DOMAIN_ID is 233"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "HERE"}, "ROS_AUTOMATIC_DISCOVERY_RANGE is 'HERE'"),
    ):
        result = run(code, **env)
        assert result.returncode == 1 and reason in result.stderr, result.stderr


def test_missing_library_is_explained(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    monkeypatch.setattr("ctypes.util.find_library", lambda _: None)
    with refused(ddslib.DdsError, None, "cyclonedds"):
        ddslib.library_path()
    wrong = tmp_path / "libddsc.so"
    wrong.write_text("no library")
    with refused(ddslib.DdsError, None, str(wrong)):
        ddslib.Library(str(wrong))


def test_self_test_notices_a_library_that_loses_samples(
    monkeypatch: pytest.MonkeyPatch, domain: int
) -> None:
    participant = dds.Participant(domain)
    try:
        dds.self_test(participant)
        monkeypatch.setattr(dds.Reader, "take", lambda _: [])
        with refused(ddslib.DdsError, None, ddslib.library_path()):
            dds.self_test(participant)
    finally:
        participant.close()


def test_client_is_named_once_in_the_log() -> None:
    code = (
        "import stepdiag_ros.client, rclpy\n"
        "for _ in range(2):\n"
        "    rclpy.init()\n"
        "    rclpy.create_node('a')\n"
        "    rclpy.shutdown()\n"
    )
    result = run(code)
    assert result.returncode == 0
    assert result.stderr.count("This is the embedded ROS 2 client") == 1


def test_own_messages_come_from_the_packages_folder() -> None:
    from stepdiag_ros import resources
    from stepdiag_ros.embedded import registry

    files = sorted(path.stem for path in resources.directory("msg").glob("*.msg"))
    assert files and registry.names("stepdiag_ros", "msg") == files
    for name in files:
        cls = registry.message_class(f"stepdiag_ros/msg/{name}")
        message = cls()
        assert registry.deserializer(cls)(registry.serializer(cls)(message)) == message
