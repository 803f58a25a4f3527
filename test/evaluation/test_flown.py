"""Delays of lines on the fly by the sense of the motion."""

import numpy as np
import pytest

from stepdiag_ros.evaluation.flown import reversals_of
from stepdiag_ros.metrology.on_the_fly.flight import FlownLine
from stepdiag_ros.metrology.on_the_fly.record import AxisDelay, MovingPass
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD, LINEAR, STEP_DIAGONAL, Line, Volume

VOLUME = Volume((0.0, 0.0, 0.0), (0.01, 0.01, 0.01), 3)
U = 2e-6


def flown(line, **delays):
    nodes = len(line.stops(VOLUME))
    found = MovingPass(
        np.zeros(nodes),
        np.eye(nodes),
        ("",) * nodes,
        (),
        delays=tuple(AxisDelay(axis, delay, U) for axis, delay in delays.items()),
    )
    return FlownLine(line, 1, 10.0, found)


def test_a_force_with_the_sign_of_the_motion_shows_as_a_difference():
    friction, clocks = 15e-6, 300e-6
    forth, back = clocks + friction, clocks - friction
    lines = [
        flown(Line(LINEAR, "x", "", 0, FORWARD), X=forth),
        flown(Line(LINEAR, "x", "", 0, BACKWARD), X=back),
        flown(Line(LINEAR, "z", "", 0, FORWARD), Z=clocks),
        # Forward along this diagonal, X moves in its negative sense.
        flown(Line(STEP_DIAGONAL, "npp", "XYZ", 0, FORWARD), X=back, Y=clocks),
        flown(Line(STEP_DIAGONAL, "npp", "XYZ", 0, BACKWARD), X=forth, Y=clocks),
    ]
    found = {one.axis: one for one in reversals_of(lines, VOLUME)}
    assert found.keys() == {"X", "Y"}
    assert found["X"].delay == pytest.approx(2.0 * friction)
    assert found["X"].standard_uncertainty == pytest.approx(U)
    assert found["Y"].delay == pytest.approx(0.0, abs=1e-12)
    assert found["Y"].standard_uncertainty == pytest.approx(np.sqrt(2.0) * U)
