"""Frames: right-handed, along the beam, and as far away as the forward model reads."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag_ros.metrology import frames
from stepdiag_ros.metrology.forward import Alignment, ErrorCurves, reading
from stepdiag_ros.metrology.geometry import (
    BODY_DIAGONALS,
    FACE_DIAGONALS,
    LINEAR_LINES,
    beam_direction,
)
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD, Line, Volume, kind_of

VOLUME = Volume((-0.1, 0.02, 0.3), (0.02, 0.01, 0.015), 8)
OFFSET = (0.01, -0.02, 0.03)
DISTANCE = 0.4


def line_of(name, order="", direction=FORWARD):
    return Line(kind_of(name, order), name, order, 0, direction)


def matrix(quaternion):
    """Rotate the unit vectors by q v q*, with the products of quaternions written out."""
    x, y, z, w = quaternion
    vector = np.array([x, y, z])
    columns = []
    for unit in np.eye(3):
        twice = 2.0 * np.cross(vector, unit)
        columns.append(unit + w * twice + np.cross(vector, twice))
    return np.column_stack(columns)


@pytest.mark.parametrize(
    "name", [*LINEAR_LINES, *BODY_DIAGONALS, *FACE_DIAGONALS, "nnn", "nnp", "0nn"]
)
def test_laser_and_mirror_look_along_the_beam(name):
    laser, mirror = frames.setup_placements(line_of(name), VOLUME, DISTANCE, OFFSET)
    axes = matrix(laser.rotation)
    beam = beam_direction(name, np.array(VOLUME.step))
    np.testing.assert_allclose(axes[:, 0], beam, atol=1e-14)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert axes[2, 1] == pytest.approx(0.0, abs=1e-14)  # y is horizontal
    assert np.linalg.norm(laser.rotation) == pytest.approx(1.0)
    assert (laser.parent, laser.child) == ("machine", "laser")
    assert (mirror.parent, mirror.child) == ("tool", "mirror")
    assert mirror.rotation == laser.rotation and mirror.translation == OFFSET
    first = line_of(name).stops(VOLUME)[0]
    assert np.linalg.norm(first + OFFSET - laser.translation) == pytest.approx(DISTANCE)


@pytest.mark.parametrize("name", ["x", "ppp", "npp", "pn0"])
def test_the_way_to_the_mirror_is_what_the_forward_model_reads(name):
    order = "YZX" if name in BODY_DIAGONALS else ""
    line = line_of(name, order)
    laser, _ = frames.setup_placements(line, VOLUME, DISTANCE, OFFSET)
    perfect = ErrorCurves.from_curves(VOLUME.all_nodes, {})
    beam = beam_direction(name, np.array(VOLUME.step))
    alignment = Alignment(beam, beam, np.array(laser.translation))
    stops = line.stops(VOLUME)
    expected = reading(stops, alignment, perfect, "XYZ", np.array(OFFSET))
    ways = [frames.beam_length(laser, frames.triple(stop), OFFSET) for stop in stops]
    np.testing.assert_allclose(ways, expected, atol=1e-14)
    assert ways[0] == pytest.approx(DISTANCE) and ways[-1] > ways[0]


def test_both_passes_share_one_laser():
    forward, backward = (line_of("npp", "XYZ", way) for way in (FORWARD, BACKWARD))
    assert frames.setup_placements(forward, VOLUME, 0.3, OFFSET) == frames.setup_placements(
        backward, VOLUME, 0.3, OFFSET
    )


def test_a_shifted_line_has_a_shifted_laser():
    line = replace(line_of("x"), offset=(0.0, 0.05, 0.0))
    shifted, _ = frames.setup_placements(line, VOLUME, 0.3, OFFSET)
    plain, _ = frames.setup_placements(line_of("x"), VOLUME, 0.3, OFFSET)
    assert np.subtract(shifted.translation, plain.translation) == pytest.approx([0.0, 0.05, 0.0])


def test_quaternions_of_all_half_turns_and_small_turns():
    rng = np.random.default_rng(2)
    for _ in range(200):
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        angle = rng.choice([np.pi, np.pi - 1e-9, 1e-9, 0.0, rng.uniform(0, np.pi)])
        given = np.array([*(axis * np.sin(angle / 2)), np.cos(angle / 2)])
        found = np.array(frames.quaternion_of(matrix(given)))
        np.testing.assert_allclose(matrix(found), matrix(given), atol=1e-12)
        assert found[3] >= 0.0


def test_the_tool_is_where_the_axes_are_and_the_workpiece_where_the_box_begins():
    assert frames.tool_placement((1.0, 2.0, 3.0)).translation == (1.0, 2.0, 3.0)
    assert frames.workpiece_placement(VOLUME).translation == VOLUME.origin
