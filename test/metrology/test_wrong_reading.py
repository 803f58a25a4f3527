"""Wrong readings are found with their sizes, and no effect of the machine is mistaken for one."""

import numpy as np
import pytest
from hidden_runs import NOISE, hidden_run, with_change

from stepdiag_ros.metrology.discrepancy import CONSISTENT, NAMED, diagnose
from stepdiag_ros.metrology.discrepancy.findings import UNEXPLAINED
from stepdiag_ros.metrology.discrepancy.wrong_reading import WrongReading
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.words.next_measurement import next_sentences

SETTINGS = {"repeats": 1, "orders": ("XYZ",)}
"""As someone measures who notes readings by hand: one pass in each direction."""


def spiked(run, row, size):
    """Return a run in which one reading is off, and which stop that is."""
    stops = stops_of(run)
    added = np.zeros(len(stops.time))
    added[row] = size
    wrong = WrongReading(int(stops.pass_index[row]), int(stops.number[row]), size)
    return with_change(run, added), wrong.words(run)


def test_a_reading_is_named_by_pass_stop_and_place():
    run = hidden_run(**SETTINGS)
    number = next(at for at, one in enumerate(run.lines) if one.line.name == "z")
    words = WrongReading(number, 3, 1e-6).words(run)
    assert words == f"stop 3 of {run.lines[number].line} (X 0, Y 0, Z 30 mm)"


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("size", [-100.0, 45.0, 900.0], ids=["-10 µm", "4.5 µm", "90 µm"])
def test_a_wrong_reading_is_named_with_its_size(seed, size):
    plain = hidden_run(seed=seed, **SETTINGS)
    row = int(np.random.default_rng(seed).integers(1, len(stops_of(plain).time) - 1))
    run, which = spiked(plain, row, size * NOISE)
    found = diagnose(run)
    assert (found.verdict, found.wrong_readings) == (UNEXPLAINED, (which,))
    assert not found.findings and not found.partial and found.description is None
    left = found.residual_before[row] - found.residual_after[row]
    assert np.isnan(left) and np.isnan(found.residual_after[row])
    assert found.noise == pytest.approx(NOISE, rel=0.3)
    assert found.lack_of_fit_p_after > 0.002 > found.lack_of_fit_p_before
    # The picture of the gap is that of the whole run.
    assert max(one.rms for one in found.map) > 3.0 * found.noise
    (advice,) = next_sentences(found)
    assert which in advice


def several_wrong(seed, count):
    """Return a run with some wrong readings, of different passes, and which stops these are.

    At another place each: where both passes are wrong, nothing tells which value is right.
    """
    run, which, taken = hidden_run(seed=seed, **SETTINGS), set(), set()
    stops, random = stops_of(run), np.random.default_rng(seed)
    for number in random.choice(len(run.lines), count, replace=False):
        rows = np.flatnonzero(stops.pass_index == number)
        places = {row: tuple(np.round(stops.position[row], 6)) for row in rows[1:]}
        row = int(random.choice([row for row in places if places[row] not in taken]))
        taken.add(places[row])
        size = random.choice([-1.0, 1.0]) * random.choice([3e-6, 10e-6, 90e-6])
        run, one = spiked(run, row, size)
        which.add(one)
    return run, which


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("count", [2, 3, 6])
def test_a_few_wrong_readings_are_named_together(seed, count):
    run, which = several_wrong(seed, count)
    found = diagnose(run)
    assert (found.verdict, set(found.wrong_readings)) == (UNEXPLAINED, which)
    assert found.lack_of_fit_p_after > 0.002
    (advice,) = next_sentences(found)
    assert all(one in advice for one in which)


@pytest.mark.parametrize("seed", range(3))
def test_more_wrong_readings_than_slips_make_are_not_called_slips(seed):
    assert diagnose(several_wrong(seed, 14)[0]).wrong_readings == ()


@pytest.mark.parametrize("seed", range(3))
def test_two_stops_in_a_row_are_not_called_slips(seed):
    plain = hidden_run(seed=seed, **SETTINGS)
    row = int(np.flatnonzero(np.diff(stops_of(plain).pass_index))[4]) - 1
    run = spiked(spiked(plain, row, 5e-6)[0], row + 1, 5e-6)[0]
    assert diagnose(run).wrong_readings == ()


def test_runs_with_nothing_or_with_an_effect_name_no_reading():
    backlash = ActiveEffect(catalogue()["backlash"], {"axis": "X"}, {"lost_motion": 2e-6})
    for seed in range(3):
        plain, with_effect = (hidden_run(*one, seed=seed, **SETTINGS) for one in ((), (backlash,)))
        assert (diagnose(plain).verdict, diagnose(plain).wrong_readings) == (CONSISTENT, ())
        found = diagnose(with_effect)
        assert (found.verdict, found.wrong_readings) == (NAMED, ())


def test_a_machine_that_is_off_at_one_place_in_every_pass_is_not_a_wrong_reading():
    def dent(stops):
        line = stops.lines[stops.pass_index[40]]
        same = [one.name == line.name for one in stops.lines]
        at = np.all(np.isclose(stops.position, stops.position[40]), axis=1)
        return 5e-6 * (at & np.array(same)[stops.pass_index])

    run = hidden_run(seed=1, shape=dent, **SETTINGS)
    assert diagnose(run).wrong_readings == ()


def test_a_reading_that_no_other_pass_repeats_is_not_suspected():
    plain = hidden_run(seed=2, repeats=2, orders=("XYZ",), directions=("forward",))
    once = tuple(line for line in plain.lines if line.line.name != "ppp" or line.line.repeat == 0)
    alone = type(plain)(**{**vars(plain), "lines": once})
    stops = stops_of(alone)
    row = next(
        place
        for place, one in enumerate(stops.pass_index)
        if stops.lines[one].name == "ppp" and stops.number[place] == 9
    )
    run, _ = spiked(alone, row, 8e-6)
    assert diagnose(run).wrong_readings == ()


def loose_flange(stops):
    """Return a change that no effect of the catalogue makes: the middle of each diagonal sags."""
    middle = np.all(np.abs(stops.share - 0.5) < 0.3, axis=1)
    return 40.0 * NOISE * (middle & (stops.number % 3 == 0))


def test_a_reading_that_is_off_by_far_is_wrong_whatever_else_the_run_shows():
    plain = hidden_run(shape=loose_flange, **SETTINGS)
    before = diagnose(plain)
    assert before.verdict not in (CONSISTENT, NAMED)
    assert not before.wrong_readings
    row = len(stops_of(plain).time) // 2
    run, which = spiked(plain, row, 5000.0 * NOISE)
    found = diagnose(run)
    assert found.verdict == UNEXPLAINED and found.wrong_readings == (which,)
