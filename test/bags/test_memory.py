"""What reading a bag keeps in memory does not grow with its file."""

import sys
from pathlib import Path

import pytest
from bags_for_tests import PERIOD, READING, START, header

from stepdiag_ros import topics
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.writer import BagWriter

MEGABYTE = 2**20
SIZE = 64


def mapped():
    """Return how many bytes of mapped files are in memory."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    told = dict(line.split(":", 1) for line in lines)
    return int(told["RssFile"].split()[0]) * 1024


@pytest.mark.skipif(sys.platform != "linux", reason="Linux tells what is mapped")
def test_the_file_does_not_stay_in_memory(tmp_path):
    path = tmp_path / "run.mcap"
    with BagWriter(path, header(), compress=False) as bag:
        for number in range(SIZE):
            data = bytes([number]) * MEGABYTE
            bag.write(READING, topics.READING.type_name, data, START + number * PERIOD)
    before = mapped()
    with BagReader(path) as bag:
        assert bag.size > SIZE * MEGABYTE
        most = max(mapped() for _ in bag.records())
    assert most - before < SIZE * MEGABYTE / 3
