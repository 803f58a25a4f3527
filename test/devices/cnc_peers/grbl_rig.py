"""A driver of Grbl in front of the peer, as tests use it."""

import time

from cnc_conformance import Operator, Rig
from grbl_peer import GrblPeer

from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.metrology.machine import Machine

MACHINE = Machine("grbl", "XYZ", (-0.3, -0.3, -0.2), (0.3, 0.3, 0.2), 0.3, 2.0, position_hold_s=0.1)


def opener(url, machine=MACHINE, **changed):
    """Return what opens a controller at a URL."""
    settings = {
        "connection": {"url": url},
        "report_rate_hz": 100,
        "position_rate_hz": 100,
        "without_homing": True,
        "silence_s": 1.0,
        "start_limit_s": 2.0,
    } | changed
    prepared = prepare("cnc", "grbl", settings, Surroundings(machine))
    return lambda: prepared(time.time_ns())


def grbl_rig(peer, machine=MACHINE, **changed):
    # A step is 1 µm.
    return Rig(machine, opener(peer.url, machine, **changed), time.time_ns, time.sleep, 0.05, 1e-6)


def operator_of(peer, machine=MACHINE, **changed):
    return Operator(grbl_rig(peer, machine, **changed))


__all__ = ["MACHINE", "GrblPeer", "grbl_rig", "opener", "operator_of"]
