"""Drivers that put faults into what a device says, when the fault campaign asks for them.

Each stands around another driver of its kind. What is to go wrong is a JSON file that the campaign
replaces: ``{"number": 3, "kind": "spike", "until": 1234.5, "size": 2e-5}``; until when it lasts is
a time of the clock that never steps and is one for all processes of a computer, s.
Drivers of other packages are found by entry points: the campaign writes those of this module into a
folder that it puts on the nodes' path.
"""

import json
import os
import time
from pathlib import Path

from stepdiag_ros.configuration import load_cell
from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.cnc import PositionSample, StateChange, traits_of
from stepdiag_ros.devices.interferometer import STATUS_BEAM_LOST

ENTRY_POINTS = """[stepdiag_ros.cnc]
faulty = faulty_devices:cnc

[stepdiag_ros.interferometer]
faulty = faulty_devices:laser
"""
METADATA = "Metadata-Version: 2.1\nName: stepdiag-faulty-devices\nVersion: 0\n"
NAN = float("nan")
FORWARDED = (
    "update_position",
    "update_environment",
    "begin_run",
    "update_command",
    "update_answer",
    "close",
)


def install(folder):
    """Let nodes find these drivers: return what must be on their PYTHONPATH."""
    info = folder / "stepdiag_faulty_devices-0.dist-info"
    info.mkdir(parents=True, exist_ok=True)
    (info / "METADATA").write_text(METADATA)
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    return os.pathsep.join((str(folder), str(Path(__file__).parent)))


class Injector:
    """What is to go wrong just now."""

    def __init__(self, file):
        self._file = Path(file)
        self._seen = self._number = None
        self._until = 0.0
        self.kind, self.size = "", 0.0
        self.new = False

    def look(self):
        """Return the fault at work; ``new`` says that it has just begun."""
        self.new = False
        try:
            seen = self._file.stat().st_mtime_ns
            if seen != self._seen:
                self._seen = seen
                asked = json.loads(self._file.read_text())
                # A device that is opened again does not begin an old fault anew.
                if asked["number"] != self._number and time.monotonic() < asked["until"]:
                    self._number, self.new = asked["number"], True
                    self.kind, self.size = asked["kind"], asked["size"]
                    self._until = asked["until"]
        except FileNotFoundError:
            pass
        return self.kind if self.new or time.monotonic() < self._until else ""


class FaultyLaser:
    """Drop, freeze, spike, slip, beam and stall (``InterferometerDevice`` and ``FollowsRun``)."""

    def __init__(self, device, injector):
        self._device, self._injector = device, injector
        self._last = None
        self._slip, self._spikes = 0.0, 0
        for name in FORWARDED:
            setattr(self, name, getattr(device, name))

    def align(self, *given):
        """Set a new zero, with which a count is right again."""
        self._slip = 0.0
        self._device.align(*given)

    def poll(self, time_ns):
        """Return the readings, or what the fault at work makes of them."""
        kind = self._injector.look()
        if kind == "stall":
            return []
        readings = self._device.poll(time_ns)
        if self._injector.new:
            self._slip += self._injector.size if kind == "slip" else 0.0
            self._spikes = 3 if kind == "spike" else 0
        if kind == "drop":
            return []
        return [self._meddled(reading, kind) for reading in readings]

    def _meddled(self, reading, kind):
        if kind == "freeze" and self._last is not None:
            raw, compensated = self._last
            return reading._replace(raw_displacement=raw, compensated_displacement=compensated)
        self._last = reading.raw_displacement, reading.compensated_displacement
        if kind == "beam":
            return reading._replace(
                status=STATUS_BEAM_LOST, raw_displacement=NAN, compensated_displacement=NAN
            )
        off = self._slip
        if self._spikes:
            self._spikes -= 1
            off += self._injector.size
        if not off:
            return reading
        return reading._replace(
            raw_displacement=reading.raw_displacement + off,
            compensated_displacement=reading.compensated_displacement + off,
        )


class FaultyCnc:
    """Freeze and offset of the encoders, stall, error and e-stop (``CncDevice``).

    What the device inside has really done goes to a file, a line each: time of a clock that never
    steps and is one for all processes (s), what.
    """

    def __init__(self, device, injector, log):
        self._device, self._injector = device, injector
        self._log = Path(log)
        self._held = None

    @property
    def state(self):
        """That of the device."""
        return self._device.state

    @property
    def soft_limits(self):
        """Those of the device."""
        return self._device.soft_limits

    @property
    def traits(self):
        """Those of the device."""
        return traits_of(self._device)

    def start_move(self, time_ns, target, feed, axes):
        """Begin a move, and note it."""
        self._note(f"start {' '.join(f'{value:.9g}' for value in target)}")
        self._device.start_move(time_ns, target, feed, axes)

    def stop(self, time_ns, reason):
        """Stop, and note it."""
        self._note("stop")
        self._device.stop(time_ns, reason)

    def reset(self, time_ns):
        """Reset the device."""
        self._device.reset(time_ns)

    def close(self):
        """Let the device go."""
        self._device.close()

    def poll(self, time_ns):
        """Return what has happened, or what the fault at work makes of it."""
        kind = self._injector.look()
        if kind == "error":
            raise OSError("the controller does not answer (a fault that was asked for)")
        if kind == "estop" and self._injector.new and hasattr(self._device, "inject_fault"):
            self._device.inject_fault(time_ns, "emergency stop")
        if kind == "stall":
            # The device goes on, and is looked at; only what it says is late.
            return []
        told = []
        for event in self._device.poll(time_ns):
            if isinstance(event, StateChange):
                self._note(event.state.name)
                told.append(event)
            elif isinstance(event, PositionSample):
                told.append(self._meddled(event, kind))
        return told

    def _meddled(self, sample, kind):
        if kind == "freeze":
            self._held = self._held or sample.position
            return sample._replace(position=self._held)
        self._held = None
        if kind == "offset":
            x, y, z = sample.position
            return sample._replace(position=(x + self._injector.size, y, z))
        return sample

    def _note(self, text):
        with self._log.open("a", encoding="utf-8") as log:
            log.write(f"{time.monotonic():.6f} {text}\n")


def _inner(kind, settings, surroundings):
    cell = surroundings.cell
    if settings.get("cell"):
        cell = load_cell(settings["cell"])[0]
    inside = dict(settings.get("settings", {}))
    if "position_rate_hz" in settings:
        inside["position_rate_hz"] = settings["position_rate_hz"]
    return prepare(kind, settings["driver"], inside, Surroundings(surroundings.machine, cell))


def laser(settings, surroundings):
    """Return what opens a laser with faults; settings: driver, settings, cell, faults."""
    opened = _inner("interferometer", settings, surroundings)
    return lambda start: FaultyLaser(opened(start), Injector(settings["faults"]))


def cnc(settings, surroundings):
    """Return what opens a controller with faults; settings: as for the laser, and log."""
    opened = _inner("cnc", settings, surroundings)
    return lambda start: FaultyCnc(opened(start), Injector(settings["faults"]), settings["log"])
