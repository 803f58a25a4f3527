"""Whatever happens to writer or file, everything whole comes out; the rest is accounted for."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from bags_for_tests import READING, header, reading_cdr, write_readings
from refused import refused

from stepdiag_ros.bags.errors import BagCutError, BagError
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.recover import RECOVERY_METADATA, recover
from stepdiag_ros.bags.run import load_run

HERE = Path(__file__).parent

WRITER = """
import sys
from bags_for_tests import READING, START, PERIOD, header, reading_cdr, description, put
from stepdiag_ros import topics
from stepdiag_ros.bags.writer import BagWriter

bag = BagWriter(sys.argv[1], header())
put(bag, topics.RUN_DESCRIPTION, description(), START)
number = 0
while True:
    for _ in range(300):
        time = START + number * PERIOD
        bag.write(READING, topics.READING.type_name, reading_cdr(number), time, time, number)
        number += 1
        print("w", number, flush=True)
    bag.flush()
    print("f", number, flush=True)
"""


@pytest.mark.parametrize("moments", [2, 20], ids=["few", "many"])
def test_a_killed_writer_loses_nothing_that_was_flushed(tmp_path, moments):
    """Kill -9 at random moments: never more than what came after the last flush is lost."""
    script = tmp_path / "writer.py"
    script.write_text(WRITER)
    paths = [str(HERE), str(HERE.parent.parent), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    chance = random.Random(3)
    for trial in range(moments):
        bag, log = tmp_path / f"{trial}.mcap", tmp_path / f"{trial}.log"
        with log.open("w") as output:
            process = subprocess.Popen(
                [sys.executable, script, bag], stdout=output, env=environment
            )
            try:
                while not log.stat().st_size:
                    assert process.poll() is None
                    time.sleep(0.005)
                time.sleep(chance.uniform(0.0, 0.25))
            finally:
                process.send_signal(signal.SIGKILL)
                process.wait()
        whole_lines = log.read_text().split("\n")[:-1]  # the last one may be torn
        said = [line.split() for line in whole_lines]
        flushed = max((int(n) for kind, n in said if kind == "f"), default=0)
        written = max((int(n) for kind, n in said if kind == "w"), default=0)
        with pytest.raises(BagCutError):
            BagReader(bag)
        clean = tmp_path / f"{trial}_clean.mcap"
        if not flushed and bag.stat().st_size < 4000:
            assert recover(bag, clean).attachments == 4  # no chunk was full yet: only the head
            continue
        report = recover(bag, clean)
        with BagReader(clean) as found:
            data = [record.data for record in found.records(topics=(READING,))]
            assert found.header == header()
        assert flushed <= len(data) <= written + 1
        assert data == [reading_cdr(n) for n in range(len(data))]
        assert report.losses
        assert load_run(clean).plan.name == "three lines"


def test_an_intact_bag_loses_nothing(tmp_path):
    path = write_readings(tmp_path / "a.mcap", 1000)
    before = path.read_bytes()
    report = recover(path, tmp_path / "b.mcap")
    assert (report.messages, report.losses, report.messages_lost) == (1001, [], 0)
    assert "Nothing was lost" in report.text
    assert path.read_bytes() == before
    assert _readings(tmp_path / "b.mcap") == [reading_cdr(n) for n in range(1000)]
    with BagReader(tmp_path / "b.mcap") as bag:
        assert bag.metadata[RECOVERY_METADATA]["source"] == "a.mcap"
        assert bag.header == header()


def test_a_cut_bag_gives_every_whole_chunk(tmp_path):
    path = write_readings(tmp_path / "a.mcap", 3000, flush_every=250)
    good = path.read_bytes()
    last = -1
    for length in range(len(good) // 10, len(good), len(good) // 10):
        path.write_bytes(good[:length])
        target = tmp_path / f"{length}.mcap"
        report = recover(path, target)
        data = _readings(target)
        assert data == [reading_cdr(n) for n in range(len(data))]
        assert last < len(data)
        assert not report.was_closed
        last = len(data)
    assert last > 2000


def test_a_damaged_chunk_is_left_out_and_its_messages_are_counted(tmp_path):
    path = write_readings(tmp_path / "a.mcap", 3000, flush_every=250, compress=False)
    bad = bytearray(path.read_bytes())
    bad[bad.index(reading_cdr(1100)) + 50] ^= 1
    path.write_bytes(bad)
    report = recover(path, tmp_path / "b.mcap")
    data = _readings(tmp_path / "b.mcap")
    assert report.damaged_chunks == 1
    assert report.lost_is_known
    assert report.messages_lost == 3000 - len(data) > 0
    assert f"{report.messages_lost} messages in them are lost" in report.text
    assert reading_cdr(1100) not in data
    assert set(data) <= {reading_cdr(n) for n in range(3000)}


def test_a_broken_frame_costs_only_what_stands_there(tmp_path):
    path = write_readings(tmp_path / "a.mcap", 3000, flush_every=250)
    bad = bytearray(path.read_bytes())
    with BagReader(path) as bag:
        chunk = bag._chunks[3]
    bad[chunk.offset + 6] ^= 0xFF  # in the length: the next record is no longer where it should be
    path.write_bytes(bad)
    report = recover(path, tmp_path / "b.mcap")
    data = _readings(tmp_path / "b.mcap")
    assert 2400 < len(data) < 3000
    assert reading_cdr(2999) in data
    assert "unreadable" in report.text
    assert not report.lost_is_known


def test_garbage_in_the_middle_is_skipped(tmp_path):
    path = write_readings(tmp_path / "a.mcap", 3000, flush_every=250)
    good = path.read_bytes()
    noise = random.Random(5).randbytes(5000)
    path.write_bytes(good[:60_000] + noise + good[65_000:])
    recover(path, tmp_path / "b.mcap")
    data = _readings(tmp_path / "b.mcap")
    assert reading_cdr(0) in data
    assert reading_cdr(2999) in data
    assert set(data) <= {reading_cdr(n) for n in range(3000)}


def test_damage_in_the_identity_is_said(tmp_path):
    path = write_readings(tmp_path / "a.mcap", 10)
    bad = bytearray(path.read_bytes())
    bad[bad.index(b"bench")] ^= 1
    path.write_bytes(bad)
    report = recover(path, tmp_path / "b.mcap")
    assert "identity" in report.text


def test_a_damaged_attachment_is_left_out_and_said(tmp_path):
    path = write_readings(tmp_path / "a.mcap", 10)
    bad = bytearray(path.read_bytes())
    bad[bad.index(b"hello")] ^= 1
    path.write_bytes(bad)
    report = recover(path, tmp_path / "b.mcap")
    assert report.attachments == 3
    assert "is damaged and was left out" in report.text


def test_nothing_to_save_is_an_error_and_leaves_no_file(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + bytes(200))
    with refused(BagError, "damaged", "a.mcap"):
        recover(path, tmp_path / "b.mcap")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap"]


def test_an_existing_target_is_not_touched(tmp_path):
    path = write_readings(tmp_path / "a.mcap", 10)
    with refused(BagError, "exists", "a.mcap"):
        recover(path, path)


def _readings(path):
    with BagReader(path) as bag:
        return [record.data for record in bag.records(topics=(READING,))]
