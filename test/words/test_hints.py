"""Hints: what in a machine has the shape of a gap that has no name."""

import pytest

from stepdiag_ros.metrology.discrepancy.findings import Dependence
from stepdiag_ros.words.hints import hints


def of(acts_on, *drivers):
    return Dependence(acts_on, drivers, ("x^1",), 1.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("dependence", "word"),
    [
        (of("Y", "the place of X", "the place of Z"), "bends under a load"),
        (of("Z", "the place of X", "the sense of Z's last move"), "backlash"),
        (of("Y", "the sense of Y's last move"), "backlash"),
        (of("X", "the sense of X's last move", "the sense of Y's last move"), "backlash"),
        (of("Z", "the place of X", "the sense of Y's last move"), "drag chain"),
        (of("Z", "the sense of Y's last move"), "drag chain"),
        (of("reading", "the sense of Y's last move"), "measuring system"),
        (of("X", "the time since X turned round"), "creeps"),
        (of("X", "time, periodically"), "cooler"),
        (of("Y", "the place of X", "the material temperature"), "warms up"),
        (of("reading", "time"), "drift"),
        (of("reading", "time, between two jumps"), "loose"),
        (of("reading", "the line", "the length of the beam's path"), "warmer"),
        (of("X", "the place of X, periodically", "the place of Y"), "within its period"),
        (of("E_CX", "the place of X", "the material temperature"), "warms up"),
        (of("E_AX", "the place of X", "time"), "away from every sensor"),
        (of("reading", "the place of X", "the place of Y"), "refractive index"),
    ],
)
def test_each_kind_of_dependence_has_its_hint(dependence, word):
    (hint,) = hints(dependence)
    assert word in hint


def test_nothing_is_said_of_what_nothing_is_known():
    assert hints(of("X", "the phase of the moon")) == []
