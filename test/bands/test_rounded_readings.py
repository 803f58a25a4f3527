"""Bands of readings that a person rounded: repeats agree too well, and U must not follow them."""

import numpy as np
import pytest
from band_rows import solved_rows
from band_table import NARROW, counted, summaries
from cells_for_tests import rounded
from plausible_machines import draw

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
        machine = draw(seed, without=without)
        plan = machine.steps()
        truth, measured = machine.truth(plan.volume), rounded(machine.measure(plan), step)
        for row, both in solved_rows(machine, truth, measured).items():
            rows.setdefault(row, []).append(counted(*both))
    judged = summaries({row: np.array(counts) for row, counts in rows.items()})
    assert [row for row, one in judged.items() if one["says"] == NARROW] == []
    assert {row: one["rms_z"] for row, one in judged.items() if one["rms_z"] > 3.0} == {}
