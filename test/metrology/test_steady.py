"""Readings freed of noise by their repeats, and what that spares the workflow."""

import numpy as np
import pytest
from standard_runs import cell

from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.metrology.discrepancy.diagnose import diagnose
from stepdiag_ros.metrology.discrepancy.findings import CONSISTENT
from stepdiag_ros.metrology.discrepancy.steady import _without_noise, steadied
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.simulation import simulate

NOISE = 20e-9
PLAN = """\
name: many repeats
step_m: [0.03, 0.02, 0.025]
blocks: 5
repeats: {repeats}
directions: [forward, backward]
feed_m_per_s: 0.05
lines:
  - {{kind: linear, names: [x, y, z]}}
  - {{kind: step_diagonal, names: [ppp, npp, pnp, ppn]}}
"""


def run_of(seed, repeats=12, noise=NOISE):
    plan = plan_from_text(PLAN.format(repeats=repeats), "test plan")
    return simulate(plan, cell(noise=noise, tilt=0.0, seed=7), seed=seed)


def test_offset_and_slope_of_a_pass_stay_and_noise_goes():
    rng = np.random.default_rng(1)
    common = np.cumsum(rng.uniform(5e-3, 2e-2, 8))
    truth = common + np.array([[0.0], [3e-7], [-2e-7]]) + np.array([[0.0], [2e-6], [1e-6]]) * common
    noisy = truth + NOISE * rng.standard_normal(truth.shape)
    noisy[1, 3] = np.nan
    steady = _without_noise(noisy)
    assert np.isnan(steady[1, 3])
    known = np.isfinite(noisy)
    left = (steady - truth)[known]
    assert np.sqrt(np.mean(left**2)) < 0.8 * np.sqrt(np.mean((noisy - truth)[known] ** 2))
    # What has no noise stays as it is.
    np.testing.assert_allclose(_without_noise(truth), truth, atol=1e-12)


def test_readings_without_repeats_stay_as_they_are():
    stops = stops_of(run_of(1, repeats=1))
    np.testing.assert_array_equal(steadied(stops).displacement, stops.displacement)


def test_repeats_take_the_noise_from_readings():
    stops = stops_of(run_of(1))

    def noise(readings):
        """Return the scatter about what is exact, less the zero of each setup."""
        off = readings - stops_of(run_of(1, noise=0.0)).displacement
        zero = [np.mean(off[stops.setup == one]) for one in range(len(stops.setups))]
        return np.std(off - np.array(zero)[stops.setup])

    assert noise(stops.displacement) == pytest.approx(NOISE, rel=0.1)
    assert noise(steadied(stops).displacement) < 0.5 * NOISE


@pytest.mark.parametrize("seed", [3, 4, 12, 15])
def test_many_repeats_make_no_effect_of_noise(seed):
    """A phase with the reading's own noise named nonlinearities in every second of such runs."""
    nonlinearity = [one for name, one in catalogue().items() if "nonlinearity" in name]
    assert diagnose(run_of(seed), catalogue=nonlinearity).verdict == CONSISTENT
