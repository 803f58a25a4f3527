"""Simulated devices whose data a test meddles with on their way to the nodes."""

from stepdiag_ros.configuration import load_cell
from stepdiag_ros.devices import Surroundings
from stepdiag_ros.devices.cnc import PositionSample
from stepdiag_ros.devices.cnc import simulated as simulated_cnc
from stepdiag_ros.devices.interferometer import STATUS_BEAM_LOST
from stepdiag_ros.devices.interferometer import simulated as simulated_laser

meddling: set[str] = set()
"""What is done just now: mute, dim, lose, skip (one reading), hold (no positions)."""


class Meddled:
    """A device as it is, but for what it says when it is polled."""

    def __init__(self, device):
        self._device = device

    def __getattr__(self, name):
        return getattr(self._device, name)


class MeddledLaser(Meddled):
    def poll(self, time_ns):
        readings = self._device.poll(time_ns)
        if "mute" in meddling:
            return []
        if "dim" in meddling:
            readings = [reading._replace(signal_strength=0.05) for reading in readings]
        if "lose" in meddling:
            readings = [reading._replace(status=STATUS_BEAM_LOST) for reading in readings]
        if "skip" in meddling and len(readings) > 0:
            meddling.discard("skip")
            return readings[1:]
        return readings


class MeddledCnc(Meddled):
    def poll(self, time_ns):
        events = self._device.poll(time_ns)
        if "hold" in meddling:
            events = [event for event in events if not isinstance(event, PositionSample)]
        return events


def _meddled(kind, wrapper):
    def driver(settings, surroundings):
        cell = load_cell("demo")[0]
        opened = kind.from_settings(settings, Surroundings(surroundings.machine, cell))
        return lambda start: wrapper(opened(start))

    return driver


laser = _meddled(simulated_laser, MeddledLaser)
cnc = _meddled(simulated_cnc, MeddledCnc)
