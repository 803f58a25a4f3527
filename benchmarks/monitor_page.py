"""Live page: from what is taken in to what is painted, and memory over hours of a run.

    python benchmarks/monitor_page.py [--seconds 20] [--hours 4]

Part 1, latency: a stop is published on its topic 20 times a second, beside a block, a reading and a
position each time; the node ``monitor``, a process of its own, hears it. Five browser pages look
on, and a sixth viewer never takes what it is sent. A page notes when the frame after the one with
the new stop begins: then it is painted. All clocks are the one of this computer.

Part 2, memory: as much data as a run of so many hours makes (a stop and a block every 3 s, a line
and a result every 37 stops, readings and positions at the 20 updates a second that a viewer gets at
most) is fed without pauses, so fast as one page takes it: the next comes when the last is painted.
The JavaScript heap after garbage collection and the memory of the server are told ten times.

Needs playwright and Chromium.
"""

import argparse
import asyncio
import json
import re
import resource
import shutil
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import aiohttp
import numpy as np
from playwright.sync_api import sync_playwright

from stepdiag_ros import topics
from stepdiag_ros.bags.run import RecordedRun, load_run
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.measurement import Environment, Reading, SettledStop
from stepdiag_ros.nodes.operator import OperatorNode
from stepdiag_ros.processes.graph import in_graph
from stepdiag_ros.processes.node_process import NodeProcess, Processes
from stepdiag_ros.viewers.page.access import make_access
from stepdiag_ros.viewers.page.items import AxisPlace, RunBegin
from stepdiag_ros.viewers.page.server import MonitorServer, Offer
from stepdiag_ros.viewers.page.state import PageState

RATE = 20.0
VIEWERS = 5
STOP_SECONDS = 3.0
# A page notes the wall clock at which the displacement of the last stop was painted.
NOTE = """
window.painted = [];
new MutationObserver(() => requestAnimationFrame(() => setTimeout(
  () => painted.push([document.getElementById('stop-where').textContent, Date.now()]))))
  .observe(document.getElementById('stop-where'),
           {childList: true, characterData: true, subtree: true});
"""


class Feed:
    """Tells the page what the nodes of a long run would."""

    def __init__(self, bag: Path) -> None:
        self.run = load_run(bag)
        self.state = PageState()
        self.state.take(RunBegin(self.run.run_id, 0, self.run.plan, self.run.chain, simulated=True))
        self.count = 0

    def readings(self) -> None:
        """Tell a reading and a position."""
        self.count += 1
        self.state.take(reading(self.count))
        self.state.take(AxisPlace(self.count, (1e-6 * (self.count % 1000), 0.02, 0.03)))

    def stop(self, number: int) -> str:
        """Tell a stop and what comes with it; return how the page names the stop."""
        stop = self.run.stops[number % len(self.run.stops)]
        self.state.take(stop)
        self.state.take(self.run.blocks[number % len(self.run.blocks)])
        if number % 37 == 36:
            self.state.take(self.run.lines[(number // 37) % len(self.run.lines)])
            self.state.take(self.run.results[(number // 37) % len(self.run.results)])
        return name_of(stop)


def reading(number: int) -> Reading:
    """Return the reading of a number."""
    air = Environment(20.0 + 0.01 * (number % 7), 101_325.0, 0.5, 20.0)
    shift = 1e-6 * (number % 1000)
    return Reading(number, number, shift, shift, 0.8, 0, air)


def name_of(stop: SettledStop) -> str:
    """Return how the page names a stop."""
    return f"{stop.line}, stop {stop.command.stop}, {stop.readings} readings"


def stall(url: str, stop: threading.Event) -> None:
    """Be a viewer that takes nothing, and comes again when it is cut off."""

    async def run() -> None:
        async with aiohttp.ClientSession() as client:
            while not stop.is_set():
                async with client.ws_connect(f"{url}live") as viewer:
                    await viewer.send_json({"token": ""})
                    while not viewer.closed and not stop.is_set():
                        try:
                            await asyncio.wait_for(viewer.receive(), 1.0)
                        except asyncio.TimeoutError:
                            continue

    asyncio.run(run())


def started_node(folder: Path, operator: OperatorNode, processes: Processes) -> str:
    """Wait for the node ``monitor`` and return where its page is."""
    log = folder / "monitor.log"

    def up() -> bool:
        heard = any(peer.role == "monitor" for peer in operator.watch.peers.values())
        return heard and "the page is at" in log.read_text(errors="replace")

    if not operator.spin_until(lambda: up() or bool(processes.ended()), 120.0) or not up():
        raise SystemExit(f"the node did not come up: {processes.ended()}")
    return re.findall(r"the page is at (http://\S+)", log.read_text(errors="replace"))[-1]


def latency(browser, bag: Path, seconds: float) -> None:
    """Measure from publishing a stop to its being painted; see the module."""
    run = load_run(bag)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        stack.enter_context(in_graph())
        operator = OperatorNode()
        spoken = (topics.RUN_DESCRIPTION, topics.STOP, topics.BLOCK, topics.READING)
        outlets = {topic: operator.announce(topic) for topic in (*spoken, topics.JOINT_STATES)}
        node = NodeProcess("monitor", {"port": 0})
        processes = stack.enter_context(Processes([node], folder))
        url = started_node(folder, operator, processes)
        outlets[topics.RUN_DESCRIPTION].publish(description_of(run))
        operator.spin_until(lambda: False, 1.0)
        pages = []
        for _ in range(VIEWERS):
            # A window of its own each: what is in the background is painted rarely.
            page = browser.new_context().new_page()
            page.goto(url)
            page.wait_for_selector("#contact[data-contact=good]")
            page.evaluate(NOTE)
            pages.append(page)
        end = threading.Event()
        threading.Thread(target=stall, args=(url, end), daemon=True).start()
        told: dict[str, list[float]] = {}
        joints = conversion.new_message(topics.JOINT_STATES.type_name)
        joints.name = list(AXES)
        began = time.monotonic()
        for number in range(int(seconds * RATE)):
            time.sleep(max(0.0, began + number / RATE - time.monotonic()))
            stop = run.stops[number % len(run.stops)]
            block = run.blocks[number % len(run.blocks)]
            joints.position = [1e-4 * (number % 100), 0.02, 0.03]
            outlets[topics.JOINT_STATES].publish(joints)
            outlets[topics.READING].publish(conversion.from_reading(reading(number), "laser"))
            outlets[topics.BLOCK].publish(conversion.from_block(block, run.run_id))
            now = time.time() * 1e3
            told.setdefault(name_of(stop), []).append(now)
            outlets[topics.STOP].publish(conversion.from_settled_stop(stop, run.run_id))
        pages[0].wait_for_timeout(1000)
        end.set()
        every = []
        for number, page in enumerate(pages):
            delays = []
            for text, painted in page.evaluate("painted"):
                before = [when for when in told.get(text, []) if when <= painted]
                if before:
                    delays.append(painted - before[-1])
            every += delays
            print(
                f"viewer {number + 1}: {len(delays)} painted, median {np.median(delays):.0f} ms, "
                f"95 % {np.percentile(delays, 95):.0f} ms, longest {max(delays):.0f} ms"
            )
            page.context.close()
    share = float(np.mean(np.array(every) < 300.0))
    print(f"all viewers: {100.0 * share:.2f} % of {len(every)} within 300 ms")


def description_of(run: RecordedRun):
    """Return the RunDescription of a recorded run."""
    message = conversion.new_message(topics.RUN_DESCRIPTION.type_name)
    set_header(message, run.start_time)
    message.run_id, message.plan, message.machine = run.run_id, run.plan_text, run.machine_text
    return message


def memory(browser, feed: Feed, url: str, hours: float) -> None:
    page = browser.new_context().new_page()
    page.goto(url)
    page.wait_for_selector("#contact[data-contact=good]")
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")
    updates = int(hours * 3600.0 * RATE)
    each = int(STOP_SECONDS * RATE)
    stops = updates // each
    print(f"{hours:g} h: {stops} stops, {updates} updates of readings and positions")
    began, heaps = time.monotonic(), []
    for number in range(stops):
        for _ in range(each):
            feed.readings()
        where = feed.stop(number)
        # What lies between two updates of a viewer is skipped by design; each stop is painted.
        seen = page.wait_for_function(
            "want => document.getElementById('stop-where').textContent === want", arg=where
        )
        seen.dispose()
        if number % max(1, stops // 10) == 0 or number == stops - 1:
            session.send("HeapProfiler.collectGarbage")
            metrics = session.send("Performance.getMetrics")["metrics"]
            values = {one["name"]: one["value"] for one in metrics}
            heaps.append(values["JSHeapUsedSize"] / 1e6)
            server = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
            print(
                f"{number * STOP_SECONDS / 3600.0:5.2f} h: heap {heaps[-1]:6.2f} MB, DOM nodes "
                f"{values['Nodes']:.0f}, listeners {values['JSEventListeners']:.0f}, "
                f"server at most {server:.0f} MB"
            )
    print(f"took {time.monotonic() - began:.0f} s; heap after the first tenth to the end: "
          f"{heaps[-1] - heaps[1]:+.2f} MB")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", type=Path, help="of a run, such as that of stepdiag demo")
    parser.add_argument("--seconds", type=float, default=20.0, help="of part 1; 0: leave out")
    parser.add_argument("--hours", type=float, default=4.0, help="of part 2; 0: leave out")
    arguments = parser.parse_args()
    feed = Feed(arguments.bag)
    offer = Offer(feed.state, make_access("127.0.0.1", ""), "replay", "benchmark", None, print)
    server = MonitorServer(offer, 0)
    server.start()
    program = shutil.which("chromium") or shutil.which("google-chrome")
    print(json.dumps({"page": server.url, "first update (bytes)": len(feed.state.update()[1])}))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=program, args=["--no-sandbox", "--disable-gpu"]
        )
        if arguments.seconds:
            latency(browser, arguments.bag, arguments.seconds)
        if arguments.hours:
            memory(browser, feed, server.url, arguments.hours)
        browser.close()
    server.close()


if __name__ == "__main__":
    main()
