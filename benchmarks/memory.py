"""Peak memory of ``stepdiag solve`` over the length of a bag at 1 kHz, as JSON.

A run of ``stepdiag demo`` is copied, and its readings go on at 1 kHz behind its end, as when nobody
stops the recorder. Each bag is solved in a fresh process, as a user would; peak memory is the
largest resident set that Linux saw of it. The exit code is 1 if the longest bag takes more than 50
MB beyond the shortest.

    python benchmarks/memory.py RUN.mcap [--minutes 10,60]
"""

import argparse
import json
import struct
import sys
import tempfile
from pathlib import Path

from solve_growth import solved

PERIOD = 1_000_000
"""Between two readings, ns."""
MOST_GROWTH = 50.0
"""MB."""


def make_bag(path, run, minutes):
    """Write a copy of a run whose readings go on for some minutes; return the number of these."""
    from stepdiag_ros import topics
    from stepdiag_ros.bags.reader import BagReader
    from stepdiag_ros.bags.writer import BagWriter

    count = round(minutes * 60e9 / PERIOD)
    with BagReader(run) as source, BagWriter(path, source.header) as bag:
        last = None
        for one in source.records():
            bag.write(one.topic, one.type_name, one.data, one.log_time, one.publish_time)
            if one.type_name == topics.READING.type_name:
                last = one
        message, types = source.decode(last), source.types
        data = bytearray(types.encode(last.type_name, message))
        low, high = (
            types.encode(last.type_name, _numbered(message, one)) for one in (0, 2**64 - 1)
        )
        place = next(at for at, (a, b) in enumerate(zip(low, high, strict=True)) if a != b)
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        for number in range(1, count + 1):
            seconds, rest = divmod(stamp + number * PERIOD, 10**9)
            struct.pack_into("<iI", data, 4, seconds, rest)
            struct.pack_into("<Q", data, place, message.sequence + number)
            bag.write(last.topic, last.type_name, bytes(data), source.end_time + number * PERIOD)
    return count


def _numbered(message, sequence):
    message = type(message)(**vars(message))
    message.sequence = sequence
    return message


def main():
    """Print the document."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", type=Path, help="a run of stepdiag demo")
    parser.add_argument("--minutes", default="10,60", help="lengths of the bags, with commas")
    arguments = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for text in arguments.minutes.split(","):
            bag = Path(folder) / f"{text}_minutes.mcap"
            readings = make_bag(bag, arguments.bag, float(text))
            seconds, memory = solved(bag)
            row = {
                "minutes": float(text),
                "further_readings": readings,
                "bag_MB": round(bag.stat().st_size / 1e6, 1),
                "processor_s": round(seconds, 2),
                "peak_memory_MB": round(memory),
            }
            print(row, file=sys.stderr, flush=True)
            rows.append(row)
    print(json.dumps({"runs": rows}, indent=2))
    memory = [row["peak_memory_MB"] for row in rows]
    return int(max(memory) - min(memory) > MOST_GROWTH)


if __name__ == "__main__":
    sys.exit(main())
