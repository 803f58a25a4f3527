"""Every driver of a controller does what the bridge relies on: one list of checks for all."""

import pytest
from cnc_conformance import CHECKS, Rig
from grbl_rig import GrblPeer, grbl_rig
from opcua_rig import OpcUaPeer, opcua_rig
from trajectory_rig import TrajectoryRig

from stepdiag_ros.devices.cnc.simulated import SimulatedCnc
from stepdiag_ros.metrology.cell import DriveModel
from stepdiag_ros.metrology.machine import Machine

START = 1_700_000_000_000_000_000


@pytest.fixture
def simulated():
    machine = Machine("m", "YXZ", (-0.1, -0.1, -0.1), (0.5, 0.4, 0.3), 0.5, 2.0)
    clock = [START]

    def sleep(seconds):
        clock[0] += round(seconds * 1e9)

    def opened():
        return SimulatedCnc(machine, DriveModel(), clock[0])

    return Rig(machine, opened, lambda: clock[0], sleep)


@pytest.fixture
def grbl():
    peer = GrblPeer()
    yield grbl_rig(peer)
    peer.close()


@pytest.fixture(scope="module")
def plc():
    peer = OpcUaPeer()
    yield peer
    peer.close()


@pytest.fixture
def opcua(plc):
    return opcua_rig(plc)


@pytest.fixture
def ros2_control():
    return TrajectoryRig()


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__[6:])
@pytest.mark.parametrize("driver", ["simulated", "grbl", "opcua", "ros2_control"])
def test_a_driver_keeps_to(check, driver, request):
    check(request.getfixturevalue(driver))
