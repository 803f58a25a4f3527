"""How fast bags are written and read, beside plain ``mcap`` and ``rosbags`` on the same messages.

Every library writes, and reads back from its own file, the same 1 kHz stream of readings. Ours
flushes to the disk every second, as the recorder does at each stop, and always compares checksums.
Prints JSON: messages per second, median of several rounds, and our ratio to each.

    python benchmarks/bags.py [MESSAGES] [ROUNDS]
"""

import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import Reader as RosbagsReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stepdiag_ros import topics
from stepdiag_ros.bags.header import RunHeader
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.messages import conversion
from stepdiag_ros.metrology.measurement import Environment, Reading

TYPE = topics.READING.type_name
TOPIC = topics.absolute(topics.READING)
START = 1_700_000_000_000_000_000
PERIOD = 1_000_000
Messages = list[bytes]


def make_messages(count: int) -> Messages:
    """Return serialised readings with noise in their last digits, as real ones have."""
    types = own_types()
    message = types.new(TYPE)
    data = []
    for number in range(count):
        noise = (number * 2654435761 % 2**32) / 2**32 * 1e-7
        air = Environment(20.0 + 1e4 * noise, 101325.0 + 1e6 * noise, 0.5, 20.0)
        reading = Reading(START + number * PERIOD, number, noise, noise / 1.00027, 0.9, 0, air)
        data.append(types.encode(TYPE, conversion.from_reading(reading, "laser", message=message)))
    return data


def write_ours(path: Path, messages: Messages) -> None:
    """Write with small compressed chunks and a flush to the disk every 1,000 messages."""
    header = RunHeader("benchmark", "none", "0", 1, "none", START)
    with BagWriter(path, header) as bag:
        for number, data in enumerate(messages):
            bag.write(TOPIC, TYPE, data, START + number * PERIOD, sequence=number)
            if number % 1000 == 999:
                bag.flush()


def write_mcap(path: Path, messages: Messages) -> None:
    """Write with the library's defaults: chunks of 1 MiB, no flush."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2")
        schema = writer.register_schema(TYPE, "ros2msg", own_types().schema(TYPE).encode())
        channel = writer.register_channel(TOPIC, "cdr", schema)
        for number, data in enumerate(messages):
            log_time = START + number * PERIOD
            writer.add_message(channel, log_time, data, log_time, number)
        writer.finish()


def _rosbags_store() -> Any:
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(own_types().schema(TYPE), TYPE))
    return store


def write_rosbags(path: Path, messages: Messages) -> None:
    """Write with the library's defaults into MCAP: chunks of 1 MiB, not compressed, no flush."""
    writer = RosbagsWriter(path, version=9, storage_plugin=StoragePlugin.MCAP)
    with writer:
        connection = writer.add_connection(TOPIC, TYPE, typestore=_rosbags_store())
        for number, data in enumerate(messages):
            writer.write(connection, START + number * PERIOD, data)


def read_ours(path: Path) -> int:
    """Read in order of time, with every checksum compared."""
    with BagReader(path) as bag:
        return sum(len(record.data) for record in bag.records("time"))


def read_mcap(path: Path) -> int:
    """Read in order of time, with checksums compared."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return sum(len(message.data) for _, _, message in reader.iter_messages())


def read_rosbags(path: Path) -> int:
    """Read in order of time."""
    with RosbagsReader(path) as bag:
        return sum(len(data) for _, _, data in bag.messages())


def decode_ours(path: Path) -> int:
    """Read and decode every message."""
    with BagReader(path) as bag:
        return sum(1 for _ in bag.messages("time"))


def decode_rosbags(path: Path) -> int:
    """Read and decode every message."""
    store = _rosbags_store()
    with RosbagsReader(path) as bag:
        return sum(1 for _, _, data in bag.messages() if store.deserialize_cdr(data, TYPE))


Write = Callable[[Path, Messages], None]
WRITERS: dict[str, Write] = {
    "stepdiag_ros": write_ours,
    "mcap": write_mcap,
    "rosbags": write_rosbags,
}
READERS: dict[str, dict[str, Callable[[Path], int]]] = {
    "read": {"stepdiag_ros": read_ours, "mcap": read_mcap, "rosbags": read_rosbags},
    "decode": {"stepdiag_ros": decode_ours, "rosbags": decode_rosbags},
}


def measure(count: int, rounds: int) -> dict[str, Any]:
    """Return messages per second of each library, and our ratio to the others."""
    messages = make_messages(count)
    rates: dict[str, dict[str, list[float]]] = {"write": {}, "read": {}, "decode": {}}
    sizes: dict[str, int] = {}
    # Interleaved, so that whatever else the machine does meets all libraries alike.
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            for name, write in WRITERS.items():
                path = Path(folder) / f"{name}.mcap"
                _time(rates["write"], name, count, partial(write, path, messages))
                written = [path] if path.is_file() else list(path.glob("*.mcap"))
                sizes[name] = sum(file.stat().st_size for file in written)
            for what, readers in READERS.items():
                for name, read in readers.items():
                    path = Path(folder) / f"{name}.mcap"
                    _time(rates[what], name, count, partial(read, path))
    report: dict[str, Any] = {"messages": count, "bytes_per_message": len(messages[0])}
    for what, by_name in rates.items():
        median = {name: statistics.median(values) for name, values in by_name.items()}
        ours = median["stepdiag_ros"]
        report[what] = {
            "messages_per_second": {name: round(rate) for name, rate in median.items()},
            "ratio_to": {
                name: round(ours / rate, 2) for name, rate in median.items() if rate is not ours
            },
        }
    report["file_size"] = sizes
    return report


def _time(
    rates: dict[str, list[float]], name: str, count: int, action: Callable[[], object]
) -> None:
    begin = time.perf_counter()
    action()
    rates.setdefault(name, []).append(count / (time.perf_counter() - begin))


if __name__ == "__main__":
    count, rounds = (int(text) for text in (sys.argv[1:] + ["60000", "5"][len(sys.argv) - 1 :]))
    print(json.dumps(measure(count, rounds), indent=2))
