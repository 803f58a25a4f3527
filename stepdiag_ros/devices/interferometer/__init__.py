"""Laser interferometers, as their node needs them."""

from typing import Protocol, runtime_checkable

from stepdiag_ros.metrology.measurement import Environment, Reading, StopCommand
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.samples import SampleBlock

Point = tuple[float, float, float]

STATUS_OK = 0
STATUS_LOW_SIGNAL = 1
STATUS_BEAM_LOST = 2
STATUS_OVERSPEED = 3
STATUS_FAULT = 4
STATUS_COUNT_ERROR = 5


class InterferometerDevice(Protocol):
    """An interferometer that streams readings.

    Times are ns and never decrease; a time before the last one counts as the last one.
    """

    def align(self, time_ns: int, setup: str, line: str, step: Point, start: Point) -> None:
        """Say that beam and mirror stand for a setup, and set the zero.

        Nothing happens if they stand for this setup already and its zero is not lost.

        Args:
            time_ns: now.
            setup: identity of the alignment.
            line: name of the line, x y z or a body diagonal.
            step: size of one block along X, Y, Z, m.
            start: machine coordinates of the first stop of the setup's first line, m.
        """
        ...

    def update_position(self, time_ns: int, position: Point) -> None:
        """Take the actual position of the axes (m) at a time; in order of time."""
        ...

    def update_environment(self, time_ns: int, environment: Environment) -> None:
        """Take what the weather sensors say at a time; in order of time."""
        ...

    def poll(self, time_ns: int) -> list[Reading]:
        """Return the readings since the last poll, in order."""
        ...

    def close(self) -> None:
        """Let the instrument go."""
        ...


@runtime_checkable
class FollowsRun(Protocol):
    """An ``InterferometerDevice`` that also receives the commands of the run.

    A real one reads what is there; a simulated one must know what the machine is asked to do.
    """

    def begin_run(self, plan: Plan, start_ns: int) -> None:
        """Say which plan is to be measured, and when the run begins.

        Raises:
            ValueError: the device cannot be used with this plan; says why.
        """
        ...

    def update_command(self, command: StopCommand, ends_at_stop: bool) -> None:
        """Take a command to the machine; one to travel only (``ends_at_stop`` False) is for stop 0.

        A command that was taken before, or is older, is left out.
        """
        ...

    def update_answer(self, command_id: int, time_ns: int, in_position: bool) -> None:
        """Take the controller's last word on a command: in position at that time, or failed."""
        ...


@runtime_checkable
class StreamsSamples(Protocol):
    """An interferometer that hands over arrays, beside all of ``InterferometerDevice``.

    For one that samples faster than about 1 kHz: an object for each sample would keep the computer
    from its work. Its node asks it either for readings (``poll``) or for samples, never for both.
    """

    @property
    def sample_rate(self) -> float:
        """Samples in a second, Hz."""
        ...

    def poll_samples(self, time_ns: int) -> list[SampleBlock]:
        """Return the samples since the last poll, in order, none left out.

        What would take long may come in several turns. At most ``samples.MOST_IN_BLOCK`` to a
        block. The stamps are those of the instrument's own grid, even from block to block, not the
        times at which blocks happen to come in.
        """
        ...
