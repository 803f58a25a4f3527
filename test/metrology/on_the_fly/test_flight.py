"""The assembler makes the stops of a line on the fly, whichever of its streams is ahead."""

from dataclasses import replace

import numpy as np
import pytest
from moving_machine import DIAGONAL, START, VOLUME, MovingMachine, Worst

from stepdiag_ros.metrology.assembly import Assembler, assemble
from stepdiag_ros.metrology.measurement import (
    Arrival,
    BlockDisplacement,
    Environment,
    MeasuredLine,
    Reading,
    SettledStop,
    StopCommand,
)
from stepdiag_ros.metrology.on_the_fly.evaluate import evaluate_pass
from stepdiag_ros.metrology.on_the_fly.flight import needs_corner_stops
from stepdiag_ros.metrology.plan import ON_THE_FLY, Plan, Sampling, moved_axes
from stepdiag_ros.metrology.refusal import Refusal

AIR = Environment(20.0, 101_325.0, 0.5, 20.0)
PLAN = Plan(
    "one line", VOLUME, (DIAGONAL,), 0.1, Sampling(dwell=0.3, window=0.2), measurement=ON_THE_FLY
)


class Streams:
    """What the nodes publish while a machine moves through a line."""

    def __init__(self, **worst):
        self.machine = machine = MovingMachine(5, worst=Worst(feed=0.1, **worst))
        self.record = record = machine.record()
        begins = [int(START + (at + 0.005) * 1e9) for at in machine.node_times[:-1]]
        last_arrival = int(START + (machine.end - 0.4) * 1e9)
        arrivals = [START + 10_000_000, *(begin - 4_000_000 for begin in begins[1:]), last_arrival]
        commands = [START, int(START + 0.5e9), *begins[1:]]
        self.commands, self.arrivals = [], []
        for stop, (sent, there) in enumerate(zip(commands, arrivals, strict=True)):
            target = tuple(machine.targets[stop].tolist())
            axis = moved_axes(machine.targets[max(stop - 1, 0)], machine.targets[stop])
            self.commands.append(
                StopCommand(stop + 1, 0, 1, DIAGONAL.setup, stop, axis, target, sent)
            )
            self.arrivals.append(Arrival(stop + 1, there, target))
        self.readings = [
            Reading(time, number, value + 1e-4, value, 1.0, status, AIR)
            for time, number, value, status in zip(
                record.reading_times.tolist(),
                record.sequences.tolist(),
                record.displacements.tolist(),
                record.statuses.tolist(),
                strict=True,
            )
        ]
        self.positions = [
            (time, tuple(place))
            for time, place in zip(
                record.position_times.tolist(), record.positions.tolist(), strict=True
            )
        ]

    def assembled(self):
        return assemble(PLAN, START, self.commands, self.arrivals, self.readings, self.positions)


@pytest.fixture(scope="module")
def streams():
    return Streams()


@pytest.mark.parametrize("idle", [0, 300, 700])
def test_a_long_line_keeps_its_readings_however_long_was_waited_before(streams, idle):
    """The buffer holds a small part of the line; where it drops depends on what came before."""
    assembler = Assembler(PLAN, START, buffer=500)
    first = streams.readings[0]
    for number in range(-idle, 0):
        time = first.time + number * 1_000_000
        assembler.add_reading(first._replace(time=time, sequence=first.sequence + number))
    # What the machine says comes some readings after its time.
    told = [
        *((one.time, assembler.add_command, (one,)) for one in streams.commands),
        *((one.time, assembler.add_arrival, (one,)) for one in streams.arrivals),
        *((time, assembler.add_position, (time, place)) for time, place in streams.positions),
    ]
    told = sorted((time + 50_000_000, number, *rest) for number, (time, *rest) in enumerate(told))
    events = []
    for reading in streams.readings:
        while told and told[0][0] <= reading.time:
            _, _, add, what = told.pop(0)
            events += add(*what)
        events += assembler.add_reading(reading)
    for _, _, add, what in told:
        events += add(*what)
    (line,) = (event for event in events if isinstance(event, MeasuredLine))
    assert line.complete
    assert repr(events) == repr(streams.assembled())


def test_a_line_on_the_fly_is_made_of_the_same_data(streams):
    events = streams.assembled()
    stops = [event for event in events if isinstance(event, SettledStop)]
    blocks = [event for event in events if isinstance(event, BlockDisplacement)]
    (line,) = (event for event in events if isinstance(event, MeasuredLine))
    assert [stop.command.stop for stop in stops] == list(range(19))
    assert len(blocks) == 18 and line.complete
    true = streams.machine.true()
    error = line.displacement - (true - true[0])
    spread = np.hypot(line.standard_uncertainty, line.standard_uncertainty[0])
    assert np.max(np.abs(error[1:] / spread[1:])) < 4.0
    assert stops[3].raw_displacement - stops[3].displacement == pytest.approx(1e-4)
    assert stops[3].environment == AIR
    assert stops[3].window_start < stops[3].time < stops[3].window_end


def test_no_stream_needs_to_be_ahead(streams):
    expected = streams.assembled()
    for first in ("readings", "positions"):
        assembler = Assembler(PLAN, START)
        events = []
        for command, arrival in zip(streams.commands, streams.arrivals, strict=True):
            events += assembler.add_command(command)
            events += assembler.add_arrival(arrival)
        if first == "readings":
            # The stream of positions may be behind for as long as a stop may take to settle.
            events += assembler.add_readings(streams.readings[:-1])
        for time, place in streams.positions:
            events += assembler.add_position(time, place)
        events += assembler.add_readings(streams.readings if first == "positions" else ())
        events += assembler.add_readings(streams.readings[-1:])
        assert _numbers(events) == _numbers(expected)


def _numbers(events):
    return [
        event.displacement.tolist() if isinstance(event, MeasuredLine) else event
        for event in events
    ]


def test_a_lost_beam_rejects_the_rest_of_the_line():
    streams = Streams()
    streams.readings[2000:] = [one._replace(status=2) for one in streams.readings[2000:]]
    stops = [event for event in streams.assembled() if isinstance(event, SettledStop)]
    settled = [stop.settled for stop in stops]
    assert settled[:7] == [True] * 7 and not any(settled[7:])
    assert all(stop.reason and np.isnan(stop.displacement) for stop in stops[7:])


def test_without_positions_the_line_asks_for_corner_stops():
    streams = Streams()
    streams.positions = []
    later = streams.readings[-1]
    streams.readings += [
        later._replace(time=later.time + k * 1_000_000, sequence=later.sequence + k)
        for k in range(1, 4000)
    ]
    stops = [event for event in streams.assembled() if isinstance(event, SettledStop)]
    assert len(stops) == 19
    assert all(needs_corner_stops(stop.reason) for stop in stops)


def test_a_line_whose_beginning_was_not_heard_is_refused():
    streams = Streams()
    del streams.commands[:2], streams.arrivals[:2]
    stops = [event for event in streams.assembled() if isinstance(event, SettledStop)]
    assert [stop.settled for stop in stops] == [False] * 17


def test_counts_that_do_not_fit_the_way_are_refused():
    streams = Streams()
    record = streams.record
    wrong = record.displacements.copy()
    wrong[2000:] += 5e-3
    assert np.all(np.isnan(evaluate_pass(replace(record, displacements=wrong)).displacement))


def test_a_line_of_two_moves_is_refused():
    plan = {
        "step_m": [0.1, 0.1, 0.1],
        "blocks": 2,
        "feed_m_per_s": 0.1,
        "measurement": ON_THE_FLY,
        "lines": [{"kind": "linear", "names": ["x"]}],
    }
    with pytest.raises(Refusal) as refusal:
        Plan.from_mapping(plan, "test")
    assert refusal.value.about == "measurement"
    assert Plan.from_mapping({**plan, "blocks": 3}, "test").on_the_fly
