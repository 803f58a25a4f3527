"""Controllers of machine tools, as the CNC bridge needs them."""

from enum import IntEnum
from typing import NamedTuple, Protocol

Point = tuple[float, float, float]


class MoveRefused(ValueError):
    """The controller does not begin a move; the text says why. Nothing has moved."""


class CncState(IntEnum):
    """State of a controller; the numbers are STATE_* of MachineState.msg."""

    READY = 1
    MOVING = 2
    STOPPED = 3
    FAULT = 4


class PositionSample(NamedTuple):
    """Actual position of the axes.

    Attributes:
        time: of the sample, ns.
        position: X Y Z as the controller reckons it, with its own compensation, m.
        motors: X Y Z of the motors or scales before any compensation of the controller, m; None
            where the controller does not tell, or does not compensate.
    """

    time: int
    position: Point
    motors: Point | None = None


class StateChange(NamedTuple):
    """The controller is in another state, or a move has ended.

    A move has ended in position when the state becomes READY from MOVING: the actual position has
    then stayed within the machine's window of the target for the hold time.

    Attributes:
        time: of the change, ns.
        state: from then on.
        position: actual position at that time, m.
        reason: why it stopped or what is faulty; empty otherwise.
    """

    time: int
    state: CncState
    position: Point
    reason: str


CncEvent = PositionSample | StateChange


class CncDevice(Protocol):
    """A controller that makes straight moves, one at a time.

    Times are ns and never decrease; a time before the last one counts as the last one.
    """

    @property
    def state(self) -> CncState:
        """State at the last time that the device was told."""
        ...

    @property
    def soft_limits(self) -> tuple[Point, Point]:
        """Lower and upper soft limits of X, Y, Z, m."""
        ...

    def start_move(self, time_ns: int, target: Point, feed: float, axes: str) -> None:
        """Begin a straight move: all its axes start together and arrive together.

        Args:
            time_ns: now.
            target: X Y Z after the move, m. A target that is the present position is a move of no
                length.
            feed: along the path, m/s; no axis is faster.
            axes: that may move, such as X or XYZ; empty for a move of no length.

        Raises:
            MoveRefused: the controller is not ready, another axis would move, or a limit forbids
                the move.
        """
        ...

    def stop(self, time_ns: int, reason: str) -> None:
        """Brake to rest at once; STOPPED, with the reason, is told when the axes stand."""
        ...

    def reset(self, time_ns: int) -> None:
        """Become READY again after a stop or a fault whose cause is gone.

        Raises:
            MoveRefused: the axes still move.
        """
        ...

    def poll(self, time_ns: int) -> list[CncEvent]:
        """Return what has happened since the last poll, in order of time."""
        ...

    def close(self) -> None:
        """Let the controller go."""
        ...
