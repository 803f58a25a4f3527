"""A run compensated anew from its counts and its weather: as on line, or as it should have been."""

from dataclasses import replace

import numpy as np
import pytest
from live_cell import LiveCell
from test_live_effects import CELL, PLAN

from stepdiag_ros.metrology.air.recompensation import (
    AirChoice,
    SensorValue,
    begins_of_setups,
    recompensated,
)
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.measurement import MeasuredLine

DEAD_PATH = 0.8


class Spy:
    """Notes what an object is told by some of its methods, and passes it on."""

    def __init__(self, watched, *methods):
        self.watched = watched
        self.told = {name: [] for name in methods}

    def __getattr__(self, name):
        method = getattr(self.watched, name)
        if name not in self.told:
            return method

        def noted(value):
            answer = method(value)
            self.told[name].append((value, answer))
            return answer

        return noted


class Run:
    """A measured run in air that changes, and everything that a bag would hold of it."""

    def __init__(self):
        live = LiveCell(PLAN, replace(CELL, dead_path=DEAD_PATH))
        live.assembler = Spy(live.assembler, "add_command", "add_arrival")
        live.weather = Spy(live.weather, "poll")
        live.measure()
        self.plan, self.start, self.lines = PLAN, live.start, live.lines
        self.readings = live.readings
        self.commands = [command for command, _ in live.assembler.told["add_command"]]
        self.arrivals = [arrival for arrival, _ in live.assembler.told["add_arrival"]]
        self.weather = [
            SensorValue(time, name, value)
            for _, samples in live.weather.told["poll"]
            for time, environment in samples
            for name, value in environment._asdict().items()
        ]

    def lines_with(self, choice, weather=None):
        """Return the displacements of all lines, compensated anew."""
        readings = recompensated(
            self.readings,
            self.weather if weather is None else weather,
            begins_of_setups(self.commands, self.arrivals),
            self.plan,
            choice,
        )
        events = assemble(self.plan, self.start, self.commands, self.arrivals, readings)
        return [event.displacement for event in events if isinstance(event, MeasuredLine)]

    def off_by(self, choice):
        """Return the largest difference from the lines of the live run, m."""
        made = self.lines_with(choice)
        assert len(made) == len(self.lines)
        pairs = zip(made, self.lines, strict=True)
        return max(float(np.abs(one - line.displacement).max()) for one, line in pairs)


@pytest.fixture(scope="module")
def run():
    return Run()


def test_the_same_choice_gives_the_lines_of_the_live_run(run):
    assert run.off_by(AirChoice("own", DEAD_PATH, longest_age=3600.0)) < 1e-11


def test_another_dead_path_or_equation_shows(run):
    temperatures = [value.value for value in run.weather if value.name == "air_temperature"]
    # 1 K is about 1 µm in a metre.
    expected = 1e-6 * (max(temperatures) - min(temperatures)) * DEAD_PATH
    without = run.off_by(AirChoice("own", 0.0, longest_age=3600.0))
    assert 0.1 * expected < without < 3.0 * expected
    ciddor = run.off_by(AirChoice("own", DEAD_PATH, equation="ciddor", longest_age=3600.0))
    assert 1e-12 < ciddor < 1e-8
    length = max(float(np.abs(line.displacement).max()) for line in run.lines)
    assert run.off_by(AirChoice("off")) == pytest.approx(2.7e-4 * length, rel=0.05)


def test_where_the_weather_is_missing_stops_are_unknown_and_not_invented(run):
    half = run.weather[: len(run.weather) // 2]
    made = run.lines_with(AirChoice("own", DEAD_PATH, longest_age=1.0), half)
    assert np.isfinite(made[0]).all() and np.isnan(made[-1]).all()
    nothing = run.lines_with(AirChoice("own", DEAD_PATH), [])
    assert all(np.isnan(line).all() for line in nothing)
    assert all(np.isfinite(line).all() for line in run.lines_with(AirChoice("off"), []))
