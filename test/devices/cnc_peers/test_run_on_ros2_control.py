"""A whole measurement through the ros2_control driver, with eight kinds of faults on the way."""

import numpy as np
import pytest
from joint_faults import SETTINGS, Faults, check_holds, check_lines, check_moves, in_turn
from peer_run import PeerRun, check_displacements, check_result, positions_of
from trajectory_peer import TrajectoryPeer

import stepdiag_ros.client  # noqa: F401
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.devices.cnc.simulated import SimulatedCnc
from stepdiag_ros.metrology.cell import DriveModel
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.units import NANOSECONDS

pytestmark = pytest.mark.timeout(600)
RESOLUTION = 1e-12
"""m: positions of the joints are floating-point numbers of some 10 mm."""


@pytest.fixture(scope="module")
def peer():
    return TrajectoryPeer()


@pytest.fixture(scope="module")
def faults(peer):
    return Faults(peer, in_turn())


@pytest.fixture(scope="module")
def finished(peer, faults, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    return PeerRun(folder, "ros2_control", SETTINGS, faults.mend, peer)


@pytest.fixture(scope="module")
def recorded(finished):
    return load_run(finished.bag)


def test_each_fault_holds_the_run_and_is_named(finished, faults):
    check_holds(finished, faults)


def test_no_move_is_lost_and_none_is_made_twice(finished, peer):
    check_moves(finished, peer)


def test_only_lines_that_were_broken_off_are_measured_again(finished, recorded):
    check_lines(finished, recorded)


def test_the_lines_agree_with_the_twin_to_within_their_uncertainty(recorded):
    check_displacements(recorded)


def test_the_bag_gives_the_same_result_and_it_is_right(recorded):
    check_result(recorded)


def test_all_stops_stand_where_the_simulated_controller_stands(finished, recorded):
    """The same commands, given to the simulated controller, end at the same actual positions."""
    stops = positions_of(finished.bag)
    assert len(stops) >= recorded.plan.stop_count
    machine = Machine("ideal", "YXZ", (-0.1,) * 3, (0.1,) * 3, 0.5, 2.0)
    now, here = 0, (0.0, 0.0, 0.0)
    simulated = SimulatedCnc(machine, DriveModel(lag_s=0.0), now, here)
    for target, position in stops:
        ways = zip("XYZ", here, target, strict=True)
        axes = "".join(axis for axis, start, end in ways if start != end)
        simulated.start_move(now, target, 0.1, axes)
        now += 10 * NANOSECONDS
        here = simulated.poll(now)[-1].position
        np.testing.assert_allclose(position, here, rtol=0.0, atol=RESOLUTION)
