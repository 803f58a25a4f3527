"""The bent volume, the plan's lines, and the projection that both are drawn in."""

from dataclasses import replace

import numpy as np
import pytest
from refused import refused
from results_by_hand import VOLUME, make_result, with_rotations, with_unknown

from stepdiag_ros import plots
from stepdiag_ros.configuration import load_machine, load_plan
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.metrology.volumetric_map import VolumetricMap
from stepdiag_ros.planning.moves import passes_of
from stepdiag_ros.plots.space import PROJECTION, box_edges, project
from stepdiag_ros.plots.volumes import exaggeration_of, wires_of


def wires(figure):
    return {one.get_label(): one.get_segments() for one in figure.axes[0].collections}


def test_the_projection_is_a_turned_view_in_true_proportion():
    # Two rows of a rotation: at right angles, of length one.
    np.testing.assert_allclose(PROJECTION.T @ PROJECTION, np.eye(2), atol=1e-12)
    assert project(np.array([1.0, 0.0, 0.0]))[0] > 0 > project(np.array([1.0, 0.0, 0.0]))[1]
    assert project(np.array([0.0, 1.0, 0.0])).min() > 0
    np.testing.assert_allclose(project(np.array([0.0, 0.0, 1.0]))[0], 0.0, atol=1e-12)
    edges = box_edges([0.0, 0.0, 0.0], [1.0, 2.0, 3.0])
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    assert sorted(lengths) == [1.0] * 4 + [2.0] * 4 + [3.0] * 4


@pytest.mark.parametrize(
    ("longest", "factor"), [(1e-6, 5000.0), (2.5e-6, 2000.0), (6e-6, 1000.0), (0.0, 1.0)]
)
def test_errors_are_enlarged_by_a_round_factor(longest, factor):
    assert exaggeration_of(longest, np.array([0.03, 0.06, 0.09])) == factor


@pytest.mark.parametrize("turning", [False, True])
def test_the_wires_are_bent_by_the_error_map_and_the_worst_place_is_marked(turning):
    result = make_result()
    if turning:
        result = with_rotations(result, unknown=())
    chain = "YXZ" if turning else ""
    figure = plots.volume(result, chain)
    drawn = wires(figure)
    worst = of_result(result, chain)
    error_map = VolumetricMap.of_result(result, chain)
    factor = exaggeration_of(worst.value, error_map.high - error_map.low)
    straight = wires_of(error_map)
    assert len(drawn["as it is, exaggerated"]) == len(straight) == 36
    for wire, bent in zip(straight, drawn["as it is, exaggerated"], strict=True):
        np.testing.assert_allclose(bent, project(wire + factor * error_map.errors(wire)))
    (arrow,) = drawn["longest error vector"]
    place, vector = np.array(worst.position), np.array(worst.vector)
    np.testing.assert_allclose(arrow, project(np.stack([place, place + factor * vector])))
    said = " ".join(text.get_text().replace("\n", " ") for text in figure.texts)
    assert f"Errors are drawn {factor:,.0f} times larger" in said
    assert f"{worst.value * 1e6:.2f}"[:3] in said


def test_a_volume_that_is_not_known_is_not_drawn():
    assert plots.volume(with_unknown(make_result())) is None
    with refused(Refusal, "missing"):
        plots.volume(with_rotations(make_result(), unknown=()))


@pytest.mark.parametrize("name", ["demo", "iso230_6_face"])
def test_the_plan_is_drawn_with_every_line_at_its_stops(name):
    plan, machine = load_plan(name)[0], load_machine("demo")[0]
    figure = plots.plan(plan, machine)
    assert len(figure.axes) == len({line.kind for line in plan.lines})
    drawn = [artist.get_xydata() for axes in figure.axes for artist in axes.get_lines()]
    for one in passes_of(plan):
        if one.line.direction == "forward":
            stops = project(one.line.stops(plan.volume))
            assert any(d.shape == stops.shape and np.allclose(d, stops) for d in drawn), one.line
    labels = [label for axes in figure.axes for label in axes.get_legend_handles_labels()[1]]
    assert "measured box" in labels
    assert "travel" not in plots.plan(plan).axes[0].get_legend_handles_labels()[1]


def test_a_box_that_is_small_in_the_travel_is_drawn_alone():
    plan, machine = load_plan("quick")[0], load_machine("demo")[0]
    small = replace(plan, volume=VOLUME)
    labels = plots.plan(small, machine).axes[0].get_legend_handles_labels()[1]
    assert "travel" not in labels and "measured box" in labels
