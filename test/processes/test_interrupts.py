"""Ctrl-C in the middle of a log line ends a command without a traceback."""

import signal
import subprocess
import sys
import time

import pytest

LOGS = """\
import logging
import stepdiag_ros.client
from rclpy.logging import get_logger
from stepdiag_ros.nodes import interrupts

logging.basicConfig(level=logging.INFO)
try:
    with interrupts.raised():
        print("begun", flush=True)
        while True:
            get_logger("node").info("a line")
            logging.getLogger("library").info("a line")
except KeyboardInterrupt:
    print("ended", flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM] * 2)
def test_a_signal_while_lines_are_logged_prints_no_traceback(tmp_path, number):
    log = tmp_path / "log"
    with log.open("w") as stream:
        process = subprocess.Popen(
            [sys.executable, "-c", LOGS], stdout=subprocess.PIPE, stderr=stream, text=True
        )
        assert process.stdout.readline() == "begun\n"
        while log.stat().st_size < 10_000:
            time.sleep(0.01)
        process.send_signal(number)
        assert process.communicate(timeout=30)[0] == "ended\n"
    assert process.returncode == 0
    said = log.read_text()
    assert "a line" in said
    assert not any(word in said for word in ("Traceback", "Logging error"))
