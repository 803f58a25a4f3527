"""NC programs of measurements with a tracker, read back by a small interpreter."""

import re
from itertools import pairwise

import numpy as np
import pytest
from refused import refused

from stepdiag_ros.configuration import load_machine
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.readings import SEVEN_LINES, points_of
from stepdiag_ros.metrology.tracker.seven_lines import make_test
from stepdiag_ros.planning.tracker_duration import seven_line_duration
from stepdiag_ros.planning.tracker_program import tracker_program

BOX = Box(np.zeros(3), np.array([0.8, 0.5, 0.4]))
STATION = np.array([0.05, 0.04, -0.12])
TRACKER = Tracker(minimum_range=0.1)
OVERRUN = 2e-3


def driven(program):
    """Return places in m, in order, and whether the program stays at each."""
    place, places, stays = [0.0, 0.0, 0.0], [], []
    for line in program.splitlines():
        words = re.sub(r"\(.*?\)", "", line)
        moves = re.findall(r"([XYZ])(-?[\d.]+)", words)
        if words.startswith("G1") and moves:
            for axis, value in moves:
                place["XYZ".index(axis)] = float(value) / 1e3
            places.append(list(place))
            stays.append(False)
        elif words.startswith("G4"):
            assert not stays[-1]
            stays[-1] = True
    return np.array(places), np.array(stays)


@pytest.fixture(scope="module")
def planned():
    test = make_test(BOX, STATION, TRACKER, targets=5, runs=2, overrun=OVERRUN)
    readings = test.readings()
    program = tracker_program(
        readings, STATION, TRACKER, BOX, feed_m_per_s=0.05, name="test", overrun=OVERRUN
    )
    return readings, program


def test_it_stops_at_the_places_in_order_and_nowhere_else(planned):
    readings, program = planned
    places, stays = driven(program)
    np.testing.assert_allclose(places[stays], points_of(readings), atol=1e-9)


def test_it_stays_in_the_volume_and_in_sight_all_the_way(planned):
    _, program = planned
    places, _ = driven(program)
    # The first three moves bring the machine from wherever it stood.
    places = places[2:]
    assert np.all(places >= BOX.low - 1e-9)
    assert np.all(places <= BOX.high + 1e-9)
    for here, there in pairwise(places):
        assert not TRACKER.unseen_on_the_way(here, there, STATION)


def test_every_target_of_a_run_is_approached_in_the_sense_of_the_run(planned):
    readings, program = planned
    places, stays = driven(program)
    stops = np.flatnonzero(stays)
    for number, (reading, stop) in enumerate(zip(readings, stops, strict=True)):
        if reading.line not in SEVEN_LINES:
            continue
        arrival = places[stop] - places[stop - 1]
        same_run = [
            other
            for other in readings
            if (other.line, other.run, other.direction)
            == (reading.line, reading.run, reading.direction)
        ]
        sense = np.array(same_run[-1].position) - np.array(same_run[0].position)
        cosine = arrival @ sense / np.linalg.norm(arrival) / np.linalg.norm(sense)
        assert cosine == pytest.approx(1.0, abs=1e-5), (number, reading)


def test_several_axes_move_together_only_along_a_diagonal(planned):
    _, program = planned
    for line in program.splitlines():
        axes = re.findall(r"[XYZ](?=-?\d)", line) if line.startswith("G1") else []
        assert len(axes) <= 3
    places, stays = driven(program)
    several = np.count_nonzero(np.abs(np.diff(places, axis=0)) > 1e-9, axis=1) > 1
    assert np.all(stays[1:][several])


def test_a_place_out_of_the_volume_is_refused(planned):
    readings, _ = planned
    small = Box(np.zeros(3), np.array([0.5, 0.5, 0.4]))
    with refused(Refusal, "out_of_range"):
        tracker_program(
            readings, STATION, TRACKER, small, feed_m_per_s=0.05, name="x", overrun=OVERRUN
        )


@pytest.mark.parametrize("name", ["demo", "gantry"])
def test_a_tracker_takes_half_to_a_third_of_a_lasers_time(name):
    """ATLI: half by its abstract, a third by section 1."""
    machine, _ = load_machine(name)
    box = Box(np.array(machine.travel_low_m), np.array(machine.travel_high_m))
    station = box.low + np.array([-0.15, 0.1, 0.1])
    test = make_test(box, station, TRACKER)
    how = {"feed": 0.05, "dwell": 3.0, "overrun": 2e-3}
    one = seven_line_duration(test.readings(), station, TRACKER, box, machine, **how)
    assert one.lines == len(test.lines)
    assert 1.8 < one.laser / one.tracker < 3.2
    # The dwells alone, without a single move.
    assert one.running > 3.0 * len(test.readings())
    assert one.running > one.laser_running
    slower = seven_line_duration(
        test.readings(), station, TRACKER, box, machine, **{**how, "feed": 0.01}
    )
    assert slower.running > one.running
