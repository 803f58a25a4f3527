"""Stops read at a hardware trigger: the marked readings count, one trigger a stop, in order."""

import numpy as np
import pytest
from runs_for_tests import PLAN, SECOND, START, Run, lines_of, stops_of

from stepdiag_ros.metrology.assembly import assemble

FIRST, LAST = 0.15, 0.21
"""s after in position: a burst of six readings at 100 Hz, inside the window of 0.1 s to 0.3 s."""


def triggered(numbers, later=0.0):
    """A line of which stop k is read at the trigger of that number, or at none (0)."""
    run = Run()
    run.measure(0)
    for number, arrival in zip(numbers, run.arrivals, strict=True):
        begin = arrival.time + round((FIRST + later) * SECOND)
        run.change(begin, arrival.time + round((LAST + later) * SECOND), trigger=number)
    return run


def decided(run):
    return assemble(PLAN, START, run.commands, run.arrivals, run.readings)


def test_the_readings_of_the_trigger_alone_count():
    run = triggered((5, 6, 7, 8))
    # Somebody leans against the table, but not while the trigger is there.
    for arrival in run.arrivals:
        run.shift(arrival.time + round(0.25 * SECOND), arrival.time + SECOND, lambda s: 1e-4 * s)
    stops = stops_of(decided(run))
    assert [(stop.settled, stop.readings) for stop in stops] == [(True, 6)] * 4
    for number, stop in enumerate(stops, start=5):
        burst = [r.compensated_displacement for r in run.readings if r.trigger == number]
        assert stop.displacement == pytest.approx(np.mean(burst), abs=1e-15)
        assert stop.last_sequence - stop.first_sequence == 5
    (line,) = lines_of(decided(run))
    assert line.complete
    assert not all(stop.settled for stop in stops_of(decided(untriggered(run))))


def untriggered(run):
    run.change(START, START + 1000 * SECOND, trigger=0)
    return run


def test_a_trigger_that_comes_late_is_waited_for():
    stops = stops_of(decided(triggered((1, 2, 3, 4), later=0.5)))
    # The first stop has no trigger to compare with: it may be one of a run without triggers.
    assert [stop.readings for stop in stops[1:]] == [20, 20, 20]
    stops = stops_of(decided(triggered((1, 2, 3, 4), later=0.0)))
    late = triggered((1, 2, 3, 4))
    arrival = late.arrivals[2]
    late.change(arrival.time, arrival.time + SECOND, trigger=0)
    begin = arrival.time + round(0.55 * SECOND)
    late.change(begin, begin + round(0.06 * SECOND), trigger=3)
    found = stops_of(decided(late))
    assert [(stop.settled, stop.readings) for stop in found] == [(True, 6)] * 4
    assert found[2].window_start > stops[2].window_start


def test_a_trigger_that_is_missing_rejects_the_stop():
    stops = stops_of(decided(triggered((1, 2, 0, 4))))
    assert [stop.settled for stop in stops] == [True, True, False, True]
    assert "no trigger has come since trigger 2, that of the stop before" in stops[2].reason


def test_a_trigger_of_the_stop_before_rejects_the_stop():
    run = triggered((1, 2, 2, 3))
    arrival = run.arrivals[2].time
    run.change(arrival, arrival + SECOND, trigger=2)
    stops = stops_of(decided(run))
    assert [stop.settled for stop in stops] == [True, True, False, True]
    assert "trigger 2 was that of the stop before" in stops[2].reason


def test_a_trigger_line_that_bounces_rejects_the_stop():
    run = triggered((1, 2, 3, 4))
    arrival = run.arrivals[1].time
    for tenth in range(10):
        begin = arrival + tenth * SECOND // 10
        run.change(begin, begin + SECOND // 10, trigger=2 + 7 * (tenth % 2))
    stops = stops_of(decided(run))
    assert [stop.settled for stop in stops] == [True, False, True, True]
    assert "the triggers 2, 9 came in one stop" in stops[1].reason
