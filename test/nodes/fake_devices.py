"""Devices that do as the test says: they fail on command, and note what was asked of them."""

from stepdiag_ros.devices.cnc import CncState, MoveRefused, PositionSample, StateChange
from stepdiag_ros.metrology.measurement import Environment, Reading

asked: list[str] = []
"""What was asked of the devices, in order."""
broken: dict[str, Exception] = {}
"""What fails, and how: ``open``, or a method."""


def forget():
    asked.clear()
    broken.clear()


def ask(what):
    asked.append(what)
    if what in broken:
        raise broken[what]


class FakeDevice:
    def __init__(self, start):
        self.start = start
        ask("open")

    def close(self):
        ask("close")


class FakeCnc(FakeDevice):
    """A controller that moves for ever, until it is stopped; it then brakes until told not to."""

    braking = False

    def __init__(self, start):
        super().__init__(start)
        self.state = CncState.READY
        self.soft_limits = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
        self.events = []
        self.stopped_because = ""

    def start_move(self, time_ns, *_):
        ask("start_move")
        self.change(time_ns, CncState.MOVING)

    def stop(self, _, reason):
        ask("stop")
        self.stopped_because = self.stopped_because or reason

    def reset(self, time_ns):
        ask("reset")
        if self.state is CncState.MOVING:
            raise MoveRefused("the axes still move")
        self.stopped_because = ""
        self.change(time_ns, CncState.READY)

    def poll(self, time_ns):
        ask("poll")
        if self.stopped_because and not FakeCnc.braking and self.state is not CncState.STOPPED:
            self.change(time_ns, CncState.STOPPED, self.stopped_because)
        events, self.events = self.events, []
        return [*events, PositionSample(time_ns, (0.0, 0.0, 0.0))]

    def change(self, time_ns, state, reason=""):
        self.state = state
        self.events.append(StateChange(time_ns, state, (0.0, 0.0, 0.0), reason))


class FakeLaser(FakeDevice):
    sequence = 0

    def align(self, _, setup, *__):
        ask(f"align {setup}")

    def update_position(self, *_):
        ask("update_position")

    def update_environment(self, *_):
        ask("update_environment")

    def poll(self, time_ns):
        ask("poll")
        FakeLaser.sequence += 1
        return [Reading(time_ns, FakeLaser.sequence, 0.0, 0.0, 1.0, 0, Environment())]


def cnc(*_):
    return FakeCnc


def laser(*_):
    return FakeLaser
