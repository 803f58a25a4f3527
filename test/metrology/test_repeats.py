"""The repeats of a measurement, each solved alone."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from refused import refused

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.repeats import line_errors, solve_repeats, split_repeats
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve

PLAN = make_plan(blocks=4, repeats=5, diagonals=("ppp", "npp", "pnp"))


def measured(plan=PLAN, noise=0.1e-6):
    return simulate(plan, make_cell(high=(0.04,) * 3, noise=noise), seed=4)


def test_every_part_has_all_lines_of_one_repeat():
    parts = split_repeats(
        measured(make_plan(blocks=2, repeats=3, directions=("forward", "backward")))
    )
    assert [len(part.lines) for part in parts] == [14, 14, 14]
    for number, part in enumerate(parts):
        assert {line.line.repeat for line in part.lines} == {number}
        assert part.chain == "YXZ"


def test_repeats_that_some_lines_lack_are_left_out():
    measurement = measured()
    lines = tuple(
        line for line in measurement.lines if line.line.name != "y" or line.line.repeat in (1, 3)
    )
    parts = split_repeats(replace(measurement, lines=lines))
    assert [part.lines[0].line.repeat for part in parts] == [1, 3]
    assert split_repeats(replace(measurement, lines=())) == ()


def test_the_mean_of_the_repeats_is_the_result_of_all_and_its_scatter_the_uncertainty():
    measurement = measured()
    found, reasons = solve_repeats(measurement, ["conventional", "setup_robust", "soons"])
    assert set(found) == {"conventional", "setup_robust"}
    assert "three orders" in reasons["soons"]
    whole = solve(measurement, "setup_robust")
    ratios = []
    for name, curve in whole.curves.items():
        spread = found["setup_robust"].spread(name)
        assert spread.values.shape == (5, 5)
        np.testing.assert_allclose(spread.mean, curve, atol=1e-15)
        assert np.all(spread.low <= spread.mean + 1e-18)
        assert np.all(spread.high >= spread.mean - 1e-18)
        known = whole.standard_uncertainty[name] > 1e-12
        ratios.append(
            (spread.standard_uncertainty_of_mean / whole.standard_uncertainty[name].clip(1e-12))[
                known
            ]
        )
    assert np.sqrt(np.mean(np.concatenate(ratios) ** 2)) == pytest.approx(1.0, abs=0.3)


def test_one_run_has_no_spread():
    with refused(Refusal, "too_few", "1"):
        solve_repeats(measured(make_plan(blocks=2)), ["setup_robust"])


def test_line_errors_are_what_a_line_reads_too_much():
    plan = make_plan(blocks=3, repeats=2, directions=("forward", "backward"), diagonals=("npp",))
    lines = {line.name: line for line in line_errors(measured(plan, noise=0.0))}
    assert set(lines) == {"x", "y", "z", "npp XYZ"}
    cell = make_cell(high=(0.04,) * 3)
    volume = plan.volume
    expected = cell.errors.at(0, volume.nodes(0))[:, 0]
    assert lines["x"].errors.shape == (4, 4)
    for errors in lines["x"].errors:
        # A tilted beam of a linear line shows in the second order only.
        np.testing.assert_allclose(errors, expected - expected[0], atol=5e-9)
    np.testing.assert_allclose(lines["npp XYZ"].path[::3], np.arange(4) * 0.01 * np.sqrt(3))
