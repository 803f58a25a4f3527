"""The simulated interferometer against the cell that it runs on, and its faults."""

import math
from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from hypothesis import given, settings
from hypothesis import strategies as st
from refused import refused

from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.metrology.air import compensated_displacement, index_of
from stepdiag_ros.metrology.cell import WeatherModel
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.refusal import Refusal

START = 1_700_000_000_000_000_123
MS = 1_000_000
SECOND = 1_000_000_000
STEP = (0.01, 0.01, 0.01)
ORIGIN = (0.0, 0.0, 0.0)
CELL = make_cell(
    seed=5,
    high=(0.2,) * 3,
    rotation=5e-6,
    squareness=(0.0,) * 3,
    tilt=2e-4,
    mirror=5e-5,
    noise=0.0,
    dead_path_m=0.4,
    weather={"air_temperature_degC": 21.0, "air_temperature_drift_K_per_h": 360.0},
    held=0.0,
)
NOISY = replace(CELL, reading_noise=1e-7)


def laser(cell=CELL, **options):
    return prepare("interferometer", "simulated", options, Surroundings(cell=cell))(START)


def weather(cell=CELL, **options):
    return prepare("weather", "simulated", options, Surroundings(cell=cell))(START)


def feed(device, until, position, station=None, begin=START, every=5 * MS):
    """Give positions (constant, or a function of seconds) up to a time, and the weather."""
    for time in range(begin, until + 1, every):
        at = position((time - START) * 1e-9) if callable(position) else position
        device.update_position(time, at)
    for time, environment in (station or weather()).poll(until):
        device.update_environment(time, environment)


def stepping(seconds):
    """Stands, moves X by 10 mm from 1 s to 1.5 s, stands."""
    return (0.01 * min(max((seconds - 1.0) / 0.5, 0.0), 1.0), 0.0, 0.0)


def test_readings_lie_on_their_own_grid_and_are_counted():
    device = laser(rate_hz=300)
    device.align(START, "ppp XYZ", "ppp", STEP, ORIGIN)
    feed(device, START + SECOND, ORIGIN)
    readings = device.poll(START + SECOND)
    assert [r.time for r in readings] == [START + round(k * SECOND / 300) for k in range(301)]
    assert [r.sequence for r in readings] == list(range(301))
    assert {r.status for r in readings} == {0}
    assert {r.signal_strength for r in readings} == {1.0}


def test_compensated_readings_are_the_true_displacement_in_changing_air():
    device = laser()
    device.align(START, "ppp XYZ", "ppp", STEP, ORIGIN)
    feed(device, START + 10 * SECOND, stepping, weather(rate_hz=50))
    readings = device.poll(START + 10 * SECOND)
    alignment = CELL.alignment("ppp XYZ", "ppp", STEP, ORIGIN)
    true = CELL.displacement(np.array([stepping(10.0), ORIGIN]), alignment)
    # 1 K of change and 0.4 m of dead path: 0.4 µm in the count, nothing in the compensated value.
    assert readings[-1].compensated_displacement == pytest.approx(true[0] - true[1], abs=3e-9)
    index = index_of(CELL.environment(10.0))
    count = index * true[0] - index_of(CELL.environment(0.0)) * true[1]
    assert readings[-1].raw_displacement == pytest.approx(count, abs=1e-13)
    assert abs(readings[0].compensated_displacement) < 1e-15
    assert readings[-1].environment == pytest.approx(CELL.environment(10.0), abs=0.01)


@pytest.mark.parametrize("again", ["", " #2"])
def test_a_mirror_mounted_elsewhere_reads_the_turns_of_the_tool_there(again):
    mount = (0.0, 0.1, 0.0)
    plan = make_plan(diagonals=("ppp",), linear=())
    plan = replace(plan, lines=tuple(replace(one, mirror_offset=mount) for one in plan.lines))
    (setup,) = {plan.setup_of(line) for line in plan.lines}
    device = laser()
    device.begin_run(plan, START)
    device.align(START, setup + again, "ppp", STEP, ORIGIN)
    end = (0.06, 0.06, 0.06)
    feed(device, START + 2 * SECOND, lambda seconds: end if seconds > 1.0 else ORIGIN)
    read = device.poll(START + 2 * SECOND)[-1].compensated_displacement
    there, usual = (
        np.ptp(
            CELL.displacement(
                np.array([end, ORIGIN]),
                CELL.alignment(setup + again, "ppp", STEP, ORIGIN, place),
                place,
            )
        )
        for place in (mount, ORIGIN)
    )
    assert read == pytest.approx(there, abs=5e-9)
    assert abs(there - usual) > 50e-9


def test_a_wrong_dead_path_and_a_wrong_sensor_leave_their_errors():
    ends = {}
    for name, options, sensors in (
        ("right", {}, {}),
        ("dead path", {"dead_path_m": 0.0}, {}),
        ("sensor", {}, {"air_temperature_error_K": 1.0}),
    ):
        device = laser(**options)
        device.align(START, "x", "x", STEP, ORIGIN)
        feed(device, START + 10 * SECOND, stepping, weather(rate_hz=50, **sensors))
        last = device.poll(START + 10 * SECOND)[-1]
        ends[name] = last.compensated_displacement
    change = index_of(CELL.environment(10.0)) - index_of(CELL.environment(0.0))
    assert ends["dead path"] - ends["right"] == pytest.approx(0.4 * change, rel=0.02)
    # What the sensor says 1 K too warm, about 1 µm/m.
    told = [
        air._replace(air_temperature=air.air_temperature + 1.0)
        for air in (CELL.environment(0.0), CELL.environment(10.0))
    ]
    expected = compensated_displacement(
        last.raw_displacement, 0.4, index_of(told[1]), index_of(told[0])
    )
    assert ends["sensor"] == pytest.approx(expected, abs=1e-13)
    assert ends["sensor"] - ends["right"] == pytest.approx(8e-9, abs=2e-9)


def test_noise_has_its_size_and_depends_on_the_seed_alone():
    values = {}
    for seed in (1, 1, 2):
        device = laser(NOISY, rate_hz=1000, seed=seed)
        device.align(START, "x", "x", STEP, ORIGIN)
        feed(device, START + 4 * SECOND, ORIGIN, weather(rate_hz=100))
        readings = device.poll(START + 4 * SECOND)
        noise = np.array([r.compensated_displacement for r in readings])
        assert np.std(np.diff(noise)) == pytest.approx(math.sqrt(2) * 1e-7, rel=0.05)
        if seed in values:
            assert np.array_equal(values[seed], noise)
        values[seed] = noise
    assert not np.array_equal(values[1], values[2])


@settings(max_examples=15)
@given(st.lists(st.integers(1, 400 * MS), min_size=1, max_size=15))
def test_readings_do_not_depend_on_when_they_are_asked_for(waits):
    results = []
    for polls in ([], waits):
        device = laser(NOISY)
        device.align(START + 100 * MS, "ppp XYZ", "ppp", STEP, ORIGIN)
        device.inject_beam_break(START + 2500 * MS, START + 2600 * MS)
        feed(device, START + 3 * SECOND, stepping)
        device.align(START + 2 * SECOND, "npp XYZ", "npp", STEP, ORIGIN)
        readings, now = [], START
        for wait in polls:
            now = min(now + wait, START + 3 * SECOND)
            readings += device.poll(now)
        results.append(readings + device.poll(START + 3 * SECOND))
    one, other = results
    assert len(one) == len(other) == 301
    numbers = [np.array([(*r[:6], *r.environment) for r in result]) for result in results]
    # Interpolation within another batch may differ in the last bit.
    assert np.allclose(numbers[0], numbers[1], rtol=0, atol=1e-15, equal_nan=True)


def test_readings_wait_for_positions_and_go_on_when_the_controller_is_dead():
    device = laser()
    assert device.poll(START + SECOND) == []
    device.align(START, "x", "x", STEP, ORIGIN)
    feed(device, START + SECOND, stepping)
    assert device.poll(START + 1100 * MS)[-1].time == START + SECOND
    assert device.poll(START + 1200 * MS) == []
    late = device.poll(START + 1210 * MS)
    assert late[-1].time == START + 1210 * MS
    lengths = {round(r.compensated_displacement * 1e12) for r in late}
    assert max(lengths) - min(lengths) < 3e5  # the air alone: the last position holds


def test_hold_can_be_lengthened_for_hurried_time():
    device = laser(hold_after_s=3.0)
    device.align(START, "x", "x", STEP, ORIGIN)
    feed(device, START + SECOND, ORIGIN)
    device.poll(START + SECOND)
    assert device.poll(START + 3 * SECOND) == []
    assert device.poll(START + 4 * SECOND + 1)


def test_without_alignment_there_is_no_beam():
    device = laser()
    feed(device, START + SECOND, ORIGIN)
    readings = device.poll(START + SECOND)
    assert {r.status for r in readings} == {2}
    assert {r.signal_strength for r in readings} == {0.0}
    assert all(math.isnan(r.raw_displacement) for r in readings)


def test_alignment_holds_from_its_time_on_and_sets_a_zero():
    device = laser()
    device.align(START, "x", "x", STEP, ORIGIN)
    feed(device, START + 3 * SECOND, stepping, weather(rate_hz=100))
    device.align(START + 2 * SECOND, "ppp XYZ", "ppp", STEP, ORIGIN)
    readings = device.poll(START + 3 * SECOND)
    before = next(r for r in readings if r.time == START + 2 * SECOND - 10 * MS)
    after = next(r for r in readings if r.time == START + 2 * SECOND)
    assert before.compensated_displacement == pytest.approx(0.01, abs=1e-5)
    assert after.raw_displacement == 0.0
    # The zero was set 10 mm along X from the first stop: the dead path is reckoned from there.
    assert readings[-1].compensated_displacement == pytest.approx(0.0, abs=2e-9)


def test_a_zero_set_away_from_the_first_stop_has_a_longer_dead_path():
    device = laser()
    device.align(START, "x", "x", STEP, ORIGIN)
    feed(device, START + 10 * SECOND, (0.1, 0.0, 0.0), weather(rate_hz=50))
    readings = device.poll(START + 10 * SECOND)
    # 1 K over 0.1 m that were not reckoned with would be 0.09 µm.
    assert readings[-1].raw_displacement == pytest.approx(-0.47e-6, abs=0.02e-6)
    assert readings[-1].compensated_displacement == pytest.approx(0.0, abs=3e-9)


def test_a_mirror_that_comes_back_between_two_polls_is_where_it_is():
    device = laser()
    device.align(START, "x", "x", STEP, ORIGIN)
    device.update_environment(START, CELL.environment(0.0))
    readings = []
    for tick, x in enumerate((0.0, 0.01, 0.0, 0.01, 0.01, 0.0)):
        time = START + tick * 10 * MS
        device.update_position(time, (x, 0.0, 0.0))
        if tick != 0:
            readings += device.poll(time)
    found = [r.compensated_displacement for r in readings]
    assert found == pytest.approx([0.0, 0.01, 0.0, 0.01, 0.01, 0.0], abs=1e-5)


def test_the_same_setup_again_changes_nothing_while_its_zero_holds():
    device = laser()
    device.align(START, "x", "x", STEP, ORIGIN)
    feed(device, START + 3 * SECOND, stepping)
    first = device.poll(START + 2 * SECOND)[-1]
    device.align(START + 2 * SECOND, "x", "x", STEP, ORIGIN)
    last = device.poll(START + 3 * SECOND)[-1]
    assert last.compensated_displacement == pytest.approx(first.compensated_displacement, abs=1e-6)
    assert first.compensated_displacement == pytest.approx(0.01, abs=1e-5)


def test_a_broken_beam_loses_the_zero_until_it_is_aligned_again():
    device = laser()
    device.align(START, "x", "x", STEP, ORIGIN)
    device.inject_beam_break(START + SECOND, START + 1200 * MS)
    feed(device, START + 5 * SECOND, ORIGIN)
    readings = device.poll(START + 2 * SECOND)
    for reading in readings:
        seconds = (reading.time - START) / SECOND
        broken = 1.0 <= seconds < 1.2
        assert reading.status == (2 if seconds >= 1.0 else 0)
        assert reading.signal_strength == (0.0 if broken else 1.0)
        assert math.isnan(reading.raw_displacement) == broken
        assert math.isnan(reading.compensated_displacement) == broken
    device.align(START + 2 * SECOND + 1, "x", "x", STEP, ORIGIN)
    readings = device.poll(START + 3 * SECOND)
    assert {r.status for r in readings} == {0}
    assert readings[0].raw_displacement == 0.0


def test_a_mirror_that_is_too_fast_loses_the_zero():
    device = laser(fastest_m_per_s=0.015)
    device.align(START, "x", "x", STEP, ORIGIN)
    feed(device, START + 2 * SECOND, stepping)
    statuses = [r.status for r in device.poll(START + 2 * SECOND)]
    assert statuses == [0] * 101 + [3] * 100
    slow = laser(fastest_m_per_s=0.025)
    slow.align(START, "x", "x", STEP, ORIGIN)
    feed(slow, START + 2 * SECOND, stepping)
    assert {r.status for r in slow.poll(START + 2 * SECOND)} == {0}


def test_weather_that_stops_or_is_impossible_leaves_the_air_unknown():
    device = laser(weather_age_s=2.0)
    device.align(START, "x", "x", STEP, ORIGIN)
    station = weather()
    station.inject_silence(START + 2 * SECOND)
    feed(device, START + 5 * SECOND, ORIGIN, station)
    readings = device.poll(START + 5 * SECOND)
    for reading in readings:
        unknown = reading.time > START + 3 * SECOND
        assert math.isnan(reading.compensated_displacement) == unknown
        assert math.isnan(reading.environment.air_temperature) == unknown
        assert math.isfinite(reading.raw_displacement)
    device.update_environment(START + 5 * SECOND, Environment(20.0, 101325.0, 50.0, 20.0))
    device.update_position(START + 6 * SECOND, ORIGIN)
    later = device.poll(START + 6 * SECOND)
    assert all(math.isnan(r.compensated_displacement) for r in later)
    assert later[-1].environment.relative_humidity == 50.0


def test_air_that_becomes_known_after_the_zero_still_serves():
    device = laser()
    device.align(START, "x", "x", STEP, ORIGIN)
    for time in range(START, START + 3 * SECOND, 5 * MS):
        device.update_position(time, stepping((time - START) * 1e-9))
    device.update_environment(START + SECOND // 2, CELL.environment(0.5))
    readings = device.poll(START + 3 * SECOND)
    assert math.isnan(readings[49].compensated_displacement)
    assert readings[51].compensated_displacement == pytest.approx(0.0, abs=3e-7)
    assert readings[-1].compensated_displacement == pytest.approx(0.01, abs=1e-5)


def test_settings_are_checked():
    with refused(Refusal, "out_of_range", "0", about="rate_hz"):
        laser(rate_hz=0)
    with refused(Refusal, "unknown", "rate_hz", about="rate"):
        laser(rate=10)
    with refused(Refusal, "missing"):
        prepare("interferometer", "simulated", {}, Surroundings())


def test_the_compensation_takes_the_equation_that_it_is_told():
    hot = replace(CELL, weather=WeatherModel(air_temperature=48.0, relative_humidity=0.9))
    found = {}
    for equation in ("edlen", "ciddor"):
        device = laser(hot, index_equation=equation)
        device.align(START, "x", "x", STEP, ORIGIN)
        feed(device, START + 2 * SECOND, stepping, weather(hot))
        found[equation] = device.poll(START + 2 * SECOND)[-1]
    assert found["edlen"].raw_displacement == found["ciddor"].raw_displacement
    ratio = found["ciddor"].compensated_displacement / found["edlen"].compensated_displacement
    indices = [index_of(found["edlen"].environment, equation=name) for name in found]
    assert ratio - 1.0 == pytest.approx(indices[0] / indices[1] - 1.0, abs=1e-12)
    assert abs(ratio - 1.0) > 1e-8
    with refused(Refusal, "unknown", "owens", about="index_equation"):
        laser(index_equation="owens")
