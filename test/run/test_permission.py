from dataclasses import replace
from math import inf, nan

import pytest

from stepdiag_ros.devices.cnc import Traits
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import (
    BACKWARD,
    DIAGONAL,
    FORWARD,
    LINEAR,
    STEP_DIAGONAL,
    Line,
    Plan,
    Volume,
)
from stepdiag_ros.run.permission import (
    OFF_LINE,
    CommandedMove,
    MotionPermission,
    refusal_of_plan,
    shortcomings,
    too_brisk,
)

PLAN = Plan(
    "all kinds",
    Volume((0.0, 0.0, 0.0), (0.01, 0.02, 0.03), 2),
    (
        Line(LINEAR, "x", "", 0, FORWARD),
        Line(STEP_DIAGONAL, "ppp", "XYZ", 0, FORWARD),
        Line(DIAGONAL, "npp", "", 0, FORWARD),
        Line(DIAGONAL, "pp0", "", 0, BACKWARD, (0.0, 0.0, 0.06)),
    ),
    0.1,
)
START, MIDDLE, END = (0.02, 0.0, 0.0), (0.01, 0.02, 0.03), (0.0, 0.04, 0.06)


MACHINE = Machine("m", "YXZ", (-0.1, -0.1, -0.1), (0.5, 0.4, 0.3), 0.2, 2.0)
WIDE = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))


def permission(plan=PLAN, machine=MACHINE, limits=WIDE, **traits):
    return MotionPermission(plan, machine, limits, Traits(**traits))


def a_move(**changed):
    """Return the move from the first stop of line 1 to the next, with some of it changed."""
    first = CommandedMove(1, True, 1, "X", (0.0, 0.0, 0.0), (0.01, 0.0, 0.0), 0.1)
    return replace(first, **changed)


def travel(axes, position, target, **changed):
    return a_move(at_stop=False, stop=0, axes=axes, position=position, target=target, **changed)


def test_an_axis_that_stands_may_stay_where_a_correction_has_brought_it():
    meant, actual = (0.0, 0.0, 0.0), (0.0, 3e-4, 0.0)
    for place in (meant, actual):
        move = travel("X", meant, (0.01, place[1], 0.0), uncorrected=actual)
        assert permission().refusal(move) == ""
    elsewhere = travel("X", meant, (0.01, 6e-4, 0.0), uncorrected=actual)
    assert "move Y as well" in permission().refusal(elsewhere)


FAR = (0.3, 0.3, 0.25)


@pytest.mark.parametrize(
    "move",
    [
        a_move(),
        a_move(position=(2e-6, -1e-6, 3e-6)),
        a_move(stop=2, axes="Y", position=(0.01, 0.0, 0.0), target=(0.01, 0.02, 0.0)),
        a_move(stop=0, axes="", target=(0.0, 0.0, 0.0)),
        a_move(feed=0.1 * (1 + 1e-12)),
        travel("X", FAR, (0.01, 0.3, 0.25)),
        travel("Y", (0.01, 0.3, 0.25), (0.01, 0.0, 0.25)),
        travel("", FAR, FAR),
        travel("Z", (0.02, 0.04, 0.25), (0.02, 0.04, 0.06)),
        a_move(line_index=2, stop=1, axes="XYZ", position=START, target=MIDDLE),
    ],
)
def test_moves_of_a_run_are_allowed(move):
    assert permission().refusal(move) == ""


@pytest.mark.parametrize(
    ("move", "words"),
    [
        (a_move(line_index=4), "for line 4, but the plan has 4 lines"),
        (a_move(target=(nan, 0.0, 0.0)), "is not a position"),
        (a_move(target=(inf, 0.0, 0.0)), "is not a position"),
        (a_move(position=(nan, 0.0, 0.0)), "not known where the machine stands"),
        (a_move(feed=0.0), "feed 0 m/s"),
        (a_move(feed=-0.1), "feed -0.1 m/s"),
        (a_move(feed=nan), "feed nan m/s"),
        (a_move(feed=inf), "feed inf m/s"),
        (a_move(feed=0.1001), "above the feed of the plan, 0.1 m/s"),
        (a_move(position=(0.0, 2e-4, 0.0)), "would move Y as well, but was asked for as one of X"),
        (a_move(axes=""), "would move X as well, but was asked for as one of none"),
        (a_move(axes="Y"), "would move X as well"),
        (a_move(stop=99), "for stop 99, but line 'ppp XYZ forward, repeat 0' has 7 stops"),
        (a_move(stop=3), "stop 3 of line 'ppp XYZ forward, repeat 0' is at 0.01, 0.02, 0.03 m"),
        (a_move(target=(0.010001, 0.0, 0.0)), "stop 1 of line 'ppp"),
        (a_move(position=(-0.001, 0.0, 0.0)), "begins at X = -0.001 m, outside the plan's box"),
        (a_move(position=(0.021, 0.0, 0.0)), "begins at X = 0.021 m, outside the plan's box"),
        (travel("X", FAR, (0.31, 0.3, 0.25)), "leads to X = 0.31 m, outside the plan's box"),
        (travel("X", FAR, (0.03, 0.3, 0.25)), "leads to X = 0.03 m, outside the plan's box"),
        (travel("X", (0.0, 0.0, 0.0), (-0.01, 0.0, 0.0)), "leads to X = -0.01 m, outside"),
        (travel("XY", FAR, (0.01, 0.02, 0.25)), "only one axis may move at a time"),
        (a_move(axes="XYZ", target=(0.01, 0.0, 0.0)), "only one axis may move at a time"),
    ],
)
def test_any_other_move_is_refused(move, words):
    assert words in permission().refusal(move)


def test_feeds_of_machine_and_controller_are_heeded():
    fast = replace(PLAN, feed=5.0)
    assert "limit of the machine, 0.2 m/s" in permission(fast).refusal(a_move(feed=0.3))
    slow = permission(feed_limit=(nan, nan, 0.05))
    assert "limit of the controller for Z, 0.05 m/s" in slow.refusal(a_move(feed=0.06))
    assert "the plan has no feed" in permission(replace(PLAN, feed=nan)).refusal(a_move())


def test_soft_limits_are_the_narrower_of_machine_file_and_controller():
    narrow = ((-1.0, -1.0, -1.0), (0.009, 1.0, 1.0))
    assert "X = 0.01 m lies beyond" in permission(limits=narrow).refusal(a_move())
    small = replace(MACHINE, travel_high_m=(0.009, 0.4, 0.3))
    assert "-0.1 m to 0.009 m" in permission(machine=small).refusal(a_move())
    untold = ((nan, nan, nan), (nan, nan, nan))
    assert permission(limits=untold).refusal(a_move()) == ""
    assert "X = 0.01 m lies" in permission(machine=small, limits=untold).refusal(a_move())


def test_the_box_holds_the_run_ups():
    low, high = permission(replace(PLAN, overrun=0.004)).box
    assert low[0] == pytest.approx(-0.004) and low[2] < -0.003 and high[1] > 0.043
    low, high = permission().box
    assert tuple(low) == (0.0, 0.0, 0.0) and high == pytest.approx((0.02, 0.04, 0.06))
    edge = travel("X", FAR, (-OFF_LINE, 0.3, 0.25))
    assert permission().refusal(edge) == ""


def test_a_controller_brisker_than_the_machine_is_named():
    assert too_brisk(MACHINE, Traits(acceleration=(2.0, 2.01, nan))) == ""
    assert "accelerates Y with up to 3 m/s²" in too_brisk(
        MACHINE, Traits(acceleration=(2.0, 3.0, 2.0))
    )


def test_what_an_operator_must_know_of_a_controller():
    assert shortcomings(Traits(dead_man=0.3)) == []
    assert "not known to stop by itself" in shortcomings(Traits())[0]
    assert "goes on for 2 s" in shortcomings(Traits(dead_man=2.0))[0]
    assert "lost steps" in shortcomings(Traits(dead_man=0.3, measured=False))[0]


@pytest.mark.parametrize(
    ("line_index", "axes", "position", "target"),
    [
        (2, "XYZ", START, MIDDLE),
        (2, "XYZ", MIDDLE, END),
        (2, "XYZ", END, START),
        (2, "XYZ", (0.02 + 1e-6, -1e-6, 0.0), MIDDLE),
        (0, "X", (0.3, 0.2, 0.1), (0.3, 0.2, 0.2)),
        (3, "XY", (0.02, 0.04, 0.06), (0.01, 0.02, 0.06)),
    ],
)
def test_several_axes_may_move_along_their_diagonal(line_index, axes, position, target):
    assert refusal_of_plan(PLAN, line_index, axes, position, target) == ""


@pytest.mark.parametrize(
    ("line_index", "axes", "position", "target", "words"),
    [
        (0, "XY", (0.0, 0.0, 0.0), (0.01, 0.02, 0.0), "X and Y at once; on line 'x forward"),
        (1, "XYZ", (0.0, 0.0, 0.0), (0.01, 0.02, 0.03), "only one axis may move at a time"),
        (4, "XYZ", START, MIDDLE, "for line 4, but the plan has 4 lines"),
        (-1, "XY", START, MIDDLE, "for line -1, but the plan has 4 lines"),
        (2, "XY", START, (0.01, 0.02, 0.0), "'npp diagonal forward, repeat 0' is one of X and Y"),
        (3, "XYZ", (0.0, 0.0, 0.06), (0.01, 0.02, 0.0), "is one of X and Y"),
        (2, "ZYX", START, MIDDLE, "is one of X and Y and Z"),
        (2, "XYZ", (0.0, 0.0, 0.0), MIDDLE, "begins at 0, 0, 0 m, which is not on line 'npp"),
        (2, "XYZ", START, (0.01, 0.02, 0.0305), "ends at 0.01, 0.02, 0.0305 m, which is not on"),
        (2, "XYZ", START, (-0.01, 0.06, 0.09), "ends at -0.01, 0.06, 0.09 m"),
        (2, "XYZ", START, (float("nan"), 0.02, 0.03), "ends at nan"),
        (3, "XY", (0.02, 0.04, 0.0), (0.01, 0.02, 0.0), "begins at 0.02, 0.04, 0 m"),
    ],
)
def test_any_other_move_of_several_axes_is_refused(line_index, axes, position, target, words):
    assert words in refusal_of_plan(PLAN, line_index, axes, position, target)


def test_beyond_the_ends_as_far_as_the_overrun():
    plan = replace(PLAN, overrun=0.004)
    beyond = plan.run_up(plan.lines[2])
    assert beyond is not None
    assert refusal_of_plan(plan, 2, "XYZ", START, tuple(beyond)) == ""
    assert "ends at" in refusal_of_plan(PLAN, 2, "XYZ", START, tuple(beyond))
    farther = replace(PLAN, overrun=0.005).run_up(plan.lines[2])
    assert "ends at" in refusal_of_plan(plan, 2, "XYZ", START, tuple(farther))
