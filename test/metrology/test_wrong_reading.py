"""One wrong reading is found with its size, and no effect of the machine is mistaken for one."""

import numpy as np
import pytest
from hidden_runs import NOISE, hidden_run, with_change

from stepdiag_ros.metrology.discrepancy import CONSISTENT, NAMED, diagnose
from stepdiag_ros.metrology.discrepancy.findings import UNEXPLAINED
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
    line = run.lines[stops.pass_index[row]].line
    return with_change(run, added), f"stop {stops.number[row]} of {line}"


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("size", [-100.0, 45.0, 900.0], ids=["-10 µm", "4.5 µm", "90 µm"])
def test_a_wrong_reading_is_named_with_its_size(seed, size):
    plain = hidden_run(seed=seed, **SETTINGS)
    row = int(np.random.default_rng(seed).integers(1, len(stops_of(plain).time) - 1))
    run, which = spiked(plain, row, size * NOISE)
    found = diagnose(run)
    assert (found.verdict, found.wrong_reading) == (UNEXPLAINED, which)
    assert not found.findings and not found.partial and found.description is None
    left = found.residual_before[row] - found.residual_after[row]
    assert np.isnan(left) and np.isnan(found.residual_after[row])
    assert found.noise == pytest.approx(NOISE, rel=0.3)
    assert found.lack_of_fit_p_after > 0.002 > found.lack_of_fit_p_before
    # The picture of the gap is that of the whole run.
    assert max(one.rms for one in found.map) > 3.0 * found.noise
    (advice,) = next_sentences(found)
    assert which in advice


def test_runs_with_nothing_or_with_an_effect_name_no_reading():
    backlash = ActiveEffect(catalogue()["backlash"], {"axis": "X"}, {"lost_motion": 2e-6})
    for seed in range(3):
        plain, with_effect = (hidden_run(*one, seed=seed, **SETTINGS) for one in ((), (backlash,)))
        assert (diagnose(plain).verdict, diagnose(plain).wrong_reading) == (CONSISTENT, "")
        found = diagnose(with_effect)
        assert (found.verdict, found.wrong_reading) == (NAMED, "")


def test_a_machine_that_is_off_at_one_place_in_every_pass_is_not_a_wrong_reading():
    def dent(stops):
        line = stops.lines[stops.pass_index[40]]
        same = [one.name == line.name for one in stops.lines]
        at = np.all(np.isclose(stops.position, stops.position[40]), axis=1)
        return 5e-6 * (at & np.array(same)[stops.pass_index])

    run = hidden_run(seed=1, shape=dent, **SETTINGS)
    assert diagnose(run).wrong_reading == ""


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
    assert diagnose(run).wrong_reading == ""
