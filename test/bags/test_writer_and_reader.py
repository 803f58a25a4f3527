"""What is written is what is read; whatever is not what was written is refused."""

import random
import subprocess
import sys
import textwrap

import pytest
from bags_for_tests import PERIOD, READING, START, header, reading, reading_cdr, write_readings
from refused import refused

from stepdiag_ros import topics
from stepdiag_ros.bags.errors import BagCorruptError, BagCutError, BagError
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.messages import conversion


def test_messages_come_back_byte_for_byte_with_their_times(tmp_path):
    path = write_readings(tmp_path / "a.mcap", 2000)
    with BagReader(path) as bag:
        records = list(bag.records(topics=(READING,)))
        decoded = [conversion.to_reading(bag.decode(record)) for record in records]
    assert [record.data for record in records] == [reading_cdr(n) for n in range(2000)]
    assert [record.log_time for record in records] == [START + n * PERIOD + 5 for n in range(2000)]
    assert [record.publish_time for record in records] == [START + n * PERIOD for n in range(2000)]
    assert [record.sequence for record in records] == list(range(2000))
    assert {record.type_name for record in records} == {topics.READING.type_name}
    assert decoded == [reading(n) for n in range(2000)]


def test_identity_and_files_come_back(tmp_path):
    path = write_readings(tmp_path / "a.mcap", 3)
    with BagReader(path) as bag:
        assert bag.header == header()
        assert list(bag.topics) == ["/run/description", READING]
        assert bag.start_time == START
        assert bag.end_time == START + 2 * PERIOD + 5


def test_identity_and_files_stand_in_front_of_all_messages(tmp_path):
    path = tmp_path / "a.mcap"
    bag = BagWriter(path, header())
    before = path.read_bytes()
    bag.close()
    for text in (b"three lines", b"test machine", b"assembler: {}", b"hello", b"bench"):
        assert text in before


def test_flush_puts_every_message_into_the_file(tmp_path):
    path = tmp_path / "a.mcap"
    bag = BagWriter(path, header(), compress=False)
    bag.write(READING, topics.READING.type_name, reading_cdr(1), START)
    assert reading_cdr(1) not in path.read_bytes()
    bag.flush()
    assert reading_cdr(1) in path.read_bytes()
    bag.close()


def test_time_order_sorts_messages_of_overlapping_chunks_and_keeps_equal_times_as_written(tmp_path):
    path = tmp_path / "a.mcap"
    chance = random.Random(1)
    times = [number // 10 + chance.randrange(20) for number in range(400)]
    assert times != sorted(times)
    with BagWriter(path, header(), chunk_size=500) as bag:
        for number, time in enumerate(times):
            bag.write(READING, topics.READING.type_name, reading_cdr(0), time, sequence=number)
    with BagReader(path) as bag:
        assert bag.chunk_count > 20
        found = [(record.log_time, record.sequence) for record in bag.records("time")]
        in_file = [record.sequence for record in bag.records("file")]
        part = [record.log_time for record in bag.records("time", start=10, end=12)]
    assert found == sorted((time, number) for number, time in enumerate(times))
    assert in_file == list(range(400))
    assert part == sorted(time for time in times if 10 <= time <= 12)


def test_an_existing_file_is_never_overwritten(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"precious")
    with refused(BagError, "exists", "a.mcap"):
        BagWriter(path, header())
    assert path.read_bytes() == b"precious"


def test_a_missing_folder_is_named(tmp_path):
    with refused(BagError, "not_found", "a.mcap"):
        BagWriter(tmp_path / "nowhere" / "a.mcap", header())


def test_two_types_on_one_topic_are_refused(tmp_path):
    with BagWriter(tmp_path / "a.mcap", header()) as bag:
        bag.write("/t", topics.READING.type_name, reading_cdr(0), START)
        with refused(BagError, "mismatch", "a.mcap"):
            bag.write("/t", topics.RUN_STATE.type_name, b"", START)


def test_an_unknown_type_is_refused(tmp_path):
    with (
        BagWriter(tmp_path / "a.mcap", header()) as bag,
        refused(BagError, "unknown", "no_such/msg/Thing"),
    ):
        bag.write("/t", "no_such/msg/Thing", b"", START)


def test_a_closed_bag_takes_nothing(tmp_path):
    bag = BagWriter(tmp_path / "a.mcap", header())
    bag.close()
    bag.close()
    with refused(BagError, "stopped", "a.mcap"):
        bag.write(READING, topics.READING.type_name, reading_cdr(0), START)


def test_latched_topics_are_offered_as_transient_local(tmp_path):
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import QosDurability, QosReliability

    path = write_readings(tmp_path / "a.mcap", 1)
    with AnyReader([path]) as bag:
        offered = {c.topic: c.ext.offered_qos_profiles[0] for c in bag.connections}
    assert offered["/run/description"].durability is QosDurability.TRANSIENT_LOCAL
    assert offered["/run/description"].depth == topics.RUN_DESCRIPTION.depth
    assert offered[READING].durability is QosDurability.VOLATILE
    assert offered[READING].depth == topics.READING.depth
    assert all(qos.reliability is QosReliability.RELIABLE for qos in offered.values())


@pytest.mark.parametrize("compress", [True, False])
def test_a_flipped_bit_anywhere_is_noticed(tmp_path, compress):
    path = write_readings(tmp_path / "a.mcap", 1500, compress=compress)
    good = path.read_bytes()
    chance = random.Random(2)
    unnoticed = []
    for _ in range(150):
        place, bit = chance.randrange(8, len(good)), chance.randrange(8)
        bad = bytearray(good)
        bad[place] ^= 1 << bit
        path.write_bytes(bad)
        try:
            with BagReader(path) as bag:
                list(bag.messages())
            unnoticed.append((place, bit))
        except BagError as error:
            assert "stepdiag recover" in str(error)
    assert unnoticed == []


def test_a_damaged_chunk_is_named_by_its_offset(tmp_path):
    path = write_readings(tmp_path / "a.mcap", 1500, compress=False)
    good = path.read_bytes()
    place = good.index(reading_cdr(700))
    bad = bytearray(good)
    bad[place + 40] ^= 4
    path.write_bytes(bad)
    with refused(BagCorruptError, "damaged", "a.mcap") as caught:
        BagReader(path)
    offset = int(str(caught.value).split("record at byte ")[1].split()[0])
    assert offset < place < offset + 40_000
    assert good[offset] == 6


def test_every_cut_is_recognised(tmp_path):
    path = write_readings(tmp_path / "a.mcap", 300)
    good = path.read_bytes()
    for length in [9, 60, len(good) // 2, len(good) - 37, len(good) - 8, len(good) - 1]:
        path.write_bytes(good[:length])
        with refused(BagCutError, "cut", "a.mcap"):
            BagReader(path)


def test_what_is_no_bag_is_said_to_be_none(tmp_path):
    (tmp_path / "empty.mcap").touch()
    with refused(BagCutError, "too_few", "empty.mcap"):
        BagReader(tmp_path / "empty.mcap")
    (tmp_path / "text.mcap").write_text("hello, this is a text")
    with refused(BagError, "wrong_kind", "text.mcap"):
        BagReader(tmp_path / "text.mcap")
    with refused(BagError, "not_found", "nothing.mcap"):
        BagReader(tmp_path / "nothing.mcap")


def test_bytes_that_are_no_message_are_named_with_topic_and_time(tmp_path):
    path = tmp_path / "a.mcap"
    with BagWriter(path, header()) as bag:
        bag.write(READING, topics.READING.type_name, reading_cdr(0)[:30], START)
    with BagReader(path) as bag, refused(BagError, "malformed", READING, str(START)):
        list(bag.messages())


def test_a_full_disk_is_an_error_and_what_was_written_stays_readable(tmp_path):
    from stepdiag_ros.bags.recover import recover

    script = tmp_path / "fill.py"
    script.write_text(
        textwrap.dedent(
            """
            import resource, signal, sys
            from pathlib import Path
            from bags_for_tests import READING, START, PERIOD, header, reading_cdr
            from stepdiag_ros import topics
            from stepdiag_ros.bags.errors import BagWriteError
            from stepdiag_ros.bags.writer import BagWriter

            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            bag = BagWriter(sys.argv[1], header(), compress=False)
            resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
            try:
                for number in range(10_000):
                    time = START + number * PERIOD
                    bag.write(READING, topics.READING.type_name, reading_cdr(number), time)
            except BagWriteError as error:
                print(number, error)
            try:
                bag.close()
            except BagWriteError as error:
                print("close says so too")
            """
        )
    )
    path = tmp_path / "a.mcap"
    run = subprocess.run(
        [sys.executable, script, path], capture_output=True, text=True, env=_environment()
    )
    assert run.returncode == 0, run.stderr
    assert "the disk is full" in run.stdout
    assert "close says so too" in run.stdout
    written = int(run.stdout.split()[0])
    report = recover(path, tmp_path / "b.mcap")
    assert written - 400 < report.messages <= written


def _environment():
    import os
    from pathlib import Path

    here = Path(__file__).parent
    paths = [str(here), str(here.parent.parent), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
