"""Which known name somebody meant."""

import pytest

from stepdiag_ros.metrology.spelling import nearest


@pytest.mark.parametrize(
    ("typed", "known", "meant"),
    [
        ("measurment", ["info", "measurement"], "measurement"),
        ("ros2control", ["opcua", "ros2_control"], "ros2_control"),
        ("pause", ["pause_s", "plan"], "pause_s"),
        ("demp", ["moving", "demo"], "demo"),
        # Nobody who types this means a cell that moves.
        ("nothing", ["moving", "demo"], ""),
        ("", ["demo"], ""),
        (12, ["demo"], ""),
    ],
)
def test_a_name_that_is_near_is_meant_and_no_other(typed, known, meant):
    assert nearest(typed, known) == meant
