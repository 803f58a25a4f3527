"""What is sent to a controller is one block of a straight move, whatever it was asked for."""

import re

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from refused import refused

from stepdiag_ros.devices.cnc import MoveRefused, grbl_move, linuxcncrsh
from stepdiag_ros.devices.cnc.move_check import check_target

LIMITS = (-2.0, -2.0, -2.0), (2.0, 2.0, 2.0)
NUMBERS = st.one_of(st.floats(), st.floats(-2.5, 2.5))
AXES = st.one_of(
    st.text(max_size=8), st.text("XYZ", max_size=4), st.sampled_from(["X\nM3", "X;G0"])
)
NUMBER = r"-?[0-9]{1,6}(\.[0-9]{1,7})?"


@given(st.tuples(NUMBERS, NUMBERS, NUMBERS), NUMBERS, AXES)
@example((0.1, 0.0, 0.0), 0.01, "X Y")
@example((0.1, 0.0, 0.0), 0.01, "XX")
@example((0.1, 0.0, 0.0), 0.01, "X\u2028M30")
@example((1e-300, -0.0, -1e-9), 1e-4, "XYZ")
@example((0.1, float("nan"), 0.0), 0.01, "X")
@example((0.1, 0.0, 0.0), float("inf"), "X")
def test_a_move_is_one_block_or_refused(target, feed, axes):
    try:
        check_target(
            (0.0, 0.0, 0.0), target, feed, axes, limits=LIMITS, feed_limit=0.5, near=(1e-6,) * 3
        )
    except MoveRefused as refused:
        assert str(refused).isprintable()
        return
    grbl = grbl_move.line_of_move(target, feed, axes)
    assert re.fullmatch(rf"G90G94G21G53G1([XYZ]{NUMBER}){{{len(axes)}}}F{NUMBER}", grbl)
    mdi = linuxcncrsh.line_of_move(target, feed)
    assert re.fullmatch(rf"G21 G90 G94 G53 G1 X{NUMBER} Y{NUMBER} Z{NUMBER} F{NUMBER}", mdi)


@pytest.mark.parametrize("axes", ["x", "A", "XYX", "X Y", "X\nM30", "XYZ\r$X"])
def test_axes_that_are_none_are_refused(axes):
    with refused(MoveRefused, "malformed", aspect="axes"):
        check_target(
            *((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.01, axes),
            limits=LIMITS,
            feed_limit=0.5,
            near=(1e-6,) * 3,
        )
