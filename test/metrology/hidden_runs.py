"""Simulated runs in which effects of the catalogue, or shapes that have no name, are hidden."""

from dataclasses import replace

import numpy as np
from cells_for_tests import make_cell, make_plan

from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.simulation import simulate

NOISE = 0.1e-6
BOTH = ("forward", "backward")


def hidden_run(*effects, seed=5, machine=None, shape=None, plan=None, weather=None, **changed):
    """Return a simulated run with hidden effects, and perhaps a shape that has no name.

    ``weather`` has the keys of a cell file; without it air and material stay as they are.
    """
    usual = {"blocks": 7, "repeats": 2, "directions": BOTH, "orders": ("XYZ", "YZX")}
    plan = plan or make_plan(**{**usual, **changed})
    cell = make_cell(seed=machine or seed, noise=NOISE, weather=weather or {})
    run = simulate(plan, cell, seed)
    stops = stops_of(run)
    added = sum((effect.readings(stops) for effect in effects), np.zeros(len(stops.time)))
    if shape is not None:
        added = added + shape(stops)
    return with_change(run, added)


def with_change(run, added):
    """Return a run with something added to its readings, m, in the order of its stops."""
    parts = np.split(added, np.cumsum([len(line.time) for line in run.lines])[:-1])
    lines = tuple(
        replace(line, displacement=line.displacement + part)
        for line, part in zip(run.lines, parts, strict=True)
    )
    return replace(run, lines=lines)
