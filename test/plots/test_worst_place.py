"""The picture of the worst place: the arrow stands where the result says, and so do the walls."""

import re

import numpy as np
import pytest
from matplotlib.figure import Figure
from results_by_hand import make_result, with_unknown

from stepdiag_ros import plots
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.metrology.volumetric_map import VolumetricMap
from stepdiag_ros.plots.space import frame_box, project
from stepdiag_ros.text.numbers import with_expanded


def test_the_arrow_begins_at_the_worst_place_and_points_along_the_error():
    result = make_result()
    worst = of_result(result)
    panel, _ = plots.worst_error(result).axes
    (arrow,) = [one for one in panel.texts if getattr(one, "arrow_patch", None) is not None]
    place, vector = np.array(worst.position), np.array(worst.vector)
    np.testing.assert_allclose(arrow.xyann, project(place))
    along = np.array(arrow.xy) - arrow.xyann
    expected = project(place + vector) - project(place)
    np.testing.assert_allclose(
        along / np.linalg.norm(along), expected / np.linalg.norm(expected), atol=1e-9
    )
    # How much longer it is than to scale is said below.
    said = " ".join(text.get_text() for text in panel.figure.texts)
    told = float(re.search(r"([\d,]+) times", said)[1].replace(",", ""))
    assert told == pytest.approx(np.linalg.norm(along) / np.linalg.norm(expected), rel=0.05)


@pytest.mark.parametrize("sides", [(0.5, 0.3, 0.27), (2.0, 0.4, 0.1), (0.1, 0.1, 1.0), (1, 1, 1)])
@pytest.mark.parametrize("width", [2.0, 5.0])
def test_the_names_of_the_axes_are_within_the_drawing_whatever_the_box_is_like(sides, width):
    figure = Figure(figsize=(width, 0.7 * width))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    low = np.array([0.05, 0.05, 0.03])
    frame_box(axes, low, low + np.array(sides))
    page = figure.bbox
    for text in axes.texts:
        place = text.get_window_extent()
        assert page.x0 - 1.0 <= place.x0 and place.x1 <= page.x1 + 1.0, text.get_text()
        assert page.y0 - 1.0 <= place.y0 and place.y1 <= page.y1 + 1.0, text.get_text()


def test_each_wall_shows_the_longest_error_in_front_of_it():
    result = make_result()
    worst, error_map = of_result(result), VolumetricMap.of_result(result)
    panel, _ = plots.worst_error(result).axes
    walls = {one.get_label(): one for one in panel.collections if "wall" in one.get_label()}
    assert set(walls) == {"wall X", "wall Y", "wall Z"}
    nodes = error_map.nodes
    grid = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).reshape(-1, 3)
    lengths = np.linalg.norm(error_map.errors(grid), axis=1).reshape([len(one) for one in nodes])
    for axis, wall in enumerate(walls.values()):
        seen = lengths.max(axis=axis)
        cells = (seen[:-1, :-1] + seen[1:, :-1] + seen[1:, 1:] + seen[:-1, 1:]) / 4.0
        np.testing.assert_allclose(wall.get_array(), cells.ravel())
        assert wall.get_clim() == (0.0, worst.value)


def test_size_uncertainty_and_place_stand_above_it():
    result = make_result()
    worst = of_result(result)
    figure = plots.worst_error(result, expanded_uncertainty=2e-7)
    said = [text.get_text() for text in figure.texts]
    assert said[0] == f"Largest error: {with_expanded(worst.value, 2e-7, 1e6)} µm (95 %)"
    assert said[1].startswith(f"at X {worst.position[0] * 1e3:.1f}, Y ")
    assert plots.worst_error(with_unknown(result)) is None
    of_readings = plots.worst_error(result).texts[0].get_text()
    assert "of the readings" in of_readings


def test_letters_are_readable_where_it_is_600_pixels_wide():
    figure = plots.worst_error(make_result())
    panel, _ = figure.axes
    words = [text for text in panel.texts if text.get_text()]
    smallest = min(text.get_fontsize() for text in words)
    assert smallest / 72.0 / figure.get_figwidth() * 600.0 >= 12.0


def test_the_scale_of_colours_ends_at_the_largest_error():
    result = make_result()
    _, scale = plots.worst_error(result).axes
    largest = of_result(result).value
    assert scale.get_ylim() == (0.0, largest)
    shown = [float(label.get_text()) for label in scale.get_yticklabels()]
    np.testing.assert_allclose(shown, [0.0, 0.5e6 * largest, 1e6 * largest], atol=0.051)
