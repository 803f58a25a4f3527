"""A bag opens without this package: in mcap, in mcap-ros2-support and in rosbags."""

import subprocess
import sys
import textwrap

import pytest
from bags_for_tests import description, header, put, reading_cdr

from stepdiag_ros import topics
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.metrology.measurement import Environment

COUNT = 250

READERS = {
    "mcap": """
        from mcap.reader import make_reader
        with open(path, "rb") as file:
            reader = make_reader(file, validate_crcs=True)
            assert reader.get_header().profile == "ros2"
            for schema, channel, message in reader.iter_messages():
                assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
                counts[channel.topic] += 1
                if channel.topic == "/interferometer/reading":
                    checks.append(message.sequence == counts[channel.topic] - 1)
            texts = {a.name: a.data.decode() for a in reader.iter_attachments()}
            assert "three lines" in texts["plan.yaml"]
            metadata = {m.name: m.metadata for m in reader.iter_metadata()}
            assert metadata["stepdiag_ros.run"]["run_id"] == "20260101-000000-abcd"
    """,
    "mcap-ros2-support": """
        from mcap_ros2.reader import read_ros2_messages
        for item in read_ros2_messages(path):
            counts[item.channel.topic] += 1
            message = item.ros_msg
            if item.channel.topic == "/interferometer/reading":
                checks.append(message.sequence == counts[item.channel.topic] - 1)
                checks.append(message.header.frame_id == "laser")
            elif item.channel.topic == "/measurement/line":
                checks.append(list(message.displacement) == [0.0, 0.25, 0.5])
                checks.append(list(message.target) == [float(n) for n in range(9)])
                checks.append(list(message.offset) == [0.0, 0.5, 0.0])
    """,
    "rosbags": """
        from pathlib import Path
        from rosbags.highlevel import AnyReader
        with AnyReader([Path(path)]) as reader:
            for connection, time, raw in reader.messages():
                counts[connection.topic] += 1
                message = reader.deserialize(raw, connection.msgtype)
                if connection.topic == "/interferometer/reading":
                    checks.append(message.sequence == counts[connection.topic] - 1)
                    checks.append(message.STATUS_BEAM_LOST == 2)
                elif connection.topic == "/measurement/line":
                    checks.append(message.displacement.tolist() == [0.0, 0.25, 0.5])
    """,
}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Write one message of every topic, and many readings."""
    path = tmp_path_factory.mktemp("foreign") / "a.mcap"
    types = own_types()
    with BagWriter(path, header()) as writer:
        for topic in topics.RECORDED:
            message = types.new(topic.type_name)
            if topic is topics.RUN_DESCRIPTION:
                message = description()
            elif topic is topics.LINE:
                message = _line(message)
            if topic is not topics.READING:
                put(writer, topic, message, 1000)
        for number in range(COUNT):
            writer.write(
                topics.absolute(topics.READING),
                topics.READING.type_name,
                reading_cdr(number),
                2000 + number,
                sequence=number,
            )
    return path


def _line(message):
    message.line, message.offset = "x", [0.0, 0.5, 0.0]
    message.time = [0.0, 1.0, 2.0]
    message.target = list(range(9))  # whole numbers, which must not be written as such
    message.displacement = [0.0, 0.25, 0.5]
    message.standard_uncertainty = [1e-7] * 3
    for name in Environment._fields:
        setattr(message, name, [20.0] * 3)
    set_header(message, 1000)
    return message


@pytest.mark.parametrize("library", READERS)
def test_the_bag_opens_without_this_package(bag, tmp_path, library):
    script = tmp_path / "read.py"
    script.write_text(
        "import sys\nfrom collections import Counter\n"
        "sys.modules['stepdiag_ros'] = None\n"
        "path, counts, checks = sys.argv[1], Counter(), []\n"
        + textwrap.dedent(READERS[library])
        + "assert all(checks), checks\n"
        + "print(len(checks), sorted(counts.items()))\n"
    )
    run = subprocess.run([sys.executable, "-I", script, bag], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    expected = {topics.absolute(topic): 1 for topic in topics.RECORDED}
    expected[topics.absolute(topics.READING)] = COUNT
    checks, counts = run.stdout.split(maxsplit=1)
    assert int(checks) >= COUNT
    assert counts.strip() == str(sorted(expected.items()))
