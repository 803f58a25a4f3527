"""The driver of LinuxCNC, polled as the bridge does it."""

import errno
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

import numpy as np
from patience import PATIENCE

from stepdiag_ros.configuration import load_machine
from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.cnc import CncEvent, CncState, MoveRefused, PositionSample, StateChange
from stepdiag_ros.devices.cnc.linuxcnc import LinuxCnc
from stepdiag_ros.devices.cnc.linuxcnc_instance import LinuxCncInstance

T = TypeVar("T")
DEAD_MAN = 2.0
"""Seconds; the longest that the driver may be given."""
SLOW = 0.02
"""Feed, m/s, of moves that something is to happen to, which a busy computer delays."""


class Watched:
    """A driver that is polled as the bridge does it, and what it has told.

    Args:
        path: of the agent's socket.
        patience: s in which the agent may see that the client before has gone.
        silence: s without a word from the agent, after which it counts as dead.
    """

    def __init__(self, path: Path, patience: float = 0.0, silence: float = 20.0) -> None:
        settings = {"socket": str(path), "dead_man_s": DEAD_MAN, "silence_s": silence}
        make = prepare("cnc", "linuxcnc", settings, Surroundings(load_machine("demo")[0]))
        self.events: list[CncEvent] = []
        end = time.monotonic() + patience
        while True:
            try:
                self.driver: LinuxCnc = make(0)
                return
            except OSError as error:
                if error.errno != errno.EBUSY or time.monotonic() > end:
                    raise
            time.sleep(0.02)

    def until(self, condition: Callable[[], bool], limit: float = PATIENCE) -> "Watched":
        end = time.monotonic() + limit
        while True:
            self.events += self.driver.poll(time.time_ns())
            if condition():
                return self
            assert time.monotonic() < end, f"not in {limit} s; {self.states()[-3:]}"
            time.sleep(0.002)

    def wait(self, seconds: float) -> "Watched":
        end = time.monotonic() + seconds
        return self.until(lambda: time.monotonic() > end)

    def meanwhile(self, action: Callable[[], T]) -> T:
        """Return what an action returns, which may take longer than the dead-man waits."""
        with ThreadPoolExecutor() as beside:
            done = beside.submit(action)
            self.until(done.done)
        return done.result()

    def until_moved(self) -> "Watched":
        """Wait until the axes have moved by 2 mm: a busy computer begins late."""
        begun = np.array(self.position())
        return self.until(lambda: np.abs(self.samples()[-1].position - begun).max() > 2e-3)

    def until_state(self, *states: CncState) -> StateChange:
        """Wait until it is in one of these states, from which it does not come to another."""

        def has_ended() -> bool:
            told = self.states()[-1:]
            return self.driver.state in states or any(e.state is CncState.FAULT for e in told)

        self.until(has_ended)
        assert self.driver.state in states, self.states()[-3:]
        return self.states()[-1]

    def states(self) -> list[StateChange]:
        return [event for event in self.events if isinstance(event, StateChange)]

    def samples(self) -> list[PositionSample]:
        return [event for event in self.events if isinstance(event, PositionSample)]

    def reset(self) -> None:
        """Reset it as the sequencer does: again, until the axes stand."""
        end = time.monotonic() + PATIENCE
        while True:
            try:
                self.driver.reset(time.time_ns())
                return
            except ValueError as error:
                assert time.monotonic() < end, error
                self.wait(0.02)

    def go(self, *millimetres: float, feed: float = 0.1, axes: str = "X") -> None:
        x, y, z = (1e-3 * value for value in millimetres)
        end = time.monotonic() + PATIENCE
        while True:
            try:
                return self.driver.start_move(time.time_ns(), (x, y, z), feed, axes)
            except MoveRefused as error:
                # A busy computer has let this process wait for longer than the agent does.
                if not str(error).startswith("the client was silent") or time.monotonic() > end:
                    raise
            self.reset()

    def position(self) -> tuple[float, float, float]:
        told = len(self.samples())
        return self.until(lambda: len(self.samples()) > told).samples()[-1].position


def at_rest(instance: LinuxCncInstance) -> float:
    """Return where X stands, mm, by LinuxCNC's own word; waits until it does.

    An axis that is somewhere twice is not at rest on a busy computer, where LinuxCNC itself may
    pause in mid-move: it must not be commanded to move either.
    """
    end = time.monotonic() + PATIENCE
    places = [math.nan, math.inf]
    while places[-1] != places[-2] or velocity(instance) != 0.0:
        assert time.monotonic() < end, "X does not come to rest"
        time.sleep(0.1)
        places.append(float(instance.run("halcmd", "getp", "joint.0.motor-pos-fb")))
    return places[-1]


def velocity(instance: LinuxCncInstance) -> float:
    """Return how fast LinuxCNC commands the axes to move just now, mm/s."""
    return float(instance.run("halcmd", "getp", "motion.current-vel"))


def until_all_are_up(operator, nodes) -> None:
    """Wait until every node of a cell answers and is well."""
    peers = operator.watch.peers
    assert operator.spin_until(
        lambda: len(peers) == len(nodes) and not any(p.faulty for p in peers.values()), PATIENCE
    ), {peer.role: peer.text for peer in peers.values()}
