"""What a print in grey needs: names, borders and marks that do without colour."""

import numpy as np
import pytest
from standard_runs import PLAN, measured

from stepdiag_ros import plots
from stepdiag_ros.configuration import load_plan
from stepdiag_ros.metrology.plan import LINEAR, STEP_DIAGONAL
from stepdiag_ros.metrology.solvers import solvers
from stepdiag_ros.plots.discrepancy import _MARKED, _mark_negative
from stepdiag_ros.plots.style import Sheet, band, style_of


@pytest.mark.parametrize(
    "plan", [load_plan("demo")[0], measured(PLAN)[0]], ids=["demo", "diagonals"]
)
def test_every_line_of_a_plan_bears_its_name_in_its_panel(plan):
    figure = plots.plan(plan, title="")
    named = [{text.get_text() for text in panel.texts} for panel in figure.axes]
    for kind in {line.kind for line in plan.lines}:
        names = {line.name for line in plan.lines if line.kind == kind}
        if kind in (LINEAR, STEP_DIAGONAL):
            assert any(names <= texts for texts in named)
        else:
            assert names <= set().union(*named)


def test_no_two_methods_share_marker_and_line():
    looks = [(style.marker, style.line) for style in map(style_of, solvers())]
    assert len(set(looks)) == len(looks)


def test_a_band_has_the_border_of_its_curves_line():
    panel = Sheet(1, 1, 1.0).panels[0]
    places, values = np.arange(3.0), np.zeros(3)
    for method in ("setup_robust", "least_squares"):
        band(panel, places, values, np.ones(3), style_of(method))
    dashed, solid = (one.get_linestyle()[0][1] for one in panel.collections)
    assert dashed is not None and solid is None


def test_only_clearly_negative_stops_are_marked():
    panel = Sheet(1, 1, 1.0).panels[0]
    reach = 2.0
    edge = -_MARKED * reach
    shown = np.array([[-2.5, edge - 0.01, edge + 0.01], [2.5, 0.0, np.nan]])
    _mark_negative(panel, shown, reach)
    marked = {tuple(xy) for line in panel.lines for xy in line.get_xydata()}
    assert marked == {(0.0, 0.0), (1.0, 0.0)}
