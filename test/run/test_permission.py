from dataclasses import replace

import pytest

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
from stepdiag_ros.run.permission import refusal_of_plan

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


@pytest.mark.parametrize("axes", ["", "X", "Y", "Z"])
@pytest.mark.parametrize("line_index", [0, 1, 2, 3, 99])
def test_single_axes_may_move_anywhere(axes, line_index):
    assert refusal_of_plan(PLAN, line_index, axes, (0.3, 0.2, 0.1), (0.3, 0.2, 0.2)) == ""


@pytest.mark.parametrize(
    ("line_index", "axes", "position", "target"),
    [
        (2, "XYZ", START, MIDDLE),
        (2, "XYZ", MIDDLE, END),
        (2, "XYZ", END, START),
        (2, "XYZ", (0.02 + 1e-6, -1e-6, 0.0), MIDDLE),
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
