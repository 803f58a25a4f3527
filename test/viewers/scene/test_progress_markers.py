"""The picture of a measurement that goes on, and the messages that pictures become."""

import numpy as np
import pytest

from stepdiag_ros.configuration import load_plan
from stepdiag_ros.metrology.frames import setup_placements, tool_placement, workpiece_placement
from stepdiag_ros.metrology.geometry import TRANSLATIONS
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.viewers.scene import shapes as colours
from stepdiag_ros.viewers.scene.conversion import from_placements, from_shapes
from stepdiag_ros.viewers.scene.error_markers import picture
from stepdiag_ros.viewers.scene.progress_markers import DrawnProgress, courses, progress_markers

PLAN = load_plan("demo")[0]
"""x, y, z, ppp, npp, pnp, ppn: four passes each, one after the other."""


def lines(shapes):
    return {shape.number: shape for shape in shapes if shape.group == "lines"}


def shade(shape):
    return shape.colours.tolist()


def test_a_line_is_drawn_once_through_its_stops_for_all_its_passes():
    found = courses(PLAN)
    assert [course.name for course in found] == [
        "x", "y", "z", "ppp XYZ", "npp XYZ", "pnp XYZ", "ppn XYZ",
    ]  # fmt: skip
    assert sorted(one for course in found for one in course.passes) == list(range(28))
    drawn = lines(progress_markers(PLAN, DrawnProgress()))
    assert len(drawn) == 7 and len(drawn[0].points) == 13 and len(drawn[3].points) == 37
    moves = np.diff(drawn[4].points, axis=0)
    assert np.all(np.count_nonzero(moves, axis=1) == 1)  # one axis after the other


def test_colours_tell_what_is_done():
    measured = {0: True, 1: True, 2: True, 3: True, 4: True, 5: False, 8: True}
    drawn = lines(progress_markers(PLAN, DrawnProgress(measured, present=12)))
    assert shade(drawn[0]) == shade_of(colours.SKY_BLUE)  # all four passes
    assert shade(drawn[1]) == shade_of(colours.VERMILION)  # one without all its stops
    assert shade(drawn[2]) == shade_of(colours.GREY)  # one of four
    assert shade(drawn[3]) == shade_of(colours.ORANGE)  # going on
    assert shade(drawn[4]) == shade_of(colours.GREY)  # not begun
    after = lines(progress_markers(PLAN, DrawnProgress(dict.fromkeys(range(28), True))))
    assert {tuple(shade(shape)[0]) for shape in after.values()} == {
        tuple(shade_of(colours.SKY_BLUE)[0])
    }


def shade_of(colour):
    return colour.tolist()


def test_names_stand_beyond_the_ends_and_count_passes():
    shapes = progress_markers(PLAN, DrawnProgress({12: True, 13: True}))
    names = [shape for shape in shapes if shape.group == "line_names"]
    (ppp,) = (shape for shape in names if "ppp" in shape.text)
    assert ppp.text == "ppp XYZ  2/4" and np.all(ppp.points > 0.12)
    orders = load_plan("ibaraki_hata_2010")[0]
    labels = [s.text for s in progress_markers(orders, DrawnProgress()) if s.group == "line_names"]
    # Lines that end at one place share a label, so that none covers another.
    assert sum(label.count("\n") + 1 for label in labels) == len(courses(orders)) > len(labels)


def test_laser_beam_and_mirror_are_there_while_a_line_is_measured():
    at = (0.03, 0.02, 0.02)
    before = {shape.group for shape in progress_markers(PLAN, DrawnProgress(position=at))}
    assert before == {"lines", "line_names"}
    progress = DrawnProgress(present=13, position=at, laser_distance=0.25)
    shapes = {shape.group: shape for shape in progress_markers(PLAN, progress)}
    assert (shapes["laser"].frame, shapes["mirror"].frame) == ("laser", "mirror")
    beam = shapes["beam"]
    assert beam.frame == "laser" and np.all(beam.points[:, 1:] == 0.0)
    # The body diagonal: 0.25 m to the first stop, and the place's share along the beam.
    assert beam.points[1, 0] == pytest.approx(0.25 + sum(at) / 3**0.5)
    unknown = progress_markers(PLAN, DrawnProgress(present=13))
    assert "beam" not in {shape.group for shape in unknown}


@pytest.fixture
def array():
    nodes = PLAN.volume.all_nodes
    curves = {name: np.linspace(0.0, 1e-5, 13) for name in TRANSLATIONS}
    result = VolumetricErrors(
        nodes, curves, "least_squares", {name: np.zeros(13) for name in curves}, (), 28, np.nan, 0
    )
    shapes = [
        *picture((result,), PLAN),
        *progress_markers(PLAN, DrawnProgress({}, 3, (0.0, 0.0, 0.0))),
    ]
    return from_shapes(shapes, 12_000_000_345, "cell_1/")


def test_a_message_takes_the_place_of_all_before_it(array):
    first, *rest = array.markers
    assert first.action == type(first).DELETEALL == 3
    assert all(marker.action == type(marker).ADD for marker in rest)
    assert len({(marker.ns, marker.id) for marker in rest}) == len(rest)


def test_markers_are_as_viewers_want_them(array):
    kinds = set()
    for marker in array.markers[1:]:
        kinds.add(marker.type)
        assert marker.header.frame_id in ("cell_1/machine", "cell_1/laser", "cell_1/mirror")
        assert (marker.header.stamp.sec, marker.header.stamp.nanosec) == (12, 345)
        assert marker.pose.orientation.w == 1.0 and marker.frame_locked
        points = np.array([[point.x, point.y, point.z] for point in marker.points])
        assert np.all(np.isfinite(points)) and len(marker.colors) in (0, len(points))
        assert 0.0 < marker.color.a <= 1.0
        scale = np.array([marker.scale.x, marker.scale.y, marker.scale.z])
        if marker.type == marker.TEXT_VIEW_FACING:
            assert marker.text.isascii() and marker.text and scale[2] > 0.0
        elif marker.type in (marker.ARROW, marker.CUBE):
            assert np.all(scale > 0.0)
        else:
            assert scale[0] > 0.0
        if marker.type in (marker.TEXT_VIEW_FACING, marker.CUBE):
            assert len(points) == 0
        if marker.type == marker.ARROW:
            assert len(points) == 2 and np.linalg.norm(points[1] - points[0]) > 0.0
        if marker.type == marker.LINE_LIST:
            assert len(points) % 2 == 0 < len(points)
    assert kinds == {
        array.markers[0].ARROW,
        array.markers[0].CUBE,
        array.markers[0].LINE_LIST,
        array.markers[0].LINE_STRIP,
        array.markers[0].TEXT_VIEW_FACING,
    }
    assert "50 um" in {marker.text for marker in array.markers}


def test_transforms_are_messages():
    placements = [
        workpiece_placement(PLAN.volume),
        *setup_placements(PLAN.lines[12], PLAN.volume, 0.3, (0.0, 0.0, 0.1)),
        tool_placement((0.1, 0.2, 0.3)),
    ]
    message = from_placements(placements, 5_000_000_001, "a/")
    names = [(one.header.frame_id, one.child_frame_id) for one in message.transforms]
    assert names == [
        ("a/machine", "a/workpiece"),
        ("a/machine", "a/laser"),
        ("a/tool", "a/mirror"),
        ("a/machine", "a/tool"),
    ]
    turn = message.transforms[1].transform.rotation
    assert np.linalg.norm([turn.x, turn.y, turn.z, turn.w]) == pytest.approx(1.0)
    place = message.transforms[3].transform.translation
    assert (place.x, place.y, place.z) == (0.1, 0.2, 0.3)
    assert message.transforms[0].header.stamp.nanosec == 1
