"""A node that cannot do what it is asked for says so in one sentence, and ends."""

import subprocess
import sys

import pytest
from patience import PATIENCE


def start(name, *arguments):
    return subprocess.run(
        [sys.executable, "-m", f"stepdiag_ros.nodes.{name}", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("sequencer", ("-p", "plan:=nonsense"), "there is no plan 'nonsense'"),
        (
            "sequencer",
            ("-p", "plan:=3"),
            "'plan' of node sequencer is 3; expected a text",
        ),
        ("sequencer", ("-p", "plans:=demo"), "has no parameter 'plans'; did you mean 'plan'?"),
        (
            "solver",
            ("-p", "use_sim_time:=maybe"),
            "'use_sim_time' of node solver is 'maybe'; expected true or",
        ),
        ("weather", ("-r", "__node:=1bad"), "Invalid node name"),
        ("clock", ("-p", "factor:=2"), "is 2; expected a number with a point"),
        (
            "clock",
            ("-p", "factor:=0.0"),
            "such as 1.0, from 0.001 to 1000",
        ),
        ("interferometer", ("-p", "rate:=0.001"), "'rate_hz' is 0.001; expected"),
        ("bridge", ("-p", "device:=nonsense"), "there is no cnc driver 'nonsense'"),
        ("diagnosis", ("-p", "model:=nonsense"), "there is no model 'nonsense'"),
        ("diagnosis", ("-p", "pause_s:=-1.0"), "'pause_s' of node diagnosis is -1.0; expected"),
        ("recorder", ("-p", "folder:=/dev/null/bags"), "/dev/null/bags: not a directory"),
    ],
)
def test_a_wrong_parameter_is_refused(name, arguments, message):
    done = start(name, "--ros-args", *arguments)
    assert done.returncode == 1
    said = [line for line in done.stderr.splitlines() if "embedded ROS 2 client" not in line]
    assert len(said) == 1, done.stderr
    assert said[0].startswith("stepdiag: error: ")
    assert message in said[0]


def test_parameters_without_ros_args_are_not_ignored():
    done = start("sequencer", "-p", "plan:=quick")
    assert done.returncode == 1
    assert "'-p plan:=quick' is not understood; parameters go behind --ros-args" in done.stderr


def test_a_wrong_domain_is_said_without_a_traceback(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "nonsense")
    done = start("solver")
    assert done.returncode == 1
    assert "ROS_DOMAIN_ID is 'nonsense'" in done.stderr
    assert "Traceback" not in done.stderr
