"""Runs of one machine over months: each with its own curves, noise and alignments."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from hidden_runs import with_change

from stepdiag_ros.metrology.discrepancy import diagnose
from stepdiag_ros.metrology.discrepancy.course import CHANGES, COMES_AND_GOES, GROWS, IN_ALL
from stepdiag_ros.metrology.discrepancy.history import DiagnosedRun, histories_of
from stepdiag_ros.metrology.effects.backlash import EFFECT as BACKLASH
from stepdiag_ros.metrology.effects.cosine_error import EFFECT as COSINE
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.servo_lag import EFFECT as LAG
from stepdiag_ros.metrology.effects.settling import EFFECT as SETTLING
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.effects.trigger_delay import EFFECT as DELAY
from stepdiag_ros.metrology.model import MachineModel
from stepdiag_ros.metrology.simulation import simulate

PLAN = make_plan(blocks=4, repeats=2, directions=("forward", "backward"))
CATALOGUE = (BACKLASH, COSINE, SETTLING)


def acting(effect, size, **setting):
    return ActiveEffect(effect, setting, {effect.sizes[0].name: size})


def month_of(month, *effects, noise=0.05e-6, catalogue=CATALOGUE, shape=None):
    """A run of a machine whose curves, alignments and zeros are others every month."""
    cell = make_cell(seed=50 + month, high=(0.04, 0.04, 0.04), noise=noise, size=3e-6)
    run = simulate(PLAN, replace(cell, effects=effects), seed=50 + month)
    if shape is not None:
        run = with_change(run, shape(stops_of(run)))
    return DiagnosedRun(run, float(month), diagnose(run, catalogue=catalogue))


def followed(runs, catalogue=CATALOGUE):
    return {one.label: one for one in histories_of(runs, MachineModel(), catalogue)}


@pytest.fixture(scope="module")
def four():
    """Settling of X stays, backlash of Y grows, and one alignment of the third run is off."""
    return followed(
        [
            month_of(
                month,
                acting(SETTLING, 0.4e-6, axis="X"),
                acting(BACKLASH, 0.2e-6 * month, axis="Y"),
                *([acting(COSINE, 30e-6, setup="ppp XYZ")] if month == 2 else []),
                noise=(0.05e-6, 0.1e-6, 0.05e-6, 0.03e-6)[month],
            )
            for month in range(4)
        ]
    )


def test_what_stays_what_grows_and_what_comes_and_goes(four):
    kinds = {one.candidates[0].effect.name: one.course.kind for one in four.values()}
    assert kinds == {"settling": IN_ALL, "backlash": GROWS, "cosine error": COMES_AND_GOES}
    low, high = four["settling of X"].course.common.band
    assert low < 0.4e-6 < high < 0.5e-6
    low, high = four["backlash of Y"].course.rate.band
    assert low < 0.2e-6 < high < 0.3e-6
    (once,) = (one for label, one in four.items() if label.startswith("cosine"))
    assert "cosine error of ppp XYZ" in {once.label, *once.rivals}
    assert once.course.having == once.named_in == (2,)
    assert set(once.course.lacking) == {0, 1, 3}
    assert np.isnan(once.course.rate.value)


def test_each_run_has_the_band_of_its_own_noise(four):
    noisy = [one.standard_uncertainty for one in four["settling of X"].course.sizes]
    assert noisy[1] > 1.4 * noisy[0] > 1.4 * noisy[3]
    for one in four["settling of X"].course.sizes:
        assert abs(one.value - 0.4e-6) < 4.0 * one.standard_uncertainty


def test_an_effect_is_followed_where_its_run_does_not_name_it(four):
    growing = four["backlash of Y"]
    assert 0 not in growing.named_in and 3 in growing.named_in
    first = growing.course.sizes[0]
    assert abs(first.value) < 4.0 * first.standard_uncertainty


def test_other_curves_every_month_are_no_effect():
    assert followed([month_of(month) for month in range(3)]) == {}


def test_two_runs_show_that_something_changed_but_not_how():
    runs = [month_of(0), month_of(1, acting(BACKLASH, 0.5e-6, axis="Z"))]
    assert followed(runs)["backlash of Z"].course.kind == CHANGES


def test_what_no_run_distinguishes_stays_one_group():
    """Servo lag and trigger delay do the same at one feed."""
    both = (DELAY, LAG)
    runs = [month_of(month, acting(LAG, 0.4e-6), catalogue=both) for month in range(3)]
    (one,) = histories_of(runs, MachineModel(), both)
    assert {one.label, *one.rivals} == {"servo lag", "position-trigger delay"}
    assert one.course.kind == IN_ALL
    assert one.named_in == (0, 1, 2)


def test_a_gap_without_a_name_is_followed_by_its_formula():
    def bend(stops):
        x, z = stops.share[:, 0], stops.share[:, 2]
        return 3e-6 * stops.direction[:, 1] * np.maximum(2.0 * x - 1.0, 0.0) * z

    runs = [month_of(month, shape=bend if month != 1 else None) for month in range(3)]
    assert {one.diagnosis.verdict for one in runs} == {"DESCRIBED", "CONSISTENT"}
    (one,) = followed(runs).values()
    assert "the places of" in one.label or "the place of" in one.label
    assert one.figure.unit == "m" and all(each.effect.learned for each in one.candidates)
    assert one.course.having == (0, 2)
    assert one.course.kind == COMES_AND_GOES
