"""Controllers of machine tools, as the CNC bridge needs them."""

from enum import IntEnum
from math import nan
from typing import NamedTuple, Protocol

from stepdiag_ros.metrology.refusal import Refusal

Point = tuple[float, float, float]

UNKNOWN_POINT: Point = (nan, nan, nan)
"""Value that a controller does not report."""


class MoveRefused(Refusal):
    """The controller does not begin a move; the text says why. Nothing has moved."""


class CncState(IntEnum):
    """State of a controller; the numbers are STATE_* of MachineState.msg."""

    READY = 1
    MOVING = 2
    STOPPED = 3
    FAULT = 4


def not_ready(state: CncState) -> MoveRefused:
    """Return the refusal of a move in a state in which none begins."""
    return MoveRefused(
        f"the machine is {state.name.lower()}, not ready", fault="not_ready", aspect="state"
    )


def still_moves() -> MoveRefused:
    """Return the refusal of a reset while the axes move."""
    return MoveRefused(
        "the axes still move: stop the machine first, then reset it", fault="busy", aspect="motion"
    )


class PositionSample(NamedTuple):
    """Actual position of the axes.

    Attributes:
        time: of the sample, ns.
        position: X Y Z as the controller calculates it, with its own compensation, m.
        motors: X Y Z of the motors or scales before any compensation of the controller, m; None
            where the controller does not report them, or does not compensate.
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


class Traits(NamedTuple):
    """Properties of a controller with its driver; NaN where it does not report them.

    A driver returns them by its property ``traits``, as read when the controller was opened.

    Attributes:
        resolution: step of the reported actual positions of X, Y, Z, m. The window in which an
            axis counts as in position is widened by it.
        acceleration: largest that the controller gives to X, Y, Z, m/s².
        feed_limit: largest speed that the controller gives to X, Y, Z, m/s.
        dead_man: the machine is braked at the latest this long after the last ``poll``,
            by a component nearer to it than this process, s.
        measured: actual positions come from encoders or scales; False where the controller
            reports what it has commanded, as one of stepping motors does.
        simulated: there is no machine; only then may ROS time be simulated or replayed.
    """

    resolution: Point = UNKNOWN_POINT
    acceleration: Point = UNKNOWN_POINT
    feed_limit: Point = UNKNOWN_POINT
    dead_man: float = nan
    measured: bool = True
    simulated: bool = False


def traits_of(device: "CncDevice") -> Traits:
    """Return the properties of a controller; all unknown if its driver reports none."""
    told = getattr(device, "traits", None)
    return told if isinstance(told, Traits) else Traits()


class CncDevice(Protocol):
    """A controller that makes straight moves, one at a time.

    Times are ns and never decrease; a time before the last one counts as the last one.

    A driver is a watchdog as well: the caller calls ``poll`` many times a second, and while
    the axes move, a ``poll`` that fails to come brakes them. The process of the driver may be the
    one that has died, so what brakes must be nearer to the machine: an agent beside the controller,
    a watchdog variable of the PLC, or the controller's own loss of connection. How long that takes
    is ``Traits.dead_man`` (0.5 s or less is expected); where a controller cannot do it, it is
    unknown, the bridge reports that, and the integrator must see to it (docs/safety.md).

    An emergency stop, a following error, power off and every other fault of the controller are
    ``CncState.FAULT`` with the fault in words as reason; a controller that is in order again, but
    was not reset by ``reset``, stays in that state.
    """

    @property
    def state(self) -> CncState:
        """State at the last time passed to the device."""
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
        """Brake to rest at once; STOPPED, with the reason, is reported when the axes stand."""
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
