"""A stop that was rejected and is measured again in the same attempt at its line."""

import numpy as np
import pytest
from runs_for_tests import FORTH, PLAN, SECOND, START, Run, blocks_of, lines_of, stops_of

from stepdiag_ros.metrology.assembly import assemble, repetition_helps


class RepeatedRun(Run):
    """A pass along the first line in which one stop is approached and measured twice."""

    def measure_again(self, stop):
        """Go back to the stop before, come again, and stay: two moves, of which one is no stop."""
        targets = FORTH.stops(self.plan.volume)
        self.read(0.3, targets[stop - 1], FORTH)
        again = self.commands[-1]._replace(
            command_id=self.commands[-1].command_id + 5, time=self.now
        )
        self.commands.append(again)
        self.read(0.3, targets[stop], FORTH)
        place = tuple((targets[stop] + 1e-7).tolist())
        self.arrivals.append(
            self.arrivals[-1]._replace(command_id=again.command_id, time=self.now, position=place)
        )
        self.read(1.0, targets[stop], FORTH)


def repeated(restless_again=False):
    run = RepeatedRun()
    run.measure(0, stops=3)
    begin = run.arrivals[-1].time
    end = run.now
    run.measure_again(2)
    again = run.arrivals[-1].time
    last = Run.measure
    commands, arrivals = list(run.commands), list(run.arrivals)
    run.commands, run.arrivals = [], []
    last(run, 0, stops=4)
    # Only the last stop of this second pass belongs to the line that is measured.
    command, arrival = run.commands[-1], run.arrivals[-1]
    number = commands[-1].command_id + 10
    run.commands = [*commands, command._replace(command_id=number)]
    run.arrivals = [*arrivals, arrival._replace(command_id=number)]
    run.shift(begin, end, lambda seconds: 2e-5 * np.sin(300.0 * seconds))
    if restless_again:
        run.shift(again, again + SECOND, lambda seconds: 2e-5 * np.sin(300.0 * seconds))
    return run


def test_the_second_measurement_takes_the_place_of_the_first():
    run = repeated()
    events = assemble(PLAN, START, run.commands, run.arrivals, run.readings)
    stops = stops_of(events)
    assert [(stop.command.stop, stop.settled) for stop in stops] == [
        (0, True),
        (1, True),
        (2, False),
        (2, True),
        (3, True),
    ]
    assert repetition_helps(stops[2].reason) and not repetition_helps("the zero is lost: no beam")
    assert [(block.from_stop, block.to_stop) for block in blocks_of(events)] == [
        (0, 1),
        (1, 2),
        (2, 3),
    ]
    (line,) = lines_of(events)
    assert line.complete and line.attempt == 1
    assert line.displacement[2] == pytest.approx(
        stops[3].displacement - stops[0].displacement, abs=1e-12
    )
    assert line.time[2] == pytest.approx((stops[3].time - START) * 1e-9)


def test_a_stop_that_never_settles_has_no_value():
    run = repeated(restless_again=True)
    events = assemble(PLAN, START, run.commands, run.arrivals, run.readings)
    assert [stop.settled for stop in stops_of(events)] == [True, True, False, False, True]
    (line,) = lines_of(events)
    assert np.isnan(line.displacement[2]) and np.isfinite(line.displacement[[0, 1, 3]]).all()
