"""Rests are found at any rate, and in spite of noise, lag, vibration, drift, display and spikes."""

from math import nan

import numpy as np
import pytest

from stepdiag_ros.configuration import load_plan
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.metrology.stillness import Criteria, StillnessDetector, smallest_step

STEP = 0.01
MOVE, DWELL = 0.4, 2.0
CRITERIA = Criteria(band=5e-4, shortest=0.3, kept=2.4, fastest=0.033)


def stream(rate, noise=1e-7, lag=0.02, seed=0, stops=6, feed=None, **also):
    """Readings of moves of 0.4 s between stops of 2 s, and when each stop begins and ends, s."""
    rng = np.random.default_rng(seed)
    move = MOVE if feed is None else STEP / feed
    times = np.arange(0.0, stops * DWELL + (stops - 1) * move, 1.0 / rate)
    number, since = np.divmod(times, DWELL + move)
    part = np.clip((since - DWELL) / move, 0.0, 1.0)
    command = STEP * (number + part)
    # A move at constant feed leaves a lag that dies away exponentially at the stop.
    came = np.where(number > 0, STEP / move * lag * np.exp(-since / lag), 0.0)
    values = command - np.where(part > 0.0, 0.0, came) + noise * rng.standard_normal(len(times))
    values = values + also.get("drift", 0.0) * times
    values = values + also.get("vibration", 0.0) * np.sin(2.0 * np.pi * 37.0 * times)
    if also.get("quantum"):
        values = np.round(values / also["quantum"]) * also["quantum"]
    begins = [n * (DWELL + move) for n in range(stops)]
    return times, values, [(begin, begin + DWELL) for begin in begins]


def readings_of(times, values, status=None):
    return [
        Reading(round(time * 1e9), n, nan, value, nan, status[n] if status else 0, Environment())
        for n, (time, value) in enumerate(zip(times.tolist(), values.tolist(), strict=True))
    ]


def rests_of(readings, criteria=CRITERIA):
    detector = StillnessDetector(criteria)
    found = [rest for reading in readings for rest in detector.add(reading)]
    return found + detector.finish()


KINDS = {
    "plain": {},
    "noisy": {"noise": 5e-6},
    "no noise at all": {"noise": 0.0},
    "display of 0.1 µm": {"quantum": 1e-7},
    "coarse display": {"quantum": 1e-6, "noise": 0.0},
    "slow drive": {"lag": 0.06},
    "drift": {"drift": 2e-7},
    "vibration": {"vibration": 2e-6},
}


@pytest.mark.parametrize("rate", [2.0, 5.0, 10.0, 50.0, 1000.0])
@pytest.mark.parametrize("kind", KINDS)
def test_every_stop_is_one_rest_that_begins_and_ends_with_it(rate, kind):
    times, values, stops = stream(rate, **KINDS[kind])
    rests = rests_of(readings_of(times, values))
    assert len(rests) == len(stops)
    lag = KINDS[kind].get("lag", 0.02)
    for number, (rest, (begin, end)) in enumerate(zip(rests, stops, strict=True)):
        start, left = rest.start * 1e-9, rest.end * 1e-9
        # What still settles by more than the noise is no part of it; 15 lags are enough for that.
        assert begin - 0.01 <= start <= begin + 15.0 * lag + 2.0 / rate
        assert end - 2.0 / rate - 0.02 <= left <= end + 0.02
        assert rest.arrived == pytest.approx(STEP * number, abs=2e-5)
        assert rest.zero == 0


def test_the_noise_of_a_rest_is_that_of_its_readings():
    times, values, _ = stream(1000.0, noise=3e-7)
    assert [rest.noise for rest in rests_of(readings_of(times, values))] == pytest.approx(
        [3e-7] * 6, rel=0.15
    )


def test_a_slow_move_is_no_rest():
    """At half the feed of the plan nothing that moves stays within the band for so long."""
    plan = load_plan("quick")[0]
    criteria = Criteria.of_plan(plan)
    times = np.arange(0.0, 5.0, 0.01)
    slowest = 0.5 * plan.feed / np.sqrt(3.0)
    assert rests_of(readings_of(times, slowest * times), criteria) == []
    assert len(rests_of(readings_of(times, 0.0 * times), criteria)) == 1


def test_the_smallest_step_of_a_plan_is_along_its_beam():
    assert smallest_step(load_plan("quick")[0]) == pytest.approx(0.01 / np.sqrt(3.0))


@pytest.mark.parametrize("spikes", [[300], [300, 301], [10, 150, 330, 331]])
def test_spikes_of_the_instrument_do_not_divide_a_rest(spikes):
    times, values, stops = stream(100.0)
    values[spikes] += 3e-3
    rests = rests_of(readings_of(times, values))
    assert len(rests) == len(stops)


def test_a_lost_beam_ends_a_rest_and_loses_the_zero():
    times, values, _ = stream(100.0)
    status = [2 if 5.6 < time < 5.9 else 0 for time in times.tolist()]
    rests = rests_of(readings_of(times, values, status))
    assert [rest.zero for rest in rests] == [0, 0, 0, 1, 1, 1, 1]
    assert rests[2].end < 5.61e9 < 5.89e9 < rests[3].start


def test_a_jump_that_no_move_can_make_loses_the_zero():
    times, values, _ = stream(100.0)
    values[times > 5.5] += 0.02
    assert [rest.zero for rest in rests_of(readings_of(times, values))] == [0, 0, 0, 1, 1, 1, 1]
    # The same change at the feed is a move.
    times, values, _ = stream(100.0)
    values = values + np.clip((times - 5.0) * 0.03, 0.0, 0.006)
    assert {rest.zero for rest in rests_of(readings_of(times, values))} == {0}


def test_an_instrument_that_was_started_again_has_another_zero():
    times, values, _ = stream(100.0)
    readings = [
        reading if reading.time < 5e9 else reading._replace(sequence=reading.sequence - 400)
        for reading in readings_of(times, values)
    ]
    assert {rest.zero for rest in rests_of(readings)} == {0, 1}


def test_what_goes_on_is_known_before_it_ends():
    times, values, _ = stream(100.0)
    detector = StillnessDetector(CRITERIA)
    for reading in readings_of(times, values):
        detector.add(reading)
        if reading.time == 3_900_000_000:
            break
    rest = detector.present
    assert rest is not None
    assert rest.arrived == pytest.approx(STEP, abs=1e-6)
    assert rest.end == 3_900_000_000
