"""The picture of a plan: where its lines are, in the unit and the coordinates of its axes."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np

from stepdiag_ros import plots
from stepdiag_ros.configuration import load_plan
from stepdiag_ros.metrology.plan import FORWARD, LINEAR, Line


def drawn():
    plan = load_plan("demo")[0]
    shifted = Line(LINEAR, "y", "", 0, FORWARD, offset=(0.04, 0.0, 0.02))
    name = f"volumetric: {'4 step diagonals with 6 orders in all, ' * 2}1190 x 790 x 290 mm"
    return plan, plots.plan(replace(plan, name=name, lines=(*plan.lines, shifted)))


def test_a_shifted_line_is_named_where_it_is_drawn_in_mm():
    plan, figure = drawn()
    labels = [text.get_text() for panel in figure.axes for text in panel.get_legend().texts]
    (label,) = [one for one in labels if " at " in one]
    x, z = (float(one) for one in re.findall(r"[XZ] (-?[\d.]+)", label))
    origin = np.array(plan.volume.origin)
    assert x == 1e3 * (origin[0] + 0.04) and z == 1e3 * (origin[2] + 0.02) and "Y" not in label


def test_a_heading_is_never_broken_in_the_sides_of_the_box():
    _, figure = drawn()
    lines = [text.get_text().replace("\u00a0", " ") for text in figure.texts]
    assert sum("1190 x 790 x 290 mm" in line for line in lines) == 1


def test_the_numbers_of_two_axes_that_meet_stand_apart():
    _, figure = drawn()
    figure.canvas.draw()
    for panel in figure.axes:
        numbers = [text for text in panel.texts if re.fullmatch(r"-?[\d.]+", text.get_text())]
        boxes = sorted((one.get_window_extent() for one in numbers), key=lambda box: box.x0)
        for left, right in pairwise(boxes):
            if left.y0 < right.y1 and right.y0 < left.y1:
                assert right.x0 - left.x1 > 4.0
