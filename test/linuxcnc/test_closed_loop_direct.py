"""The closed loop on a real LinuxCNC without any node: driver, twin, solver, tables, restart.

As ``test_closed_loop``, but the laser's readings are computed from where the motors stand, so that
a busy computer only makes it slower.
"""

from dataclasses import replace

import numpy as np
from closed_loop import DIAGONALS, PLAN, twin
from linuxcnc_watched import Watched

from stepdiag_ros.compensation import control
from stepdiag_ros.compensation.control import Layout, checked_settings
from stepdiag_ros.compensation.generic import map_from_text
from stepdiag_ros.compensation.identified import Origin, identify
from stepdiag_ros.configuration import cell_from_text, plan_from_text
from stepdiag_ros.devices.cnc import CncState
from stepdiag_ros.metrology.forward import reading, tool_point
from stepdiag_ros.metrology.plan import LINEAR
from stepdiag_ros.metrology.simulation import planned_run
from stepdiag_ros.metrology.solvers.least_squares import solve_least_squares
from stepdiag_ros.metrology.target_correction import target_for

NOISE = 2e-9
"""m: of the mean of the readings at a stop."""


def stand(instance, lines, error_map=None):
    """Drive to all stops of some lines; return where the motors stood, line by line."""
    watched = Watched(instance.socket)
    watched.reset()
    stood = []
    for line in lines:
        sent = line.target if error_map is None else target_for(error_map, line.target)
        places = []
        for target in sent:
            watched.go(*(1e3 * target), feed=0.2, axes="XYZ")
            watched.until_state(CncState.READY)
            watched.wait(0.12)
            places.append(np.mean([one.motors for one in watched.samples()[-5:]], axis=0))
        watched.events.clear()
        stood.append(np.array(places))
    watched.driver.close()
    return stood


def read(plan, cell, lines, stood):
    """Return what the laser says of motors that stood there."""
    noise = np.random.default_rng(1)
    made = []
    for line, motors in zip(lines, stood, strict=True):
        start = tuple(line.target[0])
        alignment = cell.alignment(line.setup, line.line.name, plan.volume.step, start)
        found = reading(motors, alignment, cell.errors, cell.chain)
        found = found + NOISE * noise.standard_normal(len(found))
        spread = np.full(len(found), NOISE)
        made.append(replace(line, displacement=found - found[0], standard_uncertainty=spread))
    return tuple(made)


def true_errors(cell, lines, stood):
    return [
        tool_point(motors, cell.errors, cell.chain)[0] - line.target
        for line, motors in zip(lines, stood, strict=True)
    ]


def positioning(cell, lines, stood):
    errors = zip(lines, true_errors(cell, lines, stood), strict=True)
    return np.array(
        [np.ptp(one[:, "xyz".index(line.line.name)]) for line, one in errors if is_linear(line)]
    )


def volume(cell, lines, stood):
    """Return the rms true error, the whole turned and shifted as a workpiece may be."""
    errors = np.concatenate(true_errors(cell, lines, stood))
    places = np.concatenate([line.target for line in lines])
    turns = [np.cross(axis, places) for axis in np.eye(3)]
    shifts = [np.tile(axis, (len(places), 1)) for axis in np.eye(3)]
    rigid = np.stack([part.ravel() for part in (*turns, *shifts)], axis=1)
    weights, *_ = np.linalg.lstsq(rigid, errors.ravel(), rcond=None)
    left = (errors.ravel() - rigid @ weights).reshape(-1, 3)
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


def is_linear(line):
    return line.line.kind == LINEAR


def test_tables_and_corrected_targets_make_a_real_controller_better(
    make_instance, tmp_path, record_property
):
    plan = plan_from_text(PLAN.replace("DIAGONALS\n", DIAGONALS), "plan")
    cell = cell_from_text(twin(), "twin")
    planned = planned_run(plan, cell)
    lines = planned.lines
    instance = make_instance()
    before = stand(instance, lines)
    run = replace(planned, lines=read(plan, cell, lines, before))
    identified = identify(solve_least_squares(run), cell.chain, run, Origin(file="direct"))
    text = control("generic").write(identified, Layout())["volumetric_map.json"]
    corrected = stand(instance, lines, map_from_text(text, "map").error_map)
    instance.stop()
    found = control("linuxcnc")
    layout = Layout(settings=checked_settings(found, {}))
    for name, table in found.write(identified, layout).items():
        (tmp_path / name).write_text(table)
    tables = {letter: tmp_path / f"{letter.lower()}.comp" for letter in "XYZ"}
    restarted = make_instance(tables=tables)
    linear = [line for line in lines if is_linear(line)]
    after = stand(restarted, linear)
    restarted.stop()

    was, now = positioning(cell, lines, before), positioning(cell, linear, after)
    rms = volume(cell, lines, before), volume(cell, lines, corrected)
    record_property("positioning_um", [np.round(1e6 * was, 3), np.round(1e6 * now, 4)])
    record_property("volume_rms_um", [1e6 * value for value in rms])
    assert min(was) > 8e-6 and np.all(was / now >= 50.0), (was, now)
    assert rms[0] > 3e-6 and rms[0] / rms[1] >= 20.0, rms
