"""What is drawn anew after which news of a run."""

import numpy as np
import pytest

from stepdiag_ros.configuration import load_cell, load_plan
from stepdiag_ros.metrology.frames import setup_placements, workpiece_placement
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve_all
from stepdiag_ros.viewers.scene.run_picture import Part, RunPicture, View

PLAN = load_plan("quick")[0]
MEASUREMENT = simulate(PLAN, load_cell("demo")[0])


@pytest.fixture
def picture():
    """Return the picture of a run that has begun and was looked at."""
    made = RunPicture()
    made.begin(PLAN, "YXZ")
    seen(made)
    return made


def seen(picture, view=None):
    """Return what is drawn anew, by its name."""
    view = view or View()
    drawn = {
        "tool": picture.tool(),
        "setup": picture.setup(view),
        "progress": picture.progress(view),
        "errors": picture.errors(view),
    }
    return {name: one for name, one in drawn.items() if one is not None}


def passes_done(shapes):
    """Return how many passes the names of lines count as measured."""
    text = " ".join(shape.text for shape in shapes if shape.group == "line_names")
    return sum(int(word.split("/")[0]) for word in text.split() if "/" in word)


def test_before_a_run_the_tool_alone_is_shown():
    picture = RunPicture()
    assert seen(picture) == {}
    picture.take_position((0.1, 0.2, 0.3))
    picture.take_present(0)
    (tool,) = seen(picture)["tool"]
    assert (tool.child, tool.translation) == ("tool", (0.1, 0.2, 0.3))
    # What could not be drawn yet comes with the run.
    picture.begin(PLAN, "YXZ")
    assert set(seen(picture)) == {"setup", "progress", "errors"}
    assert seen(picture) == {}


def test_each_news_draws_what_it_changes_and_once(picture):
    line = MEASUREMENT.lines[0]
    result = solve_all(MEASUREMENT)[0]["least_squares"]
    for news, changed in (
        (lambda: picture.take_position((0.0, 0.0, 0.0)), {"tool", "progress"}),
        (lambda: picture.take_line(line), {"progress"}),
        (lambda: picture.take_present(1), {"setup", "progress"}),
        (lambda: picture.take_present(1), set()),
        (lambda: picture.take_result(result), {"errors"}),
        (lambda: picture.redraw(Part.ERRORS, Part.SETUP), {"errors", "setup"}),
    ):
        news()
        assert set(seen(picture)) == changed
        assert seen(picture) == {}


def test_the_setup_is_that_of_the_present_pass_and_stays_when_the_run_is_over(picture):
    view = View(laser_distance=0.5, mirror_offset=(0.01, 0.0, 0.0))
    last = len(PLAN.lines) - 1
    picture.take_present(last)
    drawn = seen(picture, view)
    wanted = setup_placements(PLAN.lines[last], PLAN.volume, 0.5, (0.01, 0.0, 0.0))
    assert drawn["setup"] == (workpiece_placement(PLAN.volume), *wanted)
    assert "beam" not in {shape.group for shape in drawn["progress"]}  # no position is known
    picture.take_position((0.0, 0.0, 0.0))
    assert "beam" in {shape.group for shape in seen(picture, view)["progress"]}
    picture.take_present(None)
    assert seen(picture, view)["setup"] == drawn["setup"]
    # A state of another plan: there is no such pass.
    picture.take_present(last + 1)
    assert seen(picture, view) == {}


def test_a_new_run_forgets_lines_and_results_and_keeps_the_tool(picture):
    picture.take_position((0.0, 0.0, 0.1))
    for line in MEASUREMENT.lines:
        picture.take_line(line)
    for result in solve_all(MEASUREMENT)[0].values():
        picture.take_result(result)
    picture.take_present(0)
    full = seen(picture)
    picture.begin(PLAN, "YXZ")
    new = seen(picture)
    assert "tool" not in new and set(new) == {"setup", "progress", "errors"}
    assert len(new["errors"]) < len(full["errors"])
    assert passes_done(full["progress"]) == len(PLAN.lines)
    assert passes_done(new["progress"]) == 0


def test_the_method_and_the_exaggeration_are_the_viewer_s(picture):
    for result in solve_all(MEASUREMENT)[0].values():
        picture.take_result(result)
    groups = {}
    for method in ("conventional", "least_squares", "all"):
        picture.redraw(Part.ERRORS)
        shapes = picture.errors(View(method=method))
        groups[method] = {shape.group.split("/")[0] for shape in shapes}
    assert "conventional" in groups["conventional"] - groups["least_squares"]
    assert groups["conventional"] | groups["least_squares"] <= groups["all"]

    def longest(exaggeration):
        picture.redraw(Part.ERRORS)
        drawn = picture.errors(View(method="least_squares", exaggeration=exaggeration))
        arrows = [shape.points for shape in drawn if shape.group == "least_squares/vectors"]
        return max(float(np.linalg.norm(points[-1] - points[0])) for points in arrows)

    assert longest(2000.0) == pytest.approx(2.0 * longest(1000.0))
