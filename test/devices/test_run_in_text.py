"""A whole step-diagonal run with a laser that speaks text, over a bad line, against the same run.

The laser is the simulated one; between it and the run lie a TCP connection, the driver
``line_protocol`` and our own compensation. The lines must come out as without them.
"""

import time
from dataclasses import replace
from math import isnan

import numpy as np
import pytest
from instrument_peers import MS, TcpPeer, is_open
from live_cell import LiveCell
from test_live_effects import CELL, PLAN

from stepdiag_ros.configuration import load_cell, load_tracker
from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.metrology.air.compensator import Compensator
from stepdiag_ros.metrology.air.known_air import KnownAir
from stepdiag_ros.metrology.cell import WeatherModel
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.measured_lines import plan_of
from stepdiag_ros.metrology.tracker.seven_lines import make_test

SETTINGS = {
    "message": {"columns": ["ns", "number", "raw", "state"]},
    "values": {
        "raw": {"from": "raw", "unit": "mm"},
        "time": {"from": "ns", "unit": "ns", "clock": "computer"},
        "sequence": {"from": "number"},
        "status": {"from": "state", "words": {"0": "good", "2": "beam_lost", "3": "overspeed"}},
    },
    "silence_s": 3600.0,
}
DEAD_PATH = 0.4


class TextLaser:
    """The simulated laser behind a text protocol (``InterferometerDevice`` and ``FollowsRun``).

    Args:
        laser: the simulated one.
        start: ns.
        garbage: lets a line be spoilt now and then, by this random generator; None: never.
    """

    def __init__(self, laser, start, garbage):
        self.laser, self.garbage = laser, garbage
        self.peer = TcpPeer()
        settings = {"connection": {"url": self.peer.url}, **SETTINGS}
        around = Surroundings()
        self.driver = prepare("interferometer", "line_protocol", settings, around)(start)
        self.compensator = Compensator("own", DEAD_PATH)
        self.air = KnownAir(3600.0)
        self.plan = None
        self.update_command, self.update_answer = laser.update_command, laser.update_answer
        self.spoilt = 0
        while self.peer.connection is None or not is_open(self.driver):
            self.driver.poll(start)
            self.peer.attend()

    def begin_run(self, plan, start):
        self.plan = plan
        self.laser.begin_run(plan, start)

    def align(self, now, setup, line, step, start):
        self.laser.align(now, setup, line, step, start)
        # The simulated one ends what was on its way with the old zero.
        self.driver.align(now, setup, line, step, start)
        beam = next(one.beam(self.plan.volume) for one in self.plan.lines if one.name == line)
        self.compensator.align(now, beam, np.array(start))

    def update_position(self, now, position):
        self.laser.update_position(now, position)
        self.compensator.move(position)

    def update_environment(self, now, environment):
        self.laser.update_environment(now, environment)
        for name, value in environment._asdict().items():
            self.air.take(name, value, now)

    def poll(self, now):
        text, good = "", 0
        for one in self.laser.poll(now):
            raw = "---" if isnan(one.raw_displacement) else repr(one.raw_displacement * 1e3)
            line = f"{one.time},{one.sequence},{raw},{one.status}"
            if self.garbage is not None and self.garbage.random() < 0.006:
                line, self.spoilt = line[: len(line) // 2].replace(",", "#"), self.spoilt + 1
            else:
                good += 1
            text += line + "\r\n"
        self.peer.say(text)
        found, end = [], time.monotonic() + 5.0
        while len(found) < good and time.monotonic() < end:
            found += self.driver.poll(now)
            time.sleep(0)
        assert len(found) == good, "a reading was lost on the way"
        return [self.compensator.reading(reading, self.air.at(now)) for reading in found]

    def close(self):
        self.driver.close()
        self.peer.close()


def measured(cell, garbage=None, trouble=None, plan=PLAN):
    live = LiveCell(plan, cell)
    text = live.laser = TextLaser(live.laser, live.now, garbage)
    if trouble is not None:
        live.watchers.append(lambda stop: trouble(live, stop))
    try:
        return live.measure(), text, live
    finally:
        text.close()


@pytest.fixture(scope="module")
def cell():
    return replace(CELL, dead_path=DEAD_PATH)


@pytest.fixture(scope="module")
def direct(cell):
    return LiveCell(PLAN, cell).measure()


def furthest_off(first, second):
    pairs = zip(first.lines, second.lines, strict=True)
    return max(float(np.abs(a.displacement - b.displacement).max()) for a, b in pairs)


def test_a_run_in_text_gives_the_lines_of_the_run_without(cell, direct):
    run, _, _ = measured(cell)
    assert all(line.complete for line in run.lines)
    assert furthest_off(run, direct) < 5e-9


def test_a_bad_line_and_a_lost_beam_cost_time_but_no_number_is_wrong(cell, direct):
    broken = []

    def break_beam(live, stop):
        if not broken and stop.command.line_index == 2 and stop.command.stop == 1:
            broken.append(live.now)
            live.laser.laser.inject_beam_break(live.now + 50 * MS, live.now + 300 * MS)

    run, text, live = measured(cell, np.random.default_rng(7), break_beam)
    assert text.spoilt > 5 and broken
    rejected = [stop.reason for stop in live.stops if not stop.settled]
    assert any("the beam was lost" in reason for reason in rejected)
    assert any(line.attempt > 1 for line in run.lines)
    assert all(line.complete for line in run.lines)
    assert furthest_off(run, direct) < 5e-9


def test_a_tracker_in_text_gives_the_lengths_of_the_run_without():
    """Its path in air is the whole length, so that a wrong path would show in every line."""
    tracker, box = load_tracker("demo")[0], Box(np.zeros(3), np.full(3, 0.12))
    station = np.array([-0.15, 0.15, -0.15])
    places = make_test(box, station, tracker, targets=5, runs=1, locating=6).readings("1")
    plan = plan_of(places, {"1": station}, tracker, box, name="seven lines", feed=0.05)
    plan = replace(plan, lines=plan.lines[:5])
    warming = WeatherModel(air_temperature_drift=2.0 / 60.0)
    cell = replace(load_cell("demo")[0], weather=warming)
    run, _, _ = measured(cell, plan=plan)
    without = LiveCell(plan, cell).measure()
    assert all(line.complete for line in run.lines)
    # The planned place of the tracker is a millimetre or two off, and the air warms by a kelvin.
    assert furthest_off(run, without) < 10e-9
