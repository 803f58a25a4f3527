"""The picture of a run with a tracker: stations, lines, places, and a beam that follows."""

import numpy as np
from tracker_runs import BESIDE, STATIONS, tracker_run, write_tracker_run

from stepdiag_ros import topics
from stepdiag_ros.bags.folder import open_bag
from stepdiag_ros.bags.runs import choose_run, records_of
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.metrology.frames import setup_placements
from stepdiag_ros.metrology.tracker.run_result import solve_station
from stepdiag_ros.viewers.foxglove.recorded_scene import RecordedScene
from stepdiag_ros.viewers.scene.progress_markers import DrawnProgress, courses, progress_markers
from stepdiag_ros.viewers.scene.run_picture import RunPicture, View
from stepdiag_ros.viewers.scene.shapes import Kind


def group(shapes, name):
    return [shape for shape in shapes if shape.group == name]


def test_every_station_is_drawn_and_named_where_the_plan_has_it():
    plan, _ = tracker_run(stations=STATIONS, nodes=4)
    shapes = group(progress_markers(plan, DrawnProgress()), "stations")
    boxes = [shape for shape in shapes if shape.kind is Kind.BOX]
    assert {tuple(one.points[0]) for one in boxes} == set(STATIONS)
    assert [one.text for one in shapes if one.kind is Kind.TEXT] == [
        f"station {number}" for number in "1234"
    ]
    assert len({one.number for one in shapes}) == len(shapes)


def test_lines_are_paths_and_places_are_no_way():
    plan, _ = tracker_run()
    drawn = group(progress_markers(plan, DrawnProgress()), "lines")
    for course, shape in zip(courses(plan), drawn, strict=True):
        stops = course.line.stops(plan.volume)
        if course.line.name == "1:locate":
            assert shape.kind is Kind.LINES
            pairs = shape.points.reshape(-1, 2, 3)
            middles = pairs.mean(axis=1).reshape(-1, 3, 3)
            np.testing.assert_allclose(middles, np.repeat(stops[:, None], 3, axis=1), atol=1e-12)
            assert np.all(np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1) < 0.02)
        else:
            assert shape.kind is Kind.PATH
            np.testing.assert_array_equal(shape.points, stops)


def test_a_single_place_is_named_without_a_direction():
    plan, _ = tracker_run(stations=STATIONS, nodes=4)
    names = group(progress_markers(plan, DrawnProgress()), "line_names")
    assert all(np.all(np.isfinite(shape.points)) for shape in names)


def test_the_beam_goes_from_the_station_to_where_the_reflector_is():
    plan, _ = tracker_run()
    offset = (0.01, 0.0, -0.02)
    for position in ((0.03, 0.05, 0.01), (0.12, 0.0, 0.12)):
        progress = DrawnProgress(present=2, position=position, mirror_offset=offset)
        (beam,) = group(progress_markers(plan, progress), "beam")
        assert beam.frame == "machine"
        np.testing.assert_allclose(beam.points, np.array([BESIDE, position]) + np.array(offset))
    laser, _ = setup_placements(plan.lines[2], plan.volume, 0.3, (0.0, 0.0, 0.0))
    np.testing.assert_allclose(laser.translation, BESIDE, atol=1e-12)


def test_the_words_of_a_result_without_curves_are_its_figures():
    plan, lines = tracker_run()
    result, _ = solve_station(lines[-1], lines, plan, "YXZ")
    drawing = RunPicture()
    drawing.begin(plan, "YXZ")
    for line in lines:
        drawing.take_line(line)
    drawing.take_result(result)
    text = " ".join(shape.text for shape in drawing.errors(View()))
    assert "C0Y" in text and "positioning E_XX" in text
    assert "unknown" not in text


def test_the_scene_of_a_bag_has_stations_and_follows_messages_without_places(tmp_path):
    plan, lines = tracker_run()
    bag = write_tracker_run(tmp_path / "run.mcap", plan, lines)
    with open_bag(bag) as opened:
        run = choose_run(opened, None)
        scene = RecordedScene(run.description)
        for record, message in records_of(opened, run, ["/measurement/line"]):
            scene.take(topics.LINE, message if message is not None else opened.decode(record))
        drawn = scene.drawn(0)
    types = own_types()
    markers = types.decode(topics.RUN_MARKERS.type_name, drawn[topics.RUN_MARKERS]).markers
    assert "station 1" in [marker.text for marker in markers]
    assert "1:xyz  4/4" in "\n".join(marker.text for marker in markers)
    assert topics.FIXED_FRAMES in drawn
