from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from refused import refused

from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import planned_run, read_again, simulate


def test_lines_of_a_setup_share_one_zero_and_one_alignment():
    plan = make_plan(diagonals=("ppp", "npp"), repeats=2, directions=("forward", "backward"))
    measured = simulate(plan, make_cell(noise=0.0), seed=1)
    assert len(measured.lines) == len(plan.lines)
    first, back, again, _ = (line for line in measured.lines if line.setup == "ppp XYZ")
    assert first.displacement[0] == 0.0
    assert back.displacement == pytest.approx(first.displacement[::-1], abs=1e-15)
    assert again.displacement == pytest.approx(first.displacement, abs=1e-15)


def test_readings_grow_along_the_beam_by_the_way_of_the_line():
    measured = simulate(make_plan(), make_cell(noise=0.0), seed=1)
    for line in measured.lines:
        direction = beam_direction(line.line.name, np.array(measured.volume.step))
        way = (line.target - line.target[0]) @ direction
        assert line.displacement == pytest.approx(way, abs=50e-6)


def test_noise_is_that_of_the_mean_of_the_readings_of_a_stop():
    plan = make_plan(blocks=40, step=(1e-3,) * 3, repeats=3)
    quiet = simulate(plan, make_cell(noise=0.0))
    noisy = simulate(plan, make_cell(noise=0.2e-6), seed=5, readings_per_stop=4)
    errors = np.concatenate(
        [
            n.displacement - q.displacement - np.mean(n.displacement - q.displacement)
            for n, q in zip(noisy.lines, quiet.lines, strict=True)
        ]
    )
    assert np.std(errors) == pytest.approx(0.1e-6, rel=0.05)
    assert noisy.lines[0].standard_uncertainty == pytest.approx(np.full(41, 0.1e-6))
    with refused(Refusal, "out_of_range", "readings_per_stop"):
        simulate(plan, make_cell(), readings_per_stop=0)


def test_the_same_seed_gives_the_same_measurement_and_another_one_does_not():
    one, same, other = (simulate(make_plan(), make_cell(), seed=s) for s in (4, 4, 5))
    for a, b, c in zip(one.lines, same.lines, other.lines, strict=True):
        assert np.array_equal(a.displacement, b.displacement)
        assert not np.array_equal(a.displacement, c.displacement)


def test_times_rise_and_weather_is_recorded():
    measured = simulate(make_plan(), make_cell())
    times = np.concatenate([line.time for line in measured.lines])
    assert np.all(np.diff(times) > 0)
    assert measured.lines[0].environment.shape == (7, 4)
    assert np.all(np.isfinite(measured.lines[-1].environment))
    assert measured.lines[-1].end_time == round(times[-1] * 1e9)


def test_a_run_that_was_made_is_read_again_by_another_cell():
    plan, cell = make_plan(repeats=2), make_cell(noise=0.1e-6)
    run = simulate(plan, cell, seed=4)
    same = read_again(run, cell, noise=0.1e-6, seed=4)
    exact = read_again(run, cell)
    for line, again, truth, planned in zip(
        run.lines, same.lines, exact.lines, planned_run(plan, cell).lines, strict=True
    ):
        assert np.array_equal(again.displacement, line.displacement)
        assert np.all(truth.standard_uncertainty == 0.0)
        assert np.std(line.displacement - truth.displacement) < 0.4e-6
        assert np.array_equal(planned.time, truth.time)
        assert np.all(planned.displacement == 0.0)


def test_what_was_not_read_is_not_read_again_and_a_lost_zero_keeps_its_alignment():
    cell = make_cell(noise=0.0)
    run = simulate(make_plan(repeats=2), cell)
    first, second = (line for line in run.lines if line.setup == "ppp XYZ")
    holed = first.displacement.copy()
    holed[[0, 5]] = np.nan
    changed = tuple(
        replace(line, displacement=holed)
        if line is first
        else replace(line, setup="ppp XYZ (zero 2)")
        if line is second
        else line
        for line in run.lines
    )
    again = read_again(replace(run, lines=changed), cell)
    one, two = (line for line in again.lines if line.setup.startswith("ppp XYZ"))
    assert np.flatnonzero(np.isnan(one.displacement)).tolist() == [0, 5]
    # Counted from the first stop that was read; the other way round, no tilt has changed.
    assert one.displacement[1] == 0.0 and two.displacement[0] == 0.0
    assert two.displacement == pytest.approx(first.displacement, abs=1e-15)
