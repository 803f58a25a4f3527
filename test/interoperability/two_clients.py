"""Two sides, each with a ROS 2 client of its own, in processes and environments of their own."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

SUBJECTS = ("latched", "messages", "graph", "services", "parameters", "lifecycle", "actions")
"""What the asker can be told to ask about."""
NO_SERVICES = SUBJECTS[:3]
"""Those without services, in which middlewares of different makers do not agree."""
FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]
ASK_LIMIT = 180.0
"""Real seconds that all questions together may take."""
_OF_A_SOURCED_ROS = (
    "AMENT_PREFIX_PATH",
    "CMAKE_PREFIX_PATH",
    "COLCON_PREFIX_PATH",
    "LD_LIBRARY_PATH",
    "PYTHONPATH",
    "RMW_IMPLEMENTATION",
    "ROS_DISTRO",
    "ROS_PYTHON_VERSION",
    "ROS_VERSION",
)
_PROBE = """
import rclpy
import stepdiag_ros.msg
rclpy.init()
print(rclpy.get_rmw_implementation_identifier())
"""


class NotThere(Exception):
    """One of the sides cannot run here; the text says why."""


def environment(client: str) -> dict[str, str]:
    """Return the environment of a process with a client, ``real`` or ``embedded``."""
    kept = dict(os.environ)
    if client == "embedded":
        kept = {key: value for key, value in kept.items() if key not in _OF_A_SOURCED_ROS}
        kept["PYTHONPATH"] = str(ROOT)
    return kept


def interpreter(client: str) -> str:
    """Return the Python of a client: for the real one that which ROS 2 itself was built for.

    Raises:
        NotThere: no ROS 2 is sourced.
    """
    if client == "embedded":
        return sys.executable
    command = shutil.which("ros2")
    if command is None:
        raise NotThere("no ROS 2 is sourced in this shell, so the real side cannot run")
    first = Path(command).read_text("utf-8").splitlines()[0]
    return first.removeprefix("#!").split()[-1] if first.startswith("#!") else "python3"


@cache
def middleware() -> str:
    """Return the middleware of the sourced ROS 2, for example ``rmw_cyclonedds_cpp``.

    Raises:
        NotThere: there is none, or it lacks this package.
    """
    found = subprocess.run(
        [interpreter("real"), "-c", _PROBE],
        env=environment("real"),
        cwd=FOLDER,
        capture_output=True,
        text=True,
        timeout=60,
    )
    if found.returncode:
        why = found.stderr.strip().splitlines()[-1]
        raise NotThere(f"a ROS 2 is sourced, but this package was not built for it: {why}")
    return found.stdout.split()[-1]


@contextmanager
def serving(client: str) -> Iterator[subprocess.Popen[str]]:
    """Let a server with a client serve while the block runs."""
    command = [interpreter(client), str(FOLDER / "echo_server.py")]
    with subprocess.Popen(
        command, env=environment(client), stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            said = []
            for line in process.stdout:
                said.append(line)
                if line.startswith("serving"):
                    break
            else:
                raise AssertionError(f"the server with the {client} client ended: {''.join(said)}")
            yield process
            assert process.poll() is None, "the server has died"
        finally:
            process.terminate()
            try:
                process.wait(8)
            except subprocess.TimeoutExpired:
                process.kill()


Found = dict[str, dict[str, tuple[bool, str]]]
"""Subject → check → whether it passed, and what was seen."""


def ask(client: str, subjects: tuple[str, ...]) -> Found:
    """Ask the server about subjects with a client, and return what was found."""
    done = subprocess.run(
        [interpreter(client), str(FOLDER / "echo_asker.py"), *subjects],
        env=environment(client),
        capture_output=True,
        text=True,
        timeout=ASK_LIMIT,
    )
    assert done.returncode == 0, done.stderr
    found: Found = {}
    for line in done.stdout.splitlines():
        subject, check, passed, detail = json.loads(line)
        found.setdefault(subject, {})[check] = (passed, detail)
    return found
