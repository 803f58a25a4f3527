"""The embedded client beside another rclpy: round trip and rate without loss, as JSON.

Two processes of one client each, a single-threaded executor in both, reliable topics that keep the
last 1000, a new message object for every message sent and one for every message received. Round
trip: from just before ``publish`` to the start of the callback with the echo, one message after
the other. Rate: one way, with at most 900 messages under way, so that none may be lost; the count
of those received goes back through memory that both processes map, outside of either client.

Sides take turns in every round; ratios are of the two runs of one round. The exit code is 1 if a
message was lost or out of order, or if, beside the real rclpy, a median ratio misses the bar.

    python benchmarks/clients.py [--rounds 5]
        [--other-python python3 --other-setup /opt/ros/jazzy/setup.bash]
"""

from __future__ import annotations

import argparse
import json
import mmap
import os
import shlex
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from array import array
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

SIZES = (100, 10_000)
"""Bytes of content of a message."""
KINDS = ("text", "numbers")
"""``std_msgs/String``, and ``std_msgs/Float64MultiArray``."""
DEPTH = 1000
UNDER_WAY = 900
"""Messages sent and not received yet, at most: fewer than the subscription keeps."""
WARM_UP = 200
"""Messages before those that are measured."""
DISCOVERY_LIMIT = 30.0
SILENCE_LIMIT = 60.0
"""Seconds after which a message that has not come counts as lost."""
SETTLING = 0.5
"""Seconds after discovery; DDS may hold a new stream back until its first heartbeat."""
BARS = {"round_trip": 0.7, "rate": 4.0}
"""Round trip at most, rate at least this times the other's."""
_COUNT = struct.Struct("<q")


class Kind:
    """How messages of one kind are made and read.

    Args:
        name: one of :data:`KINDS`.
        size: bytes of content.
    """

    def __init__(self, name: str, size: int) -> None:
        from std_msgs.msg import Float64MultiArray, String

        self.name = f"{name}_{size}"
        self.message_class = String if name == "text" else Float64MultiArray
        self.make: Callable[[int], Any]
        self.number: Callable[[Any], int]
        if name == "text":
            filling = "x" * (size - 12)
            self.make = lambda number: String(data=f"{number:012d}{filling}")
            self.number = lambda message: int(message.data[:12])
        else:
            filling_numbers = array("d", [0.1] * (size // 8 - 1))
            self.make = lambda number: Float64MultiArray(
                data=array("d", [number]) + filling_numbers
            )
            self.number = lambda message: int(message.data[0])


def start() -> Any:
    """Return rclpy, the embedded one if there is no other."""
    try:
        import rclpy
    except ImportError:
        from stepdiag_ros import embedded

        embedded.activate()
        import rclpy

    rclpy.init(args=[])
    return rclpy


def quality() -> Any:
    """Return the quality of service of all topics here."""
    from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE
    )


class Counter:
    """A number in a file that two processes map."""

    def __init__(self, path: str) -> None:
        with Path(path).open("r+b") as file:
            self._memory = mmap.mmap(file.fileno(), _COUNT.size)

    @property
    def value(self) -> int:
        """The number."""
        return int(_COUNT.unpack_from(self._memory)[0])

    @value.setter
    def value(self, number: int) -> None:
        _COUNT.pack_into(self._memory, 0, number)


def answer(path: str) -> None:
    """Send back what comes for the round trip, and count what comes for the rate, until ended."""
    rclpy = start()
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

    node = rclpy.create_node("benchmark_answerer")
    counter = Counter(path)

    def serve(kind: Kind) -> None:
        publisher = node.create_publisher(kind.message_class, f"pong_{kind.name}", quality())
        node.create_subscription(
            kind.message_class, f"ping_{kind.name}", publisher.publish, quality()
        )
        number = kind.number

        def count(message: Any) -> None:
            # One that is missing or out of order stops the count, which the sender reports.
            if number(message) == counter.value:
                counter.value += 1

        node.create_subscription(kind.message_class, f"flood_{kind.name}", count, quality())

    for name in KINDS:
        for size in SIZES:
            serve(Kind(name, size))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


def ask(path: str, round_trips: int, messages: int) -> dict[str, Any]:
    """Return what is measured against a process that answers."""
    rclpy = start()
    from rclpy.executors import SingleThreadedExecutor

    node = rclpy.create_node("benchmark_asker")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    counter = Counter(path)
    report: dict[str, Any] = {
        "client": "embedded" if hasattr(rclpy, "IS_EMBEDDED") else "rclpy",
        "middleware": rclpy.get_rmw_implementation_identifier(),
        "python": sys.version.split()[0],
    }
    for name in KINDS:
        for size in SIZES:
            kind = Kind(name, size)
            report[kind.name] = {
                "round_trip_us": round_trip(node, executor, kind, round_trips),
                **rate(node, kind, counter, messages),
            }
    node.destroy_node()
    rclpy.try_shutdown()
    return report


def round_trip(node: Any, executor: Any, kind: Kind, count: int) -> float:
    """Return the median time in µs of a message there and back."""
    from rclpy.task import Future

    took: list[int] = []
    done = Future()
    publisher = node.create_publisher(kind.message_class, f"ping_{kind.name}", quality())
    sent = 0

    def send(number: int) -> None:
        nonlocal sent
        message = kind.make(number)
        sent = time.monotonic_ns()
        publisher.publish(message)

    def on_echo(message: Any) -> None:
        took.append(time.monotonic_ns() - sent)
        if kind.number(message) != len(took) - 1:
            sys.exit(f"echo {len(took) - 1} of {kind.name} was lost")
        if len(took) < count + WARM_UP:
            send(len(took))
        else:
            done.set_result(None)

    subscription = node.create_subscription(
        kind.message_class, f"pong_{kind.name}", on_echo, quality()
    )
    meet(publisher.get_subscription_count)
    meet(lambda: node.count_publishers(f"pong_{kind.name}"))
    send(0)
    executor.spin_until_future_complete(done, timeout_sec=SILENCE_LIMIT)
    if not done.done():
        sys.exit(f"echo {len(took)} of {kind.name} was lost")
    node.destroy_subscription(subscription)
    node.destroy_publisher(publisher)
    return statistics.median(took[WARM_UP:]) * 1e-3


def rate(node: Any, kind: Kind, counter: Counter, count: int) -> dict[str, Any]:
    """Return messages per second one way, and processor time of the sender."""
    publisher = node.create_publisher(kind.message_class, f"flood_{kind.name}", quality())
    counter.value = 0
    meet(publisher.get_subscription_count)
    make, publish = kind.make, publisher.publish
    total = count + WARM_UP
    received, began = 0, 0.0
    for number in range(total):
        if number == WARM_UP:
            wait_for(counter, WARM_UP, kind)
            received, began = WARM_UP, time.monotonic()
        if number - received >= UNDER_WAY:
            received = wait_for(counter, number - UNDER_WAY // 2, kind)
        publish(make(number))
    wait_for(counter, total, kind)
    seconds = time.monotonic() - began
    node.destroy_publisher(publisher)
    return {"messages_per_second": count / seconds}


def wait_for(counter: Counter, number: int, kind: Kind) -> int:
    """Wait until so many messages have been received; return how many have."""
    deadline = time.monotonic() + SILENCE_LIMIT
    while (received := counter.value) < number:
        if time.monotonic() > deadline:
            sys.exit(f"message {received} of {kind.name} was lost or came out of order")
        time.sleep(0.0002)
    return received


def meet(count: Callable[[], int]) -> None:
    """Wait until the peer is found."""
    deadline = time.monotonic() + DISCOVERY_LIMIT
    while not count():
        if time.monotonic() > deadline:
            sys.exit(f"the other process was not found in {DISCOVERY_LIMIT:g} s")
        time.sleep(0.01)
    time.sleep(SETTLING)


class Side:
    """One client library: the Python that runs it and the shell script that sets it up."""

    def __init__(self, python: str, setup: str) -> None:
        self._python, self._setup = python, setup

    def command(self, *arguments: str) -> list[str]:
        """Return the command that runs this script on this side."""
        plain = [self._python, str(Path(__file__).resolve()), *arguments]
        if not self._setup:
            return plain
        return ["bash", "-c", f"source {shlex.quote(self._setup)} && exec {shlex.join(plain)}"]

    def run(self, round_trips: int, messages: int) -> dict[str, Any]:
        """Measure once, in two new processes."""
        with tempfile.NamedTemporaryFile() as file:
            file.write(bytes(_COUNT.size))
            file.flush()
            answerer = subprocess.Popen(self.command("--answer", file.name))
            try:
                counts = ["--round-trips", str(round_trips), "--messages", str(messages)]
                asker = subprocess.run(
                    self.command("--ask", file.name, *counts), stdout=subprocess.PIPE, text=True
                )
            finally:
                answerer.kill()
                answerer.wait()
        if asker.returncode:
            sys.exit(1)
        return dict(json.loads(asker.stdout))


def spread(values: list[float], digits: int) -> dict[str, Any]:
    """Return median, least and greatest of the rounds."""
    rounded = [round(value, digits) for value in sorted(values)]
    return {"median": round(statistics.median(values), digits), "of": [rounded[0], rounded[-1]]}


def summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what one side's rounds say."""
    found: dict[str, Any] = {key: runs[0][key] for key in ("client", "middleware", "python")}
    for name in names():
        found[name] = {
            "round_trip_us": spread([run[name]["round_trip_us"] for run in runs], 1),
            "messages_per_second": spread([run[name]["messages_per_second"] for run in runs], 0),
        }
    return found


def names() -> list[str]:
    """Return the names of the messages."""
    return [f"{kind}_{size}" for kind in KINDS for size in SIZES]


def ratios(runs: list[dict[str, Any]], others: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the ratios of this client's figures to the other's, in each round."""
    pairs = list(zip(runs, others, strict=True))
    return {
        name: {
            ratio: spread([one[name][key] / two[name][key] for one, two in pairs], 2)
            for ratio, key in (("round_trip", "round_trip_us"), ("rate", "messages_per_second"))
        }
        for name in names()
    }


def met(found: dict[str, Any]) -> bool:
    """Return whether all median ratios hold the bars."""
    return all(
        entry["round_trip"]["median"] <= BARS["round_trip"]
        and entry["rate"]["median"] >= BARS["rate"]
        for entry in found.values()
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--round-trips", type=int, default=2000, help="in each round")
    parser.add_argument("--messages", type=int, default=10_000, help="for the rate, in each round")
    parser.add_argument("--other-python", help="compare with the rclpy of this Python")
    parser.add_argument("--other-setup", default="", help="shell script to source before it")
    parser.add_argument("--answer", help=argparse.SUPPRESS)
    parser.add_argument("--ask", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.answer:
        answer(arguments.answer)
        return 0
    if arguments.ask:
        print(json.dumps(ask(arguments.ask, arguments.round_trips, arguments.messages)))
        return 0
    sides = [Side(sys.executable, "")]
    if arguments.other_python or arguments.other_setup:
        sides.append(Side(arguments.other_python or "python3", arguments.other_setup))
    runs: list[list[dict[str, Any]]] = [[] for _ in sides]
    for number in range(arguments.rounds):
        # Who begins changes, so that a machine that slows down favours neither.
        order = list(zip(sides, runs, strict=True))
        for side, done in order if number % 2 == 0 else reversed(order):
            done.append(side.run(arguments.round_trips, arguments.messages))
    report: dict[str, Any] = {"rounds": arguments.rounds, "cores": os.cpu_count()}
    report["this"] = summary(runs[0])
    good = True
    if len(sides) > 1:
        report["other"] = summary(runs[1])
        report["ratios"] = ratios(*runs)
        report["bars"] = BARS
        good = report["other"]["client"] != "rclpy" or met(report["ratios"])
    print(json.dumps(report, indent=2))
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
