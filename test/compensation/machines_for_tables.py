"""A simulated machine whose errors were measured, for the tests of compensation."""

from functools import cache

import numpy as np
from cells_for_tests import make_cell

from stepdiag_ros.compensation.identified import Identified, Origin, identify
from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.forward import tool_point
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers.least_squares import solve_least_squares

STEP = (0.02, 0.015, 0.01)
BLOCKS = 10
ORIGIN = (-0.05, 0.0, -0.08)
ORIGIN_OF = Origin(file="run.mcap", sha256="0" * 64, run_id="run-1", method="least_squares")


def plan_of(directions=("forward", "backward")) -> Plan:
    diagonals = ["ppp", "npp", "pnp", "ppn"]
    return Plan.from_mapping(
        {
            "step_m": list(STEP),
            "origin_m": list(ORIGIN),
            "blocks": BLOCKS,
            "repeats": 2,
            "overrun_m": 0.002,
            "directions": list(directions),
            "feed_m_per_s": 0.05,
            "lines": [
                {"kind": "linear", "names": ["x", "y", "z"]},
                {"kind": "step_diagonal", "names": diagonals, "orders": ["XYZ"]},
            ],
        },
        "plan of the tests of compensation",
    )


def cell_of(noise=5e-9, lost_motion=0.0) -> SimulatedCell:
    high = [o + BLOCKS * s for o, s in zip(ORIGIN, STEP, strict=True)]
    effects = []
    if lost_motion:
        effects = [
            {"effect": "backlash", "setting": {"axis": "X"}, "sizes": {"lost_motion": lost_motion}}
        ]
    return make_cell(
        seed=11,
        low=ORIGIN,
        high=high,
        size=3e-6,
        squareness=(60e-6, -40e-6, 50e-6),
        tilt=50e-6,
        mirror=5e-6,
        noise=noise,
        effects=effects,
        held=0.0,
    )


@cache
def measured(noise=5e-9, lost_motion=0.0) -> tuple[SimulatedCell, Identified]:
    """Return a machine and what a measurement of it says."""
    cell = cell_of(noise, lost_motion)
    run = simulate(plan_of(), cell, seed=3)
    return cell, identify(solve_least_squares(run), cell.chain, run, ORIGIN_OF)


def tool_errors(cell: SimulatedCell, wanted, sent):
    """Return where the tool is less where it should be, whole volume turned and shifted as best.

    How a workpiece lies in the machine is no error of the machine.
    """
    actual, _ = tool_point(sent, cell.errors, cell.chain)
    apart = actual - wanted
    turns = [np.cross(axis, wanted) for axis in np.eye(3)]
    shifts = [np.tile(axis, (len(wanted), 1)) for axis in np.eye(3)]
    rigid = np.stack([part.ravel() for part in (*turns, *shifts)], axis=1)
    weights, *_ = np.linalg.lstsq(rigid, apart.ravel(), rcond=None)
    return apart - (rigid @ weights).reshape(apart.shape)


def along(identified: Identified, axis: int, fine: int = 1):
    """Return places along an axis at the first corner: the nodes, and more between them."""
    nodes = identified.error_map.nodes[axis]
    count = (len(nodes) - 1) * fine + 1
    places = np.tile(identified.error_map.low, (count, 1))
    places[:, axis] = np.interp(np.arange(count) / fine, np.arange(len(nodes)), nodes)
    return places


def positioning(cell, places, sent, axis):
    """Return the range of the true positioning error along an axis, m."""
    actual, _ = tool_point(sent, cell.errors, cell.chain)
    error = actual[:, axis] - places[:, axis]
    return float(np.ptp(error))
