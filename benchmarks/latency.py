"""Latency of a reading to its subscriber, and readings per second without loss, as JSON.

Publisher and subscriber are two processes with the interferometer's own topic, message and quality
of service; the subscriber converts each message, as the assembler does. Latency: from just before
a message is given to ``publish`` to the start of the subscriber's callback, with readings at an
even rate. Throughput: the publisher keeps all and sends as fast as it can; the time runs from the
first reading sent to the last one received. Both processes read Linux's one monotonic clock.
Rounds are medians; the exit code is 1 if any reading was lost or out of order.

    python benchmarks/latency.py [--rate 1000] [--seconds 10] [--readings 40000] [--rounds 3]
"""

import argparse
import json
import statistics
import subprocess
import sys
import time
from typing import Any

import numpy as np
from shared import gaps, processor_seconds

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros import topics
from stepdiag_ros.embedded import client
from stepdiag_ros.messages.conversion import from_reading, new_message, to_reading
from stepdiag_ros.messages.fields import set_stamp
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.nodes.links import message_class, quality

TOPIC = topics.READING
DISCOVERY_LIMIT = 20.0
"""Seconds within which publisher and subscriber must have found each other."""
SILENCE_LIMIT = 30.0
"""Seconds more than they should take, after which readings that have not come count as lost."""

SETTLING = 0.5
"""Seconds after the first reading; DDS may hold a new stream back until its first heartbeat."""
QUANTILES = {"median": 0.5, "p99": 0.99, "p999": 0.999, "max": 1.0}


def subscribe(count: int, seconds: float) -> None:
    """Receive readings until the last one has come, then print what came as JSON."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.task import Future

    received: list[tuple[int, int, int]] = []
    done = Future()

    def on_reading(message: Any) -> None:
        now = time.monotonic_ns()
        reading = to_reading(message)
        received.append((reading.sequence, reading.time, now))
        if reading.sequence == count - 1:
            done.set_result(None)

    rclpy.init(args=[])
    node = rclpy.create_node("benchmark_subscriber")
    subscription = node.create_subscription(
        message_class(TOPIC), TOPIC.name, on_reading, quality(TOPIC, keep_all=True)
    )
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    wait_for(lambda: subscription.get_publisher_count() == 1, "the publisher")
    print("ready", flush=True)
    before = processor_seconds()
    executor.spin_until_future_complete(done, timeout_sec=seconds + SILENCE_LIMIT)
    used = processor_seconds() - before
    rclpy.try_shutdown()
    sequence = [number for number, _, _ in received]
    # The first reading only made the two processes acquainted.
    latencies = np.array([came - sent for _, sent, came in received[1:]]) * 1e-9
    if not len(latencies):
        sys.exit("not one reading was received")
    report = {
        "received": len(received),
        "gaps": gaps([-1, *sequence, count]),
        "seconds": (received[-1][2] - received[1][1]) * 1e-9,
        "processor_seconds": used,
        "latency": dict(
            zip(QUANTILES, np.quantile(latencies, list(QUANTILES.values())), strict=True)
        ),
    }
    print(json.dumps(report))


def wait_for(condition: Any, whom: str) -> None:
    """Wait until the other process is found; end this one if it is not."""
    deadline = time.monotonic() + DISCOVERY_LIMIT
    while not condition():
        if time.monotonic() > deadline:
            sys.exit(f"{whom} was not found in {DISCOVERY_LIMIT:g} s")
        time.sleep(0.01)


def publish(count: int, rate: float) -> dict[str, Any]:
    """Send ``count`` readings to a subscriber process at a rate (0: without pause)."""
    import rclpy

    seconds = count / rate if rate else 0.0
    command = [sys.executable, __file__, "--subscribe", str(count), "--seconds", str(seconds)]
    # The interferometer keeps the last readings only; a sender without pause has to keep all.
    qos = quality(TOPIC, keep_all=not rate)
    rclpy.init(args=[])
    node = rclpy.create_node("benchmark_publisher")
    publisher = node.create_publisher(message_class(TOPIC), TOPIC.name, qos)
    air = Environment(20.0, 101325.0, 0.5, 20.0)
    message = new_message(TOPIC.type_name)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as subscriber:
        assert subscriber.stdout is not None
        if subscriber.stdout.readline() != "ready\n":
            sys.exit("the subscriber did not start")
        wait_for(lambda: publisher.get_subscription_count() == 1, "the subscriber")
        began = time.monotonic()
        for number in range(count):
            if number == 1:
                time.sleep(SETTLING)
                before, began = processor_seconds(), time.monotonic()
            if rate and (left := began + number / rate - time.monotonic()) > 0.0:
                time.sleep(left)
            reading = Reading(0, number, 1e-6, 1e-6 / 1.00027, 0.9, 0, air)
            message = from_reading(reading, "interferometer", message=message)
            set_stamp(message.header.stamp, time.monotonic_ns())
            publisher.publish(message)
        used = processor_seconds() - before
        report = json.loads(subscriber.stdout.read())
    node.destroy_node()
    rclpy.try_shutdown()
    report["processor_us_per_reading"] = {
        "publisher": used / count * 1e6,
        "subscriber": report["processor_seconds"] / count * 1e6,
    }
    return report


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", type=float, default=1000.0, help="for the latency, 1/s")
    parser.add_argument("--seconds", type=float, default=10.0, help="for the latency")
    parser.add_argument("--readings", type=int, default=40_000, help="for the throughput")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--subscribe", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.subscribe:
        subscribe(arguments.subscribe, arguments.seconds)
        return 0
    paced_count = round(arguments.rate * arguments.seconds)
    paced, hurried = [], []
    for _ in range(arguments.rounds):
        paced.append(publish(paced_count, arguments.rate))
        hurried.append(publish(arguments.readings, 0.0))
    lost = {
        "latency": sum(paced_count - run["received"] for run in paced),
        "throughput": sum(arguments.readings - run["received"] for run in hurried),
    }
    disorder = sum(run["gaps"] for run in paced + hurried)

    def processor(runs: list[dict[str, Any]]) -> dict[str, float]:
        return {
            who: round(statistics.median(run["processor_us_per_reading"][who] for run in runs), 1)
            for who in ("publisher", "subscriber")
        }

    report = {
        "client": client(),
        "rounds": arguments.rounds,
        "latency": {
            "readings": paced_count,
            "rate": arguments.rate,
            "us": {
                name: round(statistics.median(run["latency"][name] for run in paced) * 1e6, 1)
                for name in QUANTILES
            },
            "processor_us_per_reading": processor(paced),
            "lost": lost["latency"],
        },
        "throughput": {
            "readings": arguments.readings,
            "readings_per_second": round(
                statistics.median(run["received"] / run["seconds"] for run in hurried)
            ),
            "processor_us_per_reading": processor(hurried),
            "lost": lost["throughput"],
        },
        "gaps": disorder,
    }
    print(json.dumps(report, indent=2))
    return int(bool(disorder))


if __name__ == "__main__":
    sys.exit(main())
