"""The assembler: values, uncertainty, every rejection, independence of the interleaving."""

import math
import pickle
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refused import a_fault, refused
from runs_for_tests import (
    AIR,
    BACK,
    FORTH,
    LINEAR_X,
    PLAN,
    SAMPLING,
    SECOND,
    START,
    VOLUME,
    Run,
    blocks_of,
    lines_of,
    stops_of,
)

from stepdiag_ros.metrology.assembly import Assembler, assemble
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.plan import FORWARD, STEP_DIAGONAL, Line, Plan, Volume
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.window import standard_uncertainty_of_mean


def events_of(run, plan=PLAN):
    return assemble(plan, START, run.commands, run.arrivals, run.readings)


def bits(events):
    """Every bit of some events; NaN equals NaN of the same bits."""

    def flat(value):
        return value.tobytes() if isinstance(value, np.ndarray) else value

    return [
        pickle.dumps([type(event).__name__, *(flat(getattr(event, f.name)) for f in fields(event))])
        for event in events
    ]


def interleaved(run, order, plan=PLAN, **options):
    """Feed the streams in the order of the letters, then what is left of each."""
    assembler = Assembler(plan, START, **options)
    streams = {
        "c": (iter(run.commands), assembler.add_command),
        "a": (iter(run.arrivals), assembler.add_arrival),
        "r": (iter(run.readings), assembler.add_reading),
    }
    events = []
    for letter, count in order:
        stream, add = streams[letter]
        for _ in range(count):
            item = next(stream, None)
            if item is None:
                break
            events += add(item)
    for stream, add in streams.values():
        for item in stream:
            events += add(item)
    return events


# Values ------------------------------------------------------------------------------------------


def test_a_line_gives_stops_blocks_and_the_line_in_order():
    run = Run(noise=50e-9)
    run.measure(0)
    events = events_of(run)
    assert [type(event).__name__[0] for event in events] == list("SSBSBSBM")
    for number, stop in enumerate(stops_of(events)):
        arrival, command = run.arrivals[number], run.commands[number]
        assert stop.settled and stop.reason == ""
        assert stop.command == command and stop.line == FORTH
        assert stop.position == arrival.position and stop.in_position_time == arrival.time
        assert stop.window_start == arrival.time + SECOND // 10
        assert stop.window_end == stop.window_start + SECOND // 5
        taken = [r for r in run.readings if stop.window_start <= r.time < stop.window_end]
        assert stop.readings == len(taken) == 20
        assert (stop.first_sequence, stop.last_sequence) == (taken[0].sequence, taken[-1].sequence)
        values = np.array([reading.compensated_displacement for reading in taken])
        assert stop.displacement == pytest.approx(np.mean(values), abs=1e-16)
        assert stop.raw_displacement == pytest.approx(1.00027 * np.mean(values), abs=1e-15)
        assert stop.standard_deviation == pytest.approx(np.std(values, ddof=1), rel=1e-6)
        assert stop.time == sum(r.time for r in taken) // len(taken)
        assert stop.environment == AIR


def test_blocks_are_differences_of_stops():
    run = Run()
    run.measure(0)
    run.measure(1)
    events = events_of(run)
    stops, blocks = stops_of(events), blocks_of(events)
    assert [(b.line_index, b.block, b.axis, b.from_stop, b.to_stop) for b in blocks] == [
        (0, 1, "X", 0, 1),
        (0, 1, "Y", 1, 2),
        (0, 1, "Z", 2, 3),
        (1, 1, "Z", 0, 1),
        (1, 1, "Y", 1, 2),
        (1, 1, "X", 2, 3),
    ]
    move = 0.01 / math.sqrt(3)
    for block, before, after in zip(
        blocks, [*stops[:3], *stops[4:7]], [*stops[1:4], *stops[5:]], strict=True
    ):
        assert block.nominal_displacement == pytest.approx(move * (1 - 2 * block.line_index))
        assert block.displacement == after.displacement - before.displacement
        assert block.displacement == pytest.approx(block.nominal_displacement, abs=1e-7)
        assert block.standard_uncertainty == pytest.approx(
            math.hypot(before.standard_uncertainty, after.standard_uncertainty)
        )
        assert block.time == after.time


def test_blocks_of_three_moves_and_of_one():
    volume = Volume((0.0, 0.0, 0.0), (0.01, 0.01, 0.01), 2)
    lines = (Line(STEP_DIAGONAL, "ppp", "YZX", 0, FORWARD), LINEAR_X)
    plan = Plan("more", volume, lines, 0.1, SAMPLING)
    run = Run(plan=plan)
    run.measure(0)
    run.measure(1)
    blocks = blocks_of(events_of(run, plan))
    assert [b.block for b in blocks] == [1, 1, 1, 2, 2, 2, 1, 2]
    assert "".join(b.axis for b in blocks) == "YZXYZXXX"


def test_the_line_has_the_zero_of_its_setup():
    run = Run()
    run.measure(0)
    run.measure(1)
    events = events_of(run)
    stops = stops_of(events)
    forth, back = lines_of(events)
    assert forth.complete and back.complete
    assert forth.setup == back.setup == "npp XYZ"
    assert forth.displacement[0] == 0.0
    zero = stops[0].displacement
    assert np.array_equal(forth.displacement, [s.displacement - zero for s in stops[:4]])
    assert np.array_equal(back.displacement, [s.displacement - zero for s in stops[4:]])
    assert back.displacement[0] == pytest.approx(0.01 * math.sqrt(3), abs=1e-6)
    assert np.array_equal(forth.time, [(s.time - START) * 1e-9 for s in stops[:4]])
    assert np.array_equal(forth.standard_uncertainty, [s.standard_uncertainty for s in stops[:4]])
    assert np.array_equal(forth.target, FORTH.stops(VOLUME))
    assert np.array_equal(back.target, BACK.stops(VOLUME))
    assert np.array_equal(forth.environment, [AIR] * 4)
    assert (forth.line_index, forth.attempt, forth.end_time) == (0, 1, stops[3].time)


def test_another_setup_has_its_own_zero_even_when_it_comes_back():
    plan = replace(PLAN, lines=(FORTH, LINEAR_X, BACK))
    run = Run(plan=plan)
    for index in range(3):
        run.measure(index)
    lines = lines_of(events_of(run, plan))
    assert [line.setup for line in lines] == ["npp XYZ", "x", "npp XYZ (zero 2)"]
    assert [line.displacement[0] for line in lines] == [0.0, 0.0, 0.0]


def test_a_new_attempt_keeps_the_zero_and_drops_the_stops_of_the_old_one():
    run = Run()
    run.measure(0, attempt=1, stops=2)
    run.measure(0, attempt=2)
    events = events_of(run)
    (line,) = lines_of(events)
    stops = stops_of(events)
    assert line.attempt == 2 and line.setup == "npp XYZ" and line.complete
    assert line.displacement[0] == stops[2].displacement - stops[0].displacement != 0.0
    # No block joins two attempts.
    assert [(b.attempt, b.to_stop) for b in blocks_of(events)] == [(1, 1), (2, 1), (2, 2), (2, 3)]


def test_a_line_may_be_started_again_while_a_stop_of_the_old_attempt_still_waits():
    run = Run(noise=50e-9)
    run.measure(0, attempt=1, stops=2)
    restless = run.arrivals[1].time
    # Stopped and started again 0.5 s after in position, when the stop could have waited for 0.9 s.
    run.now = restless + SECOND // 2
    run.readings = [r for r in run.readings if r.time < run.now]
    run.count = len(run.readings)
    run.shift(restless, run.now, lambda t: 9e-6 * math.sin(150 * t))
    run.measure(0, attempt=2)
    assert run.arrivals[2].time < restless + 9 * SECOND // 10
    events = events_of(run)
    stops = stops_of(events)
    assert [s.settled for s in stops] == [True, False, True, True, True, True]
    (line,) = lines_of(events)
    assert line.attempt == 2 and line.complete


def test_environment_is_averaged_and_unknown_stays_unknown():
    run = Run()
    run.measure(0, stops=1)
    arrival = run.arrivals[0].time
    middle = arrival + SECOND // 5
    run.change(middle, run.now, environment=Environment(22.0, 101325.0, math.nan, 20.5))
    (stop,) = stops_of(events_of(run))
    assert stop.environment.air_temperature == pytest.approx(21.0)
    assert stop.environment.air_pressure == pytest.approx(101325.0)
    assert math.isnan(stop.environment.relative_humidity)
    assert stop.environment.material_temperature == 20.5


# When a stop is decided --------------------------------------------------------------------------


def test_a_stop_is_decided_by_the_first_reading_at_or_after_the_end_of_its_window():
    run = Run()
    run.measure(0, stops=1)
    end = run.arrivals[0].time + 3 * SECOND // 10
    run.change(end, end + 1, sequence=run.readings[0].sequence)
    assembler = Assembler(PLAN, START)
    assembler.add_command(run.commands[0])
    assembler.add_arrival(run.arrivals[0])
    times = [r.time for r in run.readings if assembler.add_reading(r)]
    assert times == [min(r.time for r in run.readings if r.time >= end)]


def test_the_first_quiet_window_is_taken():
    run = Run()
    run.measure(0, stops=1)
    begin = run.arrivals[0].time
    run.shift(begin, begin + SECOND // 2, lambda t: 5e-6 * math.sin(200 * t))
    (stop,) = stops_of(events_of(run))
    assert stop.settled
    # Windows of 0.2 s from 0.1 s on: those from 0.1 and 0.3 s are disturbed.
    assert stop.window_start == begin + SECOND // 2
    assert stop.standard_deviation < 1e-7


def test_nothing_is_decided_without_a_later_reading():
    run = Run()
    run.measure(0, stops=1)
    end = run.arrivals[0].time + 3 * SECOND // 10
    run.readings = [r for r in run.readings if r.time < end]
    assert events_of(run) == []


# Rejections -------------------------------------------------------------------------------------


def rejected(run, number=0, plan=PLAN):
    events = events_of(run, plan)
    stop = stops_of(events)[number]
    assert not stop.settled and stop.reason
    return stop, events


def test_readings_that_never_rest_are_rejected():
    run = Run()
    run.measure(0)
    begin = run.arrivals[1].time
    run.shift(begin, begin + SECOND, lambda t: 5e-6 * math.sin(200 * t))
    stop, events = rejected(run, 1)
    assert "not settled within 0.9 s" in stop.reason and "standard deviation" in stop.reason
    assert "µm" in stop.reason and "limit of 1 µm" in stop.reason
    # The numbers are those of the last window tried.
    assert stop.window_end == begin + 9 * SECOND // 10
    assert stop.standard_deviation > 1e-6
    (line,) = lines_of(events)
    assert np.isnan(line.displacement).tolist() == [False, True, False, False]
    assert np.isnan(line.standard_uncertainty).tolist() == [False, True, False, False]
    assert not line.complete
    assert np.isfinite(line.time).all()
    assert [block.to_stop for block in blocks_of(events)] == [3]


def test_drifting_readings_are_rejected():
    run = Run(noise=1e-9)
    run.measure(0, stops=1)
    run.shift(START, run.now, lambda t: 3e-6 * t)
    stop, _ = rejected(run)
    assert "drift by 0.6 µm" in stop.reason
    sinking = Run(noise=1e-9)
    sinking.measure(0, stops=1)
    sinking.shift(START, sinking.now, lambda t: -3e-6 * t)
    assert "drift by -0.6 µm" in rejected(sinking)[0].reason
    slow = Run(noise=1e-9)
    slow.measure(0, stops=1)
    slow.shift(START, slow.now, lambda t: -2e-6 * t)
    assert stops_of(events_of(slow))[0].settled


def test_weak_signal_is_not_averaged_and_does_not_lose_the_zero():
    run = Run()
    run.measure(0, stops=2)
    begin = run.arrivals[0].time
    run.change(begin, begin + SECOND, status=1)
    stop, events = rejected(run)
    assert "signal was low" in stop.reason
    assert stops_of(events)[1].settled
    later = Run()
    later.measure(0, stops=1)
    later.change(begin, begin + SECOND // 5, status=1)
    (stop,) = stops_of(events_of(later))
    assert stop.settled and stop.window_start == begin + 3 * SECOND // 10


def test_unknown_air_is_rejected_in_so_many_words():
    run = Run()
    run.measure(0, stops=1)
    run.change(START, run.now, compensated_displacement=math.nan, environment=Environment())
    stop, _ = rejected(run)
    assert "air is not known" in stop.reason
    assert math.isnan(stop.displacement) and math.isfinite(stop.raw_displacement)
    assert math.isnan(stop.standard_uncertainty)


def test_lost_readings_are_rejected():
    run = Run()
    run.measure(0, stops=1)
    begin = run.arrivals[0].time
    missing = {r.sequence for r in run.readings if r.time >= begin and r.sequence % 10 == 5}
    run.readings = [r for r in run.readings if r.sequence not in missing]
    stop, _ = rejected(run)
    assert "2 readings of the window are missing" in stop.reason


def test_too_few_readings_are_rejected():
    run = Run(rate=8.0)
    run.measure(0, stops=1)
    run.read(1.0, np.zeros(3), FORTH)
    stop, _ = rejected(run)
    assert "readings in the window; at least 3" in stop.reason


def test_no_readings_at_all_are_rejected():
    run = Run()
    run.measure(0, stops=1)
    begin = run.arrivals[0].time
    run.readings = [r for r in run.readings if r.time < begin or r.time >= begin + SECOND - 10**7]
    stop, _ = rejected(run)
    assert "no readings" in stop.reason
    assert stop.readings == 0 and math.isnan(stop.displacement)


def test_a_window_that_the_readings_do_not_fill_is_rejected():
    run = Run()
    run.measure(0, stops=1)
    begin = run.arrivals[0].time
    # The instrument pauses, without a gap in the sequence, in every window from its middle on.
    kept = [r for r in run.readings if (r.time - begin - SECOND // 10) % (SECOND // 5) < 80_000_000]
    run.readings = [r._replace(sequence=number) for number, r in enumerate(kept)]
    run.readings.append(run.readings[-1]._replace(time=run.now, sequence=len(run.readings)))
    stop, _ = rejected(run)
    assert "do not fill the window" in stop.reason


@pytest.mark.parametrize(
    ("status", "words"), [(2, "beam was lost"), (3, "too fast"), (4, "reported a fault")]
)
def test_a_lost_zero_rejects_every_later_stop_of_the_line_at_once(status, words):
    run = Run()
    run.measure(0)
    run.measure(1)
    lost = run.commands[2].time + SECOND // 10
    run.change(lost, lost + SECOND // 50, status=status)
    stops, lines = stops_of(events_of(run)), lines_of(events_of(run))
    assert [stop.settled for stop in stops] == [True, True, False, False, True, True, True, True]
    for stop in stops[2:4]:
        assert "zero is lost" in stop.reason and words in stop.reason
        assert stop.window_end == stop.in_position_time + 3 * SECOND // 10
    # The next line of the setup has a zero of its own, and says so.
    assert [line.setup for line in lines] == ["npp XYZ", "npp XYZ (zero 2)"]
    assert lines[1].displacement[0] == 0.0 and lines[1].complete
    assert stops[4].command.setup == "npp XYZ (zero 2)"


def test_a_beam_that_stays_lost_rejects_without_end():
    run = Run()
    run.measure(0)
    run.measure(1)
    run.change(run.commands[2].time, run.now, status=2)
    stops = stops_of(events_of(run))
    assert [stop.settled for stop in stops] == [True, True] + [False] * 6


def test_a_restarted_instrument_has_lost_its_zero():
    run = Run()
    run.measure(0)
    again = run.commands[2].time + SECOND // 10
    first = next(r.sequence for r in run.readings if r.time >= again)
    run.readings = [
        r._replace(sequence=r.sequence - first) if r.time >= again else r for r in run.readings
    ]
    stop, _ = rejected(run, 2)
    assert "started again" in stop.reason


def test_moving_too_early_is_rejected_and_voids_the_stop_that_was_left():
    run = Run()
    run.measure(0)
    end = run.arrivals[1].time + 3 * SECOND // 10
    run.commands[2] = run.commands[2]._replace(time=end - 1)
    stop, events = rejected(run, 2)
    assert "moved too early" in stop.reason and "stop 1" in stop.reason
    (line,) = lines_of(events)
    assert np.isnan(line.displacement).tolist() == [False, True, True, False]
    run.commands[2] = run.commands[2]._replace(time=end)
    assert all(stop.settled for stop in stops_of(events_of(run)))


def test_a_machine_that_stands_elsewhere_is_rejected():
    run = Run()
    run.measure(0)
    # The controller says done, but the axis has not moved.
    begin = run.commands[2].time
    run.shift(begin, run.arrivals[2].time + SECOND, lambda _: -0.9 * 0.01 / math.sqrt(3))
    stop, events = rejected(run, 2)
    assert "stands elsewhere" in stop.reason and "5.77" in stop.reason
    assert [s.settled for s in stops_of(events)] == [True, True, False, True]
    near = Run()
    near.measure(0)
    near.shift(begin, near.arrivals[2].time + SECOND, lambda _: -0.4 * 0.01 / math.sqrt(3))
    assert all(stop.settled for stop in stops_of(events_of(near)))


def test_a_machine_clock_that_steps_back_is_rejected():
    run = Run()
    run.measure(0)
    early = run.arrivals[0].time - 1
    run.arrivals[1] = run.arrivals[1]._replace(time=early)
    stop, events = rejected(run, 1)
    assert "stepped back" in stop.reason
    assert len(stops_of(events)) == 4


def test_readings_that_are_no_longer_kept_are_not_missed_silently():
    run = Run()
    run.measure(0, stops=1)
    run.read(5.0, np.zeros(3), FORTH)
    (stop,) = stops_of(interleaved(run, [("r", 10**6)], buffer=100))
    assert not stop.settled and "no longer kept" in stop.reason
    (stop,) = stops_of(interleaved(run, [("r", 10**6)], buffer=1000))
    assert stop.settled


# What is left out -------------------------------------------------------------------------------


def test_commands_that_never_arrive_are_left_out():
    run = Run()
    run.measure(0)
    del run.arrivals[1]
    events = events_of(run)
    assert [stop.command.stop for stop in stops_of(events)] == [0, 2, 3]
    (line,) = lines_of(events)
    assert np.isnan(line.displacement).tolist() == [False, True, False, False]
    assert np.isnan(line.time).tolist() == [False, True, False, False]
    assert [block.to_stop for block in blocks_of(events)] == [3]


def test_repetitions_and_arrivals_of_other_moves_change_nothing():
    run = Run()
    run.measure(0)
    expected = bits(events_of(run))
    other = run.arrivals[1]._replace(command_id=15, time=run.arrivals[1].time - 7)
    run.arrivals.insert(1, other)
    run.arrivals.insert(2, run.arrivals[0])
    run.commands.insert(2, run.commands[1])
    run.readings = [reading for reading in run.readings for _ in range(2)]
    assert bits(events_of(run)) == expected


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"line_index": 2}, a_fault("mismatch", "2", aspect="line")),
        ({"stop": 4}, a_fault("mismatch", "4", "0", aspect="stop")),
        ({"stop": -1}, a_fault("mismatch", "-1", aspect="stop")),
        ({"target": (0.01, 0.0, 1e-6)}, a_fault("mismatch", "0", aspect="place")),
        ({"target": (0.01, 0.0, math.nan)}, a_fault("mismatch", "0", aspect="place")),
    ],
)
def test_commands_of_another_plan_are_refused(change, words):
    run = Run()
    run.measure(0, stops=1)
    with refused(Refusal, words):
        Assembler(PLAN, START).add_command(run.commands[0]._replace(**change))


@pytest.mark.parametrize("stream", ["commands", "arrivals"])
@pytest.mark.parametrize("late", [False, True], ids=["another of the same number", "a late one"])
def test_two_senders_that_contradict_each_other_are_refused(stream, late):
    run = Run()
    run.measure(0)
    events = getattr(run, stream)
    other = events.pop(1) if late else events[1]._replace(time=events[1].time + 1)
    events.insert(2, other)
    with refused(Refusal, "out_of_order", stream[:-1], str(other.command_id)):
        events_of(run)


# Interleaving ------------------------------------------------------------------------------------


def troubled_run():
    """A run with everything in it that can go wrong."""
    run = Run(noise=80e-9, seed=7)
    run.measure(0, attempt=1)
    run.measure(0, attempt=2, stops=3)
    run.measure(0, attempt=3)
    run.measure(1, attempt=1)
    run.measure(1, attempt=2, setup="npp XYZ #2")
    at = [arrival.time for arrival in run.arrivals]
    run.shift(at[1], at[1] + SECOND // 2, lambda t: 5e-6 * math.sin(200 * t))
    run.shift(at[2], at[2] + SECOND, lambda t: 9e-6 * math.sin(150 * t))
    run.change(at[5] - SECOND // 10, at[5], status=2)
    run.change(at[8], at[8] + SECOND // 5, compensated_displacement=math.nan)
    run.commands[13] = run.commands[13]._replace(time=at[12] + SECOND // 5)
    del run.arrivals[16]
    lost = {r.sequence for r in run.readings if at[14] < r.time and r.sequence % 37 == 0}
    run.readings = [r for r in run.readings if r.sequence not in lost]
    return run


TROUBLED = troubled_run()
EXPECTED = bits(events_of(TROUBLED))


def test_the_troubled_run_has_all_kinds_of_trouble():
    stops = stops_of(events_of(TROUBLED))
    assert {stop.settled for stop in stops} == {True, False}
    reasons = " ".join(stop.reason for stop in stops)
    for word in ("standard deviation", "zero is lost", "too early"):
        assert word in reasons
    assert len(lines_of(events_of(TROUBLED))) == 4


@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(st.sampled_from("car"), st.integers(1, 400)),
        max_size=40,
    )
)
def test_any_interleaving_gives_the_same_bits_in_the_same_order(order):
    assert bits(interleaved(TROUBLED, order)) == EXPECTED


@pytest.mark.parametrize("order", ["rca", "rac", "cra", "car", "arc", "acr"])
def test_one_stream_wholly_before_another_gives_the_same(order):
    assert bits(interleaved(TROUBLED, [(letter, 10**6) for letter in order])) == EXPECTED


# Uncertainty ------------------------------------------------------------------------------------


def test_uncertainty_of_white_noise():
    random = np.random.default_rng(3)
    sets = random.standard_normal((400, 300))
    found = np.array([standard_uncertainty_of_mean(values) for values in sets])
    plain = np.std(sets, axis=1, ddof=1) / math.sqrt(300)
    assert np.all(found >= plain * (1 - 1e-12))
    # Only where chance shows a correlation (1 in 40) is it above s/√n.
    assert np.mean(found > plain * (1 + 1e-9)) < 0.06
    assert np.mean(found) == pytest.approx(1 / math.sqrt(300), rel=0.03)


@pytest.mark.parametrize("memory", [0.6, 0.9])
def test_uncertainty_of_correlated_noise_covers_the_scatter_of_means(memory):
    random = np.random.default_rng(4)
    noise = random.standard_normal((400, 800))
    for column in range(1, 800):
        noise[:, column] += memory * noise[:, column - 1]
    noise = noise[:, 300:]
    scatter = np.std(np.mean(noise, axis=1))
    found = math.sqrt(np.mean([standard_uncertainty_of_mean(values) ** 2 for values in noise]))
    plain = math.sqrt(np.mean(np.var(noise, axis=1, ddof=1)) / 500)
    assert plain < 0.6 * scatter
    assert found == pytest.approx(scatter, rel=0.15)


def test_uncertainty_of_few_or_unknown_readings():
    assert math.isnan(standard_uncertainty_of_mean(np.array([1.0])))
    assert math.isnan(standard_uncertainty_of_mean(np.array([])))
    assert math.isnan(standard_uncertainty_of_mean(np.array([1.0, math.nan, 2.0])))
    assert standard_uncertainty_of_mean(np.array([1.0, 1.0, 1.0])) == 0.0
    assert standard_uncertainty_of_mean(np.array([0.0, 1.0])) == pytest.approx(0.5)
    # Readings that alternate are not trusted more than independent ones.
    alternate = np.array([1.0, -1.0] * 50)
    assert standard_uncertainty_of_mean(alternate) == pytest.approx(np.std(alternate, ddof=1) / 10)
