"""The frontier of plans: every plan at its duration and uncertainty, the proposed one marked."""

import numpy as np

from stepdiag_ros import plots

PLANS = [(780.0, 2.6e-6), (900.0, 2.0e-6), (5900.0, 1.2e-6)]


def test_plans_stand_at_minutes_and_micrometres_over_a_scale_from_zero():
    figure = plots.frontier(PLANS, PLANS[1], "m")
    (panel,) = figure.axes
    drawn = {line.get_label(): line.get_xydata() for line in panel.lines}
    expected = np.array([[13.0, 2.6], [15.0, 2.0], [5900.0 / 60.0, 1.2]])
    np.testing.assert_allclose(drawn["best plan of its duration"], expected)
    np.testing.assert_allclose(drawn["proposed"], expected[1:2])
    assert panel.get_ylim()[0] == 0.0 and panel.get_yscale() == "linear"
    assert "µm" in panel.get_ylabel()


def test_uncertainties_of_angles_are_in_micrometres_a_metre():
    (panel,) = plots.frontier(PLANS, PLANS[0], "rad").axes
    assert "µm/m" in panel.get_ylabel()
