"""Bands of readings that a person rounded: repeats agree too well, and U must not follow them."""

from dataclasses import replace

import numpy as np
import pytest
from band_rows import Rows, add_budget, add_result
from band_table import NARROW, counted, summaries
from hidden_runs import rounded
from plausible_machines import draw

from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.uncertainty.budget import make_budget
from stepdiag_ros.metrology.uncertainty.instrument import Spread

MACHINES = 20
QUIET = ("rotations", "wander", "air")
"""Parts without which nothing but the rounding is left; with them, it hides behind these."""


@pytest.mark.parametrize("without", [QUIET, ()], ids=["quiet", "everything"])
@pytest.mark.parametrize("step", [1e-6, 2e-6])
@pytest.mark.parametrize("machines", [2, MACHINES], ids=["few", "many"])
def test_bands_hold_where_readings_are_rounded(machines, step, without):
    # By the scatter of repeats alone: steps of 2 µm left 21 % of positioning inside, rms of z 4.1.
    rows = {}
    for seed in range(machines):
        machine, one = draw(seed, without=without), Rows()
        plan = machine.steps()
        truth, measured = machine.truth(plan.volume), rounded(machine.measure(plan), step)
        nothing = replace(machine.instrument, angular_errors=Spread())
        for method in ("setup_robust", "least_squares"):
            add_result(one, method, truth, solve(measured, method))
            add_budget(one, method, truth, make_budget(measured, nothing, method))
        for row, both in one.all().items():
            rows.setdefault(row, []).append(counted(*both))
    judged = summaries({row: np.array(counts) for row, counts in rows.items()})
    assert [row for row, one in judged.items() if one["says"] == NARROW] == []
    assert {row: one["rms_z"] for row, one in judged.items() if one["rms_z"] > 3.0} == {}
