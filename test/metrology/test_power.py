"""How small a gap a diagnosis would show is said before there is one, and it shows one so large."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag_ros.configuration import load_cell, plan_from_text
from stepdiag_ros.metrology.discrepancy.findings import CONSISTENT_LEVEL
from stepdiag_ros.metrology.discrepancy.power import POWER, noncentrality, power_of
from stepdiag_ros.metrology.simulation import simulate

PLAN = """\
name: small box
step_m: [0.03, 0.02, 0.025]
blocks: 4
repeats: {repeats}
directions: [forward, backward]
feed_m_per_s: 0.05
lines:
  - {{kind: linear, names: [x, y, z]}}
  - {{kind: step_diagonal, names: [ppp, npp, pnp, ppn], orders: [XYZ]}}
"""


def measured(repeats, noise=1.0):
    plan = plan_from_text(PLAN.format(repeats=repeats), "plan")
    cell = load_cell("demo")[0]
    return simulate(plan, replace(cell, reading_noise=noise * cell.reading_noise), seed=3)


@pytest.mark.parametrize(("freedom", "noise_freedom"), [(5.0, 40.0), (80.0, 60.0)])
def test_a_test_with_that_noncentrality_is_significant_as_often_as_it_is_said(
    freedom, noise_freedom
):
    rng = np.random.default_rng(1)
    count = 20_000
    strength = noncentrality(freedom, noise_freedom)
    below = rng.chisquare(noise_freedom, count) / noise_freedom
    ratio = rng.noncentral_chisquare(freedom, strength, count) / freedom / below
    nothing = rng.chisquare(freedom, count) / freedom / below
    level = np.quantile(nothing, 1.0 - CONSISTENT_LEVEL)
    assert np.mean(ratio > level) == pytest.approx(POWER, abs=0.02)


def test_more_repeats_show_a_smaller_gap():
    gaps = [power_of(measured(repeats)).gap for repeats in (2, 4, 8)]
    assert 0.0 < gaps[2] < gaps[1] < gaps[0] < 1e-6


def test_lines_that_cannot_contradict_the_model_have_no_power():
    once = measured(1)
    alone = replace(once, lines=once.lines[:1])
    assert np.isnan(power_of(alone).gap) and power_of(alone).why
