"""Lines measured on the fly on a real LinuxCNC: its own trajectory planner, its servo's cycles."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import ON_THE_FLY
from domains import room_for_a_cell
from linuxcnc_watched import until_all_are_up
from patience import PATIENCE

from stepdiag_ros.bags.run import load_run
from stepdiag_ros.configuration import load_cell
from stepdiag_ros.devices.cnc.linuxcnc_instance import SERVO_PERIOD
from stepdiag_ros.evaluation.flown import flown_run
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.processes.cell import twin_cell
from stepdiag_ros.processes.following import FollowedRun
from stepdiag_ros.processes.graph import in_graph
from stepdiag_ros.processes.node_process import Processes

pytestmark = pytest.mark.timeout(2 * PATIENCE)

LATE = 0.7e-3
"""s by which the laser stamps its readings late."""


@pytest.fixture(scope="module")
def run(make_instance, tmp_path_factory):
    from stepdiag_ros.nodes.operator import OperatorNode

    instance = make_instance()
    folder = tmp_path_factory.mktemp("flown")
    plan, device, laser = (folder / name for name in ("plan.yaml", "linuxcnc.yaml", "laser.yaml"))
    plan.write_text(ON_THE_FLY)
    # A busy computer is no dead controller.
    device.write_text(f"socket: {instance.socket}\ndead_man_s: 2.0\nsilence_s: 20.0\n")
    laser.write_text(f"clock_offset_s: {LATE}\n")
    nodes = twin_cell(str(plan), "demo", "moving", folder, "linuxcnc", str(device))
    interferometer = next(node for node in nodes if node.name == "interferometer")
    interferometer.parameters["device_file"] = str(laser)
    with room_for_a_cell(), in_graph(), Processes(nodes, folder / "logs") as processes:
        operator = OperatorNode()
        until_all_are_up(operator, nodes)

        def check():
            assert not processes.ended(), processes.ended()

        # This computer may be too busy for a node.
        bag = FollowedRun(operator, lambda _: None, check, lambda *_: True).measure().bag
    instance.stop()
    return load_run(bag)


def test_positions_are_those_of_single_servo_cycles(run):
    times = np.array([time for time, _ in run.positions()])
    apart = np.diff(times) * 1e-9 / SERVO_PERIOD
    assert len(times) > 2000
    # The zero of the cycles is found better in the first seconds.
    assert np.percentile(np.abs(apart - np.rint(apart)), 99) < 0.01
    assert np.median(apart) == pytest.approx(2.0, abs=1e-3)


def test_nodes_agree_with_the_true_errors(run):
    cell = replace(load_cell("moving")[0], reading_noise=0.0)
    truth = {line.setup: line for line in simulate(run.plan, cell).lines}
    complete = [line for line in run.lines if line.complete]
    assert len(complete) == len(run.plan.lines)
    for line in complete:
        assert np.max(line.standard_uncertainty) < 20e-9
        if line.setup not in truth:
            continue  # measured again after a pause, with another alignment
        true = truth[line.setup]
        along = true.displacement if line.line == true.line else true.displacement[::-1]
        error = line.displacement - along
        # What the air adds is beside the readings; what a delay would add is far more.
        assert np.max(np.abs(error - error[0])) < 60e-9


def test_the_delay_is_that_of_the_laser_and_of_the_servo(run):
    # In one servo cycle the drives move, in the next one LinuxCNC knows where they are.
    true = LATE - SERVO_PERIOD
    delays = {one.axis: one for one in flown_run(run).delays}
    assert set(delays) == {"X", "Y", "Z"}
    for one in delays.values():
        assert one.standard_uncertainty < 20e-6
        assert abs(one.delay - true) < 4.0 * one.standard_uncertainty + 1e-6
