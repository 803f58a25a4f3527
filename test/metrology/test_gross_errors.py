"""Gross errors are named before anything is fitted, and a sound run has none."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan

from stepdiag_ros.metrology.effects.gross import gross_errors, renamed
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve

UNEQUAL = (0.010, 0.012, 0.009)


def run(step=UNEQUAL, size=1e-6, **plan):
    made = make_plan(step=step, directions=("forward", "backward"), **plan)
    return simulate(made, make_cell(size=size, high=(0.08, 0.08, 0.08)))


def read_elsewhere(measurement, way):
    """Give every line the readings of the run in which the machine went other ways."""
    lines = []
    for line in measurement.lines:
        wrong = way(line)
        lines.append(replace(line, displacement=wrong))
    return replace(measurement, lines=tuple(lines))


def nominal(line, position, volume):
    direction = np.sign(line.target[-1] - line.target[0]) * np.asarray(volume.step)
    direction = direction if line.line.direction == "forward" else -direction
    direction = direction / np.linalg.norm(direction)
    return (position - position[0]) @ direction


def test_a_sound_run_has_no_gross_error_whatever_its_steps_and_slips():
    for step in (UNEQUAL, (0.01, 0.01, 0.01)):
        measurement = run(step, size=10e-6)
        assert gross_errors(measurement) == ()
        line = measurement.lines[7]
        slipped = line.displacement.copy()
        slipped[5:] += 3e-3
        slipped[2] = np.nan
        lines = list(measurement.lines)
        lines[7] = replace(line, displacement=slipped)
        assert gross_errors(replace(measurement, lines=tuple(lines))) == ()


def test_a_reversed_axis_is_named():
    measurement = run()

    def reversed_y(line):
        return nominal(line, line.target * np.array([1.0, -1.0, 1.0]), measurement.volume)

    assert gross_errors(read_elsewhere(measurement, reversed_y)) == (
        "Y runs backwards on every line: its readings have the wrong sign there",
    )


def test_a_wrong_sign_of_all_readings_is_named():
    measurement = run()
    (sentence,) = gross_errors(read_elsewhere(measurement, lambda line: -line.displacement))
    assert "sign of the readings" in sentence


def test_axes_that_are_exchanged_in_the_machine_are_named():
    measurement = run(linear=())

    def exchanged(line):
        return nominal(line, line.target[:, [1, 0, 2]], measurement.volume)

    sound = simulate(make_plan(step=UNEQUAL, linear=(), diagonals=("ppp",)), make_cell())
    found = gross_errors(read_elsewhere(sound, exchanged))
    assert found == ("ppp XYZ forward, repeat 0: X, Y are exchanged in the machine",)


@pytest.mark.parametrize("order", ["XZY", "YXZ", "ZYX", "YZX", "ZXY"])
def test_a_wrong_move_order_is_named(order):
    measurement = run(linear=(), diagonals=("pnp",))
    true = run(linear=(), diagonals=("pnp",), orders=(order,))
    lines = tuple(
        replace(line, displacement=other.displacement)
        for line, other in zip(measurement.lines, true.lines, strict=True)
    )
    found = gross_errors(replace(measurement, lines=lines))
    forward = next(sentence for sentence in found if "forward" in sentence)
    assert forward == f"pnp XYZ forward, repeat 0: its moves came in the order {order}, not XYZ"


def test_a_pass_under_the_name_of_another_diagonal_is_named():
    measurement = run(linear=("x", "y", "z"))
    lines = []
    for line in measurement.lines:
        if line.line.name == "npp":
            mirrored = line.target * np.array([-1.0, 1.0, 1.0])
            line = replace(line, displacement=nominal(line, mirrored, measurement.volume))
        lines.append(line)
    found = gross_errors(replace(measurement, lines=tuple(lines)))
    assert found[0] == (
        "npp XYZ forward, repeat 0: X moves the other way: another line, perhaps ppp"
    )
    assert all(sentence.startswith("npp") for sentence in found)


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1e3, "in mm, not in m"),
        (1 / 0.0254, "in inches"),
        (0.5, "half of what"),
        (1.3, "1.3 times what they should be"),
        (-1.0, "forward and backward are exchanged"),
    ],
)
def test_a_factor_on_one_pass_is_named(factor, words):
    measurement = run()
    lines = list(measurement.lines)
    lines[8] = replace(lines[8], displacement=factor * lines[8].displacement)
    (sentence,) = gross_errors(replace(measurement, lines=tuple(lines)))
    assert sentence.startswith(str(lines[8].line)) and words in sentence


def test_with_equal_steps_the_right_name_is_the_one_that_fits():
    """The readings of YZX under the name XYZ: no nominal displacement is wrong, the fit is."""
    plan = make_plan(orders=("XYZ", "ZXY"), directions=("forward", "backward"))
    cell = make_cell(noise=0.05e-6)
    sound = simulate(plan, cell)
    other = simulate(make_plan(orders=("YZX", "ZXY"), directions=("forward", "backward")), cell)
    lines = []
    for line, true in zip(sound.lines, other.lines, strict=True):
        mixed = line.line.name == "npp" and line.line.order == "XYZ"
        lines.append(replace(line, displacement=true.displacement) if mixed else line)
    mixed_up = replace(sound, lines=tuple(lines))
    assert gross_errors(mixed_up) == ()
    fits = {words: misfit(supposed) for words, supposed in renamed(mixed_up)}
    best = min(fits, key=fits.__getitem__)
    assert best == "what is called npp XYZ was measured in the order YZX"
    assert fits[best] < 0.2 * misfit(mixed_up)
    assert sorted(fits.values())[1] > 3.0 * fits[best]
    assert misfit(sound) == pytest.approx(fits[best], rel=0.5)


def misfit(measurement):
    return solve(measurement, "least_squares").chi_squared
