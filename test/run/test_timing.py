"""Live timing: line by line as it is measured, the same as from the bag, and said in words."""

from types import SimpleNamespace

import numpy as np
import pytest

from stepdiag_ros.bags.run import Diagnostic
from stepdiag_ros.evaluation.recorded_run import out_of_step
from stepdiag_ros.metrology.measurement import Environment, MeasuredLine, Reading
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.time_alignment import TimeOffset, run_timing
from stepdiag_ros.run.health import Level
from stepdiag_ros.run.timing import LiveTiming, effect_on_stops, in_words, worrying

START = 1_700_000_000_000_000_000
PLAN = Plan.from_mapping(
    {
        "name": "x",
        "step_m": [0.01, 0.01, 0.01],
        "blocks": 6,
        "feed_m_per_s": 0.05,
        "lines": [{"kind": "linear", "names": ["x"]}],
        "sampling": {"dwell_s": 0.6, "settle_s": 0.2, "window_s": 0.3},
    },
    "plan",
)


def place(seconds):
    """Stands for 0.6 s and moves by 10 mm in 0.2 s, six times, smoothly."""
    number = np.clip(np.floor(seconds / 0.8), 0, 6)
    part = np.clip((seconds - 0.8 * number - 0.6) / 0.2, 0.0, 1.0)
    way = np.where(number < 6, part - np.sin(2 * np.pi * part) / (2 * np.pi), 0.0)
    return 0.01 * (number + way)


def measure(late, status=0, lines=1, rate=500.0):
    timing = LiveTiming(PLAN, START)
    random = np.random.default_rng(1)
    for number in range(lines):
        begin = 20.0 * number
        end = begin + 0.8 * 6 + 0.5
        for time in np.arange(begin, end + 2.0, 1.0 / rate):
            at = START + round(time * 1e9)
            shown = 0.3 + float(place(time - late - begin)) + 1e-7 * random.standard_normal()
            timing.take_reading(Reading(at, 0, shown, shown, 1.0, status, Environment()))
            if round(time * rate) % 5 == 0:
                timing.take_position(at, (float(place(time - begin)), 0.0, 0.0))
            if abs(time - end) < 0.5 / rate:
                timing.take_line(line(begin, end))
    return timing


def line(begin, end):
    stops = 7
    return MeasuredLine(
        line=PLAN.lines[0],
        line_index=0,
        attempt=1,
        setup="x",
        time=np.linspace(begin, end, stops),
        end_time=START + round(end * 1e9),
        target=np.zeros((stops, 3)),
        displacement=np.zeros(stops),
        standard_uncertainty=np.zeros(stops),
        environment=np.zeros((stops, 4)),
    )


@pytest.mark.parametrize("late", [-0.02, 0.0, 0.035])
def test_each_line_is_looked_at_once_its_last_reading_can_be_placed(late):
    timing = measure(late, lines=2)
    assert len(timing.timing.lines) == 2
    assert timing.timing.offset.offset == pytest.approx(late, abs=2e-4)
    found = timing.judge()
    assert (found.level, found.message) == (Level.OK, "readings and positions fit in time")
    assert found.values["lines"] == "2"
    told = float(found.values["readings stamped late by (µs)"])
    assert told == pytest.approx(late * 1e6, abs=200.0)


def test_readings_that_are_late_by_more_than_the_stop_can_bear_are_told():
    found = measure(0.13).judge()
    assert found.level is Level.WARN
    assert "read too early" in found.message
    assert found.values["windows of stops"].startswith("windows begin 0.0")


def test_before_a_line_and_without_a_beam_nothing_is_said():
    for timing in (LiveTiming(PLAN, START), measure(0.01, status=2)):
        found = timing.judge()
        assert found.level is Level.OK
        assert found.message == "the offset of the clocks is not known yet"
        assert found.values["readings stamped late by (µs)"] == "unknown"
    assert "zero was lost" in found.values["windows of stops"]


def test_a_line_that_takes_hours_does_not_fill_the_memory():
    timing = LiveTiming(PLAN, START)
    for number in range(100_000):
        at = START + number * 10_000_000
        timing.take_reading(Reading(at, number, 0.0, 0.0, 1.0, 0, Environment()))
        timing.take_position(at, (0.0, 0.0, 0.0))
    assert len(timing._readings) <= 40_000 and len(timing._positions) <= 40_001


def test_words_have_the_digits_that_the_uncertainty_bears():
    good = TimeOffset(START, 0.0012345678, 2.6e-6, 30, 31)
    told = in_words(run_timing([good]))
    assert told == "readings are stamped 1234.6 µs late ± 5.3 µs (95 %, 31 moves)"
    early = in_words(run_timing([TimeOffset(START, -0.2e-6, 1e-6, 30, 31)]))
    assert "0.2 µs early" in early and "-" not in early and "late" not in early
    lines = [TimeOffset(START + k * 10**12, 1e-3 + 1e-4 * k, 1e-6, 9, 10) for k in range(4)]
    assert "+360 µs/h" in in_words(run_timing(lines))
    several = TimeOffset(START, 0.0, 1e-6, 9, 10, others=(0.8,))
    assert in_words(run_timing([several])).endswith("0.8 s fits about as well")
    unknown = TimeOffset(reason="the line has 0 moves; 3 are needed")
    assert in_words(run_timing([unknown])) == "not known: the line has 0 moves; 3 are needed"


def test_what_an_offset_does_to_stops():
    late = TimeOffset(START, 0.3, 1e-6, 9, 10)
    assert effect_on_stops(late, 0.2).startswith("windows begin 0.1 s before the machine is")
    assert worrying(late, 0.2) and not worrying(late, 1.0)
    early = TimeOffset(START, -0.3, 1e-6, 9, 10)
    assert effect_on_stops(early, 0.2) == "windows begin 0.5 s after in position instead of 0.2 s"
    assert not worrying(early, 0.2)
    # What rounds to the time that was asked for is said once.
    assert effect_on_stops(TimeOffset(START, -0.2e-6, 1e-6, 9, 10), 0.1).count("0.1 s") == 1
    assert effect_on_stops(TimeOffset(reason="no"), 0.2) == "not known: no"


def test_solve_tells_what_the_assembler_warned_of():
    told = [
        Diagnostic(START, 1, "assembler: timing", "readings are stamped so late"),
        Diagnostic(START, 0, "assembler: timing", "readings and positions fit in time"),
        Diagnostic(START, 1, "assembler: stops", "stops of this run were rejected"),
    ]
    words = out_of_step(SimpleNamespace(diagnostics=told))
    assert words == ("in this run readings are stamped so late: stepdiag info BAG",)
