"""Plans and simulated cells for tests: the one maker of each."""

from dataclasses import replace

import numpy as np

from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.forward import ErrorCurves
from stepdiag_ros.metrology.geometry import BODY_DIAGONALS
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.plausible import NOTHING


def by_noise_alone(measurement):
    """Return lines of a machine and a laser of which is known that nothing acts but noise."""
    return replace(measurement, plausible=NOTHING)


def make_plan(
    blocks=6,
    step=(0.01, 0.01, 0.01),
    origin=(0.0, 0.0, 0.0),
    diagonals=BODY_DIAGONALS,
    linear=("x", "y", "z"),
    orders=("XYZ",),
    repeats=1,
    directions=("forward",),
    offset=(0.0, 0.0, 0.0),
):
    groups = []
    if linear:
        groups.append({"kind": "linear", "names": list(linear), "offset_m": list(offset)})
    if diagonals:
        groups.append({"kind": "step_diagonal", "names": list(diagonals), "orders": list(orders)})
    return Plan.from_mapping(
        {
            "step_m": list(step),
            "origin_m": list(origin),
            "blocks": blocks,
            "repeats": repeats,
            "directions": list(directions),
            "feed_m_per_s": 0.05,
            "lines": groups,
        },
        "test plan",
    )


def make_cell(
    seed=3,
    chain="YXZ",
    low=(0.0, 0.0, 0.0),
    high=(0.06, 0.06, 0.06),
    noise=0.1e-6,
    tilt=150e-6,
    mirror=0.0,
    rotation=0.0,
    size=1e-6,
    squareness=(30e-6, -20e-6, 25e-6),
    lines=None,
    held=0.1,
    positioning=None,
    **more,
):
    """Return a cell; beyond its travel the curves are held as at its ends, over ``held`` metres.

    Straightness errors are as large as ``size``, positioning errors twice as large if nothing else
    is said. All else that a cell file has is given by its key (``weather``, ``effects``).
    """
    made = SimulatedCell.from_mapping(
        {
            "seed": seed,
            "chain": chain,
            "errors": {
                "travel_low_m": list(low),
                "travel_high_m": list(high),
                "positioning_m": 2 * size if positioning is None else positioning,
                "straightness_m": size,
                "rotation_rad": rotation,
                "squareness_rad": dict(zip(("C0Y", "B0Z", "A0Z"), squareness, strict=True)),
            },
            "misalignment": {
                "beam_sigma_rad": tilt,
                "mirror_sigma_rad": mirror,
                "lines": lines or {},
            },
            "reading_noise_m": noise,
            **more,
        },
        "test cell",
    )
    nodes = [np.array([axis[0] - held, *axis, axis[-1] + held]) for axis in made.errors.nodes]
    values = [np.vstack([axis[:1], axis, axis[-1:]]) for axis in made.errors.values]
    return replace(made, errors=ErrorCurves(tuple(nodes), tuple(values))) if held else made


ON_THE_FLY = """
name: two lines on the fly
step_m: [0.02, 0.015, 0.01]
blocks: 3
feed_m_per_s: 0.06
pause_for_setup: false
measurement: on_the_fly
lines:
  - {kind: linear, names: [x]}
  - {kind: step_diagonal, names: [ppp], directions: [forward, backward]}
sampling: {dwell_s: 0.3, settle_s: 0.1, window_s: 0.2}
"""


def rounded(run, step):
    """Return a run whose readings were noted in steps of so many m."""
    lines = tuple(
        replace(line, displacement=np.round(line.displacement / step) * step) for line in run.lines
    )
    return replace(run, lines=lines)
