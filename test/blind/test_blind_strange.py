"""Effects outside the catalogue against the physics that they are written from."""

from dataclasses import replace

import numpy as np
import pytest
from blind_cases import draw_case
from blind_effects import Hidden
from blind_machine import Machine
from blind_yardstick import Yardstick


@pytest.fixture(scope="module")
def machine():
    made = Machine(9, draw_case("none", 9).plan)
    made.approach[:] = 0.0
    return made


@pytest.fixture(scope="module")
def run(machine):
    return machine.run()


def test_a_swing_against_an_uneven_contact_has_a_mean_that_grows_with_its_square(run):
    hidden = Hidden("vibration", {"component": "y", "axis": "X", "other": "Z"})
    size = 1e-6
    moved = hidden.act(run, size).shift.sum(axis=0)
    share = run.position / run.travel
    # The contact's way for a swing of 3 um where it is largest, at every moment of the swing.
    swing = 3e-6 * np.sin(np.pi * share[:, [0]]) * share[:, [2]]
    swing = swing * np.cos(np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False))
    softening = 2.0 * size / 3e-6**2
    np.testing.assert_allclose(moved[:, 1], np.mean(softening * swing**2, axis=1), atol=1e-12)
    assert np.max(moved[:, 1]) > 0.4 * size and not np.any(moved[:, [0, 2]])


def test_warm_air_is_read_by_as_much_of_the_path_as_lies_in_it(run):
    centre, radius = [0.45, 0.5, 0.55], 0.35
    hidden = Hidden("warm_spot", {"centre": centre, "radius": radius})
    reading = hidden.act(run, 1.0).reading
    reach = radius * run.travel.min()
    share = np.linspace(0.0, 1.0, 4001)
    seen = 0
    for row in range(0, len(run.time), 7):
        source = run.start[row] - run.dead_path * run.beam[row]
        length = run.dead_path + run.along[row]
        points = source + share[:, None] * length * run.beam[row]
        inside = np.linalg.norm(points - np.asarray(centre) * run.travel, axis=1) < reach
        expected = -length * inside.mean() / (2.0 * reach)
        assert reading[row] == pytest.approx(expected, abs=2e-3 * length / reach)
        seen += expected < -0.3
    # Lines along the box's edges pass it by; the diagonals go through it.
    kinds = np.array([row[0] for row in run.rows])
    assert seen and not np.any(reading[kinds == "linear"])


def test_a_swing_within_the_scale_s_period_is_seen_by_its_stretch_and_the_other_axis(machine, run):
    setting = {"axis": "X", "other": "Z", "period": 20e-6, "phase": 0.4, "stretch": 50e-6}
    hidden = Hidden("interpolation", setting)
    moved = hidden.act(run, 1.0).shift[0, :, 0]
    share = run.position[:, 2] / run.travel[2]
    # Steps are whole periods of 20 um: the stops see the slow beat of both, 0.4 m long.
    beat = np.sin(2.0 * np.pi * run.position[:, 0] / 0.4 + 0.4) * share
    np.testing.assert_allclose(moved, beat, atol=1e-6)
    nearby = run.position + np.array([20e-6 / (1.0 + 50e-6), 0.0, 0.0])
    nearby = replace(run, position=nearby)
    np.testing.assert_allclose(hidden.act(nearby, 1.0).shift[0, :, 0], moved, atol=1e-9)
    yardstick = Yardstick(run)
    assert yardstick.visible(machine.signature(run, hidden)) > 0.02
    # The same swing alike everywhere is a part of the axis's own curve.
    alone = np.divide(moved, share, out=np.zeros_like(moved), where=share > 0.0)
    alone[share == 0.0] = np.sin(2.0 * np.pi * run.position[share == 0.0, 0] / 0.4 + 0.4)
    assert yardstick.visible(alone * run.beam[:, 0]) < 1e-6
